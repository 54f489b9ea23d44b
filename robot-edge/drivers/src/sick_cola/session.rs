//! How a connection with a SICK scanner goes.
//!
//! The settings are read first: writing them restarts the motor of some devices.

use std::time::Duration;

use measurement::MeasurementData;

use super::{
    CLIENT_LOGIN, Coding, Message, Request, ScanConfig, ScanData, ScanDataConfig, Sector,
    SickColaDecoder, error_meaning, step_deg,
};
use crate::clock_mapping::DeviceTime;
use crate::config::{ColaCoding, DeviceConfig};
use crate::device::{Device, Event, Sample, Step};

/// LMS111 data sheet; TiM and LMS5xx have their own.
const RANGE_M: [f32; 2] = [0.5, 20.0];

/// The first echo of each beam, nothing else, every scan.
const SCAN_DATA: ScanDataConfig = ScanDataConfig {
    echoes: [1, 0],
    rssi: false,
    rssi_16_bit: false,
    encoders: [0, 0],
    position: false,
    name: false,
    comment: false,
    time: false,
    every: 1,
};

/// A scanner.
#[derive(Debug)]
pub struct SickCola {
    range_m: [f32; 2],
    rate_hz: Option<f64>,
    resolution_deg: Option<f64>,
    /// Degrees from the sensor's x axis.
    sector_deg: Option<[f64; 2]>,
    /// As configured.
    coding: Option<ColaCoding>,
    /// In use.
    current: Coding,
    has_answered: bool,
    device: String,
    scan_config: Option<ScanConfig>,
    output_range: Option<Sector>,
    scan_data_config: Option<ScanDataConfig>,
    /// What was to be set when the settings were first read.
    changes: Vec<Request>,
    is_changed: bool,
    serial_number: Option<u32>,
    scan_counter: Option<u16>,
}

/// Steps of the configuration. The settings are read, changed and read back.
const READ_IDENTITY: usize = 0;
const READ_SETTINGS: usize = 1;
const LOGIN: usize = 4;
const CHANGE: usize = 5;
const READ_BACK: usize = 8;
const START: usize = 11;
const RUN: usize = 12;
const SUBSCRIBE: usize = 13;
/// Settings that can be changed.
const SETTINGS: usize = 3;

impl SickCola {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let [min, max] = RANGE_M;
        Self {
            range_m: config.range_limits_m(min, max),
            rate_hz: config.rate_hz,
            resolution_deg: config.resolution_deg,
            sector_deg: config
                .sector_from_deg
                .zip(config.sector_to_deg)
                .map(<[f64; 2]>::from),
            coding: config.coding,
            current: match config.coding {
                Some(ColaCoding::A) => Coding::A,
                Some(ColaCoding::B) | None => Coding::B,
            },
            has_answered: true,
            device: String::new(),
            scan_config: None,
            output_range: None,
            scan_data_config: None,
            changes: Vec::new(),
            is_changed: false,
            serial_number: None,
            scan_counter: None,
        }
    }

    fn request(&self, step: usize) -> Option<Request> {
        let is_changed = self.is_changed;
        Some(match step {
            READ_IDENTITY => Request::ReadIdentity,
            _ if (READ_SETTINGS..READ_SETTINGS + SETTINGS).contains(&step) => {
                self.read_setting(step - READ_SETTINGS)?
            }
            LOGIN if is_changed => CLIENT_LOGIN,
            _ if (CHANGE..CHANGE + SETTINGS).contains(&step) => *self.changes.get(step - CHANGE)?,
            _ if is_changed && (READ_BACK..READ_BACK + SETTINGS).contains(&step) => {
                self.read_setting(step - READ_BACK)?
            }
            START if is_changed => Request::StartMeasuring,
            RUN if is_changed => Request::Run,
            SUBSCRIBE => Request::Subscribe(true),
            _ => return None,
        })
    }

    fn read_setting(&self, number: usize) -> Option<Request> {
        match number {
            0 => {
                let is_set = self.rate_hz.is_some() || self.resolution_deg.is_some();
                is_set.then_some(Request::ReadScanConfig)
            }
            1 => Some(Request::ReadScanDataConfig),
            _ => self.sector_deg.map(|_| Request::ReadOutputRange),
        }
    }

    /// Settings that the device has otherwise than configured.
    fn find_changes(&self) -> Vec<Request> {
        let scan_config = self.scan_config.and_then(|is| {
            let wanted = ScanConfig {
                frequency_centihertz: (self.rate_hz)
                    .map_or(is.frequency_centihertz, |hz| (hz * 100.0).round() as u32),
                sector: Sector {
                    resolution_deg_e4: self
                        .resolution_deg
                        .map_or(is.sector.resolution_deg_e4, deg_e4),
                    ..is.sector
                },
            };
            (wanted != is).then_some(Request::SetScanConfig(wanted))
        });
        let scan_data = (self.scan_data_config).filter(|is| *is != SCAN_DATA);
        let output_range = self
            .output_range
            .zip(self.sector_deg)
            .and_then(|(is, [from, to])| {
                // The device's x axis is to the right. Its sector does not go round.
                let to = if to < from { to + 360.0 } else { to };
                let forward_deg = super::FORWARD_DEG;
                let wanted = Sector {
                    resolution_deg_e4: self.resolution_deg.map_or(is.resolution_deg_e4, deg_e4),
                    start_deg_e4: ((from + forward_deg) * super::DEG_E4).round() as i32,
                    stop_deg_e4: ((to + forward_deg) * super::DEG_E4).round() as i32,
                };
                // Devices round to their beams: an LMS111 says −44.9997° for −45°.
                let differs = |a: i32, b: i32| a.abs_diff(b) > is.resolution_deg_e4;
                let is_other = differs(is.start_deg_e4, wanted.start_deg_e4)
                    || differs(is.stop_deg_e4, wanted.stop_deg_e4)
                    || is.resolution_deg_e4 != wanted.resolution_deg_e4;
                is_other.then_some(Request::SetOutputRange(wanted))
            });
        let scan_data = scan_data.map(|_| Request::SetScanDataConfig(SCAN_DATA));
        [scan_config, scan_data, output_range]
            .into_iter()
            .flatten()
            .collect()
    }

    /// After a setting was read: what is to be changed, or whether the device has taken the changes.
    fn setting_read(&mut self, step: usize) -> Event {
        let last = |first: usize| first + if self.sector_deg.is_some() { 2 } else { 1 };
        if step == last(READ_SETTINGS) {
            self.changes = self.find_changes();
            self.is_changed = !self.changes.is_empty();
        } else if step == last(READ_BACK)
            && let Some(refused) = self.find_changes().first()
        {
            let (name, values) = match refused {
                Request::SetScanConfig(_) => (
                    "rate_hz and resolution_deg",
                    format!("{:?}", self.scan_config),
                ),
                Request::SetOutputRange(_) => ("the sector", format!("{:?}", self.output_range)),
                _ => ("what scans contain", format!("{:?}", self.scan_data_config)),
            };
            return Event::Refused(format!("the device does not take {name}; it has {values}"));
        }
        Event::Accepted
    }

    fn scan(&mut self, scan: &ScanData, events: &mut Vec<Event>) {
        if self.serial_number.replace(scan.serial_number) != Some(scan.serial_number) {
            let identity = format!("{}, serial number {}", self.device, scan.serial_number);
            events.push(Event::Identity(identity));
        }
        if self.scan_counter.replace(scan.scan_counter) == Some(scan.scan_counter) {
            return events.push(Event::Repeated);
        }
        let [min, max] = self.range_m;
        let sample = scan.to_scan(min, max).and_then(|converted| {
            Some(Sample {
                sent: Some(DeviceTime::counter(scan.transmission_time_us, 1000, 32)),
                age: scan.first_beam_age()?,
                data: MeasurementData::Scan {
                    scan: converted,
                    own_pose: None,
                },
            })
        });
        events.push(sample.map_or(Event::Unexpected, Event::Sample));
    }
}

impl ScanData {
    /// Time from the first beam to [`Self::transmission_time_us`].
    ///
    /// The manuals put [`Self::power_up_time_us`] before the first beam. In the captures the
    /// transmission follows it after 3.1 ms (LMS111 at 50 Hz) and 6.3 ms (TiM781S at 15 Hz), less than
    /// the sweep takes: it is the time of a zero index after the sweep, opposite of the x axis.
    fn first_beam_age(&self) -> Option<Duration> {
        let channel = self.channel("DIST1")?;
        let frequency_hz = f64::from(self.frequency_centihertz) / 100.0;
        let first_deg = f64::from(channel.start_deg_e4) / super::DEG_E4 - super::FORWARD_DEG;
        let to_index_s = (180.0 - first_deg) / 360.0 / frequency_hz;
        let to_transmission = self
            .transmission_time_us
            .wrapping_sub(self.power_up_time_us);
        let is_possible = step_deg(channel.step_deg_e4) > 0.0 && to_transmission < 1_000_000;
        let sweep = Duration::try_from_secs_f64(to_index_s).ok()?;
        is_possible.then(|| sweep + Duration::from_micros(to_transmission.into()))
    }
}

fn deg_e4(degrees: f64) -> u32 {
    (degrees * super::DEG_E4).round() as u32
}

impl Device for SickCola {
    type Decoder = SickColaDecoder;

    fn connect(&mut self) -> SickColaDecoder {
        if self.coding.is_none() && !self.has_answered {
            self.current = match self.current {
                Coding::A => Coding::B,
                Coding::B => Coding::A,
            };
        }
        self.has_answered = false;
        self.changes.clear();
        self.is_changed = false;
        self.serial_number = None;
        self.scan_counter = None;
        SickColaDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match self.request(step) {
            Some(request) => Step::ask(request.name(), request.to_bytes(self.current)),
            None if step > SUBSCRIBE => Step::Done,
            None => Step::Skip,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        self.has_answered |= awaited.is_some();
        let request = awaited.and_then(|step| self.request(step));
        let step = awaited.unwrap_or_default();
        let event = match (message, request) {
            (Message::Scan(scan), _) => return self.scan(&scan, events),
            (Message::Identity { device, firmware }, Some(Request::ReadIdentity)) => {
                self.device = format!("{} {}", device.trim(), firmware.trim());
                Event::Accepted
            }
            (Message::ScanConfig(config), Some(Request::ReadScanConfig)) => {
                self.scan_config = Some(config);
                Event::Accepted
            }
            (Message::ScanDataConfig(config), Some(Request::ReadScanDataConfig)) => {
                self.scan_data_config = Some(config);
                self.setting_read(step)
            }
            (Message::OutputRange(range), Some(Request::ReadOutputRange)) => {
                self.output_range = Some(range);
                self.setting_read(step)
            }
            (Message::Subscribed(true), Some(Request::Subscribe(true))) => Event::Accepted,
            (
                Message::Answer {
                    request: name,
                    result,
                },
                Some(request),
            ) if request.name().ends_with(name) => match result {
                Ok(()) => Event::Accepted,
                Err(code) => Event::Refused(format!("{name} is refused with code {code}")),
            },
            (Message::Error(code), Some(request)) => Event::Refused(format!(
                "{} is refused: {}",
                request.name(),
                error_meaning(code)
            )),
            _ => Event::Unexpected,
        };
        events.push(event);
    }
}
