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

/// One of the two motors.
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

    /// Steps, −127 … 127.
    pub const fn get(self) -> i8 {
        self.0
    }

    /// Fraction of full speed, −1 … 1.
    pub fn fraction(self) -> f64 {
        f64::from(self.0) / f64::from(Self::FULL)
    }

    /// The other way round, if so.
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

/// How an answer ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// With `+`.
    Acknowledgement,
    /// With this many values.
    Values(usize),
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
        }
        line
    }

    /// What is sent.
    pub fn bytes(self) -> Line {
        let mut line = self.line();
        line.extend(&[CARRIAGE_RETURN]);
        line
    }

    /// What ends the answer.
    pub const fn answer(self) -> Answer {
        match self {
            Self::Run(..) | Self::StopBoth => Answer::Acknowledgement,
            Self::Read(_) => Answer::Values(1),
            Self::Voltages | Self::EncoderSpeeds => Answer::Values(2),
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

/// A reply of the controller.
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
    /// What it has received.
    Echo(Line),
    /// Two hexadecimal digits.
    Value(u8),
    /// A line that means nothing.
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

    /// Forgets the line that has begun.
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

    /// The bytes.
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

/// Longest wait for the end of an answer. The longest exchange (`?E`) is 3 + 9 characters of 1.04 ms, the controller
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

/// The state of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// It still waits.
    Waiting,
    /// It was done; values where it asked for some.
    Done([u8; 2]),
    /// It was not done.
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

    /// Whether nothing at all has come.
    pub(super) const fn is_silent(&self) -> bool {
        self.echoes == 0
    }

    /// When it was sent.
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
mod tests;
