//! One command and what is said to it.

use std::time::Duration;

use super::wire::{Answer, Command, Reply};
use crate::clock::Monotonic;

/// Longest wait for the end of an answer. The longest exchange (`?E`) is 3 + 9 characters of 1.04 ms, the controller looks
/// every 16 ms (manual, p. 156), and an adapter on USB may hold characters back for 16 ms.
pub(super) const PATIENCE: Duration = Duration::from_millis(100);

/// A command that waits for its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Exchange {
    pub(super) command: Command,
    sent: Monotonic,
    is_echoed: bool,
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
            is_echoed: false,
            values: [0; 2],
            count: 0,
        }
    }

    /// When it was said.
    pub(super) const fn sent(&self) -> Monotonic {
        self.sent
    }

    pub(super) fn deadline(&self) -> Monotonic {
        self.sent + PATIENCE
    }

    /// Only what follows the command's own echo is its answer: a late answer to another one is not.
    pub(super) fn take(&mut self, reply: Reply) -> Outcome {
        match reply {
            Reply::Echo(line) if line == self.command.line() => {
                self.is_echoed = true;
                Outcome::Waiting
            }
            Reply::Echo(_) => Outcome::Garbled,
            Reply::Refused if self.is_echoed => Outcome::Refused,
            Reply::Acknowledged if self.is_echoed => match self.command.answer() {
                Answer::Acknowledgement => Outcome::Done(self.values),
                Answer::Values(_) => Outcome::Waiting,
            },
            Reply::Value(value) if self.is_echoed => self.take_value(value),
            Reply::Refused
            | Reply::Acknowledged
            | Reply::Value(_)
            | Reply::WatchdogTripped
            | Reply::Prompt
            | Reply::Noise => Outcome::Waiting,
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
    use super::super::wire::{Channel, Parameter, Power, ReplyParser};
    use super::*;

    const RUN: Command = Command::Run(Channel::One, Power::ZERO);

    fn hear(command: Command, bytes: &[u8]) -> Outcome {
        let mut exchange = Exchange::new(command, Monotonic::from_nanos(0));
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
        assert_eq!(hear(RUN, b"!A00\r+"), Outcome::Done([0; 2]));
        assert_eq!(hear(RUN, b"!A00\r-"), Outcome::Refused);
        assert_eq!(hear(RUN, b"+\r"), Outcome::Waiting, "whose is it?");
        assert_eq!(hear(RUN, b"-\r+\r!A00\r"), Outcome::Waiting);
        assert_eq!(hear(RUN, b"!A40\r+"), Outcome::Garbled);
        assert_eq!(hear(RUN, b"!A0\r"), Outcome::Garbled);
        assert_eq!(hear(RUN, b"!A00\r12\r"), Outcome::Waiting);
    }

    #[test]
    fn values_are_counted() {
        let status = Command::Read(Parameter::Status);
        assert_eq!(hear(status, b"^89\r05\r+\r"), Outcome::Done([5, 0]));
        assert_eq!(hear(status, b"05\r^89\r"), Outcome::Waiting);
        assert_eq!(hear(Command::Voltages, b"?E\r8A\r"), Outcome::Waiting);
        assert_eq!(
            hear(Command::Voltages, b"11\r?E\r8A\rW6B\r"),
            Outcome::Done([0x8A, 0x6B])
        );
    }
}
