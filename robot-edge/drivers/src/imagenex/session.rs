//! How a connection with an Imagenex 852 goes: each command makes one shot.

use std::time::Duration;

use super::{
    DEVICE_SOUND_SPEED_MPS, EchoPoints, ImagenexDecoder, Model, Settings, Shot, request_shot_852,
};
use crate::config::DeviceConfig;
use crate::device::{Device, Event, Sample, Step};
use crate::single_beam::single_beam;

const RATE_HZ: f64 = 5.0;
/// The shortest and the middle one of the ranges that the device has.
const RANGE_M: [f32; 2] = [0.5, 30.0];

/// An echo sounder.
#[derive(Debug)]
pub struct Imagenex852 {
    command: Vec<u8>,
    period: Duration,
    range_m: [f32; 2],
    sound_speed_mps: f64,
}

impl Imagenex852 {
    /// As configured. `None` if the device has no such range.
    pub fn new(config: &DeviceConfig) -> Option<Self> {
        let [min, max] = RANGE_M;
        let range_m = config.range_limits_m(min, max);
        let settings = Settings {
            head_id: 0x11,
            max_range_m: range_m[1] as u8,
            min_range_m: range_m[0].into(),
            start_gain_db: 20,
            absorption_cdb_per_m: 20,
            pulse_length_us: 100,
            echo: EchoPoints::None,
        };
        let is_whole = f32::from(settings.max_range_m).to_bits() == range_m[1].to_bits();
        Some(Self {
            command: request_shot_852(&settings).filter(|_| is_whole)?.to_vec(),
            period: Duration::from_secs_f64(1.0 / config.rate_hz.unwrap_or(RATE_HZ)),
            range_m,
            sound_speed_mps: config.sound_speed_mps.unwrap_or(DEVICE_SOUND_SPEED_MPS),
        })
    }
}

impl Device for Imagenex852 {
    type Decoder = ImagenexDecoder;

    fn connect(&mut self) -> ImagenexDecoder {
        ImagenexDecoder::new(Model::EchoSounder852)
    }

    fn step(&self, _step: usize) -> Step {
        Step::Done
    }

    fn take(&mut self, shot: Shot, _awaited: Option<usize>, events: &mut Vec<Event>) {
        if !shot.switches_accepted || shot.character_overrun {
            return events.push(Event::Unexpected);
        }
        let range_m = shot.range_at_m(self.sound_speed_mps);
        events.push(Event::Sample(Sample {
            sent: None,
            age: Duration::ZERO,
            data: single_beam(range_m.unwrap_or(f64::NAN), self.range_m),
        }));
    }

    fn poll_period(&self) -> Option<Duration> {
        Some(self.period)
    }

    fn poll(&mut self) -> Vec<u8> {
        self.command.clone()
    }

    fn max_silence(&self) -> Duration {
        (3 * self.period).max(Duration::from_secs(1))
    }
}
