//! Imagenex 852 echo sounder and 881A scanning sonar, RS-485 or RS-232 at 115200 baud, 8N1.
//!
//! Source: Imagenex, Model 852 Digital Echo Sounder, Serial Interface Specification v1.04, called
//! "manual" below. Of the 881A: `src/Sensors/Imagenex881A/Parser.hpp` of LSTS/dune at 1e90d27 and
//! `Task.cpp` at 033f28d; ranges over 100 m: data sheet 445-017. Each switch command makes one shot.
//! A reply is a header of 12 bytes, 0, 252 or 500 bytes of echo and `FC`; it has no checksum. Ranges
//! are from the transducer along its axis.

use crate::read_buffer::{Front, ReadBuffer};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::Imagenex852;

const HEADER: usize = 12;
const TERMINATOR: u8 = 0xFC;
/// The devices compute ranges with this speed of sound.
const DEVICE_SOUND_SPEED_MPS: f64 = 1500.0;
/// "Minimum detectable range" of the data sheets.
const MIN_RANGE_M: f64 = 0.15;

/// Which sonar is on the line: the replies look alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Echo sounder with a fixed beam.
    EchoSounder852,
    /// Scanning sonar.
    Scanning881A,
}

/// How many echo strengths are sent with a shot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EchoPoints {
    /// The range alone: `IPX`.
    None,
    /// 252: `IMX`.
    Points252,
    /// 500: `IGX`.
    Points500,
}

/// Settings of a shot of the 852.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// 0x11 to 0x15; 0x11 unless the unit was ordered otherwise.
    pub head_id: u8,
    /// Greatest range: 5, 10, 20, 30, 40 or 50 m.
    pub max_range_m: u8,
    /// The first echo beyond this is measured; 0 to 25 m, steps of 0.1 m.
    pub min_range_m: f64,
    /// 0 to 40 dB.
    pub start_gain_db: u8,
    /// Steps of 0.01 dB/m: 20 at 675 kHz; not 253.
    pub absorption_cdb_per_m: u8,
    /// 1 to 255 µs, not 253.
    pub pulse_length_us: u8,
    /// Echo strengths in the reply.
    pub echo: EchoPoints,
}

/// Asks the 852 for one [`Shot`]. `None` if a setting is none of the device.
///
/// Byte 6 (send data) is from `sonar_imagenex852` of CIDCO's Poseidon, whose recording is decoded in
/// the tests; the external trigger is not used.
pub fn request_shot_852(settings: &Settings) -> Option<[u8; 27]> {
    let (points, profile) = match settings.echo {
        EchoPoints::None => (0, 1),
        EchoPoints::Points252 => (25, 0),
        EchoPoints::Points500 => (50, 0),
    };
    let is_possible = Model::EchoSounder852.has_head(settings.head_id)
        && Model::EchoSounder852.has_range(settings.max_range_m)
        && (0.0..=25.0).contains(&settings.min_range_m)
        && settings.start_gain_db <= 40
        && settings.pulse_length_us > 0;
    let mut command = [0; 27];
    command[..4].copy_from_slice(&[0xFE, 0x44, settings.head_id, settings.max_range_m]);
    command[6] = 0x43;
    command[8] = settings.start_gain_db;
    command[10] = settings.absorption_cdb_per_m;
    command[14] = settings.pulse_length_us;
    command[15] = (settings.min_range_m * 10.0).round() as u8;
    command[19] = points;
    command[22] = profile;
    // The device stops at the first 253, which is the last byte.
    let is_whole = !command.contains(&0xFD);
    command[26] = 0xFD;
    (is_possible && is_whole).then_some(command)
}

/// One shot.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Which head replies.
    pub head_id: u8,
    /// The head has accepted the command.
    pub switches_accepted: bool,
    /// The head has lost characters of the command.
    pub character_overrun: bool,
    /// Where the 881A's head points, −180° to 180° from its zero mark, radians.
    pub head_angle_rad: Option<f64>,
    /// Greatest range that was searched, metres at 1500 m/s.
    pub max_range_m: f64,
    /// First range whose echo is above the threshold, metres at 1500 m/s: infinite without an echo,
    /// NaN below the smallest range of the device.
    pub range_m: f64,
    /// Strength of the echo, evenly over [`Self::max_range_m`]: 0, 252 or 500 points.
    pub echo: Vec<u8>,
}

impl Shot {
    /// [`Self::range_m`] at a speed of sound; `None` if no water has it.
    pub fn range_at_m(&self, sound_speed_mps: f64) -> Option<f64> {
        let is_water = (1300.0..=1700.0).contains(&sound_speed_mps);
        is_water.then(|| self.range_m * (sound_speed_mps / DEVICE_SOUND_SPEED_MPS))
    }
}

/// Decodes shots.
#[derive(Debug)]
pub struct ImagenexDecoder {
    model: Model,
    buffer: ReadBuffer,
}

impl ImagenexDecoder {
    /// For this sonar.
    pub fn new(model: Model) -> Self {
        Self {
            model,
            buffer: ReadBuffer::default(),
        }
    }
}

impl Decoder for ImagenexDecoder {
    type Message = Shot;

    fn push(&mut self, bytes: &[u8]) {
        self.buffer.push(bytes);
    }

    fn next_message(&mut self) -> Option<Shot> {
        self.buffer.next_message(|bytes| self.model.front(bytes))
    }

    fn dropped(&self) -> &Dropped {
        &self.buffer.dropped
    }
}

impl Model {
    fn has_head(self, head_id: u8) -> bool {
        match self {
            Self::EchoSounder852 => (0x11..=0x15).contains(&head_id),
            Self::Scanning881A => head_id == 0x10,
        }
    }

    fn has_range(self, max_range_m: u8) -> bool {
        match self {
            Self::EchoSounder852 => matches!(max_range_m, 5 | 10 | 20 | 30 | 40 | 50),
            Self::Scanning881A => (1..=200).contains(&max_range_m),
        }
    }

    fn front(self, bytes: &[u8]) -> Front<Shot> {
        let mark_is_at = |at: &usize| begins(&bytes[*at..]);
        match (0..bytes.len()).find(mark_is_at) {
            Some(0) => {}
            garbage => return Front::Skip(DropReason::Garbage, garbage.unwrap_or(bytes.len())),
        }
        let Some(header) = bytes.first_chunk() else {
            return Front::Incomplete;
        };
        let (shot, points) = match self.header(header) {
            Ok(header) => header,
            Err(reason) => return Front::Skip(reason, 1),
        };
        let total = HEADER + points + 1;
        let received = &bytes[..bytes.len().min(total)];
        let header_is_at = |at: &usize| {
            let header = received[*at..].first_chunk();
            header.is_some_and(|header| self.header(header).is_ok())
        };
        if let Some(next) = (1..received.len()).find(header_is_at) {
            return Front::Skip(DropReason::CutOff, next);
        }
        match received.get(HEADER..total) {
            None => Front::Incomplete,
            Some([echo @ .., TERMINATOR]) => {
                let echo = echo.to_vec();
                Front::Message(Shot { echo, ..shot }, total)
            }
            Some(_) => Front::Skip(DropReason::CutOff, 1),
        }
    }

    /// A shot without its echo, and the number of points that follow.
    fn header(self, bytes: &[u8; HEADER]) -> Result<(Shot, usize), DropReason> {
        let [
            _,
            kind,
            _,
            head_id,
            status,
            low,
            high,
            max_range_m,
            ref packed @ ..,
        ] = *bytes;
        let [range_low, range_high, points_low, points_high] = *packed;
        if !begins(bytes) {
            return Err(DropReason::Garbage);
        }
        if !self.has_head(head_id) {
            return Err(DropReason::UnknownKind);
        }
        let points = unpack(points_low, points_high).map(usize::from);
        match (kind, points) {
            (b'P', Some(0)) | (b'M', Some(252)) | (b'G', Some(500)) => {}
            _ => return Err(DropReason::Length),
        }
        let is_small = self == Self::Scanning881A && max_range_m < 5;
        let step_m = if is_small { 0.002 } else { 0.01 };
        let range = unpack(range_low, range_high).ok_or(DropReason::Field)?;
        let range_m = f64::from(range) * step_m;
        let head_angle_rad = match self {
            Self::EchoSounder852 => None,
            Self::Scanning881A => Some(head_angle_rad(low, high).ok_or(DropReason::Field)?),
        };
        if !self.has_range(max_range_m) || range_m > f64::from(max_range_m) {
            return Err(DropReason::Field);
        }
        let shot = Shot {
            head_id,
            switches_accepted: status & 0x40 != 0,
            character_overrun: status & 0x80 != 0,
            head_angle_rad,
            max_range_m: f64::from(max_range_m),
            range_m: match range {
                0 => f64::INFINITY,
                _ if range_m < MIN_RANGE_M => f64::NAN,
                _ => range_m,
            },
            echo: Vec::new(),
        };
        Ok((shot, points.unwrap_or_default()))
    }
}

/// Whether a mark, or its beginning at the very end, stands at the front.
fn begins(bytes: &[u8]) -> bool {
    let kind_fits = |kind: &u8| matches!(kind, b'M' | b'G' | b'P');
    bytes.first() == Some(&b'I')
        && bytes.get(1).is_none_or(kind_fits)
        && bytes.get(2).is_none_or(|last| *last == b'X')
}

/// A number of 14 bits, 7 in each byte; the highest bit of both is 0.
fn unpack(low: u8, high: u8) -> Option<u16> {
    ((low | high) & 0x80 == 0).then(|| u16::from(high) << 7 | u16::from(low))
}

/// Steps of 0.3°, 600 is zero. Bit 6 of the high byte is the direction of the next step.
fn head_angle_rad(low: u8, high: u8) -> Option<f64> {
    let step = unpack(low, high & !0x40).filter(|step| *step <= 1200)?;
    Some((f64::from(step) - 600.0) * 0.3_f64.to_radians())
}

#[cfg(test)]
mod tests;
