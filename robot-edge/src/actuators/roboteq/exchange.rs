//! One command and what is said to it.

use std::time::Duration;

use super::wire::{Answer, Channel, Command, Line, Power, Reply};
use measurement::time::Monotonic;

/// Longest wait for the end of an answer. The longest exchange (`?E`) is 3 + 9 characters of 1.04 ms, the controller looks
/// every 16 ms (manual, p. 156), and an adapter on USB may hold characters back for 16 ms.
pub(super) const REPLY_TIMEOUT: Duration = Duration::from_millis(100);

/// A command that waits for its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exchange {
    pub(super) command: Command,
    sent: Monotonic,
    /// The command before it whose echo may still come first, as it was interrupted or its answer is late.
    late_echo: Option<Command>,
    /// That command's acknowledgement may still come.
    has_late_answer: bool,
    echoes: usize,
    acknowledged: usize,
    values: [u8; 2],
    count: usize,
}

/// How it stands with a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// It still waits.
    Waiting,
    /// It was done; values where it asked for some.
    Done([u8; 2]),
    /// It was not done.
    Refused,
    /// Something else was received than was sent: nobody knows what was done.
    Garbled,
}

impl Exchange {
    pub(super) const fn new(command: Command, now: Monotonic) -> Self {
        Self {
            command,
            sent: now,
            late_echo: None,
            has_late_answer: false,
            echoes: 0,
            acknowledged: 0,
            values: [0; 2],
            count: 0,
        }
    }

    /// Both motors are told zero, whatever still waits for its answer: that comes first, and counts for nothing.
    pub(super) fn stop_both(interrupted: Option<Self>, now: Monotonic) -> Self {
        Self {
            late_echo: interrupted.filter(Self::is_silent).map(|last| last.command),
            has_late_answer: interrupted
                .is_some_and(|last| last.command.answer() == Answer::Acknowledgement),
            ..Self::new(Command::StopBoth, now)
        }
    }

    /// The same behind `silent`, whose echo had not come in time: late, it is no sign of a line that garbles.
    pub(super) fn after_silence(mut self, silent: Option<Command>) -> Self {
        let is_own = |late: &Command| late.line() == self.own_line();
        self.late_echo = self.late_echo.or(silent.filter(|late| !is_own(late)));
        self
    }

    /// Whether nothing at all has come.
    pub(super) const fn is_silent(&self) -> bool {
        self.echoes == 0
    }

    /// When it was said.
    pub(super) const fn sent(&self) -> Monotonic {
        self.sent
    }

    pub(super) fn deadline(&self) -> Monotonic {
        self.sent + REPLY_TIMEOUT
    }

    /// Only what follows the command's own echo is its answer: a late answer to another one is not.
    pub(super) fn take(&mut self, reply: Reply) -> Outcome {
        match reply {
            Reply::Echo(line) => self.take_echo(line),
            Reply::Acknowledged | Reply::Refused if self.has_late_answer => {
                self.has_late_answer = false;
                Outcome::Waiting
            }
            Reply::Refused if self.echoes > self.acknowledged => Outcome::Refused,
            Reply::Acknowledged if self.echoes > self.acknowledged => match self.command.answer() {
                Answer::Acknowledgement => {
                    self.acknowledged += 1;
                    if self.acknowledged < self.lines() {
                        Outcome::Waiting
                    } else {
                        Outcome::Done(self.values)
                    }
                }
                Answer::Values(_) => Outcome::Waiting,
            },
            Reply::Value(value) if self.echoes > 0 => self.take_value(value),
            Reply::Refused
            | Reply::Acknowledged
            | Reply::Value(_)
            | Reply::WatchdogTripped
            | Reply::Prompt
            | Reply::Noise => Outcome::Waiting,
        }
    }

    fn take_echo(&mut self, line: Line) -> Outcome {
        if self
            .late_echo
            .take()
            .is_some_and(|late| late.line() == line)
        {
            return Outcome::Waiting;
        }
        if line != self.own_line() {
            return Outcome::Garbled;
        }
        self.echoes = self.lines().min(self.echoes + 1);
        Outcome::Waiting
    }

    /// What is echoed next.
    fn own_line(&self) -> Line {
        let own = match (self.command, self.echoes) {
            (Command::StopBoth, 0) => Command::Run(Channel::One, Power::ZERO),
            (Command::StopBoth, _) => Command::Run(Channel::Two, Power::ZERO),
            (command, _) => command,
        };
        own.line()
    }

    /// Lines that it is sent in, each of which has an echo and an acknowledgement of its own.
    const fn lines(&self) -> usize {
        match self.command {
            Command::StopBoth => 2,
            Command::Run(..) | Command::Read(_) | Command::Voltages | Command::EncoderSpeeds => 1,
        }
    }

    fn take_value(&mut self, value: u8) -> Outcome {
        let Answer::Values(wanted) = self.command.answer() else {
            return Outcome::Waiting;
        };
        if let Some(slot) = self.values.get_mut(self.count) {
            *slot = value;
        }
        self.count += 1;
        if self.count < wanted {
            Outcome::Waiting
        } else {
            Outcome::Done(self.values)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::wire::{Parameter, ReplyParser};
    use super::*;

    const RUN: Command = Command::Run(Channel::One, Power::ZERO);

    fn receive(command: Command, bytes: &[u8]) -> Outcome {
        outcome(Exchange::new(command, Monotonic::from_nanos(0)), bytes)
    }

    fn outcome(mut exchange: Exchange, bytes: &[u8]) -> Outcome {
        let mut parser = ReplyParser::default();
        bytes
            .iter()
            .filter_map(|&byte| parser.push(byte))
            .map(|reply| exchange.take(reply))
            .find(|&outcome| outcome != Outcome::Waiting)
            .unwrap_or(Outcome::Waiting)
    }

    #[test]
    fn an_answer_follows_its_own_echo() {
        assert_eq!(receive(RUN, b"!A00\r+"), Outcome::Done([0; 2]));
        assert_eq!(receive(RUN, b"!A00\r-"), Outcome::Refused);
        assert_eq!(receive(RUN, b"+\r"), Outcome::Waiting, "whose is it?");
        assert_eq!(receive(RUN, b"-\r+\r!A00\r"), Outcome::Waiting);
        assert_eq!(receive(RUN, b"!A40\r+"), Outcome::Garbled);
        assert_eq!(receive(RUN, b"!A0\r"), Outcome::Garbled);
        assert_eq!(receive(RUN, b"!A00\r12\r"), Outcome::Waiting);
    }

    #[test]
    fn values_are_counted() {
        let status = Command::Read(Parameter::Status);
        assert_eq!(receive(status, b"^89\r05\r+\r"), Outcome::Done([5, 0]));
        assert_eq!(receive(status, b"05\r^89\r"), Outcome::Waiting);
        assert_eq!(receive(Command::Voltages, b"?E\r8A\r"), Outcome::Waiting);
        assert_eq!(
            receive(Command::Voltages, b"11\r?E\r8A\rW6B\r"),
            Outcome::Done([0x8A, 0x6B])
        );
    }

    #[test]
    fn both_motors_must_acknowledge() {
        let stop = Command::StopBoth;
        for done in [
            &b"!A00\r+\r!B00\r+\r"[..],
            b"!A00\r!B0+0\r+",
            b"!A00\r!B00\r++",
        ] {
            assert_eq!(receive(stop, done), Outcome::Done([0; 2]));
        }
        assert_eq!(receive(stop, b"!A00\r+\r!B00\r"), Outcome::Waiting);
        assert_eq!(receive(stop, b"!A00\r+\r+\r"), Outcome::Waiting);
        assert_eq!(receive(stop, b"!A00\r+\r!B00\r-"), Outcome::Refused);
        assert_eq!(receive(stop, b"!B00\r+"), Outcome::Garbled);
        assert_eq!(receive(stop, b"!A00\r+!A00\r+"), Outcome::Garbled);
    }

    #[test]
    fn the_answer_to_what_a_stop_interrupted_is_not_its_own() {
        let interrupting = |command| {
            let last = Exchange::new(command, Monotonic::from_nanos(0));
            Exchange::stop_both(Some(last), Monotonic::from_nanos(1))
        };
        let drive = Command::Run(Channel::Two, Power::from_fraction(1.0));
        for late in [drive, RUN] {
            let echo = [late.bytes().as_bytes(), b"+"].concat();
            let both = [&echo[..], b"!A00\r+!B00\r"].concat();
            assert_eq!(outcome(interrupting(late), &both), Outcome::Waiting);
            let done = [&both[..], b"+"].concat();
            assert_eq!(outcome(interrupting(late), &done), Outcome::Done([0; 2]));
        }
        // Its acknowledgement comes behind the stop's first echo.
        let late = b"!B7F\r!A00\r+!B00\r+";
        assert_eq!(outcome(interrupting(drive), late), Outcome::Waiting);
        let query = interrupting(Command::Voltages);
        assert_eq!(
            outcome(query, b"?E\r8A\r!A00\r6B\r+!B00\r+"),
            Outcome::Done([0; 2])
        );
        assert_eq!(outcome(query, b"?Z\r"), Outcome::Garbled);
    }
}
