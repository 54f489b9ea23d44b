//! u-blox satellite receivers of generation 9 and later: UBX on a serial line, USB or I²C.
//!
//! Source: u-blox, ZED-F9P Interface Description (UBX-18010854), sections UBX-NAV-PVT,
//! UBX-NAV-RELPOSNED, UBX-ACK, UBX-CFG-VALSET and "Configuration interface", as
//! `pyubx2/ubxtypes_get.py` and `ubxtypes_configdb.py` of semuconsulting/pyubx2 repeat it. Little-endian.
//!
//! NMEA and RTCM on the same port are garbage to this decoder: see [`Setting::nmea_output`].

use measurement::GeodeticFix;

use crate::DropReason;
use crate::gnss::{GnssPosition, GnssVelocity, Utc, is_on_earth};
use crate::read_buffer::{Framed, Front, StreamDecoder, before_mark};

mod session;

pub use session::Ublox;

const MARK: &[u8] = &[0xB5, 0x62];
/// Mark, class, identifier, length.
const HEADER: usize = 6;
/// The longest messages (raw observations) have half of it.
const MAX_PAYLOAD: usize = 8192;

/// Class and identifier.
type Kind = [u8; 2];
const NAV_PVT: Kind = [0x01, 0x07];
const NAV_RELPOSNED: Kind = [0x01, 0x3C];
const ACK_NAK: Kind = [0x05, 0x00];
const ACK_ACK: Kind = [0x05, 0x01];
/// The request of [`configure`].
pub const CFG_VALSET: [u8; 2] = [0x06, 0x8A];

/// Port of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names are those of the manual")]
pub enum Port {
    I2c,
    Uart1,
    Uart2,
    Usb,
    Spi,
}

/// A configuration item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Its key. Bits 28 to 30 are the size of the value.
    pub key: u32,
    /// Its value; negative ones as two's complement.
    pub value: u64,
}

impl Setting {
    /// NAV-PVT with each of so many solutions; 0 for never.
    pub fn pvt_output(port: Port, solutions: u8) -> Self {
        Self {
            key: 0x2091_0006 + port as u32,
            value: solutions.into(),
        }
    }

    /// NAV-RELPOSNED with each of so many solutions; 0 for never.
    pub fn relative_position_output(port: Port, solutions: u8) -> Self {
        Self {
            key: 0x2091_008D + port as u32,
            value: solutions.into(),
        }
    }

    /// All NMEA sentences.
    pub fn nmea_output(port: Port, is_on: bool) -> Self {
        Self {
            key: 0x1072_0002 + 0x2_0000 * port as u32,
            value: is_on.into(),
        }
    }

    /// Whether RTCM 3 corrections are taken.
    pub fn rtcm_input(port: Port, is_on: bool) -> Self {
        Self {
            key: 0x1071_0004 + 0x2_0000 * port as u32,
            value: is_on.into(),
        }
    }

    /// Time between measurements; each gives a solution.
    pub fn measurement_period_ms(period_ms: u16) -> Self {
        Self {
            key: 0x3021_0001,
            value: period_ms.into(),
        }
    }

    /// Key and value. `None` if the key has no size or the value is greater.
    fn to_bytes(self) -> Option<Vec<u8>> {
        let (size, is_possible) = match self.key >> 28 & 7 {
            1 => (1, self.value <= 1),
            size @ 2..=5 => {
                let size = 1 << (size - 2);
                (size, self.value.checked_shr(8 * size).unwrap_or(0) == 0)
            }
            _ => return None,
        };
        let value = &self.value.to_le_bytes()[..size as usize];
        is_possible.then(|| [&self.key.to_le_bytes(), value].concat())
    }
}

/// Sets items: until power-off, or for ever. The receiver refuses all if it refuses one; the reply is
/// [`Message::Reply`]. `None` for more than the 64 that a message holds, or an impossible one.
pub fn configure(settings: &[Setting], is_permanent: bool) -> Option<Vec<u8>> {
    // Layers: RAM; memory with battery and flash.
    let layers = if is_permanent { 0b111 } else { 0b001 };
    let settings: Option<Vec<_>> = match settings.len() {
        1..=64 => settings.iter().map(|setting| setting.to_bytes()).collect(),
        _ => None,
    };
    let payload = [&[0, layers, 0, 0], &*settings?.concat()].concat();
    Some(frame(CFG_VALSET, &payload))
}

fn frame([class, id]: Kind, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u16).to_le_bytes();
    let bytes = [MARK, &[class, id], &length, payload].concat();
    let sum = checksum(&bytes[2..]);
    [&bytes[..], &sum].concat()
}

/// Fletcher's, over class to payload.
fn checksum(bytes: &[u8]) -> [u8; 2] {
    bytes.iter().fold([0; 2], |[a, b]: [u8; 2], byte| {
        let a = a.wrapping_add(*byte);
        [a, b.wrapping_add(a)]
    })
}

/// What a receiver sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Position, velocity and time.
    Pvt(Box<Pvt>),
    /// From the base's antenna to the receiver's.
    RelativePosition(RelativePosition),
    /// Reply to a request.
    Reply {
        /// Its class and identifier, as [`CFG_VALSET`].
        request: [u8; 2],
        /// Whether it was accepted.
        is_accepted: bool,
    },
}

/// How well the ambiguities of the carrier phase are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CarrierSolution {
    /// No carrier phase: metres.
    None,
    /// Float: decimetres.
    Float,
    /// Fixed: centimetres.
    Fixed,
}

/// `NAV-PVT`.
#[derive(Clone, Debug, PartialEq)]
pub struct Pvt {
    /// GPS time of the week, ms.
    pub time_of_week_ms: u32,
    /// Time of the solution.
    pub utc: Utc,
    /// Accuracy of the time, ns.
    pub utc_accuracy_ns: u32,
    /// 0 none, 1 dead reckoning, 2 two-dimensional, 3 three-dimensional, 4 combined, 5 time alone.
    pub fix_type: u8,
    /// The receiver vouches for the fix and the position.
    pub is_valid: bool,
    /// Differential corrections are used.
    pub is_differential: bool,
    /// State of real-time kinematics.
    pub carrier: CarrierSolution,
    /// Number of satellites used.
    pub satellites: u8,
    /// Where.
    pub position: GnssPosition,
    /// How fast, and where to.
    pub velocity: GnssVelocity,
    /// Dilution of precision of the position.
    pub position_dilution: f64,
}

impl Pvt {
    /// Position of the antenna.
    pub const fn fix(&self) -> GeodeticFix {
        let is_fix = self.is_valid && matches!(self.fix_type, 2..=4);
        GeodeticFix {
            latitude_deg: self.position.latitude_deg,
            longitude_deg: self.position.longitude_deg,
            altitude_m: self.position.height_above_ellipsoid_m,
            status: match self.carrier {
                _ if !is_fix => -1,
                CarrierSolution::Float | CarrierSolution::Fixed => 2,
                CarrierSolution::None if self.is_differential => 1,
                CarrierSolution::None => 0,
            },
            sigma_m: Some(self.position.horizontal_accuracy_m),
        }
    }
}

/// `NAV-RELPOSNED`: from the base's antenna to this one. Between two antennas on a vehicle it is the
/// heading. Accuracies are 1 σ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativePosition {
    /// Base.
    pub base_station: u16,
    /// GPS time of the week, ms.
    pub time_of_week_ms: u32,
    /// North, east, down, metres; `None` if not valid, or if the receiver sent a direction alone.
    pub ned_m: Option<[f64; 3]>,
    /// Accuracy of north, east, down, metres.
    pub ned_accuracy_m: [f64; 3],
    /// Direction of the vector, clockwise from north, and its accuracy, radians; `None` if not valid.
    pub heading_and_accuracy_rad: Option<[f64; 2]>,
    /// State of real-time kinematics.
    pub carrier: CarrierSolution,
    /// The base moves.
    pub is_base_moving: bool,
}

/// Decodes what a receiver sends.
pub type UbloxDecoder = StreamDecoder<Message>;

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        let garbage = before_mark(bytes, MARK);
        if garbage > 0 {
            return Front::Skip(DropReason::Garbage, garbage);
        }
        let Some((kind, length)) = header(bytes) else {
            return Front::Incomplete;
        };
        let fits = match kind {
            NAV_PVT => length == 92,
            NAV_RELPOSNED => matches!(length, 40 | 64),
            ACK_ACK | ACK_NAK => length == 2,
            _ => length <= MAX_PAYLOAD,
        };
        if !fits {
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
        let mut fields = Fields(&received[HEADER..HEADER + length]);
        let message = match kind {
            NAV_PVT => fields.pvt().map(|pvt| Message::Pvt(Box::new(pvt))),
            NAV_RELPOSNED => fields
                .relative_position(length)
                .map(Message::RelativePosition),
            ACK_ACK | ACK_NAK => Some(Message::Reply {
                request: fields.take(),
                is_accepted: kind == ACK_ACK,
            }),
            _ => return Front::Skip(DropReason::UnknownKind, total),
        };
        match message {
            Some(message) => Front::Message(message, total),
            None => Front::Skip(DropReason::Field, total),
        }
    }
}

/// Kind and length of the payload of a message at the front.
fn header(bytes: &[u8]) -> Option<(Kind, usize)> {
    let [_, _, class, id, low, high] = *bytes.first_chunk::<HEADER>()?;
    let length = u16::from_le_bytes([low, high]);
    Some(([class, id], usize::from(length)))
}

/// Whether a message with a right checksum is at the front.
fn is_message(bytes: &[u8]) -> bool {
    let sum_is_right = |(_, length): (Kind, usize)| {
        let (message, rest) = bytes.split_at_checked(HEADER + length)?;
        Some(rest.first_chunk()? == &checksum(&message[2..]))
    };
    bytes.starts_with(MARK) && header(bytes).and_then(sum_is_right) == Some(true)
}

/// Fields of a payload whose length was checked; zeros beyond its end.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (field, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *field
    }

    fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn i32(&mut self) -> i32 {
        i32::from_le_bytes(self.take())
    }

    fn signed(&mut self, unit: f64) -> f64 {
        f64::from(self.i32()) * unit
    }

    fn unsigned(&mut self, unit: f64) -> f64 {
        f64::from(self.u32()) * unit
    }

    /// `None` if a field is impossible.
    fn pvt(&mut self) -> Option<Pvt> {
        let time_of_week_ms = self.u32();
        let (year, month_to_valid) = (self.u16(), self.take());
        let utc_accuracy_ns = self.u32();
        let utc = Utc::new(year, month_to_valid, self.i32())?;
        let [fix_type, flags, _, satellites] = self.take();
        let [longitude_deg, latitude_deg] = [self.signed(1e-7), self.signed(1e-7)];
        let position = GnssPosition {
            latitude_deg,
            longitude_deg,
            height_above_ellipsoid_m: self.signed(1e-3),
            height_above_sea_m: self.signed(1e-3),
            horizontal_accuracy_m: self.unsigned(1e-3),
            vertical_accuracy_m: self.unsigned(1e-3),
        };
        let mut velocity = GnssVelocity {
            ned_mps: [self.signed(1e-3), self.signed(1e-3), self.signed(1e-3)],
            ground_speed_mps: self.signed(1e-3),
            heading_of_motion_rad: self.signed(1e-5).to_radians(),
            speed_accuracy_mps: self.unsigned(1e-3),
            heading_accuracy_rad: self.unsigned(1e-5).to_radians(),
            heading_of_vehicle_rad: None,
        };
        let position_dilution = f64::from(self.u16()) * 0.01;
        let is_position_invalid = self.u16() & 1 != 0;
        let _reserved = self.u32();
        let heading_of_vehicle_rad = self.signed(1e-5).to_radians();
        velocity.heading_of_vehicle_rad = (flags & 0x20 != 0).then_some(heading_of_vehicle_rad);
        is_on_earth(latitude_deg, longitude_deg).then_some(Pvt {
            time_of_week_ms,
            utc,
            utc_accuracy_ns,
            fix_type,
            is_valid: flags & 1 != 0 && !is_position_invalid,
            is_differential: flags & 2 != 0,
            carrier: carrier(flags >> 6)?,
            satellites,
            position,
            velocity,
            position_dilution,
        })
    }

    /// `None` if a field is impossible. Version 0, of the NEO-M8P, has 40 bytes and no heading.
    fn relative_position(&mut self, length: usize) -> Option<RelativePosition> {
        let [version, _] = self.take();
        let has_heading = length == 64;
        let (base_station, time_of_week_ms) = (self.u16(), self.u32());
        let coarse_m = [self.signed(1e-2), self.signed(1e-2), self.signed(1e-2)];
        let mut heading_rad = 0.0;
        if has_heading {
            let _length = self.u32();
            heading_rad = self.signed(1e-5).to_radians();
            let _reserved = self.u32();
        }
        // 0.1 mm, to be added.
        let [fine @ .., _] = self.take::<4>();
        let ned_accuracy_m = [
            self.unsigned(1e-4),
            self.unsigned(1e-4),
            self.unsigned(1e-4),
        ];
        let mut heading_accuracy_rad = 0.0;
        if has_heading {
            let _length_accuracy = self.u32();
            heading_accuracy_rad = self.unsigned(1e-5).to_radians();
            let _reserved = self.u32();
        }
        let flags = self.u32();
        let is_valid = flags & 0b101 == 0b101 && flags & 0x200 == 0;
        let ned_m =
            std::array::from_fn(|axis| coarse_m[axis] + f64::from(fine[axis].cast_signed()) * 1e-4);
        (version == u8::from(has_heading)).then_some(RelativePosition {
            base_station,
            time_of_week_ms,
            ned_m: is_valid.then_some(ned_m),
            ned_accuracy_m,
            heading_and_accuracy_rad: (flags & 0x100 != 0)
                .then_some([heading_rad, heading_accuracy_rad]),
            carrier: carrier((flags >> 3) as u8)?,
            is_base_moving: flags & 0x20 != 0,
        })
    }
}

/// Of two bits.
const fn carrier(bits: u8) -> Option<CarrierSolution> {
    match bits & 3 {
        0 => Some(CarrierSolution::None),
        1 => Some(CarrierSolution::Float),
        2 => Some(CarrierSolution::Fixed),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
