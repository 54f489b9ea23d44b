//! Locomotion modes: how the wheels are set, and what the vehicle can do then [HYB 2.1, figure 2.2].

use std::time::Duration;

use serde::Deserialize;

use crate::config::{SettingError, TeleopConfig, out_of_range};
use crate::motion::Velocity;

/// How the wheels are set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LocomotionMode {
    /// Left and right wheels have speeds of their own: it goes and turns as it likes. Boats, too.
    Differential,
    /// The wheels of both axles steer against each other, or those of one axle steer: it turns only as it goes.
    DoubleAckermann,
    /// All wheels across: it goes to the left or right.
    Lateral,
    /// All wheels on one circle: it turns on the spot.
    TurnOnSpot,
    /// All wheels parallel: it goes in any direction and does not turn.
    Crab,
}

/// Settings of `[motors.modes]`: the modes that the motors have. Of several that can do what is requested, the present one
/// is kept, else the first is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "a configuration has no lists: each mode is a key"
)]
pub struct LocomotionModes {
    /// [`LocomotionMode::Differential`].
    pub differential: bool,
    /// [`LocomotionMode::DoubleAckermann`].
    pub double_ackermann: bool,
    /// [`LocomotionMode::TurnOnSpot`].
    pub turn_on_spot: bool,
    /// [`LocomotionMode::Lateral`].
    pub lateral: bool,
    /// [`LocomotionMode::Crab`].
    pub crab: bool,
}

impl LocomotionModes {
    /// That of a vehicle without others.
    pub const DIFFERENTIAL: Self = Self {
        differential: true,
        ..Self::NONE
    };

    const NONE: Self = Self {
        differential: false,
        double_ackermann: false,
        turn_on_spot: false,
        lateral: false,
        crab: false,
    };

    /// Whether one of them goes sideways.
    pub const fn goes_sideways(self) -> bool {
        self.lateral || self.crab
    }

    fn modes(self) -> [Option<LocomotionMode>; 5] {
        [
            (self.differential, LocomotionMode::Differential),
            (self.double_ackermann, LocomotionMode::DoubleAckermann),
            (self.turn_on_spot, LocomotionMode::TurnOnSpot),
            (self.lateral, LocomotionMode::Lateral),
            (self.crab, LocomotionMode::Crab),
        ]
        .map(|(has, mode)| has.then_some(mode))
    }
}

impl Default for LocomotionModes {
    fn default() -> Self {
        Self::DIFFERENTIAL
    }
}

/// Settings `modes`, `min_turn_radius_m` and `mode_change_s` of `[motors]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocomotionConfig {
    /// The modes that the motors have.
    pub modes: LocomotionModes,
    /// Of the middle of the vehicle, metres: smallest radius of a turn in [`LocomotionMode::DoubleAckermann`].
    pub min_turn_radius_m: f64,
    /// How long it stands between two modes, seconds: until it has come to rest and its wheels have turned.
    pub mode_change_s: f64,
}

impl Default for LocomotionConfig {
    fn default() -> Self {
        Self {
            modes: LocomotionModes::DIFFERENTIAL,
            min_turn_radius_m: 1.0,
            mode_change_s: 1.0,
        }
    }
}

impl LocomotionConfig {
    /// Everything that is wrong with the values; empty where nothing is.
    pub fn check(&self, teleop: &TeleopConfig) -> Vec<SettingError> {
        // The turn ends with the way ahead, however hard it brakes.
        let least_m = if self.modes.double_ackermann {
            teleop.stop_decel_mps2 / teleop.stop_decel_radps2
        } else {
            0.0
        };
        let mut faults = out_of_range(
            "motors",
            [
                (
                    "min_turn_radius_m",
                    self.min_turn_radius_m,
                    least_m.max(0.01)..=1000.0,
                    "turning must be able to end with a stop: teleop.stop_decel_mps2 over stop_decel_radps2",
                ),
                (
                    "mode_change_s",
                    self.mode_change_s,
                    0.3..=30.0,
                    "the vehicle comes to rest and its wheels turn meanwhile",
                ),
            ],
        );
        if self.modes == LocomotionModes::NONE {
            faults.push(SettingError {
                key: "motors.modes".to_owned(),
                value: "none".to_owned(),
                why: "a vehicle has at least one mode",
                allowed: "differential, double_ackermann, turn_on_spot, lateral or crab = true"
                    .to_owned(),
            });
        }
        faults
    }
}

/// The modes of one vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Locomotion {
    modes: [Option<LocomotionMode>; 5],
    min_turn_radius_m: f64,
    pub(crate) change: Duration,
}

impl LocomotionMode {
    /// The part of a velocity that is possible in this mode, whatever the radius of its turn.
    #[must_use]
    pub(crate) fn part_of(self, velocity: Velocity) -> Velocity {
        let Velocity {
            linear_mps,
            lateral_mps,
            angular_radps,
        } = velocity;
        let [linear_mps, lateral_mps, angular_radps] = match self {
            Self::Differential => [linear_mps, 0.0, angular_radps],
            Self::DoubleAckermann if linear_mps.abs() > 0.0 => [linear_mps, 0.0, angular_radps],
            Self::DoubleAckermann => [0.0; 3],
            Self::Lateral => [0.0, lateral_mps, 0.0],
            Self::TurnOnSpot => [0.0, 0.0, angular_radps],
            Self::Crab => [linear_mps, lateral_mps, 0.0],
        };
        Velocity {
            linear_mps,
            lateral_mps,
            angular_radps,
        }
    }
}

impl Locomotion {
    /// Settings that were checked.
    pub(crate) fn new(config: &LocomotionConfig) -> Self {
        Self {
            modes: config.modes.modes(),
            min_turn_radius_m: config.min_turn_radius_m,
            change: Duration::from_secs_f64(config.mode_change_s),
        }
    }

    /// The mode for a request: one that can do all of it, else one that can do a part; the `present` one before others.
    /// `None` if there is no such mode.
    pub(crate) fn mode_for(
        &self,
        requested: Velocity,
        present: Option<LocomotionMode>,
    ) -> Option<LocomotionMode> {
        let modes = || present.into_iter().chain(self.modes.into_iter().flatten());
        modes()
            .find(|mode| mode.part_of(requested) == requested)
            .or_else(|| modes().find(|mode| !mode.part_of(requested).is_neutral()))
    }

    /// The greatest turn rate of a vehicle that goes ahead at this speed, radians per second.
    pub(crate) fn max_turn_rate_radps(&self, mode: LocomotionMode, linear_mps: f64) -> f64 {
        match mode {
            LocomotionMode::DoubleAckermann => linear_mps.abs() / self.min_turn_radius_m,
            LocomotionMode::Differential
            | LocomotionMode::Lateral
            | LocomotionMode::TurnOnSpot
            | LocomotionMode::Crab => f64::INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_that_can_do_all_comes_before_one_that_can_do_a_part() {
        use LocomotionMode::{Crab, Differential, DoubleAckermann, Lateral, TurnOnSpot};
        let introbot = LocomotionModes {
            differential: false,
            double_ackermann: true,
            turn_on_spot: true,
            lateral: true,
            crab: true,
        };
        let car = LocomotionModes {
            double_ackermann: true,
            ..LocomotionModes::NONE
        };
        let skid = LocomotionModes::DIFFERENTIAL;
        for (modes, present, requested, expected) in [
            (introbot, None, [1.0, 0.0, 0.2], Some(DoubleAckermann)),
            (introbot, None, [0.0, -0.3, 0.0], Some(Lateral)),
            (introbot, None, [0.0, 0.0, 1.0], Some(TurnOnSpot)),
            (introbot, None, [0.5, 0.5, 0.0], Some(Crab)),
            // The present one is kept.
            (introbot, Some(Crab), [1.0, 0.0, 0.0], Some(Crab)),
            (introbot, Some(Crab), [0.0, 0.5, 0.0], Some(Crab)),
            (introbot, Some(Crab), [1.0, 0.0, 0.2], Some(DoubleAckermann)),
            // No mode can do all of it.
            (introbot, None, [1.0, 0.5, 0.2], Some(DoubleAckermann)),
            (introbot, Some(Crab), [1.0, 0.5, 0.2], Some(Crab)),
            (skid, None, [1.0, 0.5, 0.0], Some(Differential)),
            (skid, None, [0.0, 0.5, 0.0], None),
            (car, None, [0.0, 0.0, 1.0], None),
        ] {
            let locomotion = Locomotion::new(&LocomotionConfig {
                modes,
                ..LocomotionConfig::default()
            });
            let [linear_mps, lateral_mps, angular_radps] = requested;
            let requested = Velocity {
                linear_mps,
                lateral_mps,
                angular_radps,
            };
            assert_eq!(
                locomotion.mode_for(requested, present),
                expected,
                "{modes:?} {present:?} {requested:?}"
            );
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let keys = |config: &LocomotionConfig| -> Vec<_> {
            let faults = config.check(&TeleopConfig::default());
            faults.into_iter().map(|fault| fault.key).collect()
        };
        assert!(keys(&LocomotionConfig::default()).is_empty());
        let car = LocomotionConfig {
            modes: LocomotionModes {
                double_ackermann: true,
                ..LocomotionModes::NONE
            },
            // 1 m/s² and 4 rad/s² need 0.25 m.
            min_turn_radius_m: 0.24,
            mode_change_s: 1.0,
        };
        assert_eq!(keys(&car), ["motors.min_turn_radius_m"]);
        let wrong = LocomotionConfig {
            modes: LocomotionModes::NONE,
            min_turn_radius_m: 0.24,
            mode_change_s: f64::NAN,
        };
        let named = ["motors.mode_change_s", "motors.modes"];
        assert_eq!(keys(&wrong), named);
    }
}
