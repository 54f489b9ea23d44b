//! SICK laser scanners LMS1xx, LMS5xx and TiM: CoLa A (text) and CoLa B (binary), TCP port 2111 or 2112.
//!
//! Sources: SICK, Telegram Listing 8014631, called "listing" below, as far as the operating
//! instructions of the LMS500 (8013796, pages 82 to 84), LMS4000 (8023198, annex 12) and TiM781
//! (8024232, section 12.3) repeat it. The widths of CoLa B are those of captures of an LMS111 and a
//! TiM781S.
//!
//! Both codings carry the same values in the same order. CoLa A: STX, tokens with a space between,
//! ETX; numbers are hexadecimal, or decimal with a sign. CoLa B: four STX, a length (u32), the
//! payload, the exclusive or of its bytes; big-endian.
//!
//! [`SickColaDecoder`] recognises the coding of each telegram. Reads of up to 32 KiB lose nothing.

#![expect(
    clippy::doc_markdown,
    reason = "names of devices and of a protocol are no code"
)]

use measurement::scan::Scan;

use crate::read_buffer::{Front, ReadBuffer, before_mark};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::SickCola;

/// How values are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// CoLa A: text.
    A,
    /// CoLa B: binary.
    B,
}

/// What a host asks of a scanner. The reply is a [`Message::Answer`] if nothing else is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// `SetAccessMode`: allows settings until [`Request::Run`].
    Login {
        /// User level: 3 is the authorised client.
        level: u8,
        /// Hash of the level's password.
        password_hash: u32,
    },
    /// `EIHstCola`: changes the coding.
    SetCoding(Coding),
    /// `DeviceIdent`. Reply: [`Message::Identity`].
    ReadIdentity,
    /// `FirmwareVersion`. Reply: [`Message::FirmwareVersion`].
    ReadFirmwareVersion,
    /// `LocationName`. Reply: [`Message::LocationName`].
    ReadLocationName,
    /// `SCdevicestate`. Reply: [`Message::DeviceState`].
    ReadDeviceState,
    /// `STlms` (LMS1xx, LMS5xx). Reply: [`Message::Status`].
    ReadStatus,
    /// `LMCstartmeas`.
    StartMeasuring,
    /// `LMCstopmeas`.
    StopMeasuring,
    /// `Run`: applies the settings and logs out.
    Run,
    /// `mEEwriteall`: keeps the settings after power-off.
    StoreSettings,
    /// `LMPscancfg`. Reply: [`Message::ScanConfig`].
    ReadScanConfig,
    /// `mLMPsetscancfg`.
    SetScanConfig(ScanConfig),
    /// `LMPoutputRange`. Reply: [`Message::OutputRange`].
    ReadOutputRange,
    /// `LMPoutputRange`: beams that are sent.
    SetOutputRange(Sector),
    /// `LMDscandatacfg`. Reply: [`Message::ScanDataConfig`].
    ReadScanDataConfig,
    /// `LMDscandatacfg`: what a scan contains.
    SetScanDataConfig(ScanDataConfig),
    /// `LMDscandata`: one scan.
    ReadScan,
    /// `LMDscandata`: starts or ends the stream of scans. Reply: [`Message::Subscribed`].
    Subscribe(bool),
}

/// The login of the authorised client with the factory password (listing, section 4.1).
pub const CLIENT_LOGIN: Request = Request::Login {
    level: 3,
    password_hash: 0xF472_4744,
};

impl Request {
    /// The telegram.
    pub fn to_bytes(self, coding: Coding) -> Vec<u8> {
        let (command, values) = self.command_and_values();
        match coding {
            Coding::A => {
                let values = values.iter().map(|(_, value)| format!(" {value:X}"));
                format!("\x02{command}{}\x03", values.collect::<String>()).into_bytes()
            }
            Coding::B => {
                let mut payload = command.as_bytes().to_vec();
                if !values.is_empty() {
                    payload.push(b' ');
                }
                for (width, value) in values {
                    payload.extend(value.to_be_bytes().into_iter().skip(4 - width));
                }
                let mut telegram = vec![STX; 4];
                telegram.extend((payload.len() as u32).to_be_bytes());
                telegram.push(checksum(&payload));
                telegram.splice(8..8, payload);
                telegram
            }
        }
    }

    /// Kind and name: `sRN DeviceIdent`.
    pub fn name(self) -> &'static str {
        self.command_and_values().0
    }

    /// Values with their widths in CoLa B, bytes.
    fn command_and_values(self) -> (&'static str, Vec<(usize, u32)>) {
        match self {
            Self::Login {
                level,
                password_hash,
            } => (
                "sMN SetAccessMode",
                vec![(1, level.into()), (4, password_hash)],
            ),
            Self::SetCoding(coding) => ("sWN EIHstCola", vec![(1, (coding == Coding::B).into())]),
            Self::ReadIdentity => ("sRN DeviceIdent", vec![]),
            Self::ReadFirmwareVersion => ("sRN FirmwareVersion", vec![]),
            Self::ReadLocationName => ("sRN LocationName", vec![]),
            Self::ReadDeviceState => ("sRN SCdevicestate", vec![]),
            Self::ReadStatus => ("sRN STlms", vec![]),
            Self::StartMeasuring => ("sMN LMCstartmeas", vec![]),
            Self::StopMeasuring => ("sMN LMCstopmeas", vec![]),
            Self::Run => ("sMN Run", vec![]),
            Self::StoreSettings => ("sMN mEEwriteall", vec![]),
            Self::ReadScanConfig => ("sRN LMPscancfg", vec![]),
            Self::SetScanConfig(config) => {
                let mut values = vec![(4, config.frequency_centihertz), (2, 1)];
                values.extend(config.sector.values());
                ("sMN mLMPsetscancfg", values)
            }
            Self::ReadOutputRange => ("sRN LMPoutputRange", vec![]),
            Self::SetOutputRange(sector) => {
                let mut values = vec![(2, 1)];
                values.extend(sector.values());
                ("sWN LMPoutputRange", values)
            }
            Self::ReadScanDataConfig => ("sRN LMDscandatacfg", vec![]),
            Self::SetScanDataConfig(config) => ("sWN LMDscandatacfg", config.values()),
            Self::ReadScan => ("sRN LMDscandata", vec![]),
            Self::Subscribe(on) => ("sEN LMDscandata", vec![(1, on.into())]),
        }
    }
}

/// How a scanner turns and measures. Devices accept few combinations (listing, section 4.2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanConfig {
    /// Turns, 1/100 Hz.
    pub frequency_centihertz: u32,
    /// Beams that are measured.
    pub sector: Sector,
}

/// Beams at equal angles. 90° is forward, counter-clockwise as seen from above; 1/10,000°.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sector {
    /// Angle between beams.
    pub resolution_deg_e4: u32,
    /// First beam.
    pub start_deg_e4: i32,
    /// Last beam.
    pub stop_deg_e4: i32,
}

impl Sector {
    fn values(self) -> [(usize, u32); 3] {
        [
            (4, self.resolution_deg_e4),
            (4, self.start_deg_e4.cast_unsigned()),
            (4, self.stop_deg_e4.cast_unsigned()),
        ]
    }

    fn read(values: &mut Values<'_>) -> Option<Self> {
        Some(Self {
            resolution_deg_e4: values.u32()?,
            start_deg_e4: values.i32()?,
            stop_deg_e4: values.i32()?,
        })
    }
}

/// What a scan contains.
#[expect(clippy::struct_excessive_bools, reason = "the fields of the telegram")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanDataConfig {
    /// Echoes, as the device numbers them: `[1, 0]` is the first.
    pub echoes: [u8; 2],
    /// Signal strengths (RSSI).
    pub rssi: bool,
    /// Signal strengths have 16 bits, not 8.
    pub rssi_16_bit: bool,
    /// Encoders: `[1, 0]` is the first.
    pub encoders: [u8; 2],
    /// Position of the device.
    pub position: bool,
    /// Name of the device.
    pub name: bool,
    /// A comment.
    pub comment: bool,
    /// The device's clock.
    pub time: bool,
    /// 1: all scans, 2: every second…
    pub every: u16,
}

impl ScanDataConfig {
    fn values(self) -> Vec<(usize, u32)> {
        let bytes = [
            self.echoes[0],
            self.echoes[1],
            self.rssi.into(),
            self.rssi_16_bit.into(),
            0, // Unit of the signal strength: digits.
            self.encoders[0],
            self.encoders[1],
            self.position.into(),
            self.name.into(),
            self.comment.into(),
            self.time.into(),
        ];
        let bytes = bytes.into_iter().map(|byte| (1, byte.into()));
        bytes.chain([(2, self.every.into())]).collect()
    }

    fn read(values: &mut Values<'_>) -> Option<Self> {
        let echoes = [values.u8()?, values.u8()?];
        let (rssi, rssi_16_bit) = (values.bool()?, values.bool()?);
        values.u8()?;
        Some(Self {
            echoes,
            rssi,
            rssi_16_bit,
            encoders: [values.u8()?, values.u8()?],
            position: values.bool()?,
            name: values.bool()?,
            comment: values.bool()?,
            time: values.bool()?,
            every: values.u16()?,
        })
    }
}

/// What a scanner sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// A scan.
    Scan(Box<ScanData>),
    /// The reply to a request that sets something.
    Answer {
        /// Name of the request: `SetAccessMode`.
        request: &'static str,
        /// The device's code if it refused (listing, at each request).
        result: Result<(), u8>,
    },
    /// A request that the device could not process: see [`error_meaning`].
    Error(u16),
    /// Whether scans are streamed.
    Subscribed(bool),
    /// Type and firmware.
    Identity {
        /// `LMS10x_FieldEval`.
        device: String,
        /// `V1.36-21.10.2010`.
        firmware: String,
    },
    /// Firmware.
    FirmwareVersion(String),
    /// Name that the user gave the device.
    LocationName(String),
    /// Whether it measures.
    DeviceState(DeviceState),
    /// Code of `STlms`: 1 starting, 2 being configured, 3 idle, 4 rotating, 5 preparing, 6 ready,
    /// 7 ready to measure.
    Status(u16),
    /// How it turns.
    ScanConfig(ScanConfig),
    /// Beams that are sent.
    OutputRange(Sector),
    /// What a scan contains.
    ScanDataConfig(ScanDataConfig),
}

/// State of a device (`SCdevicestate`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceState {
    /// It starts.
    Busy,
    /// It measures.
    Ready,
    /// It is faulty.
    Error,
    /// Its laser and motor are off.
    Standby,
}

/// What a code of [`Message::Error`] means (TiM781 manual, table 202).
pub fn error_meaning(code: u16) -> &'static str {
    match code {
        1 => "the user level does not allow the method",
        2 => "unknown method",
        3 => "unknown variable",
        4 => "a value is out of its limits, or not possible now",
        5 => "invalid data",
        7 => "too much data",
        8 => "too few values",
        9 => "unknown type of variable",
        10 => "the variable cannot be set",
        11 => "unknown command for a name",
        12 => "unknown command",
        13 => "the device is busy with another method",
        14 => "an array is too long",
        15 => "unknown event",
        16 => "a value is too large",
        17 => "a character is invalid",
        _ => "internal error of the device",
    }
}

/// A scan as it was sent (`LMDscandata`).
#[derive(Clone, Debug, PartialEq)]
pub struct ScanData {
    /// Serial number of the device.
    pub serial_number: u32,
    /// State of the device.
    pub status: ScanStatus,
    /// Telegrams that the device made, modulo 2¹⁶.
    pub telegram_counter: u16,
    /// Turns of the device, modulo 2¹⁶.
    pub scan_counter: u16,
    /// Device time at its zero index, microseconds since power-on, modulo 2³². The manuals put it before
    /// the first beam, captures after the last.
    pub power_up_time_us: u32,
    /// Device time at which the scan is complete and sent, microseconds since power-on, modulo 2³².
    pub transmission_time_us: u32,
    /// Digital inputs and outputs.
    pub inputs_outputs: [u8; 4],
    /// Turns, 1/100 Hz.
    pub frequency_centihertz: u32,
    /// Encoders that were asked for.
    pub encoders: Vec<Encoder>,
    /// Those of 16 bits, then those of 8 bits.
    pub channels: Vec<Channel>,
    /// What follows the channels; `None` if it is not as the manual says.
    pub details: Option<Details>,
}

/// Device status of a scan.
///
/// The manuals describe the second byte only. An LMS111 sends `[1, 0]` in its first scans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanStatus(pub [u8; 2]);

impl ScanStatus {
    /// The device is faulty.
    pub fn is_error(self) -> bool {
        self.0[1] & 1 != 0
    }

    /// The front window is dirty: clean it soon.
    pub fn is_contamination_warning(self) -> bool {
        self.0[1] & 2 != 0
    }

    /// The front window is so dirty that ranges are unreliable.
    pub fn is_contamination_error(self) -> bool {
        self.0[1] & 4 != 0
    }
}

/// An encoder that is connected to a scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoder {
    /// Ticks.
    pub position_ticks: u32,
    /// Speed, in the unit that the device is set to.
    pub speed: u16,
}

/// Values of all beams.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// `DIST1` to `DIST5`: distances of echoes in mm; `RSSI1` to `RSSI5`: signal strengths.
    pub content: String,
    /// Factor of the values, finite.
    pub scale: f32,
    /// Added to the scaled values, finite.
    pub offset: f32,
    /// First beam: 90° is forward, counter-clockwise as seen from above; 1/10,000°.
    pub start_deg_e4: i32,
    /// Angle between beams, 1/10,000°.
    pub step_deg_e4: u16,
    /// Values in beam order.
    pub values: Vec<u16>,
}

/// What a scan has besides measurements, if it was asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Details {
    /// Where the user says the device is.
    pub position: Option<Position>,
    /// Name of the device.
    pub name: Option<String>,
    /// Comment that the user gave the device.
    pub comment: Option<String>,
    /// The device's clock. It starts in 1970 if nobody sets it.
    pub time: Option<DeviceTime>,
}

/// A position in units of the user.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// x, y, z.
    pub translation: [f32; 3],
    /// About x, y, z.
    pub rotation: [f32; 3],
    /// 0 none, 1 pitch, 2 roll, 3 free.
    pub rotation_kind: u8,
}

/// Time of a device's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceTime {
    /// Year.
    pub year: u16,
    /// Month, day, hour, minute, second.
    pub month_to_second: [u8; 5],
    /// Microsecond.
    pub microsecond: u32,
}

/// Values below this are error codes (LMS4000 manual, "reserved values").
const FIRST_DISTANCE: u16 = 16;
const FORWARD_DEG: f64 = 90.0;
const DEG_E4: f64 = 10_000.0;

impl ScanData {
    /// The channel with this content.
    pub fn channel(&self, content: &str) -> Option<&Channel> {
        let is = |channel: &&Channel| channel.content == content;
        self.channels.iter().find(is)
    }

    /// The first echo. The device does not send its limits: `range_min_m` and `range_max_m` are those
    /// of its data sheet. Distance 0 is no echo, the other codes and distances below the smallest
    /// are no range.
    ///
    /// `None` if there is no such channel, or if angles, frequency, scale or limits are impossible.
    pub fn to_scan(&self, range_min_m: f32, range_max_m: f32) -> Option<Scan> {
        let channel = self.channel("DIST1")?;
        let step_deg = step_deg(channel.step_deg_e4);
        let start_deg = f64::from(channel.start_deg_e4) / DEG_E4;
        let frequency_hz = f64::from(self.frequency_centihertz) / 100.0;
        let steps = channel.values.len().checked_sub(1)? as f64;
        let possible = step_deg > 0.0
            && steps * step_deg <= 360.0
            && start_deg.abs() <= 360.0
            && (0.1..=1000.0).contains(&frequency_hz)
            && (0.01..=100.0).contains(&channel.scale)
            && channel.offset.abs() <= 100_000.0
            && range_min_m >= 0.0
            && range_min_m < range_max_m
            && range_max_m.is_finite();
        let range_m = |value: &u16| {
            let range_mm = f64::from(*value) * f64::from(channel.scale) + f64::from(channel.offset);
            let range_m = (range_mm / 1000.0) as f32;
            match *value {
                0 => f32::INFINITY,
                1..FIRST_DISTANCE => f32::NAN,
                _ if range_m < range_min_m => f32::NAN,
                _ if range_m >= range_max_m => f32::INFINITY,
                _ => range_m,
            }
        };
        possible.then(|| Scan {
            angle_min_rad: (start_deg - FORWARD_DEG).to_radians() as f32,
            angle_increment_rad: step_deg.to_radians() as f32,
            time_increment_s: (step_deg / (360.0 * frequency_hz)) as f32,
            range_min_m,
            range_max_m,
            ranges_m: channel.values.iter().map(range_m).collect(),
        })
    }
}

/// Devices round thirds and sixths of a degree: 3333 is 1/3°, of which 810 make 270°.
fn step_deg(step_deg_e4: u16) -> f64 {
    let step = f64::from(step_deg_e4);
    let sixths = (step * 6.0 / DEG_E4).round();
    let exact = sixths * DEG_E4 / 6.0;
    let step = if (exact - step).abs() < 0.5 {
        exact
    } else {
        step
    };
    step / DEG_E4
}

const STX: u8 = 2;
const ETX: u8 = 3;
/// An LMS5xx with five echoes and their strengths sends 23 kB.
const MAX_PAYLOAD: usize = 32 * 1024;
const HEADER: usize = 8;
const MAX_ENCODERS: usize = 4;
const MAX_CHANNELS: usize = 12;
const MAX_TEXT: usize = 128;

/// Decodes what scanners send.
#[derive(Debug, Default)]
pub struct SickColaDecoder(ReadBuffer);

impl Decoder for SickColaDecoder {
    type Message = Message;

    fn push(&mut self, bytes: &[u8]) {
        self.0.push(bytes);
    }

    fn next_message(&mut self) -> Option<Message> {
        self.0.next_message(front)
    }

    fn dropped(&self) -> &Dropped {
        &self.0.dropped
    }
}

fn front(bytes: &[u8]) -> Front<Message> {
    match bytes {
        [] | [STX] => Front::Incomplete,
        [STX, STX, ..] => binary(bytes),
        [STX, b's', ..] => text(bytes),
        [_, rest @ ..] => Front::Skip(DropReason::Garbage, 1 + before_mark(rest, &[STX])),
    }
}

fn binary(bytes: &[u8]) -> Front<Message> {
    if bytes.iter().take(4).any(|byte| *byte != STX) {
        return Front::Skip(DropReason::Garbage, 1);
    }
    let Some((header, rest)) = bytes.split_first_chunk::<HEADER>() else {
        return Front::Incomplete;
    };
    let length = header.iter().skip(4);
    let length = length.fold(0, |length, byte| length << 8 | usize::from(*byte));
    if length > MAX_PAYLOAD {
        return Front::Skip(DropReason::Length, 1);
    }
    if !begins_as_telegram(rest.get(..length).unwrap_or(rest)) {
        return Front::Skip(DropReason::Field, 1);
    }
    match (rest.get(..length), rest.get(length)) {
        (Some(payload), Some(sum)) if checksum(payload) == *sum => {
            decoded(Coding::B, payload, HEADER + length + 1)
        }
        (Some(_), Some(_)) => Front::Skip(DropReason::Checksum, 1),
        _ => Front::Incomplete,
    }
}

fn text(bytes: &[u8]) -> Front<Message> {
    let within = bytes.get(1..).unwrap_or_default();
    let is_control = |byte: &u8| *byte < b' ';
    let end = within.iter().position(is_control);
    let payload = within
        .get(..end.unwrap_or(within.len()))
        .unwrap_or_default();
    if payload.len() > MAX_PAYLOAD {
        return Front::Skip(DropReason::Length, 1);
    }
    if !begins_as_telegram(payload) {
        return Front::Skip(DropReason::Field, 1);
    }
    match end.and_then(|end| within.get(end)) {
        None => Front::Incomplete,
        Some(&ETX) => decoded(Coding::A, payload, payload.len() + 2),
        Some(&STX) => Front::Skip(DropReason::CutOff, payload.len() + 1),
        Some(_) => Front::Skip(DropReason::Field, 1),
    }
}

/// Whether a payload begins like `sRA`, as far as it was received.
fn begins_as_telegram(payload: &[u8]) -> bool {
    let fits = |(at, byte): (usize, &u8)| match at {
        0 => *byte == b's',
        _ => byte.is_ascii_uppercase(),
    };
    payload.iter().take(3).enumerate().all(fits)
}

fn checksum(payload: &[u8]) -> u8 {
    payload.iter().fold(0, |sum, byte| sum ^ byte)
}

fn decoded(coding: Coding, payload: &[u8], length: usize) -> Front<Message> {
    match message(coding, payload) {
        Ok(message) => Front::Message(message, length),
        Err(DropReason::UnknownKind) => Front::Skip(DropReason::UnknownKind, length),
        Err(reason) => Front::Skip(reason, 1),
    }
}

fn message(coding: Coding, payload: &[u8]) -> Result<Message, DropReason> {
    let (kind, rest) = payload.split_at_checked(3).ok_or(DropReason::Length)?;
    let rest = rest.strip_prefix(b" ").unwrap_or(rest);
    let mut values = Values { coding, rest };
    if kind == b"sFA" {
        return whole(values.u16().map(Message::Error), &values);
    }
    let name = values.name();
    let values = &mut values;
    let accepted = |request| {
        Some(Message::Answer {
            request,
            result: Ok(()),
        })
    };
    let message = match (kind, name) {
        (b"sSN" | b"sRA", b"LMDscandata") => {
            let scan = scan_data(values).map(Box::new);
            return scan.map(Message::Scan).ok_or(DropReason::Field);
        }
        (b"sAN", b"SetAccessMode") => values.answer("SetAccessMode", 1),
        (b"sAN", b"Run") => values.answer("Run", 1),
        (b"sAN", b"mEEwriteall") => values.answer("mEEwriteall", 1),
        (b"sAN", b"LMCstartmeas") => values.answer("LMCstartmeas", 0),
        (b"sAN", b"LMCstopmeas") => values.answer("LMCstopmeas", 0),
        (b"sAN", b"mLMPsetscancfg") => {
            let answer = values.answer("mLMPsetscancfg", 0);
            // The settings that are in force now; LMPscancfg has them too.
            values.rest = &[];
            answer
        }
        (b"sWA", b"EIHstCola") => accepted("EIHstCola"),
        (b"sWA", b"LMPoutputRange") => accepted("LMPoutputRange"),
        (b"sWA", b"LMDscandatacfg") => accepted("LMDscandatacfg"),
        (b"sEA", b"LMDscandata") => values.bool().map(Message::Subscribed),
        (b"sRA", b"DeviceIdent") => values.identity(),
        (b"sRA", b"FirmwareVersion") => values.string(2).map(Message::FirmwareVersion),
        (b"sRA", b"LocationName") => values.string(2).map(Message::LocationName),
        (b"sRA", b"SCdevicestate") => values.device_state().map(Message::DeviceState),
        (b"sRA", b"STlms") => {
            let status = values.u16().map(Message::Status);
            // Temperature, time and lamps; the widths of CoLa B are not known.
            values.rest = &[];
            status
        }
        (b"sRA", b"LMPscancfg") => values.scan_config().map(Message::ScanConfig),
        (b"sRA", b"LMPoutputRange") => {
            let sectors = values.u16();
            let sector = sectors.and_then(|_| Sector::read(values));
            sector.map(Message::OutputRange)
        }
        (b"sRA", b"LMDscandatacfg") => ScanDataConfig::read(values).map(Message::ScanDataConfig),
        _ => return Err(DropReason::UnknownKind),
    };
    whole(message, values)
}

/// A message that leaves nothing over.
fn whole(message: Option<Message>, values: &Values<'_>) -> Result<Message, DropReason> {
    let nothing_left = values.rest.iter().all(|byte| *byte == b' ');
    message.filter(|_| nothing_left).ok_or(DropReason::Field)
}

/// Values that wait to be read.
#[derive(Clone, Copy)]
struct Values<'a> {
    coding: Coding,
    rest: &'a [u8],
}

impl<'a> Values<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        Some(taken)
    }

    /// Bytes up to the next space, which is taken too.
    fn name(&mut self) -> &'a [u8] {
        let is_space = |byte: &u8| *byte == b' ';
        let length = self.rest.iter().position(is_space);
        let (name, rest) = self.rest.split_at(length.unwrap_or(self.rest.len()));
        self.rest = rest.strip_prefix(b" ").unwrap_or(rest);
        name
    }

    /// A number of `width` bytes; negative ones as two's complement.
    fn number(&mut self, width: usize) -> Option<u32> {
        if self.coding == Coding::B {
            let bytes = self.take(width)?.iter();
            return Some(bytes.fold(0, |number, byte| number << 8 | u32::from(*byte)));
        }
        let token = std::str::from_utf8(self.name()).ok()?;
        let limit = 1_i64 << (8 * width);
        let number = if token.starts_with(['+', '-']) {
            let number = token.parse::<i64>().ok()?;
            let is_negative = (-limit / 2..0).contains(&number);
            if is_negative { number + limit } else { number }
        } else {
            i64::from_str_radix(token, 16).ok()?
        };
        let fits = (0..limit).contains(&number);
        fits.then_some(number as u32)
    }

    fn u8(&mut self) -> Option<u8> {
        self.number(1)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.number(2)?.try_into().ok()
    }

    fn u32(&mut self) -> Option<u32> {
        self.number(4)
    }

    fn i32(&mut self) -> Option<i32> {
        self.number(4).map(u32::cast_signed)
    }

    fn finite(&mut self) -> Option<f32> {
        let number = f32::from_bits(self.u32()?);
        number.is_finite().then_some(number)
    }

    fn bool(&mut self) -> Option<bool> {
        match self.u8()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    /// A number that is not above `limit`.
    fn count(&mut self, limit: usize) -> Option<usize> {
        let count = usize::from(self.u16()?);
        (count <= limit).then_some(count)
    }

    /// A text after its length, which has `width` bytes in CoLa B.
    fn string(&mut self, width: usize) -> Option<String> {
        let length = self.number(width)? as usize;
        let text = self.take((length <= MAX_TEXT).then_some(length)?)?;
        if self.coding == Coding::A && !self.rest.is_empty() {
            self.rest = self.rest.strip_prefix(b" ")?;
        }
        Some(String::from_utf8_lossy(text).into_owned())
    }

    fn answer(&mut self, request: &'static str, good: u8) -> Option<Message> {
        let code = self.u8()?;
        let result = if code == good { Ok(()) } else { Err(code) };
        Some(Message::Answer { request, result })
    }

    fn identity(&mut self) -> Option<Message> {
        let device = self.string(2)?;
        let firmware = self.string(2)?;
        Some(Message::Identity { device, firmware })
    }

    fn device_state(&mut self) -> Option<DeviceState> {
        match self.u8()? {
            0 => Some(DeviceState::Busy),
            1 => Some(DeviceState::Ready),
            2 => Some(DeviceState::Error),
            3 => Some(DeviceState::Standby),
            _ => None,
        }
    }

    /// Devices with several sectors send all of them; the first is read.
    fn scan_config(&mut self) -> Option<ScanConfig> {
        let frequency_centihertz = self.u32()?;
        self.u16()?;
        let sector = Sector::read(self)?;
        self.rest = &[];
        Some(ScanConfig {
            frequency_centihertz,
            sector,
        })
    }

    /// A channel whose values have `width` bytes in CoLa B.
    fn channel(&mut self, width: usize) -> Option<Channel> {
        let content = match self.coding {
            Coding::A => self.name(),
            Coding::B => self.take(5)?,
        };
        let is_content = content.len() == 5 && content.iter().all(u8::is_ascii_alphanumeric);
        let content = String::from_utf8_lossy(is_content.then_some(content)?).into_owned();
        let (scale, offset) = (self.finite()?, self.finite()?);
        let (start_deg_e4, step_deg_e4) = (self.i32()?, self.u16()?);
        let shortest = match self.coding {
            Coding::A => 2,
            Coding::B => width,
        };
        // The last token of CoLa A may lack its space.
        let count = self.count(self.rest.len().div_ceil(shortest))?;
        let value = |_| self.number(width)?.try_into().ok();
        Some(Channel {
            content,
            scale,
            offset,
            start_deg_e4,
            step_deg_e4,
            values: (0..count).map(value).collect::<Option<_>>()?,
        })
    }

    /// A number of two bytes that says whether a block follows.
    fn flag(&mut self) -> Option<bool> {
        Some(self.count(1)? == 1)
    }

    /// What follows the channels. In CoLa B, lengths of texts have `width` bytes: 1 in manuals, 2 in
    /// all other telegrams.
    fn details(mut self, width: usize) -> Option<Details> {
        let mut details = Details::default();
        if self.flag()? {
            details.position = Some(Position {
                translation: [self.finite()?, self.finite()?, self.finite()?],
                rotation: [self.finite()?, self.finite()?, self.finite()?],
                rotation_kind: self.u8()?,
            });
        }
        if self.flag()? {
            details.name = Some(self.string(width)?);
        }
        if self.flag()? {
            details.comment = Some(self.string(width)?);
        }
        if self.flag()? {
            let year = self.u16()?;
            let date = [self.u8()?, self.u8()?];
            let clock = [self.u8()?, self.u8()?, self.u8()?];
            details.time = Some(DeviceTime {
                year,
                month_to_second: [date[0], date[1], clock[0], clock[1], clock[2]],
                microsecond: self.u32()?,
            });
        }
        let is_event = self.flag()?;
        (is_event || self.rest.is_empty()).then_some(details)
    }
}

fn scan_data(values: &mut Values<'_>) -> Option<ScanData> {
    let _version = values.u16()?;
    let _device_number = values.u16()?;
    let serial_number = values.u32()?;
    let status = ScanStatus([values.u8()?, values.u8()?]);
    let (telegram_counter, scan_counter) = (values.u16()?, values.u16()?);
    let (power_up_time_us, transmission_time_us) = (values.u32()?, values.u32()?);
    let inputs_outputs = [values.u8()?, values.u8()?, values.u8()?, values.u8()?];
    let _layer = values.u16()?;
    let frequency_centihertz = values.u32()?;
    let _measurement_frequency = values.u32()?;
    let encoders = (0..values.count(MAX_ENCODERS)?).map(|_| {
        Some(Encoder {
            position_ticks: values.u32()?,
            speed: values.u16()?,
        })
    });
    let encoders = encoders.collect::<Option<_>>()?;
    let mut channels = Vec::new();
    for width in [2, 1] {
        for _ in 0..values.count(MAX_CHANNELS)? {
            channels.push(values.channel(width)?);
        }
    }
    Some(ScanData {
        serial_number,
        status,
        telegram_counter,
        scan_counter,
        power_up_time_us,
        transmission_time_us,
        inputs_outputs,
        frequency_centihertz,
        encoders,
        channels,
        details: values.details(1).or_else(|| values.details(2)),
    })
}

#[cfg(test)]
mod tests;
