//! How the encoders of an AX3500 are read: through the motor guard, which owns the port.
//!
//! The guard asks `?Q0`, `?Q1` and `?Z` between its commands and forwards what it receives, unparsed,
//! through a pipe that it never waits for: a full pipe loses bytes, which the guard counts, and in
//! their place is a character that no line has. Nothing goes the other way, so that a fault here
//! cannot reach the motors.

use std::time::Duration;

use measurement::MeasurementData;

use super::{Encoder, EncoderDecoder, Message, WheelAngle, WheelEncoder};
use crate::device::{Device, Event, Sample, Step};

/// Encoders of a left and a right wheel.
#[derive(Debug)]
pub struct RoboteqEncoders {
    /// Of channels 1 and 2.
    wheels: [Wheel; 2],
}

#[derive(Debug)]
struct Wheel {
    joint: String,
    angle: WheelAngle,
    /// New since the last measurement.
    angle_rad: Option<f64>,
}

impl RoboteqEncoders {
    /// Joints that the wheels of channels 1 and 2 turn, and their encoders.
    pub fn new(channels: [(&str, WheelEncoder); 2]) -> Self {
        let wheel = |(joint, encoder): (&str, WheelEncoder)| Wheel {
            joint: joint.to_owned(),
            angle: WheelAngle::new(encoder),
            angle_rad: None,
        };
        Self {
            wheels: channels.map(wheel),
        }
    }

    fn restart(&mut self) {
        for wheel in &mut self.wheels {
            wheel.angle.restart();
            wheel.angle_rad = None;
        }
    }
}

impl Device for RoboteqEncoders {
    type Decoder = EncoderDecoder;

    /// The controller may have been reset meanwhile: angles go on from the next counts.
    fn connect(&mut self) -> EncoderDecoder {
        self.restart();
        EncoderDecoder::default()
    }

    fn step(&self, _step: usize) -> Step {
        Step::Done
    }

    fn take(&mut self, message: Message, _awaited: Option<usize>, events: &mut Vec<Event>) {
        match message {
            Message::Count { encoder, count } => {
                let wheel = match encoder {
                    Encoder::One => &mut self.wheels[0],
                    Encoder::Two => &mut self.wheels[1],
                };
                wheel.angle_rad = Some(wheel.angle.update(count));
                // Both together, or the vehicle would turn.
                if self.wheels.iter().all(|wheel| wheel.angle_rad.is_some()) {
                    let angles = self
                        .wheels
                        .iter_mut()
                        .filter_map(|wheel| Some((wheel.joint.clone(), wheel.angle_rad.take()?)));
                    events.push(Event::Sample(Sample {
                        sent: None,
                        age: Duration::ZERO,
                        data: MeasurementData::Joints(angles.collect()),
                    }));
                }
            }
            // The guard reports them.
            Message::Speeds(_) => {}
            Message::Restarted => {
                self.restart();
                events.push(Event::Restarted);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::Decoder;

    /// The last angles of channels 1 and 2, in turns.
    fn turns(device: &mut RoboteqEncoders, bytes: &[u8]) -> Vec<[f64; 2]> {
        let mut decoder = device.connect();
        decoder.push(bytes);
        let mut events = Vec::new();
        while let Some(message) = decoder.next_message() {
            device.take(message, None, &mut events);
        }
        let joints = events.into_iter().filter_map(|event| match event {
            Event::Sample(sample) => Some(sample.data),
            _ => None,
        });
        let turns = joints.map(|data| match data {
            MeasurementData::Joints(joints) => {
                assert_eq!(
                    (joints[0].0.as_str(), joints[1].0.as_str()),
                    ("left", "right")
                );
                [0, 1].map(|wheel: usize| (joints[wheel].1 / TAU * 1e6).round() / 1e6)
            }
            other => panic!("{other:?}"),
        });
        turns.collect()
    }

    #[test]
    fn counts_become_angles_of_both_wheels() {
        // 100 pulses in a turn, four counts in a pulse; the right wheel counts backwards.
        let left = WheelEncoder::new(100.0, 0).unwrap();
        let right = WheelEncoder::new(-100.0, 0).unwrap();
        let mut device = RoboteqEncoders::new([("left", left), ("right", right)]);
        let bytes = b"?Q0\r00\r?Q1\r00\r?Z\r05\rFB\r?Q0\r64\r?Q0\rC8\r?Q1\rFF38\r?Q0\r012C\r";
        assert_eq!(turns(&mut device, bytes), [[0.0, 0.0], [-0.14, 0.5]]);
        // A new connection: the counts may have been reset, the angles stay.
        let again = turns(&mut device, b"?Q0\r00\r?Q1\r00\r?Q0\r64\r?Q1\r9C\r");
        assert_eq!(again.len(), 2);
        assert!((again[1][0] - again[0][0] - 0.25).abs() < 1e-9);
    }
}
