//! What is said on the line to an AX3500 and back, without the line.
//!
//! The source is the *AX3500 Motor Controller User's Manual*, version 1.9b, June 1, 2007; pages are its own. A command is
//! a few characters and a carriage return. The controller echoes every character; then it says `+` (done), `-` (not
//! done) or, to a query, its values, two hexadecimal digits on a line each (p. 141 f.). Unasked it says `W` each second
//! in which its watchdog has stopped the motors (p. 142), `OK` when it begins to listen (p. 140), and in R/C mode lines
//! that begin with `:` (p. 170). Whether `+` has a carriage return of its own, and what follows a bare one, the manual
//! does not say; nothing here depends on it. `+`, `-` and `W` occur in no echo and no value, so that they count wherever
//! they stand, also in the middle of an echo.

use serde::{Deserialize, Serialize};

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

/// What a channel is told, or says of its encoder: −127 … 127 of full speed.
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
    /// `!A00` and `!B00` in one write: whoever has written it need not live on until both motors stand. Whether the
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

/// Both motors to zero, for when nothing is known of what the line carries. The first command may be glued to the rest of
/// another one, and is repeated at the end.
pub fn stop_without_reply() -> Line {
    let mut line = Line::EMPTY;
    line.extend(b"!A00\r!B00\r!A00\r");
    line
}

/// Main battery, volts: 55/256 V a step (p. 67).
pub fn battery_v(value: u8) -> f64 {
    f64::from(value) * 55.0 / 256.0
}

/// What the controller says.
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

#[cfg(test)]
mod tests;
