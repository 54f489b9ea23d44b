//! Encoder replies of a Roboteq AX3500 motor controller, 9600 baud, 7E1.
//!
//! Source: *AX3500 Motor Controller User's Manual*, version 1.9b, June 1, 2007, pages 85 and 159 to 168.
//! The motor guard alone writes to the controller. This decodes what comes back on that line: the
//! echo of each query, then its values, a line for each. The replies to other commands stand between;
//! `+`, `-` and `W` (watchdog) may stand anywhere and are no part of a value.
//!
//! Lines have no checksum beyond the parity of the characters. No recording of a device was at hand.

use std::f64::consts::TAU;

use crate::read_buffer::{Front, ReadBuffer};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::RoboteqEncoders;

/// Longest line that has a meaning here is `?Q0`, the longest value 8 digits.
const MAX_LINE: usize = 16;

/// An encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// Of channel 1.
    One,
    /// Of channel 2.
    Two,
}

/// Asks for the count of an encoder since it was reset, [`Message::Count`].
pub const fn request_count(encoder: Encoder) -> &'static [u8] {
    match encoder {
        Encoder::One => b"?Q0\r",
        Encoder::Two => b"?Q1\r",
    }
}

/// Asks for [`Message::Speeds`].
pub const REQUEST_SPEEDS: &[u8] = b"?Z\r";

/// What the controller sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// Count of an encoder since it was reset; wraps. See [`WheelAngle`].
    Count {
        /// Whose.
        encoder: Encoder,
        /// Quarters of a pulse.
        count: i32,
    },
    /// Speed of encoders 1 and 2, −127 to 127; see [`WheelEncoder::speed_radps`].
    Speeds([i8; 2]),
    /// `OK`: the controller has begun to listen. Its counts may be 0 again.
    Restarted,
}

/// What turns counts into angles of a wheel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelEncoder {
    pulses_per_turn: f64,
    time_base: f64,
}

impl WheelEncoder {
    /// Pulses of the encoder in one turn of the wheel, with the gear, negative if it counts backwards
    /// as the wheel rolls forward; time base, 0 to 63, of registers A2 and A3 (p. 85, p. 164).
    /// `None` if there is no such encoder.
    pub fn new(pulses_per_turn: f64, time_base: u8) -> Option<Self> {
        let is_possible = (1.0..=1e7).contains(&pulses_per_turn.abs()) && time_base <= 63;
        is_possible.then_some(Self {
            pulses_per_turn,
            time_base: time_base.into(),
        })
    }

    /// Speed of the wheel, rad/s. By p. 85 a value of 1 is 58593.75 / ((time base + 1)·pulses per turn)
    /// turns per minute.
    pub fn speed_radps(&self, speed: i8) -> f64 {
        let rpm = f64::from(speed) * 58_593.75 / ((self.time_base + 1.0) * self.pulses_per_turn);
        rpm * TAU / 60.0
    }

    /// Four counts are a pulse.
    fn angle_rad(&self, counts: i64) -> f64 {
        counts as f64 * TAU / (4.0 * self.pulses_per_turn)
    }
}

/// Angle of a wheel since the first count, also past the wrap of the counter.
#[derive(Clone, Copy, Debug)]
pub struct WheelAngle {
    encoder: WheelEncoder,
    last: Option<i32>,
    counts: i64,
}

impl WheelAngle {
    /// At angle 0.
    pub const fn new(encoder: WheelEncoder) -> Self {
        Self {
            encoder,
            last: None,
            counts: 0,
        }
    }

    /// Takes a count; the angle, radians.
    pub fn update(&mut self, count: i32) -> f64 {
        let moved = self.last.map_or(0, |last| count.wrapping_sub(last));
        self.last = Some(count);
        self.counts = self.counts.saturating_add(moved.into());
        self.encoder.angle_rad(self.counts)
    }

    /// The counter may have been reset: the angle stays, and goes on from the next count.
    pub fn restart(&mut self) {
        self.last = None;
    }
}

/// Decodes the received side of the line.
#[derive(Debug, Default)]
pub struct EncoderDecoder {
    buffer: ReadBuffer,
    awaited: Awaited,
}

/// What the next value belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Awaited {
    /// Not known: nothing was asked as far as is known.
    #[default]
    Nothing,
    /// Another query or command.
    Other,
    Count(Encoder),
    Speeds,
    SecondSpeed(i8),
}

impl Awaited {
    fn is_ours(self) -> bool {
        !matches!(self, Self::Nothing | Self::Other)
    }
}

/// A line without its end, and without `+`, `-` and `W`.
struct Line {
    text: [u8; MAX_LINE],
    length: usize,
    is_refused: bool,
}

impl Decoder for EncoderDecoder {
    type Message = Message;

    fn push(&mut self, bytes: &[u8]) {
        self.buffer.push(bytes);
    }

    fn next_message(&mut self) -> Option<Message> {
        loop {
            let line = self.buffer.next_message(line)?;
            if let Some(message) = self.take(&line) {
                return Some(message);
            }
        }
    }

    fn dropped(&self) -> &Dropped {
        &self.buffer.dropped
    }
}

impl EncoderDecoder {
    fn take(&mut self, line: &Line) -> Option<Message> {
        let mut awaited = std::mem::take(&mut self.awaited);
        if line.is_refused && awaited.is_ours() {
            self.drop(DropReason::UnknownKind, 1);
            awaited = Awaited::Other;
        }
        let text = line.text.get(..line.length).unwrap_or_default();
        match (text, awaited) {
            ([], _) => self.awaited = awaited,
            ([b'?' | b'!' | b'^' | b'*' | b'%', ..], _) => {
                self.drop(DropReason::CutOff, awaited.is_ours().into());
                self.awaited = match text {
                    b"?Q0" | b"?q0" => Awaited::Count(Encoder::One),
                    b"?Q1" | b"?q1" => Awaited::Count(Encoder::Two),
                    b"?Z" | b"?z" => Awaited::Speeds,
                    _ => Awaited::Other,
                };
            }
            (b"OK", _) => {
                self.drop(DropReason::CutOff, awaited.is_ours().into());
                return Some(Message::Restarted);
            }
            // R/C mode.
            ([b':', ..], _) | (_, Awaited::Other) => self.awaited = awaited,
            (_, Awaited::Nothing) => self.drop(DropReason::Garbage, text.len()),
            (_, Awaited::Count(encoder)) => match count(text) {
                Ok(count) => return Some(Message::Count { encoder, count }),
                Err(reason) => self.drop(reason, 1),
            },
            (_, Awaited::Speeds) => match speed(text) {
                Ok(first) => self.awaited = Awaited::SecondSpeed(first),
                Err(reason) => self.drop(reason, 1),
            },
            (_, Awaited::SecondSpeed(first)) => match speed(text) {
                Ok(second) => return Some(Message::Speeds([first, second])),
                Err(reason) => self.drop(reason, 1),
            },
        }
        None
    }

    fn drop(&mut self, reason: DropReason, count: usize) {
        self.buffer.dropped.add(reason, count);
    }
}

/// The line at the front. What stands before an echo on its line is garbage.
fn line(bytes: &[u8]) -> Front<Line> {
    let is_end = |byte: &u8| matches!(byte, b'\r' | b'\n');
    // One more than a line and its end, so that the answer does not depend on how bytes were split.
    let window = &bytes[..bytes.len().min(MAX_LINE + 1)];
    let Some(end) = window.iter().position(is_end) else {
        return if window.len() > MAX_LINE {
            Front::Skip(DropReason::Garbage, 1)
        } else {
            Front::Incomplete
        };
    };
    let is_echo = |byte: &u8| matches!(byte, b'?' | b'!' | b'^' | b'*' | b'%');
    let is_extra = |byte: &&u8| matches!(byte, b'+' | b'-' | b'W');
    let whole = &bytes[..end];
    match whole.iter().rposition(is_echo) {
        Some(echo) if whole[..echo].iter().any(|byte| !is_extra(&byte)) => {
            return Front::Skip(DropReason::Garbage, echo);
        }
        _ => {}
    }
    let mut line = Line {
        text: [0; MAX_LINE],
        length: 0,
        is_refused: whole.contains(&b'-'),
    };
    for (slot, byte) in line
        .text
        .iter_mut()
        .zip(whole.iter().filter(|byte| !is_extra(byte)))
    {
        *slot = *byte;
        line.length += 1;
    }
    Front::Message(line, end + 1)
}

/// 1 to 8 digits. The first of fewer than 8 tells the sign: 8 to F is negative (p. 167 f.).
fn count(text: &[u8]) -> Result<i32, DropReason> {
    if text.len() > 8 {
        return Err(DropReason::Length);
    }
    let negative = matches!(text.first(), Some(b'8'..=b'9' | b'A'..=b'F' | b'a'..=b'f'));
    let sign = if negative { u32::MAX } else { 0 };
    let bits = text.iter().try_fold(sign, |bits, byte| {
        Some(bits << 4 | char::from(*byte).to_digit(16)?)
    });
    bits.map(u32::cast_signed).ok_or(DropReason::Field)
}

/// Two digits, two's complement; −128 is taken as −127, for the manual has "-127 is 80" (p. 160).
fn speed(text: &[u8]) -> Result<i8, DropReason> {
    if text.len() != 2 {
        return Err(DropReason::Length);
    }
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let bits = digit(text[0]).zip(digit(text[1]));
    let (high, low) = bits.ok_or(DropReason::Field)?;
    Ok(((high << 4 | low) as u8).cast_signed().max(-127))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::test_decoding::*;

    fn count_of(encoder: Encoder, count: i32) -> Message {
        Message::Count { encoder, count }
    }

    /// Table 33 (p. 168), the text before it (p. 167), and the limits.
    #[test]
    fn counts_of_the_manual() {
        for (text, expected) in [
            ("5", 5),
            ("0FA", 250),
            ("A", -6),
            ("F15", -235),
            ("56CB872", 91_011_186),
            ("862455", -7_986_091),
            ("15", 0x15),
            ("B", -5),
            ("0", 0),
            ("F", -1),
            ("7FFFFFFF", i32::MAX),
            ("80000000", i32::MIN),
        ] {
            let bytes = format!("?Q1\r{text}\r");
            let (messages, dropped) = decode(EncoderDecoder::default(), bytes.as_bytes());
            assert_eq!(messages, [count_of(Encoder::Two, expected)], "{text}");
            assert_eq!(dropped, Dropped::default());
        }
    }

    #[test]
    fn speeds() {
        for (text, expected) in [
            ("00\r7F", [0, 127]),
            ("FF\r81", [-1, -127]),
            ("80\r01", [-127, 1]),
        ] {
            let bytes = format!("?Z\r{text}\r");
            let (messages, dropped) = decode(EncoderDecoder::default(), bytes.as_bytes());
            assert_eq!(messages, [Message::Speeds(expected)], "{text}");
            assert_eq!(dropped, Dropped::default());
        }
    }

    /// The guard's commands and queries with their replies, and the watchdog's letter.
    #[test]
    fn replies_between_others() {
        let line = b"\r\rOK\r!A00\r+!B00\r+\r^00\r02\r?E\r9A\r5C\rW?Q0\r\rW12\r!A7F\r+?z\r0W1\rFE\r?q1\r+F0\r:0000\r\n";
        let expected = [
            Message::Restarted,
            count_of(Encoder::One, 0x12),
            Message::Speeds([1, -2]),
            count_of(Encoder::Two, -16),
        ];
        for length in [1, 2, 7, usize::MAX] {
            let (messages, dropped) = decode_in(EncoderDecoder::default(), line, &[length]);
            assert_eq!(messages, expected);
            assert_eq!(dropped, Dropped::default());
        }
    }

    #[test]
    fn bad_lines_are_dropped_and_the_next_is_found() {
        let good = "?Q0\r2A\r";
        for (bad, reason, count) in [
            ("?Q0\r123456789\r", DropReason::Length, 1),
            ("?Q0\r12G4\r", DropReason::Field, 1),
            ("?Z\r1\r", DropReason::Length, 1),
            ("?Z\r12\r123\r", DropReason::Length, 1),
            ("?Z\rXY\r", DropReason::Field, 1),
            ("?Z\r12\r\u{b5}\r", DropReason::Field, 1),
            ("?Z\r12\r", DropReason::CutOff, 1),
            ("?Q1\r", DropReason::CutOff, 1),
            ("?Q1\r1", DropReason::CutOff, 1),
            ("?Q1", DropReason::Garbage, 3),
            // The guard's sign for bytes that were lost.
            ("?Q0\r12\0\r34\r", DropReason::Field, 1),
            ("?Q0\0\r12\r", DropReason::Field, 0),
            ("?Q0\r\0\r12\r", DropReason::Field, 1),
            ("?Q0\r-\r", DropReason::UnknownKind, 1),
            ("?Q1\r-", DropReason::UnknownKind, 1),
            ("12\r", DropReason::Garbage, 2),
            ("\u{b5}", DropReason::Garbage, 2),
            (
                "0123456789012345678901234567890123456789",
                DropReason::Garbage,
                40,
            ),
        ] {
            let bytes = [bad.as_bytes(), good.as_bytes()].concat();
            for length in [1, 5, usize::MAX] {
                let (messages, dropped) = decode_in(EncoderDecoder::default(), &bytes, &[length]);
                assert_eq!(messages, [count_of(Encoder::One, 42)], "{bad:?}");
                assert_eq!(dropped.count(reason), count, "{bad:?} {dropped:?}");
            }
        }
        let (messages, dropped) = decode(EncoderDecoder::default(), b"?Z\r12\rOK\r34\r");
        assert_eq!(messages, [Message::Restarted]);
        assert_eq!(dropped.count(DropReason::CutOff), 1);
    }

    /// The examples of p. 85: 200 pulses per turn, time base 4.
    #[test]
    fn speeds_in_si_units() {
        let encoder = WheelEncoder::new(200.0, 4).unwrap();
        let rpm = |speed| encoder.speed_radps(speed) * 60.0 / TAU;
        assert!((rpm(127) - 7441.0).abs() < 0.5);
        assert!((rpm(1) - 58.6).abs() < 0.05);
        assert!((rpm(17) - 1000.0).abs() < 5.0);
        assert!((rpm(-127) + 7441.0).abs() < 0.5);
        for (pulses, time_base) in [
            (0.0, 4),
            (0.5, 4),
            (1e8, 4),
            (f64::NAN, 4),
            (f64::INFINITY, 4),
            (200.0, 64),
        ] {
            assert_eq!(WheelEncoder::new(pulses, time_base), None);
        }
    }

    #[test]
    fn angles_go_on_past_the_wrap_and_a_restart() {
        let mut angle = WheelAngle::new(WheelEncoder::new(-250.0, 0).unwrap());
        for (count, expected_turns) in [
            (i32::MAX - 499, 0.0),
            (i32::MAX, -0.499),
            (i32::MIN, -0.5),
            (i32::MIN + 500, -1.0),
            (i32::MAX, -0.499),
        ] {
            let turns = angle.update(count) / TAU;
            assert!((turns - expected_turns).abs() < 1e-9, "{count}: {turns}");
        }
        angle.restart();
        assert!((angle.update(0) / TAU + 0.499).abs() < 1e-9);
        assert!((angle.update(-1000) / TAU - 0.501).abs() < 1e-9);
    }

    /// As the controller shortens a count (p. 167).
    fn shortened(count: i32) -> String {
        let digits = format!("{count:08X}");
        let fill = if count < 0 { 'F' } else { '0' };
        let rest = digits.trim_start_matches(fill);
        let first_is_negative = rest.chars().next().is_some_and(|digit| digit >= '8');
        match (rest.is_empty(), first_is_negative == (count < 0)) {
            (false, true) => rest.to_owned(),
            _ => format!("{fill}{rest}"),
        }
    }

    proptest! {
        #[test]
        fn every_count_is_read_back_in_any_split(
            counts in prop::collection::vec((any::<bool>(), any::<i32>(), 0..32_u32), 1..20),
            lengths in read_lengths(),
        ) {
            let mut bytes = Vec::new();
            let mut expected = Vec::new();
            for (is_first, count, shift) in counts {
                let count = count >> shift;
                let encoder = if is_first { Encoder::One } else { Encoder::Two };
                bytes.extend_from_slice(request_count(encoder));
                bytes.extend_from_slice(format!("{}\r", shortened(count)).as_bytes());
                expected.push(count_of(encoder, count));
            }
            bytes.extend_from_slice(REQUEST_SPEEDS);
            bytes.extend_from_slice(b"01\r02\r");
            expected.push(Message::Speeds([1, 2]));
            prop_assert_eq!(decode_in(EncoderDecoder::default(), &bytes, &lengths), (expected, Dropped::default()));
        }

        #[test]
        fn damage_neither_panics_nor_depends_on_the_reads(
            bytes in prop::collection::vec(prop::sample::select(&b"?QZqz01289AF!^E+-WOK:\r\n"[..]), 0..300),
            damage in damage(b"?q0F!\r"),
        ) {
            let mut angle = WheelAngle::new(WheelEncoder::new(1.0, 0).unwrap());
            for message in damage.decode(EncoderDecoder::default, bytes) {
                match message {
                    Message::Count { count, .. } => prop_assert!(angle.update(count).is_finite()),
                    Message::Speeds(speeds) => prop_assert!(speeds.iter().all(|speed| *speed >= -127)),
                    Message::Restarted => angle.restart(),
                }
            }
        }
    }
}
