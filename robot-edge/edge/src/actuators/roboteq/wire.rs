//! The serial protocol of an AX3500 without I/O: commands, replies, and the state of one command (exchange).
//!
//! The source is the *AX3500 Motor Controller User's Manual*, version 1.9b, June 1, 2007; pages are its own. A command
//! is a few characters and a carriage return. The controller echoes every character; then it says `+` (done), `-` (not
//! done) or, to a query, its values, two hexadecimal digits on a line each (p. 141 f.). Unasked it says `W` each second
//! in which its watchdog has stopped the motors (p. 142), `OK` when it begins to listen (p. 140), and in R/C mode lines
//! that begin with `:` (p. 170). Whether `+` has a carriage return of its own, and what follows a bare one, the manual
//! does not say; nothing here depends on it. `+`, `-` and `W` occur in no echo and no value, so that they count
//! wherever they stand, also in the middle of an echo.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use measurement::time::Monotonic;

/// Longest line that means anything; longer ones are noise.
const LINE_BYTES: usize = 16;

/// Ends a command, an echo, a value.
const CARRIAGE_RETURN: u8 = b'\r';

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Commands `A` and `a`.
    One,
    /// Commands `B` and `b`.
    Two,
}

/// A channel command or encoder value: −127 … 127 of full speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Power(i8);

impl Power {
    /// Standing.
    pub const ZERO: Self = Self(0);
    const FULL: i8 = 127;

    /// The nearest step to a fraction of full speed, −1 … 1; beyond it, full; standing for what is not a number.
    pub fn from_fraction(fraction: f64) -> Self {
        // A cast saturates, and makes 0 of what is not a number.
        let steps = libm::round(fraction * f64::from(Self::FULL)) as i8;
        Self(steps.max(-Self::FULL))
    }

    /// From the two's complement that encoders answer with (p. 160); −128 does not exist.
    pub const fn from_bits(bits: u8) -> Self {
        let steps = bits.cast_signed();
        Self(if steps == i8::MIN { -Self::FULL } else { steps })
    }

    pub const fn get(self) -> i8 {
        self.0
    }

    pub fn fraction(self) -> f64 {
        f64::from(self.0) / f64::from(Self::FULL)
    }

    #[must_use]
    pub const fn inverted_if(self, is_inverted: bool) -> Self {
        Self(if is_inverted { -self.0 } else { self.0 })
    }
}

/// What is said to the controller, one at a time: each waits for its answer, as the manual's "should be assumed that
/// the command was lost and that it should be repeated" (p. 141) wants it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Command {
    /// `!Ann`, `!ann`, `!Bnn`, `!bnn`: run a motor (p. 143). In mixed mode it would mean something else.
    Run(Channel, Power),
    /// `!A00` and `!B00` in one write: the sender need not live on until both motors stand. Whether the
    /// controller takes two commands back to back the manual does not say: it is tried at the start.
    StopBoth,
    /// `^mm`: read a parameter (p. 147).
    Read(Parameter),
    /// `?e`: battery and internal voltage (p. 146).
    Voltages,
    /// `?z`: speeds by the encoders (p. 160).
    EncoderSpeeds,
    /// `?q0`, `?q1`: count of an encoder (p. 159).
    EncoderCount(Channel),
}

/// Parameters that are read; none is ever written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Parameter {
    /// 0 R/C, 1 RS-232 without watchdog, 2 RS-232 with watchdog, 3 analog (section "Flash Configuration Parameters").
    InputControlMode = 0x00,
    /// Bits 0–2: 0 both speeds separate, open loop; 4 the same, closed loop; others mix or steer to positions (ibid.).
    MotorControlMode = 0x01,
    /// Why the power stage is off: [`crate::actuators::report::ControllerFlags`] (p. 157).
    Status = 0x89,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// With `+`.
    Acknowledgement,
    Values(usize),
    /// 1 to 8 digits on one line, which are not read here.
    Count,
}

impl Command {
    /// What is sent, without the last carriage return; the echo must be the same.
    pub fn line(self) -> Line {
        let mut line = Line::EMPTY;
        match self {
            Self::Run(channel, power) => {
                let letter = match (channel, power.0 < 0) {
                    (Channel::One, false) => b'A',
                    (Channel::One, true) => b'a',
                    (Channel::Two, false) => b'B',
                    (Channel::Two, true) => b'b',
                };
                line.extend(&[b'!', letter]);
                line.extend(&hex(power.0.unsigned_abs()));
            }
            Self::StopBoth => line.extend(b"!A00\r!B00"),
            Self::Read(parameter) => {
                line.extend(b"^");
                line.extend(&hex(parameter as u8));
            }
            Self::Voltages => line.extend(b"?E"),
            Self::EncoderSpeeds => line.extend(b"?Z"),
            Self::EncoderCount(Channel::One) => line.extend(b"?Q0"),
            Self::EncoderCount(Channel::Two) => line.extend(b"?Q1"),
        }
        line
    }

    pub fn bytes(self) -> Line {
        let mut line = self.line();
        line.extend(&[CARRIAGE_RETURN]);
        line
    }

    pub const fn answer(self) -> Answer {
        match self {
            Self::Run(..) | Self::StopBoth => Answer::Acknowledgement,
            Self::Read(_) => Answer::Values(1),
            Self::Voltages | Self::EncoderSpeeds => Answer::Values(2),
            Self::EncoderCount(_) => Answer::Count,
        }
    }
}

/// Ten carriage returns: from R/C or analog mode into RS-232 mode, which the controller answers with `OK` (p. 140).
pub fn wake() -> Line {
    let mut line = Line::EMPTY;
    line.extend(&[CARRIAGE_RETURN; 10]);
    line
}

/// Both motors to zero, for when nothing is known of what the line carries. The first command may be glued to the rest
/// of another one, and is repeated at the end.
pub fn stop_without_reply() -> Line {
    let mut line = Line::EMPTY;
    line.extend(b"!A00\r!B00\r!A00\r");
    line
}

/// Main battery, volts: 55/256 V a step (p. 67).
pub fn battery_v(value: u8) -> f64 {
    f64::from(value) * 55.0 / 256.0
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply {
    /// `+`: done.
    Acknowledged,
    /// `-`: not done.
    Refused,
    /// `W`: its watchdog has stopped the motors.
    WatchdogTripped,
    /// `OK`: it has just begun to listen, so it was off, or in another mode, before.
    Prompt,
    Echo(Line),
    /// Two hexadecimal digits.
    Value(u8),
    /// Another number of them, 8 at most.
    Digits,
    Noise,
}

/// Makes replies of bytes, however they are split, and finds its way back after garbage at the next end of a line.
#[derive(Clone, Copy, Debug, Default)]
pub struct ReplyParser {
    line: Line,
    /// The line is too long, or holds what the controller never sends.
    is_noise: bool,
}

impl ReplyParser {
    /// Takes one byte; a byte ends at most one reply.
    pub fn push(&mut self, byte: u8) -> Option<Reply> {
        match byte {
            b'+' => Some(Reply::Acknowledged),
            b'-' => Some(Reply::Refused),
            b'W' => Some(Reply::WatchdogTripped),
            b'\r' | b'\n' => self.end(),
            // Printable ASCII; with 7 data bits nothing else is on the line, unless the settings differ.
            b' '..=b'~' => {
                self.is_noise |= !self.line.push(byte);
                None
            }
            _ => {
                self.is_noise = true;
                None
            }
        }
    }

    pub fn clear(&mut self) {
        *self = Self::default();
    }

    fn end(&mut self) -> Option<Reply> {
        let (line, is_noise) = (self.line, self.is_noise);
        self.clear();
        if is_noise {
            return Some(Reply::Noise);
        }
        match line.as_bytes() {
            [] => None,
            b"OK" => Some(Reply::Prompt),
            [b'!' | b'?' | b'^', ..] => Some(Reply::Echo(line)),
            &[high, low] => Some(match (digit(high), digit(low)) {
                (Some(high), Some(low)) => Reply::Value(high << 4 | low),
                _ => Reply::Noise,
            }),
            digits if digits.len() <= 8 && digits.iter().all(u8::is_ascii_hexdigit) => {
                Some(Reply::Digits)
            }
            _ => Some(Reply::Noise),
        }
    }
}

/// A few bytes, without a heap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Line {
    bytes: [u8; LINE_BYTES],
    length: usize,
}

impl Line {
    const EMPTY: Self = Self {
        bytes: [0; LINE_BYTES],
        length: 0,
    };

    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// Whether there was room.
    fn push(&mut self, byte: u8) -> bool {
        let Some(slot) = self.bytes.get_mut(self.length) else {
            return false;
        };
        *slot = byte;
        self.length += 1;
        true
    }

    fn extend(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.push(byte);
        }
    }
}

fn hex(value: u8) -> [u8; 2] {
    const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
    [value >> 4, value & 0xF].map(|nibble| DIGITS[usize::from(nibble)])
}

fn digit(byte: u8) -> Option<u8> {
    char::from(byte)
        .to_digit(16)
        .and_then(|digit| u8::try_from(digit).ok())
}

/// Longest wait for the end of an answer. The longest exchange (`?Q0`) is 4 + 13 characters of 1.04 ms, the controller
/// looks every 16 ms (manual, p. 156), and an adapter on USB may hold characters back for 16 ms.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Waiting,
    /// It was done; values where it asked for some.
    Done([u8; 2]),
    Refused,
    /// The echo differs from the command: the effect is unknown.
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

    /// Sends zero to both motors although an answer is pending; that answer arrives first and is ignored.
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

    pub(super) const fn is_silent(&self) -> bool {
        self.echoes == 0
    }

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
                Answer::Values(_) | Answer::Count => Outcome::Waiting,
            },
            Reply::Value(_) | Reply::Digits
                if self.echoes > 0 && self.command.answer() == Answer::Count =>
            {
                Outcome::Done(self.values)
            }
            Reply::Value(value) if self.echoes > 0 => self.take_value(value),
            Reply::Refused
            | Reply::Acknowledged
            | Reply::Value(_)
            | Reply::Digits
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
            Command::Run(..)
            | Command::Read(_)
            | Command::Voltages
            | Command::EncoderSpeeds
            | Command::EncoderCount(_) => 1,
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
    use proptest::prelude::*;

    use super::*;

    fn parse(bytes: &[u8]) -> Vec<Reply> {
        let mut parser = ReplyParser::default();
        bytes.iter().filter_map(|&byte| parser.push(byte)).collect()
    }

    fn echo(command: Command) -> Reply {
        Reply::Echo(command.line())
    }

    fn run(channel: Channel, steps: i8) -> Command {
        Command::Run(channel, Power(steps))
    }

    #[test]
    fn commands_are_those_of_the_manual() {
        for (command, bytes) in [
            // Examples of p. 143.
            (run(Channel::One, 0), "!A00\r"),
            (run(Channel::Two, 127), "!B7F\r"),
            (run(Channel::One, -63), "!a3F\r"),
            (run(Channel::One, -5), "!a05\r"),
            (run(Channel::Two, -127), "!b7F\r"),
            // Example of p. 147.
            (Command::Read(Parameter::InputControlMode), "^00\r"),
            (Command::Read(Parameter::Status), "^89\r"),
            (Command::Voltages, "?E\r"),
            (Command::EncoderSpeeds, "?Z\r"),
            // Syntax of p. 159.
            (Command::EncoderCount(Channel::One), "?Q0\r"),
            (Command::EncoderCount(Channel::Two), "?Q1\r"),
        ] {
            assert_eq!(command.bytes().as_bytes(), bytes.as_bytes());
        }
        assert_eq!(wake().as_bytes(), [b'\r'; 10]);
        assert_eq!(stop_without_reply().as_bytes().len(), 15, "it fits");
    }

    #[test]
    fn fractions_are_rounded_and_saturate() {
        for (fraction, steps) in [
            (0.0, 0),
            (1.0, 127),
            (-1.0, -127),
            (0.5, 64),
            (0.0039, 0),
            (0.004, 1),
            (7.0, 127),
            (-7.0, -127),
            (f64::INFINITY, 127),
            (f64::NEG_INFINITY, -127),
            (f64::NAN, 0),
        ] {
            assert_eq!(Power::from_fraction(fraction).get(), steps, "{fraction}");
        }
        for (bits, steps) in [
            (0x00, 0),
            (0x7F, 127),
            (0xFF, -1),
            (0x81, -127),
            (0x80, -127),
        ] {
            assert_eq!(Power::from_bits(bits).get(), steps);
        }
    }

    #[test]
    fn a_dialogue_is_understood() {
        assert_eq!(
            parse(b"!A3F\r+\r?E\r8A\r6B\r^01\r00\r!bFF\r-\r"),
            [
                echo(run(Channel::One, 63)),
                Reply::Acknowledged,
                echo(Command::Voltages),
                Reply::Value(0x8A),
                Reply::Value(0x6B),
                echo(Command::Read(Parameter::MotorControlMode)),
                Reply::Value(0),
                Reply::Echo(Line {
                    bytes: *b"!bFF\0\0\0\0\0\0\0\0\0\0\0\0",
                    length: 4
                }),
                Reply::Refused,
            ]
        );
    }

    #[test]
    fn what_comes_unasked_breaks_no_echo() {
        assert_eq!(
            parse(b"!AW3F\r\n+\r\r\rOK\r:0011223344556677889900AABB\r?!\x80\r7F\r"),
            [
                Reply::WatchdogTripped,
                echo(run(Channel::One, 63)),
                Reply::Acknowledged,
                Reply::Prompt,
                Reply::Noise,
                Reply::Noise,
                Reply::Value(0x7F),
            ]
        );
    }

    #[test]
    fn voltages_are_those_of_the_formula() {
        assert!((battery_v(0x78) - 25.781_25).abs() < 1e-9);
        assert!((battery_v(0xFF) - 54.785_156_25).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn no_bytes_harm_and_the_line_after_them_is_understood(noise in prop::collection::vec(any::<u8>(), 0..300)) {
            let mut parser = ReplyParser::default();
            for &byte in &noise {
                parser.push(byte);
            }
            parser.push(b'\r');
            let rest: Vec<Reply> = b"?E\r8A\r6B\r".iter().filter_map(|&byte| parser.push(byte)).collect();
            prop_assert_eq!(rest, [echo(Command::Voltages), Reply::Value(0x8A), Reply::Value(0x6B)]);
        }

        #[test]
        fn every_command_is_its_own_echo(steps in -127..=127i8, two in any::<bool>()) {
            let command = run(if two { Channel::Two } else { Channel::One }, steps);
            prop_assert_eq!(parse(command.bytes().as_bytes()), [echo(command)]);
            // Two commands never look alike.
            let other = run(Channel::One, steps.wrapping_add(1).max(-127));
            prop_assert_eq!(command.line() == other.line(), command == other);
        }
    }

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

    /// Counts of table 33 (p. 168), and what is none.
    #[test]
    fn a_count_is_one_line_of_1_to_8_digits() {
        let count = Command::EncoderCount(Channel::Two);
        for (line, is_done) in [
            ("?Q1\r5\r", true),
            ("?Q1\rF0\r", true),
            ("?Q1\r0FA\r", true),
            ("?Q1\rW56CB872\r", true),
            ("?Q1\r80000000\r", true),
            ("?Q1\r123456789\r", false),
            ("?Q1\r5G\r", false),
            ("?Q1\r5G0\r", false),
            ("?Q1\r\r+", false),
            ("5\r?Q1\r", false),
        ] {
            let outcome = receive(count, line.as_bytes());
            assert_eq!(outcome == Outcome::Done([0; 2]), is_done, "{line}");
        }
        assert_eq!(receive(count, b"?Q1\r-"), Outcome::Refused);
        assert_eq!(receive(count, b"?Q0\r5\r"), Outcome::Garbled);
        // Late, it is no answer to another command.
        let status = Command::Read(Parameter::Status);
        assert_eq!(receive(status, b"^89\r123\r"), Outcome::Waiting);
        assert_eq!(receive(RUN, b"!A00\r123\r"), Outcome::Waiting);
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
