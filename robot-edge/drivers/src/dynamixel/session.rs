//! How a connection with a Dynamixel servo goes: it is asked for its angle.

use std::time::Duration;

use measurement::MeasurementData;

use super::{AX_12A, DynamixelDecoder, MX_28, Model, Status, X_SERIES};
use crate::config::{DeviceConfig, Servo};
use crate::device::{Device, Event, Sample, Step};

const RATE_HZ: f64 = 50.0;

/// A servo that tilts a sensor.
#[derive(Debug)]
pub struct Dynamixel {
    model: Model,
    id: u8,
    joint: String,
    period: Duration,
}

impl Dynamixel {
    /// As configured. `None` if the configuration lacks something.
    pub fn new(config: &DeviceConfig) -> Option<Self> {
        Some(Self {
            model: match config.servo? {
                Servo::Ax12a => AX_12A,
                Servo::Mx28 => MX_28,
                Servo::XSeries => X_SERIES,
            },
            id: u8::try_from(config.servo_id?).ok()?,
            joint: config.joint.clone()?,
            period: Duration::from_secs_f64(1.0 / config.rate_hz.unwrap_or(RATE_HZ)),
        })
    }
}

impl Device for Dynamixel {
    type Decoder = DynamixelDecoder;

    fn connect(&mut self) -> DynamixelDecoder {
        DynamixelDecoder::new(self.model.protocol)
    }

    fn step(&self, step: usize) -> Step {
        match step {
            0 => Step::ask(
                "ping",
                self.model.protocol.ping(self.id).unwrap_or_default(),
            ),
            _ => Step::Done,
        }
    }

    fn take(&mut self, status: Status, awaited: Option<usize>, events: &mut Vec<Event>) {
        let event = if status.id != self.id {
            Event::Unexpected
        } else if awaited == Some(0) {
            Event::Accepted
        } else if let Some(angle_rad) = self.model.position_rad(&status) {
            Event::Sample(Sample {
                sent: None,
                age: Duration::ZERO,
                data: MeasurementData::Joints(vec![(self.joint.clone(), angle_rad)]),
            })
        } else {
            Event::Unexpected
        };
        events.push(event);
    }

    fn poll_period(&self) -> Option<Duration> {
        Some(self.period)
    }

    fn poll(&mut self) -> Vec<u8> {
        self.model.read_position(self.id).unwrap_or_default()
    }
}
