//! How a connection with a u-blox receiver goes.

use std::time::Duration;

use measurement::MeasurementData;

use super::{CFG_VALSET, Message, Port, Pvt, Setting, UbloxDecoder, configure};
use crate::clock_mapping::DeviceTime;
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};
use crate::ntrip::position_report;

const RATE_HZ: f64 = 5.0;
const WEEK_MS: u32 = 7 * 86_400_000;
/// Casters want a position every few seconds.
const REPORT_PERIOD_MS: u32 = 5000;
const IS_TIME: u8 = 2;

/// A satellite receiver.
#[derive(Debug)]
pub struct Ublox {
    configuration: Vec<u8>,
    reported_at_ms: Option<u32>,
}

impl Ublox {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let rate_hz = config.rate_hz.unwrap_or(RATE_HZ);
        let period_ms = (1000.0 / rate_hz).round() as u16;
        // Which of its ports the line is at is not known here.
        let of_port = |port| {
            [
                Setting::pvt_output(port, 1),
                Setting::nmea_output(port, false),
                Setting::rtcm_input(port, true),
            ]
        };
        let ports = [Port::Uart1, Port::Usb].into_iter().flat_map(of_port);
        let settings: Vec<Setting> = ports
            .chain([Setting::measurement_period_ms(period_ms)])
            .collect();
        Self {
            configuration: configure(&settings, false).unwrap_or_default(),
            reported_at_ms: None,
        }
    }

    fn pvt(&mut self, pvt: &Pvt, events: &mut Vec<Event>) {
        let fix = pvt.fix();
        let time_ms = pvt.time_of_week_ms % WEEK_MS;
        let passed_ms = self.reported_at_ms.map(|before| time_ms.abs_diff(before));
        if pvt.utc.valid & IS_TIME != 0 && passed_ms.is_none_or(|passed| passed >= REPORT_PERIOD_MS)
        {
            self.reported_at_ms = Some(time_ms);
            let minutes = u32::from(pvt.utc.hour) * 60 + u32::from(pvt.utc.minute);
            let time_of_day_s = f64::from(minutes * 60 + u32::from(pvt.utc.second));
            events.extend(position_report(&fix, time_of_day_s).map(Event::Forward));
        }
        events.push(Event::Sample(Sample {
            sent: Some(DeviceTime {
                nanos: i64::from(time_ms) * 1_000_000,
                period_ns: i64::from(WEEK_MS) * 1_000_000,
            }),
            age: Duration::ZERO,
            data: MeasurementData::Fix(fix),
        }));
    }
}

impl Device for Ublox {
    type Decoder = UbloxDecoder;

    fn connect(&mut self) -> UbloxDecoder {
        self.reported_at_ms = None;
        UbloxDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match step {
            0 => Step::ask("UBX-CFG-VALSET", self.configuration.clone()),
            _ => Step::Done,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        match (message, awaited) {
            (Message::Pvt(pvt), _) => self.pvt(&pvt, events),
            (
                Message::Reply {
                    request: CFG_VALSET,
                    is_accepted,
                },
                Some(0),
            ) => events.push(if is_accepted {
                Event::Accepted
            } else {
                Event::Refused("the receiver refuses the settings (UBX-CFG-VALSET)".to_owned())
            }),
            _ => events.push(Event::Unexpected),
        }
    }

    fn max_silence(&self) -> Duration {
        Duration::from_secs(3)
    }
}
