//! Settings of a vehicle whose motors hang on a Roboteq AX3500.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::wire::{Channel, Power};
use crate::actuators::differential_drive::{DifferentialDrive, SideSpeeds};
use crate::config::{ConfigIssue, Problem, WheelEncodersConfig};
use drivers::roboteq_encoders::{RoboteqEncoders, WheelEncoder};
use teleop::Velocity;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoboteqConfig {
    /// The serial port: `/dev/ttyS0`, or better a name that stays: `/dev/serial/by-id/…`.
    pub port: PathBuf,
    /// The vehicle's geometry; its full speed is that at command 127, measured on the vehicle, with a full battery
    /// where the controller runs open loop.
    pub drive: DifferentialDrive,
    /// The channel of the left side; the right side has the other.
    pub left_channel: Channel,
    #[serde(default)]
    pub left_is_inverted: bool,
    #[serde(default)]
    pub right_is_inverted: bool,
    /// Speed of a side at which its encoder says 127, metres per second; absent without encoders. By the manual (p. 85)
    /// the motor then turns at 127·58593.75 / ((time base + 1)·pulses per revolution) turns per minute.
    #[serde(default)]
    pub encoder_full_speed_mps: Option<f64>,
    /// Counts of the encoders as angles of wheels.
    #[serde(default)]
    pub encoders: Option<EncodersConfig>,
    /// Refuse to drive if the controller would not stop by itself without communication.
    #[serde(default = "yes")]
    pub require_watchdog: bool,
}

const fn yes() -> bool {
    true
}

/// A wheel's encoder counts up while its channel runs ahead, or backwards where the side is inverted; the sign of its
/// pulses says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncodersConfig {
    /// Pulses in one turn of the wheel, with the gear; four counts are a pulse.
    pub left_pulses_per_turn: f64,
    pub right_pulses_per_turn: f64,
    /// The joint in measurements, as a sensor of kind `wheel_encoders` names it.
    #[serde(default = "left_joint")]
    pub left_joint: String,
    #[serde(default = "right_joint")]
    pub right_joint: String,
}

fn left_joint() -> String {
    WheelEncodersConfig::default().left_joint
}

fn right_joint() -> String {
    WheelEncodersConfig::default().right_joint
}

impl EncodersConfig {
    fn check(&self) -> Vec<ConfigIssue> {
        let mut faults = Vec::new();
        let mut fault = |key: &str, value: String, why, allowed: &str| {
            faults.push(ConfigIssue {
                origin: None,
                key: format!("encoders.{key}"),
                problem: Problem::NotAllowed {
                    value,
                    why,
                    allowed: allowed.to_owned(),
                },
            });
        };
        for (key, pulses) in [
            ("left_pulses_per_turn", self.left_pulses_per_turn),
            ("right_pulses_per_turn", self.right_pulses_per_turn),
        ] {
            if wheel_encoder(pulses).is_none() {
                let allowed = "1 to 10000000; negative where it counts against its channel";
                fault(key, pulses.to_string(), "angles follow from it", allowed);
            }
        }
        for (key, joint) in [
            ("left_joint", &self.left_joint),
            ("right_joint", &self.right_joint),
        ] {
            if joint.is_empty() {
                fault(key, "\"\"".to_owned(), "it names a wheel", "a name");
            }
        }
        if self.left_joint == self.right_joint {
            let why = "the vehicle moves by the mean of two wheels";
            let value = format!("\"{}\"", self.right_joint);
            fault("right_joint", value, why, "a joint other than left_joint");
        }
        faults
    }
}

/// Without a time base, which only speeds have.
fn wheel_encoder(pulses_per_turn: f64) -> Option<WheelEncoder> {
    WheelEncoder::new(pulses_per_turn, 0)
}

impl RoboteqConfig {
    /// Everything that is wrong with the values; keys are relative to this table.
    pub fn check(&self) -> Vec<ConfigIssue> {
        let mut faults = Vec::new();
        let mut number = |key: &str, value: f64, least: f64, most: f64, why| {
            if !(least..=most).contains(&value) {
                faults.push(ConfigIssue {
                    origin: None,
                    key: key.to_owned(),
                    problem: Problem::NotAllowed {
                        value: value.to_string(),
                        why,
                        allowed: format!("{least} to {most}"),
                    },
                });
            }
        };
        number(
            "drive.track_width_m",
            self.drive.track_width_m,
            0.05,
            10.0,
            "the sides' speeds follow from it",
        );
        number(
            "drive.full_speed_mps",
            self.drive.full_speed_mps,
            0.05,
            20.0,
            "commands are fractions of it",
        );
        if let Some(full_mps) = self.encoder_full_speed_mps {
            number(
                "encoder_full_speed_mps",
                full_mps,
                0.05,
                50.0,
                "measured speeds are fractions of it",
            );
        }
        faults.extend(self.encoders.iter().flat_map(EncodersConfig::check));
        if self.port.as_os_str().is_empty() {
            faults.push(ConfigIssue {
                origin: None,
                key: "port".to_owned(),
                problem: Problem::NotAllowed {
                    value: "\"\"".to_owned(),
                    why: "it names the line to the motors",
                    allowed: "path of a serial port".to_owned(),
                },
            });
        }
        faults
    }

    /// The reader of the encoders, where counts are wanted.
    pub fn encoders(&self) -> Option<RoboteqEncoders> {
        let config = self.encoders.as_ref()?;
        let signed = |pulses: f64, is_inverted| if is_inverted { -pulses } else { pulses };
        let left = signed(config.left_pulses_per_turn, self.left_is_inverted);
        let right = signed(config.right_pulses_per_turn, self.right_is_inverted);
        let left = (config.left_joint.as_str(), wheel_encoder(left)?);
        let right = (config.right_joint.as_str(), wheel_encoder(right)?);
        Some(RoboteqEncoders::new(match self.left_channel {
            Channel::One => [left, right],
            Channel::Two => [right, left],
        }))
    }

    pub fn powers(&self, velocity: Velocity) -> [Power; 2] {
        let sides = self.drive.sides(velocity);
        let full_mps = self.drive.full_speed_mps;
        self.by_channel(
            Power::from_fraction(sides.left_mps / full_mps),
            Power::from_fraction(sides.right_mps / full_mps),
        )
    }

    pub fn velocity_of_powers(&self, powers: [Power; 2]) -> Velocity {
        let [left, right] = self.by_side(powers);
        self.velocity_of_sides(left, right, self.drive.full_speed_mps)
    }

    pub fn velocity_of_encoders(&self, speeds: [Power; 2]) -> Option<Velocity> {
        let [left, right] = self.by_side(speeds);
        let full_mps = self.encoder_full_speed_mps?;
        Some(self.velocity_of_sides(left, right, full_mps))
    }

    fn velocity_of_sides(&self, left: Power, right: Power, full_mps: f64) -> Velocity {
        self.drive.velocity(SideSpeeds {
            left_mps: left.fraction() * full_mps,
            right_mps: right.fraction() * full_mps,
        })
    }

    fn by_channel(&self, left: Power, right: Power) -> [Power; 2] {
        let left = left.inverted_if(self.left_is_inverted);
        let right = right.inverted_if(self.right_is_inverted);
        match self.left_channel {
            Channel::One => [left, right],
            Channel::Two => [right, left],
        }
    }

    fn by_side(&self, [one, two]: [Power; 2]) -> [Power; 2] {
        let (left, right) = match self.left_channel {
            Channel::One => (one, two),
            Channel::Two => (two, one),
        };
        [
            left.inverted_if(self.left_is_inverted),
            right.inverted_if(self.right_is_inverted),
        ]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn config() -> RoboteqConfig {
        toml::from_str(
            "port = \"/dev/ttyS0\"\nleft_channel = \"two\"\nright_is_inverted = true\n\
             drive = { track_width_m = 0.5, full_speed_mps = 2.0 }\nencoder_full_speed_mps = 2.54\n",
        )
        .unwrap()
    }

    #[test]
    fn channels_and_directions_are_those_of_the_vehicle() {
        let velocity = Velocity {
            linear_mps: 1.0,
            lateral_mps: 0.0,
            angular_radps: 1.0,
        };
        // Left 0.75 m/s on channel 2, right 1.25 m/s on channel 1 and inverted.
        let [one, two] = config().powers(velocity);
        assert_eq!((one.get(), two.get()), (-79, 48));
        let back = config().velocity_of_powers([one, two]);
        assert!((back.linear_mps - 1.0).abs() < 0.01 && (back.angular_radps - 1.0).abs() < 0.04);
        let encoders =
            config().velocity_of_encoders([Power::from_fraction(-1.0), Power::from_fraction(1.0)]);
        assert!((encoders.unwrap().linear_mps - 2.54).abs() < 1e-9);
    }

    #[test]
    fn values_that_make_no_sense_are_named() {
        assert_eq!(config().check(), []);
        assert!(
            config().require_watchdog,
            "unless it is switched off on purpose"
        );
        let mut bad = config();
        bad.drive.track_width_m = 0.0;
        bad.drive.full_speed_mps = f64::NAN;
        bad.encoder_full_speed_mps = Some(-1.0);
        bad.encoders = Some(EncodersConfig {
            left_pulses_per_turn: 0.5,
            right_pulses_per_turn: -1e8,
            left_joint: String::new(),
            right_joint: String::new(),
        });
        bad.port = PathBuf::new();
        let keys: Vec<String> = bad.check().into_iter().map(|fault| fault.key).collect();
        assert_eq!(
            keys,
            [
                "drive.track_width_m",
                "drive.full_speed_mps",
                "encoder_full_speed_mps",
                "encoders.left_pulses_per_turn",
                "encoders.right_pulses_per_turn",
                "encoders.left_joint",
                "encoders.right_joint",
                "encoders.right_joint",
                "port"
            ]
        );
    }

    proptest! {
        #[test]
        fn powers_mean_the_velocity_within_their_step(linear_mps in -1.0..1.0f64, angular_radps in -2.0..2.0f64) {
            let config = config();
            let done = config.velocity_of_powers(config.powers(Velocity { linear_mps, lateral_mps: 0.0, angular_radps }));
            let step_mps = 2.0 / 127.0;
            prop_assert!((done.linear_mps - linear_mps).abs() <= step_mps / 2.0 + 1e-9);
            prop_assert!((done.angular_radps - angular_radps).abs() <= step_mps / 0.5 + 1e-9);
        }
    }
}
