//! How a connection with the program of a `DeltaT` goes: it sends datagrams, and is asked nothing.

use std::time::Duration;

use measurement::MeasurementData;

use super::{DeltatDecoder, Ping};
use crate::device::{Device, Event, Sample, Step};

/// A multibeam sonar.
#[derive(Debug, Default)]
pub struct ImagenexDeltat {
    number: Option<u32>,
}

impl Device for ImagenexDeltat {
    type Decoder = DeltatDecoder;

    fn connect(&mut self) -> DeltatDecoder {
        self.number = None;
        DeltatDecoder::default()
    }

    fn step(&self, _step: usize) -> Step {
        Step::Done
    }

    fn take(&mut self, ping: Ping, _awaited: Option<usize>, events: &mut Vec<Event>) {
        if self.number.replace(ping.number) == Some(ping.number) {
            return events.push(Event::Repeated);
        }
        let age = ping.age_s.map(Duration::try_from_secs_f64);
        events.push(Event::Sample(Sample {
            sent: None,
            age: age.and_then(Result::ok).unwrap_or_default(),
            data: MeasurementData::Scan {
                scan: ping.scan,
                own_pose: None,
            },
        }));
    }

    /// Pings over long ranges take time.
    fn max_silence(&self) -> Duration {
        Duration::from_secs(3)
    }
}
