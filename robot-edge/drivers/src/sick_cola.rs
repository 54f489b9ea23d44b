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

use crate::read_buffer::StreamDecoder;

mod session;
mod telegram;

use telegram::{STX, Values, checksum};

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

/// Decodes what scanners send.
pub type SickColaDecoder = StreamDecoder<Message>;

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

#[cfg(test)]
mod tests;
