//! How a connection with an RPLIDAR goes. It sends single nodes, which all models can.
//!
//! The motor of an A1 turns while its adapter's DTR is low, which no request changes.

use std::time::Duration;

use measurement::MeasurementData;

use super::{Message, RplidarDecoder, Sweep, request, set_motor_pwm};
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};

/// A1 data sheet.
const RANGE_M: [f32; 2] = [0.15, 12.0];
/// As the vendor's program sets it.
const MOTOR_PWM: u16 = 660;

/// A scanner.
#[derive(Debug)]
pub struct Rplidar {
    range_m: [f32; 2],
    sample_s: f64,
}

/// Steps of the configuration.
const STOP: usize = 0;
const INFO: usize = 1;
const HEALTH: usize = 2;
const SAMPLE_DURATION: usize = 3;
const MOTOR: usize = 4;
const SCAN: usize = 5;

impl Rplidar {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let [min, max] = RANGE_M;
        Self {
            range_m: config.range_limits_m(min, max),
            sample_s: 0.0,
        }
    }

    fn sweep(&self, sweep: &Sweep) -> Event {
        let [min, max] = self.range_m;
        let sample = sweep.to_scan(self.sample_s, min, max).and_then(|scan| {
            let sweep_s = self.sample_s * sweep.nodes.len() as f64;
            Some(Sample {
                sent: None,
                age: Duration::try_from_secs_f64(sweep_s).ok()?,
                data: MeasurementData::Scan {
                    scan,
                    own_pose: None,
                },
            })
        });
        sample.map_or(Event::Unexpected, Event::Sample)
    }
}

impl Device for Rplidar {
    type Decoder = RplidarDecoder;

    fn connect(&mut self) -> RplidarDecoder {
        RplidarDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match step {
            // It may still measure for the last connection.
            STOP => Step::Tell(request::STOP.to_vec()),
            INFO => Step::ask("GET_INFO", request::INFO),
            HEALTH => Step::ask("GET_HEALTH", request::HEALTH),
            SAMPLE_DURATION => Step::ask("GET_SAMPLERATE", request::SAMPLE_DURATION),
            MOTOR => Step::Tell(set_motor_pwm(MOTOR_PWM)),
            SCAN => Step::ask("SCAN", request::SCAN),
            _ => Step::Done,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        let event = match (message, awaited) {
            (Message::Sweep(sweep), _) => self.sweep(&sweep),
            (Message::Info { model, serial, .. }, Some(INFO)) => {
                let serial = u128::from_be_bytes(serial);
                let identity = format!("RPLIDAR model {model:#04X}, serial number {serial:032X}");
                events.push(Event::Identity(identity));
                Event::Accepted
            }
            (Message::Health { status: 0 | 1, .. }, Some(HEALTH))
            | (Message::ScanBegins, Some(SCAN)) => Event::Accepted,
            (Message::Health { error_code, .. }, Some(HEALTH)) => Event::Refused(format!(
                "it is faulty, error {error_code}: switch it off and on"
            )),
            (Message::SampleDuration { scan_s, .. }, Some(SAMPLE_DURATION)) => {
                self.sample_s = scan_s;
                Event::Accepted
            }
            _ => Event::Unexpected,
        };
        events.push(event);
    }
}
