//! SICK LD-LRS and LD-OEM laser scanners: the user service protocol, TCP port 49152.
//!
//! Source: the driver of ros-drivers/sicktoolbox at 0d0b846 (`c++/drivers/ld/sickld-1.0/SickLD.cc`,
//! `SickLDMessage.cc`; BSD), which names pages of SICK's telegram listing; the services also
//! `trunk/src/laser360/ldTelegramCodes.h` of BackupTheBerlios/miro-middleware-svn. No bytes of a device
//! were at hand: **not proved on hardware**. That angles grow counter-clockwise as seen from above, and
//! that a distance of 0 is no range, is how `ros/sickld/sickld.cpp` of ros-drivers/sicktoolbox_wrapper
//! at cca88ac takes them. The device sends 0 both without an echo and for an error.
//!
//! A telegram is STX, `USP`, the length of the payload (u32), the payload and the exclusive or of its
//! bytes. A payload begins with a service; a reply has its highest bit set. Numbers are big-endian
//! words of 16 bits; angles are 1/16°.

use measurement::scan::Scan;

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder, before_mark};

mod session;

pub use session::SickLdlrs;

const MARK: &[u8] = b"\x02USP";
const HEADER: usize = 8;
/// A whole turn in steps of 1/16° with echoes.
const MAX_PAYLOAD: usize = 32 * 1024;
const TICKS_PER_TURN: u16 = 5760;
const MAX_SECTORS: u16 = 8;
const MAX_TEXT: usize = 128;
const REPLY: u16 = 0x8000;
/// The device refuses a sector.
const REFUSED: u16 = 0xFFFF;

const GET_IDENTIFICATION: u16 = 0x0101;
const GET_STATUS: u16 = 0x0102;
const SET_CONFIGURATION: u16 = 0x0201;
const GET_CONFIGURATION: u16 = 0x0202;
const SET_FUNCTION: u16 = 0x020A;
const GET_FUNCTION: u16 = 0x020B;
const GET_PROFILE: u16 = 0x0301;
const CANCEL_PROFILE: u16 = 0x0302;
const TRANS_IDLE: u16 = 0x0402;
const TRANS_ROTATE: u16 = 0x0403;
const TRANS_MEASURE: u16 = 0x0404;

/// The part of the configuration that concerns the whole device.
const GLOBAL: u16 = 0x0010;
const SERIAL_NUMBER: u16 = 0x0003;
/// Everything but a direction and an echo for each distance.
const FORMAT: u16 = 0x39FF;

/// What a host asks of a scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Reply: [`Message::SerialNumber`].
    ReadSerialNumber,
    /// Reply: [`Message::Status`].
    ReadStatus,
    /// Reply: [`Message::Global`].
    ReadGlobal,
    /// Keeps it in the flash memory, while the motor stands. Reply: [`Message::GlobalSet`].
    SetGlobal(Global),
    /// Reply: [`Message::Sector`].
    ReadSector(u16),
    /// Until power-off; not while measuring. Reply: [`Message::SectorSet`].
    SetSector(Sector),
    /// Stops the motor. From measuring, first [`Request::Rotate`]. Reply: [`Message::Status`].
    Idle,
    /// Turns the motor. Reply: [`Message::Status`].
    Rotate,
    /// Switches the laser on; from rotating alone. Reply: [`Message::Status`].
    Measure,
    /// All turns from now on. Reply: [`Message::ProfilesBegin`] or the first [`Message::Profile`].
    SendProfiles,
    /// Reply: [`Message::ProfilesEnd`].
    StopProfiles,
}

/// The configuration of the whole device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Global {
    /// Number of the sensor, 1 to 254.
    pub sensor_id: u16,
    /// Turns per second, 5 to 20.
    pub motor_hz: u16,
    /// Angle between beams, 1/16°; a divisor of 5760 above 1.
    pub step_ticks: u16,
}

/// A part of the turn, from the end of the sector before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sector {
    /// 0 to 7.
    pub number: u16,
    /// 0 not initialised (the sectors end before it), 1 not measured, 3 measured, 4 reference.
    pub function: u16,
    /// Last direction, 1/16°.
    pub stop_ticks: u16,
}

impl Request {
    /// The telegram.
    pub fn to_bytes(self) -> Vec<u8> {
        let words = match self {
            Self::ReadSerialNumber => vec![GET_IDENTIFICATION, SERIAL_NUMBER],
            Self::ReadStatus => vec![GET_STATUS],
            Self::ReadGlobal => vec![GET_CONFIGURATION, GLOBAL],
            Self::SetGlobal(global) => vec![
                SET_CONFIGURATION,
                GLOBAL,
                global.sensor_id,
                global.motor_hz,
                global.step_ticks,
            ],
            Self::ReadSector(number) => vec![GET_FUNCTION, number],
            Self::SetSector(sector) => vec![
                SET_FUNCTION,
                sector.number,
                sector.function,
                sector.stop_ticks,
                0, // Not into the flash memory.
            ],
            Self::Idle => vec![TRANS_IDLE],
            // Speed and step as configured.
            Self::Rotate => vec![TRANS_ROTATE, 0],
            Self::Measure => vec![TRANS_MEASURE],
            // 0 turns: without end.
            Self::SendProfiles => vec![GET_PROFILE, 0, FORMAT],
            Self::StopProfiles => vec![CANCEL_PROFILE],
        };
        let payload: Vec<u8> = words.into_iter().flat_map(u16::to_be_bytes).collect();
        let length = (payload.len() as u32).to_be_bytes();
        [MARK, &length, &payload, &[checksum(&payload)]].concat()
    }
}

/// What a scanner sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Reply to [`Request::ReadSerialNumber`].
    SerialNumber(String),
    /// The state.
    Status(Status),
    /// The configuration.
    Global(Global),
    /// Whether a configuration was taken.
    GlobalSet(bool),
    /// A sector.
    Sector(Sector),
    /// Whether a sector was taken.
    SectorSet(bool),
    /// Profiles follow.
    ProfilesBegin,
    /// No more profiles.
    ProfilesEnd,
    /// One turn.
    Profile(Profile),
}

/// State of a scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// What the scanner does.
    pub mode: Mode,
    /// 0 good, 4 and 9 the speed is wrong, 11 it stands or its encoder is faulty.
    pub motor: u8,
    /// Why measuring was refused: see [`refusal_meaning`]; 0 if it was not.
    pub refusal: u16,
}

/// What a scanner does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Motor and laser are off.
    Idle,
    /// The laser is off.
    Rotating,
    /// It measures.
    Measuring,
    /// It is faulty.
    Error,
    /// A mode that is not known.
    Unknown(u8),
}

/// What [`Status::refusal`] means.
pub fn refusal_meaning(code: u16) -> &'static str {
    match code {
        0 => "not refused",
        1 => "the laser would have to pulse too fast",
        2 => "the laser would have to pulse too fast on average",
        3 => "the sectors are configured wrongly",
        4 => "the ends of sectors are no multiples of the step",
        _ => "unknown",
    }
}

/// One turn.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Counts turns that the device measured, modulo 2¹⁶.
    pub counter: u16,
    /// Sectors that measured.
    pub sectors: Vec<SectorData>,
    /// State of the scanner.
    pub status: Status,
}

/// One sector of a turn.
#[derive(Clone, Debug, PartialEq)]
pub struct SectorData {
    /// Which sector.
    pub number: u16,
    /// Angle between beams, 1/16°.
    pub step_ticks: u16,
    /// Direction of the first beam, 1/16°.
    pub start_ticks: u16,
    /// Device time of the first beam, ms, modulo 2¹⁶.
    pub start_ms: u16,
    /// Device time of the last beam, ms, modulo 2¹⁶.
    pub end_ms: u16,
    /// Distances in 1/256 m; 0 is none.
    pub distances: Vec<u16>,
}

impl SectorData {
    /// The scan in SI units, in the sensor's frame. The device sends neither its limits nor its speed:
    /// they are those of the data sheet and of [`Global`]. A distance of 0 is range 0, whose meaning is a
    /// setting of the vehicle. `None` if an argument is impossible.
    pub fn to_scan(&self, motor_hz: u16, range_min_m: f32, range_max_m: f32) -> Option<Scan> {
        let is_possible = (1..=100).contains(&motor_hz)
            && (0.0..range_max_m).contains(&range_min_m)
            && range_max_m.is_finite();
        let range_m = |distance: &u16| {
            let range_m = f32::from(*distance) / 256.0;
            match distance {
                0 => 0.0,
                _ if range_m < range_min_m => f32::NAN,
                _ if range_m >= range_max_m => f32::INFINITY,
                _ => range_m,
            }
        };
        let turns = |ticks: u16| f64::from(ticks) / f64::from(TICKS_PER_TURN);
        let step = turns(self.step_ticks);
        is_possible.then(|| Scan {
            angle_min_rad: (turns(self.start_ticks) * std::f64::consts::TAU) as f32,
            angle_increment_rad: (step * std::f64::consts::TAU) as f32,
            time_increment_s: (step / f64::from(motor_hz)) as f32,
            range_min_m,
            range_max_m,
            ranges_m: self.distances.iter().map(range_m).collect(),
        })
    }
}

/// Decodes what scanners send.
pub type LdlrsDecoder = StreamDecoder<Message>;

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        let garbage = before_mark(bytes, MARK);
        if garbage > 0 {
            return Front::Skip(DropReason::Garbage, garbage);
        }
        let Some((header, rest)) = bytes.split_first_chunk::<HEADER>() else {
            return Front::Incomplete;
        };
        let [.., a, b, c, d] = *header;
        let length = u32::from_be_bytes([a, b, c, d]) as usize;
        if !(2..=MAX_PAYLOAD).contains(&length) {
            return Front::Skip(DropReason::Length, 1);
        }
        let total = HEADER + length + 1;
        let received = &bytes[..bytes.len().min(total)];
        if let Some(next) = (1..received.len()).find(|at| received[*at..].starts_with(MARK)) {
            return Front::Skip(DropReason::CutOff, next);
        }
        match (rest.get(..length), rest.get(length)) {
            (Some(payload), Some(sum)) if checksum(payload) == *sum => match message(payload) {
                Ok(message) => Front::Message(message, total),
                Err(DropReason::UnknownKind) => Front::Skip(DropReason::UnknownKind, total),
                Err(reason) => Front::Skip(reason, 1),
            },
            (Some(_), Some(_)) => Front::Skip(DropReason::Checksum, 1),
            _ => Front::Incomplete,
        }
    }
}

fn checksum(payload: &[u8]) -> u8 {
    payload.iter().fold(0, |sum, byte| sum ^ byte)
}

fn message(payload: &[u8]) -> Result<Message, DropReason> {
    let mut words = Words(payload);
    let service = words.next()?;
    let message = match service ^ REPLY {
        GET_IDENTIFICATION => {
            let text = words.0.split(|byte| *byte == 0).next().unwrap_or_default();
            if text.len() > MAX_TEXT {
                return Err(DropReason::Length);
            }
            words.0 = &[];
            Message::SerialNumber(String::from_utf8_lossy(text).trim().to_owned())
        }
        GET_STATUS | TRANS_IDLE | TRANS_ROTATE | TRANS_MEASURE => {
            // Behind the state are values that differ between services.
            let status = words.status()?;
            words.0 = &[];
            Message::Status(if service == TRANS_MEASURE | REPLY {
                status
            } else {
                Status {
                    refusal: 0,
                    ..status
                }
            })
        }
        GET_CONFIGURATION => {
            if words.next()? != GLOBAL {
                return Err(DropReason::UnknownKind);
            }
            Message::Global(Global {
                sensor_id: words.next()?,
                motor_hz: words.next()?,
                step_ticks: words.next()?,
            })
        }
        SET_CONFIGURATION => Message::GlobalSet(words.next()? == 0),
        GET_FUNCTION => Message::Sector(Sector {
            number: words.next()?,
            function: words.next()?,
            stop_ticks: words.next()?,
        }),
        SET_FUNCTION => {
            let is_set = words.next()? != REFUSED;
            words.0 = &[];
            Message::SectorSet(is_set)
        }
        GET_PROFILE if words.0.len() <= 2 => {
            words.0 = &[];
            Message::ProfilesBegin
        }
        GET_PROFILE => Message::Profile(words.profile()?),
        CANCEL_PROFILE => {
            words.0 = &[];
            Message::ProfilesEnd
        }
        _ => return Err(DropReason::UnknownKind),
    };
    let is_whole = words.0.is_empty();
    is_whole.then_some(message).ok_or(DropReason::Length)
}

/// Words that wait to be read.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn next(&mut self) -> Result<u16, DropReason> {
        let (word, rest) = self.0.split_first_chunk().ok_or(DropReason::Length)?;
        self.0 = rest;
        Ok(u16::from_be_bytes(*word))
    }

    /// Two words, of which the second tells the state; and, if there is one, that of a refusal.
    fn status(&mut self) -> Result<Status, DropReason> {
        self.next()?;
        let state = self.next()? as u8;
        Ok(Status {
            mode: match state & 0xF {
                1 => Mode::Idle,
                2 => Mode::Rotating,
                3 => Mode::Measuring,
                4 => Mode::Error,
                other => Mode::Unknown(other),
            },
            motor: state >> 4,
            refusal: self.next().unwrap_or(0),
        })
    }

    fn profile(&mut self) -> Result<Profile, DropReason> {
        if self.next()? != FORMAT {
            return Err(DropReason::UnknownKind);
        }
        let sectors = self.next()? & 0xFF;
        let _sent = self.next()?;
        let counter = self.next()?;
        let _layer = self.next()?;
        if sectors > MAX_SECTORS {
            return Err(DropReason::Length);
        }
        let sectors = (0..sectors)
            .map(|_| self.sector())
            .collect::<Result<_, _>>()?;
        Ok(Profile {
            counter,
            sectors,
            status: self.status()?,
        })
    }

    fn sector(&mut self) -> Result<SectorData, DropReason> {
        let number = self.next()?;
        let step_ticks = self.next()?;
        let points = self.next()?;
        let start_ms = self.next()?;
        let start_ticks = self.next()?;
        if usize::from(points) > self.0.len() / 2 {
            return Err(DropReason::Length);
        }
        let swept = u32::from(step_ticks) * u32::from(points.saturating_sub(1));
        if step_ticks == 0 || start_ticks >= TICKS_PER_TURN || swept > TICKS_PER_TURN.into() {
            return Err(DropReason::Field);
        }
        let distances = (0..points).map(|_| self.next()).collect::<Result<_, _>>()?;
        let end_ms = self.next()?;
        let _last_direction = self.next()?;
        Ok(SectorData {
            number,
            step_ticks,
            start_ticks,
            start_ms,
            end_ms,
            distances,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Dropped;
    use crate::test_decoding::*;

    /// A reply apart from the code under test.
    fn reply(words: &[u16]) -> Vec<u8> {
        let payload: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        let sum = payload.iter().fold(0, |sum, byte| sum ^ byte);
        let length = (payload.len() as u32).to_be_bytes();
        [&b"\x02USP"[..], &length, &payload, &[sum]].concat()
    }

    /// A turn with two sectors: 4 beams of 0.25° from 90° on, 3 of 0.5° from 359° on.
    const TURN: [u16; 29] = [
        0x8301, 0x39FF, 2, 7, 4711, 0, //
        1, 4, 4, 65_500, 1440, 0, 127, 2560, 64_000, 65_530, 1452, //
        3, 8, 3, 20, 5744, 256, 257, 25_600, 40, 5760, //
        0x1234, 0x0003,
    ];

    fn turn() -> Vec<u8> {
        reply(&TURN)
    }

    fn message_of(words: &[u16]) -> Message {
        decode_one(LdlrsDecoder::default(), &reply(words))
    }

    #[test]
    fn requests() {
        for (request, words) in [
            (Request::ReadSerialNumber, &[0x0101_u16, 3][..]),
            (Request::Rotate, &[0x0403, 0]),
            (Request::SendProfiles, &[0x0301, 0, 0x39FF]),
        ] {
            assert_eq!(request.to_bytes(), reply(words), "{request:?}");
        }
        let sector = Sector {
            number: 2,
            function: 3,
            stop_ticks: 0x1680,
        };
        assert_eq!(
            Request::SetSector(sector).to_bytes(),
            hex("02 555350 0000000A 020A 0002 0003 1680 0000 9F")
        );
        let global = Global {
            sensor_id: 1,
            motor_hz: 5,
            step_ticks: 4,
        };
        assert_eq!(
            Request::SetGlobal(global).to_bytes(),
            hex("02 555350 0000000A 0201 0010 0001 0005 0004 13")
        );
    }

    #[test]
    fn replies() {
        let status = |mode, motor, refusal| {
            Message::Status(Status {
                mode,
                motor,
                refusal,
            })
        };
        for (words, expected) in [
            (&[0x8102, 0, 0x0001, 9, 9][..], status(Mode::Idle, 0, 0)),
            (&[0x8403, 0, 0x0002], status(Mode::Rotating, 0, 0)),
            (&[0x8404, 0, 0x0093, 2], status(Mode::Measuring, 9, 2)),
            (
                &[0x8202, 0x10, 1, 5, 4],
                Message::Global(Global {
                    sensor_id: 1,
                    motor_hz: 5,
                    step_ticks: 4,
                }),
            ),
            (&[0x8201, 0], Message::GlobalSet(true)),
            (&[0x8201, 1], Message::GlobalSet(false)),
            (
                &[0x820B, 1, 3, 5756],
                Message::Sector(Sector {
                    number: 1,
                    function: 3,
                    stop_ticks: 5756,
                }),
            ),
            (&[0x820A, 1, 0], Message::SectorSet(true)),
            (&[0x820A, 0xFFFF], Message::SectorSet(false)),
            (&[0x8301, 0x39FF], Message::ProfilesBegin),
            (&[0x8302, 0], Message::ProfilesEnd),
            (
                &[0x8101, 0x3132, 0x3300],
                Message::SerialNumber("123".to_owned()),
            ),
        ] {
            assert_eq!(message_of(words), expected, "{words:04X?}");
        }
    }

    #[test]
    fn a_turn() {
        let Message::Profile(profile) = decode_one(LdlrsDecoder::default(), &turn()) else {
            panic!();
        };
        assert_eq!((profile.counter, profile.sectors.len()), (4711, 2));
        assert_eq!(profile.status.mode, Mode::Measuring);
        let first = &profile.sectors[0];
        assert_eq!((first.start_ms, first.end_ms), (65_500, 65_530));
        let scan = first.to_scan(5, 0.5, 250.0).unwrap();
        assert!((f64::from(scan.angle_min_rad) - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        assert!((f64::from(scan.angle_increment_rad) - 0.25_f64.to_radians()).abs() < 1e-9);
        assert!((scan.time_increment_s - 0.2 / 1440.0).abs() < 1e-9);
        assert_eq!(scan.ranges_m[..1], [0.0], "no echo or an error");
        assert!(scan.ranges_m[1].is_nan(), "nearer than the device measures");
        assert_eq!(scan.ranges_m[2..3], [10.0]);
        assert!(scan.ranges_m[3].is_infinite(), "250 m");
        let second = profile.sectors[1].to_scan(5, 0.5, 250.0).unwrap();
        assert_eq!(second.ranges_m, [1.0, 257.0 / 256.0, 100.0]);
        for (hz, min, max) in [(0, 0.5, 250.0), (5, 9.0, 9.0), (5, 0.5, f32::INFINITY)] {
            assert_eq!(first.to_scan(hz, min, max), None);
        }
    }

    #[test]
    fn bad_telegrams_are_dropped_by_reason() {
        let good = reply(&[0x8201, 0]);
        let mut wrong_sum = turn();
        *wrong_sum.last_mut().unwrap() ^= 1;
        let changed = |at: usize, word: u16| {
            let mut words = TURN;
            words[at] = word;
            reply(&words)
        };
        for (bytes, reason) in [
            (b"xyz".to_vec(), DropReason::Garbage),
            (wrong_sum, DropReason::Checksum),
            (hex("02555350 FFFFFFFF"), DropReason::Length),
            (hex("02555350 00000001 00 00"), DropReason::Length),
            (reply(&[0x8999, 0]), DropReason::UnknownKind),
            (reply(&[0x0201, 0]), DropReason::UnknownKind),
            (reply(&[0x8202, 0x11, 1, 5, 4]), DropReason::UnknownKind),
            (reply(&[0x8202, 0x10, 1, 5]), DropReason::Length),
            (changed(1, 0x3DFF), DropReason::UnknownKind),
            (changed(2, 9), DropReason::Length),
            (changed(7, 0), DropReason::Field),
            (changed(8, 60_000), DropReason::Length),
            (changed(10, 5760), DropReason::Field),
        ] {
            let (messages, dropped) =
                decode(LdlrsDecoder::default(), &[bytes, good.clone()].concat());
            assert_eq!(messages, [Message::GlobalSet(true)], "{reason}");
            assert!(dropped.count(reason) > 0, "{reason}: {dropped:?}");
        }
    }

    proptest! {
        #[test]
        fn reads_of_any_length_give_the_same(lengths in read_lengths()) {
            let bytes = [turn(), reply(&[0x8301, 0x39FF]), turn()].concat();
            let (messages, dropped) = decode_in(LdlrsDecoder::default(), &bytes, &lengths);
            prop_assert_eq!(messages.len(), 3);
            prop_assert_eq!(dropped, Dropped::default());
        }

        #[test]
        fn damage_gives_no_impossible_turn(damage in damage(&[2, b'U', b'S', b'P', 0x83, 0])) {
            let bytes = [turn(), turn()].concat();
            for message in damage.decode(LdlrsDecoder::default, bytes) {
                if let Message::Profile(profile) = message {
                    for sector in &profile.sectors {
                        let scan = sector.to_scan(5, 0.5, 250.0).unwrap();
                        let possible = |range: &f32| range.is_nan() || *range >= 0.5 || [0.0].contains(range);
                        prop_assert!(scan.ranges_m.iter().all(possible));
                        if !scan.ranges_m.is_empty() {
                            prop_assert!(scan.sweep_duration().is_some());
                        }
                    }
                }
            }
        }
    }
}
