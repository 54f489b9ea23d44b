//! How a connection with an LD-LRS goes. Speed and step are as the device has them in its memory.

use std::time::Duration;

use measurement::MeasurementData;

use super::{LdlrsDecoder, Message, Mode, Profile, Request, SectorData, Status, refusal_meaning};
use crate::clock_mapping::DeviceTime;
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};

/// LD-LRS data sheet.
const RANGE_M: [f32; 2] = [0.5, 250.0];

/// A scanner.
#[derive(Debug)]
pub struct SickLdlrs {
    range_m: [f32; 2],
    mode: Option<Mode>,
    counter: Option<u16>,
}

/// Steps of the configuration.
const SERIAL_NUMBER: usize = 0;
const STATUS: usize = 1;
const ROTATE: usize = 2;
const MEASURE: usize = 3;
const PROFILES: usize = 4;

impl SickLdlrs {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let [min, max] = RANGE_M;
        Self {
            range_m: config.range_limits_m(min, max),
            mode: None,
            counter: None,
        }
    }

    fn status(&mut self, status: Status, step: usize) -> Event {
        self.mode = Some(status.mode);
        match (step, status.mode) {
            (_, Mode::Error) => Event::Refused(format!("it is faulty: motor {}", status.motor)),
            (STATUS, _)
            | (ROTATE, Mode::Rotating | Mode::Measuring)
            | (MEASURE, Mode::Measuring) => Event::Accepted,
            (MEASURE, _) if status.refusal != 0 => Event::Refused(format!(
                "it does not measure: {}",
                refusal_meaning(status.refusal)
            )),
            // The motor is not yet fast enough.
            (ROTATE | MEASURE, _) => Event::NotYet,
            _ => Event::Unexpected,
        }
    }

    fn profile(&mut self, profile: &Profile, events: &mut Vec<Event>) {
        if self.counter.replace(profile.counter) == Some(profile.counter) {
            return events.push(Event::Repeated);
        }
        let [min, max] = self.range_m;
        for sector in &profile.sectors {
            let sample = sector.motor_hz().and_then(|motor_hz| {
                let scan = sector.to_scan(motor_hz, min, max)?;
                let sweep_s = scan.sweep_duration()?.as_secs_f64();
                Some(Sample {
                    sent: Some(DeviceTime::counter(sector.end_ms.into(), 1_000_000, 16)),
                    age: Duration::try_from_secs_f64(sweep_s).ok()?,
                    data: MeasurementData::Scan {
                        scan,
                        own_pose: None,
                    },
                })
            });
            events.push(sample.map_or(Event::Unexpected, Event::Sample));
        }
    }
}

impl SectorData {
    /// Turns per second, a whole number. Times have steps of 1 ms: sectors below a quarter of a turn
    /// are too short.
    fn motor_hz(&self) -> Option<u16> {
        let steps = self.distances.len().checked_sub(1)? as f64;
        let turns = steps * f64::from(self.step_ticks) / f64::from(super::TICKS_PER_TURN);
        let seconds = f64::from(self.end_ms.wrapping_sub(self.start_ms)) / 1000.0;
        let hz = (turns / seconds).round();
        (turns >= 0.25 && (1.0..=50.0).contains(&hz)).then_some(hz as u16)
    }
}

impl Device for SickLdlrs {
    type Decoder = LdlrsDecoder;

    fn connect(&mut self) -> LdlrsDecoder {
        self.mode = None;
        self.counter = None;
        LdlrsDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        let (name, request) = match (step, self.mode) {
            (SERIAL_NUMBER, _) => ("GET_IDENTIFICATION", Request::ReadSerialNumber),
            (STATUS, _) => ("GET_STATUS", Request::ReadStatus),
            (ROTATE | MEASURE, Some(Mode::Measuring)) | (ROTATE, Some(Mode::Rotating)) => {
                return Step::Skip;
            }
            (ROTATE, _) => ("TRANS_ROTATE", Request::Rotate),
            (MEASURE, _) => ("TRANS_MEASURE", Request::Measure),
            (PROFILES, _) => ("GET_PROFILE", Request::SendProfiles),
            _ => return Step::Done,
        };
        Step::ask(name, request.to_bytes())
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        match (message, awaited) {
            (Message::SerialNumber(number), Some(SERIAL_NUMBER)) => {
                let identity = format!("LD-LRS, serial number {number}");
                events.extend([Event::Identity(identity), Event::Accepted]);
            }
            (Message::Status(status), Some(step)) => events.push(self.status(status, step)),
            (Message::ProfilesBegin, Some(PROFILES)) => events.push(Event::Accepted),
            (Message::Profile(profile), awaited) => {
                // The first may be the reply.
                events.extend((awaited == Some(PROFILES)).then_some(Event::Accepted));
                self.profile(&profile, events);
            }
            _ => events.push(Event::Unexpected),
        }
    }
}
