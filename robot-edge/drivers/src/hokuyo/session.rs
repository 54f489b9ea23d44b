//! How a connection with a Hokuyo scanner goes.

use std::time::Duration;

use measurement::MeasurementData;

use super::{
    Distances, Encoding, HokuyoDecoder, Message, Parameters, middle_of_first, request,
    request_scans,
};
use crate::clock_mapping::DeviceTime;
use crate::device::{Device, Event, Sample, Step};

/// A scanner.
#[derive(Debug, Default)]
pub struct Hokuyo {
    parameters: Option<Parameters>,
    step_0_time_ms: Option<u32>,
}

/// Steps of the configuration.
const SCIP2: usize = 0;
const STOP: usize = 1;
const VERSION: usize = 2;
const PARAMETERS: usize = 3;
const LASER_ON: usize = 4;
const SCANS: usize = 5;

impl Hokuyo {
    fn scan(&mut self, distances: &Distances) -> Event {
        if self.step_0_time_ms.replace(distances.step_0_time_ms) == Some(distances.step_0_time_ms) {
            return Event::Repeated;
        }
        let converted = self.parameters.as_ref().and_then(|parameters| {
            // The device sends when the last step is measured; its time is that of step 0.
            let to_last_s = f64::from(distances.end_step) * parameters.seconds_per_step();
            let from_first_s =
                to_last_s - middle_of_first(distances) * parameters.seconds_per_step();
            let mut sent = DeviceTime::counter(distances.step_0_time_ms, 1_000_000, 24);
            sent.nanos = (sent.nanos + (to_last_s * 1e9) as i64) % sent.period_ns;
            Some(Sample {
                sent: Some(sent),
                age: Duration::try_from_secs_f64(from_first_s).ok()?,
                data: MeasurementData::Scan {
                    scan: parameters.to_scan(distances)?,
                    own_pose: None,
                },
            })
        });
        converted.map_or(Event::Unexpected, Event::Sample)
    }
}

impl Device for Hokuyo {
    type Decoder = HokuyoDecoder;

    fn connect(&mut self) -> HokuyoDecoder {
        *self = Self::default();
        HokuyoDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match step {
            SCIP2 => Step::ask("SCIP2.0", request::SCIP2),
            // It may still measure for the last connection.
            STOP => Step::ask("QT", request::LASER_OFF),
            VERSION => Step::ask("VV", request::VERSION),
            PARAMETERS => Step::ask("PP", request::PARAMETERS),
            LASER_ON => Step::ask("BM", request::LASER_ON),
            SCANS => {
                let steps = self.parameters.as_ref().map(Parameters::steps);
                let request = steps.and_then(|steps| request_scans(Encoding::Long, steps, 1, 0));
                request.map_or(Step::Skip, |bytes| Step::ask("MD", bytes))
            }
            _ => Step::Done,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        let expected = match awaited {
            Some(SCIP2) => "SCIP2.0",
            Some(STOP) => "QT",
            Some(LASER_ON) => "BM",
            Some(SCANS) => "MD",
            _ => "",
        };
        let event = match (message, awaited) {
            (Message::Distances(distances), _) => self.scan(&distances),
            (Message::Version(lines), Some(VERSION)) => {
                let value = |name: &str| {
                    let line = lines.iter().find_map(|line| line.strip_prefix(name));
                    line.unwrap_or("?").trim().to_owned()
                };
                let (product, serial) = (value("PROD:"), value("SERI:"));
                events.push(Event::Identity(format!(
                    "{product}, serial number {serial}"
                )));
                Event::Accepted
            }
            (Message::Parameters(parameters), Some(PARAMETERS)) => {
                self.parameters = Some(parameters);
                Event::Accepted
            }
            (Message::Status { request, status }, _) if request == expected => {
                if status.is_ok(request) {
                    Event::Accepted
                } else {
                    Event::Refused(format!("{request} is refused: {}", status.meaning(request)))
                }
            }
            // Measuring has stopped.
            (
                Message::Status {
                    request: "MD",
                    status,
                },
                None,
            ) if !status.is_ok("MD") => Event::Refused(status.meaning("MD").to_owned()),
            _ => Event::Unexpected,
        };
        events.push(event);
    }
}
