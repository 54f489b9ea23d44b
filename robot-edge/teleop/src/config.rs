//! Settings of `[teleop]`, and the rules that are made of them.

use std::ops::RangeInclusive;
use std::time::Duration;

use serde::Deserialize;

use super::arbiter::PLANNING_TIME;
use super::collision_monitor::CollisionMonitorConfig;
use super::locomotion::{Locomotion, LocomotionConfig};
use super::motion::{AxisLimits, MotionLimits};
use mapping::vehicle::VehicleConfig;

/// How long a request for the lease waits for the holder's consent: a person reads it and decides.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// How the vehicle obeys an operator ("Teleop: never obey an old command", settings).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TeleopConfig {
    /// Oldest command that moves the vehicle, milliseconds.
    pub max_command_age_ms: u32,
    /// How long the lease lasts that no command renews, seconds.
    pub lease_s: f64,
    /// How far the vehicle may go by a command that could be withdrawn meanwhile, metres.
    pub max_latency_travel_m: f64,
    /// How long nothing must have been pressed before a press counts, milliseconds.
    pub neutral_ms: u32,
    /// Acceleration that commands may cause, metres per second squared.
    pub accel_mps2: f64,
    /// The same of turning, radians per second squared.
    pub accel_radps2: f64,
    /// How fast acceleration may change, metres per second cubed.
    pub jerk_mps3: f64,
    /// The same of turning, radians per second cubed.
    pub jerk_radps3: f64,
    /// Deceleration of an involuntary stop, metres per second squared; no jerk limit applies to it.
    pub stop_decel_mps2: f64,
    /// The same of turning, radians per second squared.
    pub stop_decel_radps2: f64,
    /// It floats: without thrust it drifts on.
    pub is_boat: bool,
    /// The collision monitor.
    pub collision_monitor: CollisionMonitorConfig,
}

impl Default for TeleopConfig {
    fn default() -> Self {
        Self {
            max_command_age_ms: 400,
            lease_s: 2.0,
            max_latency_travel_m: 0.15,
            neutral_ms: 200,
            accel_mps2: 0.5,
            accel_radps2: 2.0,
            jerk_mps3: 2.5,
            jerk_radps3: 10.0,
            stop_decel_mps2: 1.0,
            stop_decel_radps2: 4.0,
            is_boat: false,
            collision_monitor: CollisionMonitorConfig::default(),
        }
    }
}

impl TeleopConfig {
    /// Everything that is wrong with the values; empty where nothing is.
    pub fn check(&self) -> Vec<SettingError> {
        let age = "it bounds how long the vehicle goes on after the link is lost, and cannot be switched off";
        let lease = "it outlasts the oldest command, and frees the vehicle when a console dies";
        let travel = "it is the way made before a command can be withdrawn";
        let neutral = "shorter, and the gaps of a link look like a released key";
        let brakes = "a vehicle must stop at least as hard as it may speed up";
        let any = 0.01..=1000.0;
        let mut faults = out_of_range(
            "teleop",
            [
                (
                    "max_command_age_ms",
                    self.max_command_age_ms.into(),
                    100.0..=1000.0,
                    age,
                ),
                ("lease_s", self.lease_s, 1.0..=30.0, lease),
                (
                    "max_latency_travel_m",
                    self.max_latency_travel_m,
                    0.01..=5.0,
                    travel,
                ),
                (
                    "neutral_ms",
                    self.neutral_ms.into(),
                    200.0..=2000.0,
                    neutral,
                ),
                ("accel_mps2", self.accel_mps2, any.clone(), ROOM_TO_MOVE),
                ("accel_radps2", self.accel_radps2, any.clone(), ROOM_TO_MOVE),
                ("jerk_mps3", self.jerk_mps3, any.clone(), ROOM_TO_MOVE),
                ("jerk_radps3", self.jerk_radps3, any, ROOM_TO_MOVE),
                (
                    "stop_decel_mps2",
                    self.stop_decel_mps2,
                    self.accel_mps2..=1000.0,
                    brakes,
                ),
                (
                    "stop_decel_radps2",
                    self.stop_decel_radps2,
                    self.accel_radps2..=1000.0,
                    brakes,
                ),
            ],
        );
        faults.extend(self.collision_monitor.check());
        faults
    }
}

const ROOM_TO_MOVE: &str = "limits must be finite and leave room to move";

/// The settings under `prefix` that are outside of their ranges: name, value, range and what the range is for.
pub(crate) fn out_of_range<const N: usize>(
    prefix: &str,
    settings: [(&str, f64, RangeInclusive<f64>, &'static str); N],
) -> Vec<SettingError> {
    let is_outside =
        |(_, value, range, _): &(_, f64, RangeInclusive<f64>, _)| !range.contains(value);
    let outside = settings.into_iter().filter(is_outside);
    outside
        .map(|(name, value, range, why)| SettingError {
            key: format!("{prefix}.{name}"),
            value: value.to_string(),
            why,
            allowed: format!("{} to {}", range.start(), range.end()),
        })
        .collect()
}

/// A setting whose value is not allowed.
#[derive(Clone, Debug, PartialEq)]
pub struct SettingError {
    /// Path of the key.
    pub key: String,
    /// The value.
    pub value: String,
    /// What the value would do.
    pub why: &'static str,
    /// The allowed range.
    pub allowed: String,
}

/// Settings that were checked, in the form that [`crate::step`] uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    pub(super) max_age: Duration,
    pub(super) lease: Duration,
    pub(super) neutral: Duration,
    pub(super) max_latency_travel_m: f64,
    pub(super) limits: MotionLimits,
    pub(super) locomotion: Locomotion,
    pub(super) is_boat: bool,
    pub(super) request_timeout: Duration,
    /// `None` where no planner is configured.
    pub(super) planner: Option<PlannerRules>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PlannerRules {
    /// Longest time from one velocity to the next, by their arrival.
    pub(super) max_gap: Duration,
    /// Longest time from a goal to the first velocity.
    pub(super) planning_time: Duration,
}

impl Rules {
    /// Oldest command, and oldest token of a request, that has an effect.
    pub const fn max_age(&self) -> Duration {
        self.max_age
    }

    /// The rules of a vehicle, or what is wrong with its settings.
    pub fn new(
        teleop: &TeleopConfig,
        vehicle: &VehicleConfig,
        locomotion: &LocomotionConfig,
    ) -> Result<Self, Vec<SettingError>> {
        let mut faults = teleop.check();
        faults.extend(locomotion.check(teleop));
        for (name, value) in [
            ("max_speed_mps", vehicle.max_speed_mps),
            ("max_turn_rate_radps", vehicle.max_turn_rate_radps),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                faults.push(SettingError {
                    key: format!("vehicle.{name}"),
                    value: value.to_string(),
                    why: ROOM_TO_MOVE,
                    allowed: "above 0".to_owned(),
                });
            }
        }
        if !faults.is_empty() {
            return Err(faults);
        }
        Ok(Self {
            max_age: Duration::from_millis(teleop.max_command_age_ms.into()),
            lease: Duration::from_secs_f64(teleop.lease_s),
            neutral: Duration::from_millis(teleop.neutral_ms.into()),
            max_latency_travel_m: teleop.max_latency_travel_m,
            limits: MotionLimits {
                linear: AxisLimits {
                    speed: vehicle.max_speed_mps,
                    accel: teleop.accel_mps2,
                    jerk: teleop.jerk_mps3,
                    stop_decel: teleop.stop_decel_mps2,
                },
                angular: AxisLimits {
                    speed: vehicle.max_turn_rate_radps,
                    accel: teleop.accel_radps2,
                    jerk: teleop.jerk_radps3,
                    stop_decel: teleop.stop_decel_radps2,
                },
            },
            locomotion: Locomotion::new(locomotion),
            is_boat: teleop.is_boat,
            request_timeout: REQUEST_TIMEOUT,
            planner: None,
        })
    }

    /// The same with goals for a planner, whose velocities arrive within `max_gap` of each other.
    #[must_use]
    pub const fn with_planner(self, max_gap: Duration) -> Self {
        Self {
            planner: Some(PlannerRules {
                max_gap,
                planning_time: PLANNING_TIME,
            }),
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_those_of_the_design() {
        let rules = Rules::new(
            &TeleopConfig::default(),
            &VehicleConfig::default(),
            &LocomotionConfig::default(),
        )
        .unwrap();
        assert_eq!(rules.max_age, Duration::from_millis(400));
        assert_eq!(rules.lease, Duration::from_secs(2));
        assert_eq!(rules.neutral, Duration::from_millis(200));
        assert!((rules.max_latency_travel_m - 0.15).abs() < 1e-12);
    }

    #[test]
    fn every_fault_is_named() {
        let teleop = TeleopConfig {
            max_command_age_ms: 0,
            lease_s: f64::NAN,
            max_latency_travel_m: 0.0,
            neutral_ms: 199,
            accel_mps2: f64::INFINITY,
            accel_radps2: 5.0,
            jerk_mps3: -1.0,
            jerk_radps3: 0.0,
            stop_decel_mps2: 0.0,
            stop_decel_radps2: 4.0,
            is_boat: true,
            collision_monitor: CollisionMonitorConfig {
                margin_m: f64::NAN,
                ..CollisionMonitorConfig::default()
            },
        };
        let vehicle = VehicleConfig {
            max_speed_mps: 0.0,
            max_turn_rate_radps: f64::NAN,
            ..VehicleConfig::default()
        };
        let faults = Rules::new(&teleop, &vehicle, &LocomotionConfig::default()).unwrap_err();
        let keys: Vec<_> = faults.iter().map(|fault| fault.key.as_str()).collect();
        assert_eq!(
            keys,
            [
                "teleop.max_command_age_ms",
                "teleop.lease_s",
                "teleop.max_latency_travel_m",
                "teleop.neutral_ms",
                "teleop.accel_mps2",
                "teleop.jerk_mps3",
                "teleop.jerk_radps3",
                "teleop.stop_decel_mps2",
                "teleop.stop_decel_radps2",
                "teleop.collision_monitor.margin_m",
                "vehicle.max_speed_mps",
                "vehicle.max_turn_rate_radps",
            ]
        );
        assert_eq!(
            faults[0],
            SettingError {
                key: "teleop.max_command_age_ms".to_owned(),
                value: "0".to_owned(),
                why: "it bounds how long the vehicle goes on after the link is lost, and cannot be switched off",
                allowed: "100 to 1000".to_owned(),
            }
        );
        assert_eq!(
            (faults[8].value.as_str(), faults[8].allowed.as_str()),
            ("4", "5 to 1000")
        );
    }

    #[test]
    fn the_limits_of_the_age_are_kept() {
        for (age_ms, is_allowed) in [
            (99, false),
            (100, true),
            (250, true),
            (1000, true),
            (1001, false),
        ] {
            let teleop = TeleopConfig {
                max_command_age_ms: age_ms,
                ..TeleopConfig::default()
            };
            assert_eq!(teleop.check().is_empty(), is_allowed, "{age_ms}");
        }
    }
}
