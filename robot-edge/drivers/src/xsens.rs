//! Xsens `MTi` attitude sensors: the Xbus protocol with `MTData2` messages, on a serial line.
//!
//! Source: Xsens MT Low Level Communication Protocol (MT0101P). Checked against captures of
//! einride/xsens-go (testdata) and packets of Scottapotamas/xsens-mti (`docs/mtmanager_packets.md` at
//! 9c039b0). The limit of 2048 bytes is recalled from the manual.
//!
//! The sensor's frame is right-handed; the housing shows it with z up, as `base_link` has it. The
//! coordinate system of an item (ENU, NED, NWU) is that of the Earth-fixed frame alone.

use std::f64::consts::FRAC_1_SQRT_2;

use measurement::{GeodeticFix, ImuSample};

use crate::gnss::{GnssPosition, GnssVelocity, Utc, is_on_earth};
use crate::read_buffer::{Front, ReadBuffer, before_mark};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::Xsens;

/// Preamble and bus identifier of a single device.
const MARK: [u8; 2] = [0xFA, 0xFF];
const MAX_PAYLOAD: usize = 2048;
/// Most entries of an output configuration.
const MAX_SETTINGS: usize = 32;

const DEVICE_ID: u8 = 0x01;
const GO_TO_MEASUREMENT: u8 = 0x10;
const GO_TO_CONFIG: u8 = 0x30;
const MT_DATA2: u8 = 0x36;
const WAKE_UP: u8 = 0x3E;
const ERROR: u8 = 0x42;
const OUTPUT_CONFIGURATION: u8 = 0xC0;

/// Data identifiers with single-precision numbers and ENU. A number format (1: fixed point 12.20,
/// 2: fixed point 16.32, 3: double) is added to those that have real numbers, a coordinate system
/// (4: NED, 8: NWU) to those that have orientations or velocities.
pub mod data_id {
    #![allow(missing_docs, reason = "the names are those of the manual")]
    pub const TEMPERATURE: u16 = 0x0810;
    pub const UTC_TIME: u16 = 0x1010;
    pub const PACKET_COUNTER: u16 = 0x1020;
    pub const SAMPLE_TIME_FINE: u16 = 0x1060;
    pub const SAMPLE_TIME_COARSE: u16 = 0x1070;
    pub const QUATERNION: u16 = 0x2010;
    pub const EULER_ANGLES: u16 = 0x2030;
    pub const BARO_PRESSURE: u16 = 0x3010;
    pub const DELTA_V: u16 = 0x4010;
    pub const ACCELERATION: u16 = 0x4020;
    pub const FREE_ACCELERATION: u16 = 0x4030;
    pub const ALTITUDE_ELLIPSOID: u16 = 0x5020;
    pub const LAT_LON: u16 = 0x5040;
    pub const GNSS_PVT_DATA: u16 = 0x7010;
    pub const RATE_OF_TURN: u16 = 0x8020;
    pub const DELTA_Q: u16 = 0x8030;
    pub const MAGNETIC_FIELD: u16 = 0xC020;
    pub const VELOCITY_XYZ: u16 = 0xD010;
    pub const STATUS_BYTE: u16 = 0xE010;
    pub const STATUS_WORD: u16 = 0xE020;
}

/// What a device sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Measured values.
    Data(Data),
    /// Reply to [`request_device_id`].
    DeviceId(u64),
    /// Reply to [`go_to_config`]: the device waits for configuration.
    Configuring,
    /// Reply to [`go_to_measurement`]: the device measures.
    Measuring,
    /// Reply to [`set_output_configuration`]: what the device really uses.
    OutputConfiguration(Vec<OutputSetting>),
    /// The device has power. A [`go_to_config`] within half a second keeps it from measuring.
    WakeUp,
    /// A request was refused, or measuring failed: see [`error_meaning`].
    Error(u8),
}

/// One entry of an output configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputSetting {
    /// One of [`data_id`], with number format and coordinate system.
    pub data_id: u16,
    /// Rate in Hz; 65535: with every message, or as often as possible.
    pub rate_hz: u16,
}

/// The items of one `MTData2` message, in its order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Data {
    /// Items that this module knows.
    pub items: Vec<Item>,
}

/// Earth-fixed frame of an orientation or velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EarthFrame {
    /// East, north, up: that of the project.
    EastNorthUp,
    /// North, east, down.
    NorthEastDown,
    /// North, west, up.
    NorthWestUp,
}

/// One measured value. Vectors are in the sensor's frame unless they have an [`EarthFrame`].
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// Temperature inside, °C.
    TemperatureC(f64),
    /// Time of the sample.
    Utc(Utc),
    /// Counts messages, with wrap-around.
    PacketCounter(u16),
    /// Time of the sample in 0.1 ms, with wrap-around.
    SampleTimeFine(u32),
    /// Time of the sample in seconds.
    SampleTimeCoarse(u32),
    /// Quaternion (w, x, y, z) that turns vectors from the sensor's into the Earth-fixed frame.
    Quaternion(EarthFrame, [f64; 4]),
    /// Roll, pitch, yaw: turns about x, then y, then z of the Earth-fixed frame, radians.
    EulerRad(EarthFrame, [f64; 3]),
    /// Air pressure, Pa.
    PressurePa(u32),
    /// Velocity increment of the sample, m/s.
    DeltaVMps([f64; 3]),
    /// Specific force, m/s².
    AccelerationMps2([f64; 3]),
    /// Acceleration without gravity in the Earth-fixed frame, m/s².
    FreeAccelerationMps2([f64; 3]),
    /// Height above the WGS-84 ellipsoid, metres.
    AltitudeM(f64),
    /// Latitude and longitude on WGS-84, degrees.
    LatLonDeg([f64; 2]),
    /// Solution of the satellite receiver, before the filter.
    Gnss(Box<GnssPvt>),
    /// Turn rates, rad/s.
    RateOfTurnRadps([f64; 3]),
    /// Turn of the sample as a quaternion (w, x, y, z).
    DeltaQ([f64; 4]),
    /// Magnetic field; 1 at the place of calibration.
    MagneticField([f64; 3]),
    /// Velocity of the vehicle, m/s.
    VelocityMps(EarthFrame, [f64; 3]),
    /// Status bits; of a status byte only the lowest eight.
    Status(u32),
}

/// Position, velocity and time of the satellite receiver.
#[derive(Clone, Debug, PartialEq)]
pub struct GnssPvt {
    /// GPS time of the week, ms.
    pub time_of_week_ms: u32,
    /// Time of the solution.
    pub utc: Utc,
    /// Accuracy of the time, ns.
    pub utc_accuracy_ns: u32,
    /// 0 none, 1 dead reckoning, 2 two-dimensional, 3 three-dimensional, 4 combined, 5 time alone.
    pub fix_type: u8,
    /// Bit 0: valid fix, bit 1: differential corrections used, bit 5: heading of the vehicle valid.
    pub flags: u8,
    /// Number of satellites used.
    pub satellites: u8,
    /// Where.
    pub position: GnssPosition,
    /// How fast, and where to.
    pub velocity: GnssVelocity,
    /// Dilution of precision: geometric, position, time, vertical, horizontal, northing, easting.
    pub dilution: [f64; 7],
}

/// Decoder of what a device sends.
#[derive(Debug, Default)]
pub struct XsensDecoder(ReadBuffer);

impl Decoder for XsensDecoder {
    type Message = Message;

    fn push(&mut self, bytes: &[u8]) {
        self.0.push(bytes);
    }

    fn next_message(&mut self) -> Option<Message> {
        let (message, dropped_items) = self.0.next_message(front)?;
        for (reason, count) in dropped_items.iter() {
            self.0.dropped.add(reason, count as usize);
        }
        Some(message)
    }

    fn dropped(&self) -> &Dropped {
        &self.0.dropped
    }
}

/// Asks the device to wait for configuration; it replies [`Message::Configuring`].
pub fn go_to_config() -> Vec<u8> {
    request(GO_TO_CONFIG, &[])
}

/// Asks the device to measure; it replies [`Message::Measuring`].
pub fn go_to_measurement() -> Vec<u8> {
    request(GO_TO_MEASUREMENT, &[])
}

/// Asks for the identifier, in the configuration state.
pub fn request_device_id() -> Vec<u8> {
    request(DEVICE_ID - 1, &[])
}

/// Sets what is measured, in the configuration state; an empty list asks for what is set. `None` if
/// the settings are more than the 32 that the device takes.
pub fn set_output_configuration(settings: &[OutputSetting]) -> Option<Vec<u8>> {
    let entry = |setting: &OutputSetting| {
        let [a, b] = setting.data_id.to_be_bytes();
        let [c, d] = setting.rate_hz.to_be_bytes();
        [a, b, c, d]
    };
    let payload: Vec<u8> = settings.iter().flat_map(entry).collect();
    (settings.len() <= MAX_SETTINGS).then(|| request(OUTPUT_CONFIGURATION, &payload))
}

/// What an error of the device means (MT0101P, section "Error").
pub fn error_meaning(code: u8) -> &'static str {
    match code {
        3 => "invalid period",
        4 => "invalid message",
        30 => "timer overflow",
        32 => "invalid bit rate",
        33 => "invalid parameter",
        35 | 36 => "output buffer full",
        40 => "device error",
        41 => "more data than the line can carry",
        42 => "sample buffer full",
        _ => "unknown error",
    }
}

impl Data {
    /// Attitude, turn rates and specific force; `None` without rates and forces. The attitude, ENU, is
    /// left out where the status says that the filter is not valid.
    pub fn imu(&self) -> Option<ImuSample> {
        let attitude = |item: &Item| match *item {
            Item::Quaternion(frame, wxyz) => Some(enu_attitude(frame, wxyz)),
            Item::EulerRad(frame, angles) => Some(enu_attitude(frame, quaternion(angles))),
            _ => None,
        };
        let filter_is_valid = self.status().is_none_or(|status| status & 2 != 0);
        Some(ImuSample {
            orientation_xyzw: (self.find(attitude).flatten()).filter(|_| filter_is_valid),
            angular_velocity_radps: self.find(|item| match item {
                Item::RateOfTurnRadps(rates) => Some(*rates),
                _ => None,
            })?,
            linear_acceleration_mps2: self.find(|item| match item {
                Item::AccelerationMps2(force) => Some(*force),
                _ => None,
            })?,
        })
    }

    /// Position of the filter; `None` without it. Without a status there is no fix. A position in
    /// single precision or 12.20 is good to half a metre.
    pub fn fix(&self) -> Option<GeodeticFix> {
        let [latitude_deg, longitude_deg] = self.find(|item| match item {
            Item::LatLonDeg(position) => Some(*position),
            _ => None,
        })?;
        Some(GeodeticFix {
            latitude_deg,
            longitude_deg,
            altitude_m: self.find(|item| match item {
                Item::AltitudeM(altitude) => Some(*altitude),
                _ => None,
            })?,
            status: self
                .status()
                .map_or(-1, |status| if status & 4 == 0 { -1 } else { 0 }),
            sigma_m: None,
        })
    }

    fn status(&self) -> Option<u32> {
        self.find(|item| match item {
            Item::Status(bits) => Some(*bits),
            _ => None,
        })
    }

    fn find<T>(&self, matching: impl Fn(&Item) -> Option<T>) -> Option<T> {
        self.items.iter().find_map(matching)
    }
}

impl EarthFrame {
    /// A vector of this frame, east, north, up.
    pub const fn to_enu(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::EastNorthUp => [x, y, z],
            Self::NorthEastDown => [y, x, -z],
            Self::NorthWestUp => [-y, x, z],
        }
    }

    /// Quaternion (w, x, y, z) that turns vectors of this frame to ENU.
    const fn enu_from_frame(self) -> [f64; 4] {
        const R: f64 = FRAC_1_SQRT_2;
        match self {
            Self::EastNorthUp => [1.0, 0.0, 0.0, 0.0],
            Self::NorthEastDown => [0.0, R, R, 0.0],
            Self::NorthWestUp => [R, 0.0, 0.0, R],
        }
    }
}

impl GnssPvt {
    /// Position of the receiver.
    pub const fn fix(&self) -> GeodeticFix {
        GeodeticFix {
            latitude_deg: self.position.latitude_deg,
            longitude_deg: self.position.longitude_deg,
            altitude_m: self.position.height_above_ellipsoid_m,
            status: match self.flags & 3 {
                1 => 0,
                3 => 2,
                _ => -1,
            },
            sigma_m: Some(self.position.horizontal_accuracy_m),
        }
    }
}

/// Attitude (x, y, z, w) in ENU, normalised; `None` if the quaternion is none.
fn enu_attitude(frame: EarthFrame, [w, x, y, z]: [f64; 4]) -> Option<[f64; 4]> {
    let norm = (w * w + x * x + y * y + z * z).sqrt();
    let [a, b, c, d] = frame.enu_from_frame().map(|part| part / norm);
    ((norm - 1.0).abs() < 0.01).then_some([
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
        a * w - b * x - c * y - d * z,
    ])
}

/// Quaternion (w, x, y, z) of roll, pitch, yaw.
fn quaternion(angles: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|angle| libm::sincos(angle / 2.0));
    [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
}

/// A message with this identifier. Requests are short: the length has one byte.
fn request(identifier: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![MARK[0], MARK[1], identifier, payload.len() as u8];
    bytes.extend_from_slice(payload);
    bytes.push(sum(&bytes).wrapping_neg());
    bytes
}

/// Sum of all bytes after the preamble; 0 for a whole message.
fn sum(message: &[u8]) -> u8 {
    let after_preamble = message.iter().skip(1);
    after_preamble.fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Judges received bytes: a message, and what was dropped of its items.
fn front(bytes: &[u8]) -> Front<(Message, Dropped)> {
    let garbage = before_mark(bytes, &MARK);
    if garbage > 0 {
        return Front::Skip(DropReason::Garbage, garbage);
    }
    let (start, length) = match *bytes {
        [_, _, _, 0xFF, high, low, ..] => (6, usize::from(u16::from_be_bytes([high, low]))),
        [_, _, _, short, ..] if short < 0xFF => (4, usize::from(short)),
        _ => return Front::Incomplete,
    };
    if length > MAX_PAYLOAD {
        return Front::Skip(DropReason::Length, 1);
    }
    let end = start + length + 1;
    let Some(frame) = bytes.get(..end) else {
        return Front::Incomplete;
    };
    if sum(frame) != 0 {
        return Front::Skip(DropReason::Checksum, 1);
    }
    let mut dropped = Dropped::default();
    match message(frame[2], &frame[start..end - 1], &mut dropped) {
        Ok(message) => Front::Message((message, dropped), end),
        Err(DropReason::UnknownKind) => Front::Skip(DropReason::UnknownKind, end),
        Err(reason) => Front::Skip(reason, 1),
    }
}

fn message(identifier: u8, payload: &[u8], dropped: &mut Dropped) -> Result<Message, DropReason> {
    const CONFIGURING: u8 = GO_TO_CONFIG + 1;
    const MEASURING: u8 = GO_TO_MEASUREMENT + 1;
    const CONFIGURED: u8 = OUTPUT_CONFIGURATION + 1;
    Ok(match (identifier, payload) {
        (MT_DATA2, _) => Message::Data(data(payload, dropped)?),
        (DEVICE_ID, &[a, b, c, d]) => {
            Message::DeviceId(u64::from(u32::from_be_bytes([a, b, c, d])))
        }
        (DEVICE_ID, &[a, b, c, d, e, f, g, h]) => {
            Message::DeviceId(u64::from_be_bytes([a, b, c, d, e, f, g, h]))
        }
        (CONFIGURING, []) => Message::Configuring,
        (MEASURING, []) => Message::Measuring,
        (WAKE_UP, []) => Message::WakeUp,
        (ERROR, [code, ..]) => Message::Error(*code),
        (CONFIGURED, _) if payload.len().is_multiple_of(4) && payload.len() / 4 <= MAX_SETTINGS => {
            let (entries, _) = payload.as_chunks();
            let setting = |&[a, b, c, d]: &[u8; 4]| OutputSetting {
                data_id: u16::from_be_bytes([a, b]),
                rate_hz: u16::from_be_bytes([c, d]),
            };
            Message::OutputConfiguration(entries.iter().map(setting).collect())
        }
        (DEVICE_ID | CONFIGURING | MEASURING | WAKE_UP | ERROR | CONFIGURED, _) => {
            return Err(DropReason::Length);
        }
        _ => return Err(DropReason::UnknownKind),
    })
}

/// Items until the end. A bad item is dropped alone; if one is longer than the rest, all are.
fn data(mut payload: &[u8], dropped: &mut Dropped) -> Result<Data, DropReason> {
    let mut items = Vec::new();
    while !payload.is_empty() {
        let [high, low, length, rest @ ..] = payload else {
            return Err(DropReason::Length);
        };
        let (content, next) =
            (rest.split_at_checked((*length).into())).ok_or(DropReason::Length)?;
        match item(u16::from_be_bytes([*high, *low]), content) {
            Ok(item) => items.push(item),
            Err(reason) => dropped.add(reason, 1),
        }
        payload = next;
    }
    Ok(Data { items })
}

fn item(id: u16, content: &[u8]) -> Result<Item, DropReason> {
    let format = id & 3;
    let frame = match id & 0xC {
        0 => EarthFrame::EastNorthUp,
        4 => EarthFrame::NorthEastDown,
        8 => EarthFrame::NorthWestUp,
        _ => return Err(DropReason::Field),
    };
    Ok(match id & 0xFFF0 {
        data_id::TEMPERATURE => {
            let [temperature] = reals(format, content)?;
            Item::TemperatureC(temperature)
        }
        data_id::UTC_TIME => {
            let mut fields = Fields(whole(content, 12)?);
            let nanosecond = fields.i32();
            Item::Utc(fields.utc(nanosecond)?)
        }
        data_id::PACKET_COUNTER => Item::PacketCounter(Fields(whole(content, 2)?).u16()),
        data_id::SAMPLE_TIME_FINE => Item::SampleTimeFine(Fields(whole(content, 4)?).u32()),
        data_id::SAMPLE_TIME_COARSE => Item::SampleTimeCoarse(Fields(whole(content, 4)?).u32()),
        data_id::QUATERNION => Item::Quaternion(frame, reals(format, content)?),
        data_id::EULER_ANGLES => {
            Item::EulerRad(frame, reals(format, content)?.map(f64::to_radians))
        }
        // An integer, whatever format the identifier names (xsens-mti, number_formats_2).
        data_id::BARO_PRESSURE => Item::PressurePa(Fields(whole(content, 4)?).u32()),
        data_id::DELTA_V => Item::DeltaVMps(reals(format, content)?),
        data_id::ACCELERATION => Item::AccelerationMps2(reals(format, content)?),
        data_id::FREE_ACCELERATION => Item::FreeAccelerationMps2(reals(format, content)?),
        data_id::ALTITUDE_ELLIPSOID => {
            let [altitude] = reals(format, content)?;
            Item::AltitudeM(altitude)
        }
        data_id::LAT_LON => {
            let position = reals(format, content)?;
            check_position(position)?;
            Item::LatLonDeg(position)
        }
        data_id::GNSS_PVT_DATA => Item::Gnss(Box::new(gnss_pvt(Fields(whole(content, 94)?))?)),
        data_id::RATE_OF_TURN => Item::RateOfTurnRadps(reals(format, content)?),
        data_id::DELTA_Q => Item::DeltaQ(reals(format, content)?),
        data_id::MAGNETIC_FIELD => Item::MagneticField(reals(format, content)?),
        data_id::VELOCITY_XYZ => Item::VelocityMps(frame, reals(format, content)?),
        data_id::STATUS_BYTE => Item::Status(Fields(whole(content, 1)?).u8().into()),
        data_id::STATUS_WORD => Item::Status(Fields(whole(content, 4)?).u32()),
        _ => return Err(DropReason::UnknownKind),
    })
}

/// `N` finite numbers in one of the four formats.
fn reals<const N: usize>(format: u16, content: &[u8]) -> Result<[f64; N], DropReason> {
    let size = [4, 4, 6, 8][usize::from(format & 3)];
    let content = whole(content, N * size)?;
    let numbers: [f64; N] = std::array::from_fn(|index| {
        let mut fields = Fields(&content[index * size..]);
        match format {
            0 => f32::from_bits(fields.u32()).into(),
            1 => f64::from(fields.i32()) / f64::from(1 << 20),
            // The fraction comes before the integer part.
            2 => {
                let fraction = fields.u32();
                f64::from(i16::from_be_bytes(fields.take())) + f64::from(fraction) / 2_f64.powi(32)
            }
            _ => f64::from_be_bytes(fields.take()),
        }
    });
    let all_finite = numbers.iter().all(|number| number.is_finite());
    all_finite.then_some(numbers).ok_or(DropReason::Field)
}

fn check_position([latitude_deg, longitude_deg]: [f64; 2]) -> Result<(), DropReason> {
    is_on_earth(latitude_deg, longitude_deg)
        .then_some(())
        .ok_or(DropReason::Field)
}

fn whole(content: &[u8], length: usize) -> Result<&[u8], DropReason> {
    (content.len() == length)
        .then_some(content)
        .ok_or(DropReason::Length)
}

fn gnss_pvt(mut fields: Fields<'_>) -> Result<GnssPvt, DropReason> {
    let time_of_week_ms = fields.u32();
    let mut date = Fields(fields.0);
    fields.0 = &fields.0[8..];
    let utc_accuracy_ns = fields.u32();
    let utc = date.utc(fields.i32())?;
    let [fix_type, flags, satellites, _] = fields.take();
    let [longitude_deg, latitude_deg] =
        [fields.i32(), fields.i32()].map(|raw| f64::from(raw) * 1e-7);
    check_position([latitude_deg, longitude_deg])?;
    let [height_m, height_above_sea_m] = [fields.i32(), fields.i32()].map(milli);
    let [horizontal_accuracy_m, vertical_accuracy_m] = [fields.u32(), fields.u32()].map(milli);
    let position = GnssPosition {
        latitude_deg,
        longitude_deg,
        height_above_ellipsoid_m: height_m,
        height_above_sea_m,
        horizontal_accuracy_m,
        vertical_accuracy_m,
    };
    let degrees = |raw: f64| (raw * 1e-5).to_radians();
    let velocity = GnssVelocity {
        ned_mps: [fields.i32(), fields.i32(), fields.i32()].map(milli),
        ground_speed_mps: milli(fields.i32()),
        heading_of_motion_rad: degrees(fields.i32().into()),
        speed_accuracy_mps: milli(fields.u32()),
        heading_accuracy_rad: degrees(fields.u32().into()),
        heading_of_vehicle_rad: Some(degrees(fields.i32().into())).filter(|_| flags & 0x20 != 0),
    };
    let dilution = std::array::from_fn(|_| f64::from(fields.u16()) * 0.01);
    Ok(GnssPvt {
        time_of_week_ms,
        utc,
        utc_accuracy_ns,
        fix_type,
        flags,
        satellites,
        position,
        velocity,
        dilution,
    })
}

/// Thousandths.
fn milli(raw: impl Into<f64>) -> f64 {
    raw.into() * 1e-3
}

/// Big-endian fields of content whose length was checked; zeros beyond its end.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (field, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *field
    }

    fn u8(&mut self) -> u8 {
        let [byte] = self.take();
        byte
    }

    fn u16(&mut self) -> u16 {
        u16::from_be_bytes(self.take())
    }

    fn u32(&mut self) -> u32 {
        u32::from_be_bytes(self.take())
    }

    fn i32(&mut self) -> i32 {
        i32::from_be_bytes(self.take())
    }

    /// Year to validity.
    fn utc(&mut self, nanosecond: i32) -> Result<Utc, DropReason> {
        let year = self.u16();
        Utc::new(year, self.take(), nanosecond).ok_or(DropReason::Field)
    }
}

#[cfg(test)]
mod tests;
