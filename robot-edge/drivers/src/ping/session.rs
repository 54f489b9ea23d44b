//! How a connection with a `Ping1D` goes: it is asked for each distance.

use std::time::Duration;

use super::{
    Message, PingDecoder, request_device_information, request_distance, set_speed_of_sound,
};
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};
use crate::single_beam::single_beam;

const RATE_HZ: f64 = 10.0;
/// Data sheet.
const RANGE_M: [f32; 2] = [0.3, 100.0];
const PING_1D: u8 = 1;

/// An echo sounder.
#[derive(Debug)]
pub struct Ping1d {
    period: Duration,
    range_m: [f32; 2],
    sound_speed_mps: Option<f64>,
    number: Option<u32>,
}

impl Ping1d {
    /// As configured.
    pub fn new(config: &DeviceConfig) -> Self {
        let [min, max] = RANGE_M;
        Self {
            period: Duration::from_secs_f64(1.0 / config.rate_hz.unwrap_or(RATE_HZ)),
            range_m: config.range_limits_m(min, max),
            sound_speed_mps: config.sound_speed_mps,
            number: None,
        }
    }
}

impl Device for Ping1d {
    type Decoder = PingDecoder;

    fn connect(&mut self) -> PingDecoder {
        self.number = None;
        PingDecoder::default()
    }

    fn step(&self, step: usize) -> Step {
        match step {
            0 => Step::ask("device_information", request_device_information()),
            // Not all firmware replies to it.
            1 => (self.sound_speed_mps.and_then(set_speed_of_sound)).map_or(Step::Skip, Step::Tell),
            _ => Step::Done,
        }
    }

    fn take(&mut self, message: Message, awaited: Option<usize>, events: &mut Vec<Event>) {
        let event = match message {
            Message::DeviceInformation {
                device_type,
                firmware: [major, minor, patch],
                ..
            } if awaited == Some(0) => {
                if device_type == PING_1D {
                    let identity = format!("Ping1D, firmware {major}.{minor}.{patch}");
                    events.push(Event::Identity(identity));
                    Event::Accepted
                } else {
                    Event::Refused(format!("it is no Ping1D: its type is {device_type}"))
                }
            }
            Message::Distance(distance) => {
                let number = distance.ping.map(|ping| ping.number);
                if number.is_some() && self.number == number {
                    Event::Repeated
                } else {
                    self.number = number;
                    Event::Sample(Sample {
                        sent: None,
                        age: Duration::ZERO,
                        data: single_beam(distance.distance_m, self.range_m),
                    })
                }
            }
            // The acceptance of the speed of sound.
            Message::Ack(_) => return,
            Message::Nack { id, text } => {
                Event::Refused(format!("message {id} is refused: {text}"))
            }
            Message::DeviceInformation { .. } => Event::Unexpected,
        };
        events.push(event);
    }

    fn poll_period(&self) -> Option<Duration> {
        Some(self.period)
    }

    fn poll(&mut self) -> Vec<u8> {
        request_distance()
    }

    fn max_silence(&self) -> Duration {
        (3 * self.period).max(Duration::from_secs(1))
    }
}
