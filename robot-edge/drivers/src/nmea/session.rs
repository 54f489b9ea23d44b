//! How a connection with an NMEA device goes: it sends, and is asked nothing.

use std::time::Duration;

use measurement::MeasurementData;

use super::{Gga, Message, NmeaDecoder, Sentence};
use crate::clock_mapping::DeviceTime;
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};
use crate::ntrip::position_report;
use crate::single_beam::single_beam;

const DAY_NS: i64 = 86_400_000_000_000;
/// Casters want a position every few seconds.
const REPORT_PERIOD_S: f64 = 5.0;
/// An echo sounder for boats.
const DEPTH_M: [f32; 2] = [0.3, 100.0];

/// A satellite receiver, or an echo sounder.
#[derive(Debug)]
pub struct Nmea {
    depth_limits_m: [f32; 2],
    /// Sounders that send DPT and DBT send the same depth twice.
    has_dpt: bool,
    reported_at_s: Option<f64>,
}

impl Nmea {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let [min, max] = DEPTH_M;
        Self {
            depth_limits_m: config.range_limits_m(min, max),
            has_dpt: false,
            reported_at_s: None,
        }
    }

    fn gga(&mut self, gga: &Gga, events: &mut Vec<Event>) {
        let Some(fix) = gga.fix() else {
            return events.push(Event::Unexpected);
        };
        if let Some(time_s) = gga.time_of_day_s {
            // Midnight makes one report more.
            let passed_s = self.reported_at_s.map(|before| (time_s - before).abs());
            if passed_s.is_none_or(|passed| passed >= REPORT_PERIOD_S) {
                self.reported_at_s = Some(time_s);
                events.extend(position_report(&fix, time_s).map(Event::Forward));
            }
        }
        let time = |time_s: f64| DeviceTime {
            nanos: ((time_s * 1e9) as i64).rem_euclid(DAY_NS),
            period_ns: DAY_NS,
        };
        events.push(Event::Sample(Sample {
            sent: gga.time_of_day_s.map(time),
            age: Duration::ZERO,
            data: MeasurementData::Fix(fix),
        }));
    }

    fn depth(&self, depth_m: Option<f64>) -> Event {
        Event::Sample(Sample {
            sent: None,
            age: Duration::ZERO,
            data: single_beam(depth_m.unwrap_or(f64::NAN), self.depth_limits_m),
        })
    }
}

impl Device for Nmea {
    type Decoder = NmeaDecoder;

    fn connect(&mut self) -> NmeaDecoder {
        self.has_dpt = false;
        self.reported_at_s = None;
        NmeaDecoder::default()
    }

    fn step(&self, _step: usize) -> Step {
        Step::Done
    }

    fn take(&mut self, message: Message, _awaited: Option<usize>, events: &mut Vec<Event>) {
        match message.sentence {
            Sentence::Gga(gga) => self.gga(&gga, events),
            Sentence::Dpt(dpt) => {
                self.has_dpt = true;
                events.push(self.depth(dpt.depth_m));
            }
            Sentence::Dbt(depth_m) if !self.has_dpt => events.push(self.depth(depth_m)),
            // Speeds, headings and errors have no use yet.
            _ => {}
        }
    }

    fn max_silence(&self) -> Duration {
        Duration::from_secs(3)
    }
}
