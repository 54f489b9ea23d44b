//! Blue Robotics `Ping1D` echo sounder: the ping protocol on a serial line (115200 baud) or UDP.
//!
//! Source: bluerobotics/ping-protocol, README (format and example),
//! `src/definitions/common.json` at 84ec414 and `src/definitions/ping1d.json` at 10c9357. A frame is
//! `BR`, length of the payload, message id, sender, receiver, payload, sum of all bytes before;
//! numbers are little-endian. Distances are from the transducer along its axis.

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder, before_mark};

mod session;

pub use session::Ping1d;

const MARK: &[u8] = b"BR";
const HEADER: usize = 8;
/// The longest message, a profile, has 1200 points and 26 bytes before them.
const MAX_PAYLOAD: usize = 2048;
/// Far beyond what a `Ping1D` measures (100 m).
const MAX_RANGE_MM: u32 = 1_000_000;

const ACK: u16 = 1;
const NACK: u16 = 2;
const DEVICE_INFORMATION: u16 = 4;
const GENERAL_REQUEST: u16 = 6;
const SET_SPEED_OF_SOUND: u16 = 1002;
const SET_PING_INTERVAL: u16 = 1004;
const DISTANCE_SIMPLE: u16 = 1211;
const DISTANCE: u16 = 1212;
const PROFILE: u16 = 1300;

/// What a device sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Accepts the message with this id.
    Ack(u16),
    /// Refuses a message.
    Nack {
        /// Its id.
        id: u16,
        /// The reason.
        text: String,
    },
    /// Reply to [`request_device_information`].
    DeviceInformation {
        /// 1: `Ping1D`; 2: Ping360.
        device_type: u8,
        /// Revision of the hardware.
        revision: u8,
        /// Version of the firmware: major, minor, patch.
        firmware: [u8; 3],
    },
    /// Reply to [`request_distance_simple`] and [`request_distance`]; a profile, whose points are
    /// left out.
    Distance(Distance),
}

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Distance to the bottom, metres; NaN if the device found none.
    pub distance_m: f64,
    /// Confidence in the distance, 0 to 100 %.
    pub confidence_percent: u8,
    /// How it was measured; not in a reply to [`request_distance_simple`].
    pub ping: Option<Ping>,
}

/// How a distance was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ping {
    /// Counts measurements since power-on.
    pub number: u32,
    /// Length of the acoustic pulse, seconds.
    pub transmit_duration_s: f64,
    /// Begin of the range that is searched, metres.
    pub scan_start_m: f64,
    /// Length of the range that is searched, metres.
    pub scan_length_m: f64,
    /// Index of the gain, 0 to 6: 0.6, 1.8, 5.5, 12.9, 30.2, 66.1, 144.
    pub gain_index: u8,
}

/// Asks for [`Message::DeviceInformation`].
pub fn request_device_information() -> Vec<u8> {
    frame(GENERAL_REQUEST, &DEVICE_INFORMATION.to_le_bytes())
}

/// Asks for [`Message::Distance`] without [`Ping`].
pub fn request_distance_simple() -> Vec<u8> {
    frame(GENERAL_REQUEST, &DISTANCE_SIMPLE.to_le_bytes())
}

/// Asks for [`Message::Distance`].
pub fn request_distance() -> Vec<u8> {
    frame(GENERAL_REQUEST, &DISTANCE.to_le_bytes())
}

/// Sets the speed of sound that distances are computed with. `None` if no water has it.
pub fn set_speed_of_sound(speed_mps: f64) -> Option<Vec<u8>> {
    let speed_mmps = (speed_mps * 1000.0).round() as u32;
    let is_water = (1_000_000..=2_000_000).contains(&speed_mmps);
    is_water.then(|| frame(SET_SPEED_OF_SOUND, &speed_mmps.to_le_bytes()))
}

/// Sets the time between measurements.
pub fn set_ping_interval(interval_ms: u16) -> Vec<u8> {
    frame(SET_PING_INTERVAL, &interval_ms.to_le_bytes())
}

/// A message from the host (0) to any device (0).
fn frame(id: u16, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u16).to_le_bytes();
    let bytes = [MARK, &length, &id.to_le_bytes(), &[0, 0], payload].concat();
    let sum = sum_of(&bytes).to_le_bytes();
    [&bytes[..], &sum].concat()
}

fn sum_of(bytes: &[u8]) -> u16 {
    let add = |sum: u16, byte: &u8| sum.wrapping_add(u16::from(*byte));
    bytes.iter().fold(0, add)
}

/// Decodes messages.
pub type PingDecoder = StreamDecoder<Message>;

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        let garbage = before_mark(bytes, MARK);
        if garbage > 0 {
            return Front::Skip(DropReason::Garbage, garbage);
        }
        let Some((id, length)) = header(bytes) else {
            return Front::Incomplete;
        };
        let fits = match id {
            ACK => length == 2,
            NACK => length >= 2,
            DEVICE_INFORMATION => (5..=6).contains(&length),
            DISTANCE_SIMPLE => length == 5,
            DISTANCE => length == 24,
            PROFILE => length >= 26,
            _ => true,
        };
        if length > MAX_PAYLOAD || !fits {
            return Front::Skip(DropReason::Length, 1);
        }
        let total = HEADER + length + 2;
        let received = &bytes[..bytes.len().min(total)];
        if let Some(at) = (1..received.len()).find(|at| is_message(&received[*at..])) {
            return Front::Skip(DropReason::CutOff, at);
        }
        if received.len() < total {
            return Front::Incomplete;
        }
        if !is_message(received) {
            return Front::Skip(DropReason::Checksum, 1);
        }
        match id {
            ACK | NACK | DEVICE_INFORMATION | DISTANCE_SIMPLE | DISTANCE | PROFILE => {
                match message(id, &received[HEADER..HEADER + length]) {
                    Some(message) => Front::Message(message, total),
                    None => Front::Skip(DropReason::Field, total),
                }
            }
            _ => Front::Skip(DropReason::UnknownKind, total),
        }
    }
}

/// Id and length of the payload of a message at the front.
fn header(bytes: &[u8]) -> Option<(u16, usize)> {
    let header = bytes.first_chunk::<HEADER>()?;
    let [_, _, length_low, length_high, id_low, id_high, ..] = *header;
    let length = u16::from_le_bytes([length_low, length_high]);
    Some((u16::from_le_bytes([id_low, id_high]), usize::from(length)))
}

/// Whether a message with a right sum is at the front.
fn is_message(bytes: &[u8]) -> bool {
    let sum_is_right = |(_, length): (u16, usize)| {
        let (summed, rest) = bytes.split_at_checked(HEADER + length)?;
        Some(rest.first_chunk()? == &sum_of(summed).to_le_bytes())
    };
    bytes.starts_with(MARK) && header(bytes).and_then(sum_is_right) == Some(true)
}

/// `None` if a field is impossible.
fn message(id: u16, payload: &[u8]) -> Option<Message> {
    let mut rest = payload;
    let mut next = |length: usize| {
        let (number, after) = rest.split_at_checked(length)?;
        rest = after;
        let add = |number: u32, byte: &u8| number << 8 | u32::from(*byte);
        Some(number.iter().rev().fold(0, add))
    };
    match id {
        ACK => Some(Message::Ack(next(2)? as u16)),
        NACK => Some(Message::Nack {
            id: next(2)? as u16,
            text: String::from_utf8_lossy(rest).into_owned(),
        }),
        DEVICE_INFORMATION => Some(Message::DeviceInformation {
            device_type: next(1)? as u8,
            revision: next(1)? as u8,
            firmware: [next(1)? as u8, next(1)? as u8, next(1)? as u8],
        }),
        DISTANCE_SIMPLE => Some(Message::Distance(distance(next(4)?, next(1)?, None)?)),
        _ => {
            let (distance_mm, confidence_percent) = (next(4)?, next(2)?);
            let ping = Ping {
                transmit_duration_s: f64::from(next(2)?) / 1e6,
                number: next(4)?,
                scan_start_m: metres(next(4)?)?,
                scan_length_m: metres(next(4)?)?,
                gain_index: u8::try_from(next(4)?).ok().filter(|index| *index <= 6)?,
            };
            let points = if id == PROFILE { next(2)? } else { 0 };
            let is_whole = rest.len() == points as usize;
            let measured = distance(distance_mm, confidence_percent, Some(ping))?;
            is_whole.then_some(Message::Distance(measured))
        }
    }
}

fn distance(distance_mm: u32, confidence_percent: u32, ping: Option<Ping>) -> Option<Distance> {
    let confidence_percent = u8::try_from(confidence_percent).ok()?;
    let distance_m = metres(distance_mm)?;
    let is_found = confidence_percent > 0 && distance_mm > 0;
    (confidence_percent <= 100).then_some(Distance {
        distance_m: if is_found { distance_m } else { f64::NAN },
        confidence_percent,
        ping,
    })
}

fn metres(range_mm: u32) -> Option<f64> {
    (range_mm <= MAX_RANGE_MM).then(|| f64::from(range_mm) / 1000.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Dropped;
    use crate::test_decoding::*;

    /// README, "Pack and unpack example": 7515 mm, 100 %.
    const EXAMPLE: [u8; 15] = [
        0x42, 0x52, 0x05, 0x00, 0xBB, 0x04, 0x00, 0x00, 0x5B, 0x1D, 0x00, 0x00, 0x64, 0x34, 0x02,
    ];

    const MEASURED: Message = Message::Distance(Distance {
        distance_m: 7.515,
        confidence_percent: 100,
        ping: None,
    });

    /// Payload of a distance message: 2.5 m, 95 %, 300 µs, ping 70000, 0.2 m to 30.2 m, gain 3.
    const PAYLOAD: [u8; 24] = [
        0xC4, 0x09, 0, 0, 95, 0, 0x2C, 0x01, 0x70, 0x11, 1, 0, 200, 0, 0, 0, 0x30, 0x75, 0, 0, 3,
        0, 0, 0,
    ];

    #[test]
    fn bytes_of_the_documentation() {
        assert_eq!(decode_one(PingDecoder::default(), &EXAMPLE), MEASURED);
        assert_eq!(
            request_distance_simple(),
            [
                0x42, 0x52, 0x02, 0x00, 0x06, 0x00, 0x00, 0x00, 0xBB, 0x04, 0x5B, 0x01
            ]
        );
        // tests/serialize.rs of bluerobotics/ping-rs at 717a002.
        assert_eq!(
            frame(GENERAL_REQUEST, &[5, 0]),
            [
                0x42, 0x52, 0x02, 0x00, 0x06, 0x00, 0x00, 0x00, 0x05, 0x00, 0xA1, 0x00
            ]
        );
    }

    #[test]
    fn settings() {
        let speed = set_speed_of_sound(1482.5).unwrap();
        assert_eq!(speed[4..12], [0xEA, 0x03, 0, 0, 0x04, 0x9F, 0x16, 0x00]);
        for refused in [0.0, -1500.0, 343.0, 5000.0, f64::NAN, f64::INFINITY] {
            assert_eq!(set_speed_of_sound(refused), None);
        }
        assert_eq!(set_ping_interval(100)[2..10], [2, 0, 0xEC, 3, 0, 0, 100, 0]);
    }

    #[test]
    fn all_messages() {
        let measured = Message::Distance(Distance {
            distance_m: 2.5,
            confidence_percent: 95,
            ping: Some(Ping {
                number: 70_000,
                transmit_duration_s: 0.0003,
                scan_start_m: 0.2,
                scan_length_m: 30.0,
                gain_index: 3,
            }),
        });
        let profile = [&PAYLOAD[..], &[3, 0, 7, 8, 9]].concat();
        for (id, payload, expected) in [
            (ACK, &[0xEA, 0x03][..], Message::Ack(1002)),
            (
                NACK,
                &[6, 0, b'n', b'o', 0xFF],
                Message::Nack {
                    id: 6,
                    text: "no\u{FFFD}".into(),
                },
            ),
            (
                DEVICE_INFORMATION,
                &[1, 2, 3, 28, 5, 0],
                Message::DeviceInformation {
                    device_type: 1,
                    revision: 2,
                    firmware: [3, 28, 5],
                },
            ),
            (DISTANCE, &PAYLOAD, measured.clone()),
            (PROFILE, &profile, measured),
        ] {
            assert_eq!(
                decode_one(PingDecoder::default(), &frame(id, payload)),
                expected
            );
        }
    }

    #[test]
    fn no_bottom_is_no_distance() {
        for payload in [[0xC4, 0x09, 0, 0, 0], [0, 0, 0, 0, 100]] {
            let Message::Distance(found) =
                decode_one(PingDecoder::default(), &frame(DISTANCE_SIMPLE, &payload))
            else {
                panic!()
            };
            assert!(found.distance_m.is_nan());
        }
    }

    #[test]
    fn bad_frames_are_dropped_and_the_next_is_found() {
        let changed = |at: usize, byte| {
            let mut payload = PAYLOAD;
            payload[at] = byte;
            frame(DISTANCE, &payload)
        };
        let mut wrong_sum = EXAMPLE;
        wrong_sum[13] += 1;
        for (bad, reason, count) in [
            (b"BxB\x00\xFFB".to_vec(), DropReason::Garbage, 6),
            (wrong_sum.to_vec(), DropReason::Checksum, 1),
            (frame(1203, &[0; 4]), DropReason::UnknownKind, 1),
            (
                frame(PROFILE, &[&PAYLOAD[..], &[3, 0, 7, 8]].concat()),
                DropReason::Field,
                1,
            ),
            (frame(ACK, &[0]), DropReason::Length, 1),
            (frame(NACK, &[0]), DropReason::Length, 1),
            (frame(DEVICE_INFORMATION, &[0; 7]), DropReason::Length, 1),
            (frame(DISTANCE_SIMPLE, &[0; 4]), DropReason::Length, 1),
            (frame(DISTANCE, &[0; 25]), DropReason::Length, 1),
            (frame(PROFILE, &[0; 25]), DropReason::Length, 1),
            (
                b"BR\x01\x08\x99\x99\x00\x00".to_vec(),
                DropReason::Length,
                1,
            ),
            // Confidence, distance, range, gain.
            (changed(4, 101), DropReason::Field, 1),
            (changed(5, 1), DropReason::Field, 1),
            (changed(2, 0x10), DropReason::Field, 1),
            (changed(15, 1), DropReason::Field, 1),
            (changed(20, 7), DropReason::Field, 1),
            // Cut off in the header: the length is that of no message. In the payload.
            (EXAMPLE[..3].to_vec(), DropReason::Length, 1),
            (EXAMPLE[..12].to_vec(), DropReason::Checksum, 1),
            (
                frame(PROFILE, &[9; 1226])[..40].to_vec(),
                DropReason::CutOff,
                1,
            ),
        ] {
            let bytes = [&bad[..], &EXAMPLE].concat();
            for length in [1, 5, usize::MAX] {
                let (messages, dropped) = decode_in(PingDecoder::default(), &bytes, &[length]);
                assert_eq!(messages, [MEASURED], "{bad:?}");
                assert_eq!(dropped.count(reason), count, "{bad:?} {dropped:?}");
            }
        }
    }

    fn any_frame() -> impl Strategy<Value = Vec<u8>> {
        let simple = (0..=MAX_RANGE_MM, 0..=100_u8);
        let simple = simple.prop_map(|(distance_mm, confidence_percent)| {
            let payload = [&distance_mm.to_le_bytes()[..], &[confidence_percent]].concat();
            frame(DISTANCE_SIMPLE, &payload)
        });
        let text = proptest::collection::vec(0x20..0x7F_u8, 2..40);
        let nack = text.prop_map(|text| frame(NACK, &text));
        prop_oneof![simple, nack, Just(frame(DISTANCE, &PAYLOAD))]
    }

    proptest! {
        #[test]
        fn any_split_gives_the_same_messages(
            frames in proptest::collection::vec(any_frame(), 1..10),
            lengths in read_lengths(),
        ) {
            let bytes = frames.concat();
            let (messages, dropped) = decode_in(PingDecoder::default(), &bytes, &lengths);
            prop_assert_eq!(messages.len(), frames.len());
            prop_assert_eq!(&dropped, &Dropped::default());
            // Debug text: NaN is not equal to itself.
            let whole = decode(PingDecoder::default(), &bytes).0;
            prop_assert_eq!(format!("{messages:?}"), format!("{whole:?}"));
        }

        #[test]
        fn damage_neither_panics_nor_gives_senseless_messages(
            frames in proptest::collection::vec(any_frame(), 1..10),
            damage in damage(b"BR\x01\x05\x00"),
        ) {
            for message in damage.decode(PingDecoder::default, frames.concat()) {
                let Message::Distance(found) = message else { continue };
                let is_range = |range_m: f64| (0.0..=1000.0).contains(&range_m);
                prop_assert!(found.distance_m.is_nan() || is_range(found.distance_m));
                prop_assert!(found.confidence_percent <= 100);
                let is_possible = |ping: Ping| {
                    let ranges_m = [ping.scan_start_m, ping.scan_length_m];
                    ranges_m.into_iter().all(is_range) && ping.gain_index <= 6
                };
                prop_assert!(found.ping.is_none_or(is_possible));
            }
        }
    }
}
