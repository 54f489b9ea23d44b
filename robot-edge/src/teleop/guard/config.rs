//! Settings of `[teleop.guard]`, and the rules that are made of them.

use std::time::Duration;

use serde::Deserialize;

use super::clearance::{Footprint, Margins};
use super::heading::Braking;
use crate::config::{Fault, Problem, VehicleConfig};
use crate::mapping::elevation_config::ObstacleConfig;
use crate::teleop::config::TeleopConfig;

/// From the guard's word to the next one, seconds.
const ROUND_S: f64 = 0.02;

/// How long the vehicle may go on with what it knew before its sensors fell silent, seconds.
const BEFORE_STALE_S: f64 = 0.5;

/// Ground must have been looked at within so long where the configuration does not say, seconds.
const SEEN_ON_LAND_S: f64 = 3.0;
/// A boat is slower to change its course, and little on open water moves fast.
const SEEN_ON_WATER_S: f64 = 10.0;

/// The collision guard.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GuardConfig {
    /// Whether it limits anything.
    pub enabled: bool,
    /// What it does where nothing is known of what lies ahead.
    pub on_blind: OnBlind,
    /// Speed where nothing is known, and close beside things, metres per second.
    pub creep_mps: f64,
    /// What stays free ahead of the vehicle when it has stopped, metres.
    pub margin_m: f64,
    /// What stays free beside it, metres; a third of it where it creeps.
    pub side_margin_m: f64,
    /// From a command to the motors until the vehicle obeys, seconds.
    pub actuator_delay_s: f64,
    /// A beam has seen that the way is free where it is lower than this above the ground, metres: lower things may hide.
    pub seen_below_m: f64,
    /// Above `creep_mps` the ground in the way must have been looked at within so long, seconds; absent: 3 on land, 10 on
    /// water.
    pub seen_s: Option<f64>,
    /// Whether the sensors tell "no echo" from "window blocked" themselves: then a beam without an echo has seen that the way
    /// is free, as one with an echo has.
    pub trust_misses: bool,
    /// Greatest speed where only beams without an echo say that the way is free, metres per second; 0 where they never do.
    /// They do while their sensor has had echoes of anything within the last second.
    pub open_mps: f64,
}

/// What the guard does where nothing is known of what lies ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnBlind {
    /// It allows `creep_mps`.
    Creep,
    /// It allows no motion there.
    Stop,
}

impl Default for GuardConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            on_blind: OnBlind::Creep,
            creep_mps: 0.1,
            margin_m: 0.1,
            side_margin_m: 0.03,
            actuator_delay_s: 0.1,
            seen_below_m: 0.3,
            seen_s: None,
            trust_misses: false,
            open_mps: 0.5,
        }
    }
}

impl GuardConfig {
    /// Everything that is wrong with the values; empty where nothing is.
    pub fn check(&self) -> Vec<Fault> {
        let space = "it is left free around the vehicle";
        let settings = [
            (
                "creep_mps",
                self.creep_mps,
                0.01,
                0.5,
                "it is the speed at which nothing is known",
            ),
            ("margin_m", self.margin_m, 0.0, 10.0, space),
            ("side_margin_m", self.side_margin_m, 0.0, 1.0, space),
            (
                "actuator_delay_s",
                self.actuator_delay_s,
                0.0,
                5.0,
                "the vehicle goes on for as long before it brakes",
            ),
            (
                "seen_below_m",
                self.seen_below_m,
                0.0,
                10.0,
                "beams that are higher than this have not seen what lies on the ground",
            ),
            (
                "seen_s",
                self.seen_s.unwrap_or(SEEN_ON_LAND_S),
                0.2,
                30.0,
                "ground that was looked at longer ago may have changed",
            ),
            (
                "open_mps",
                self.open_mps,
                0.0,
                10.0,
                "it is the speed where only beams without an echo say that the way is free",
            ),
        ];
        let mut faults = Vec::new();
        for (name, value, least, most, why) in settings {
            if !(least..=most).contains(&value) {
                faults.push(Fault {
                    origin: None,
                    key: format!("teleop.guard.{name}"),
                    problem: Problem::NotAllowed {
                        value: value.to_string(),
                        why,
                        allowed: format!("{least} to {most}"),
                    },
                });
            }
        }
        faults
    }
}

/// Which heights are in the vehicle's way, metres above the ground plane or the water.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_field_names, reason = "the postfix is the unit")]
pub(super) struct Heights {
    /// Higher is an obstacle …
    pub(super) h_pos_m: f64,
    /// … unless it is higher than the vehicle.
    pub(super) top_m: f64,
    /// Deeper is a hole …
    pub(super) h_neg_m: f64,
    /// … or, where the vehicle floats, an obstacle unless it is deeper than the vehicle.
    pub(super) keel_m: Option<f64>,
}

/// Settings that were checked, in the form that the guard uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardRules {
    pub(super) enabled: bool,
    pub(super) on_blind: OnBlind,
    pub(super) creep_mps: f64,
    pub(super) margins: Margins,
    pub(super) footprint: Footprint,
    pub(super) braking: Braking,
    pub(super) actuator_delay: Duration,
    pub(super) max_speed_mps: f64,
    pub(super) max_turn_rate_radps: f64,
    pub(super) heights: Heights,
    pub(super) seen_below_m: f64,
    pub(super) seen_for: Duration,
    pub(super) trust_misses: bool,
    pub(super) open_mps: f64,
    pub(super) is_boat: bool,
}

impl GuardRules {
    /// Whether the vehicle floats.
    pub const fn is_boat(&self) -> bool {
        self.is_boat
    }

    /// The rules of a vehicle, or what is wrong with its settings. Those of the arbiter are taken as valid.
    pub fn new(
        guard: &GuardConfig,
        teleop: &TeleopConfig,
        vehicle: &VehicleConfig,
        obstacle: &ObstacleConfig,
    ) -> Result<Self, Vec<Fault>> {
        let mut faults = guard.check();
        for (name, value) in [("length_m", vehicle.length_m), ("width_m", vehicle.width_m)] {
            if !(0.01..=1000.0).contains(&value) {
                faults.push(Fault {
                    origin: None,
                    key: format!("vehicle.{name}"),
                    problem: Problem::NotAllowed {
                        value: value.to_string(),
                        why: "the collision guard keeps the footprint free",
                        allowed: "0.01 to 1000".to_owned(),
                    },
                });
            }
        }
        if !faults.is_empty() {
            return Err(faults);
        }
        Ok(Self {
            enabled: guard.enabled,
            on_blind: guard.on_blind,
            creep_mps: guard.creep_mps,
            margins: Margins {
                ahead_m: guard.margin_m.max(guard.side_margin_m),
                side_m: guard.side_margin_m,
            },
            footprint: Footprint::centred(vehicle.length_m, vehicle.width_m)
                .moved_ahead(vehicle.footprint_offset_m),
            braking: Braking {
                reaction_s: ROUND_S,
                decel_mps2: teleop.stop_decel_mps2,
                decel_radps2: teleop.stop_decel_radps2,
            },
            actuator_delay: Duration::from_secs_f64(guard.actuator_delay_s),
            max_speed_mps: vehicle.max_speed_mps,
            max_turn_rate_radps: vehicle.max_turn_rate_radps,
            heights: Heights {
                h_pos_m: obstacle.h_pos_m,
                top_m: vehicle.lowest_point_m + vehicle.height_m,
                h_neg_m: obstacle.h_neg_m,
                keel_m: teleop.is_boat.then_some(vehicle.lowest_point_m),
            },
            seen_below_m: guard.seen_below_m,
            seen_for: Duration::from_secs_f64(guard.seen_s.unwrap_or(if teleop.is_boat {
                SEEN_ON_WATER_S
            } else {
                SEEN_ON_LAND_S
            })),
            trust_misses: guard.trust_misses,
            open_mps: guard.open_mps,
            is_boat: teleop.is_boat,
        })
    }

    /// How far from where the vehicle will be when it obeys anything can matter, metres.
    pub fn reach_m(&self) -> f64 {
        let Braking {
            reaction_s,
            decel_mps2,
            decel_radps2,
        } = self.braking;
        let braking_s =
            (self.max_speed_mps / decel_mps2).max(self.max_turn_rate_radps / decel_radps2);
        let gone_m = self.max_speed_mps * (reaction_s + 0.5 * braking_s);
        self.footprint.radius_m() + self.margins.ahead_m + gone_m
    }

    /// How far from the vehicle a sweep or a map must tell what is there, metres: it is driven on while they age.
    pub fn window_m(&self) -> f64 {
        self.reach_m() + (BEFORE_STALE_S + self.actuator_delay.as_secs_f64()) * self.max_speed_mps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_named() {
        let guard = GuardConfig {
            creep_mps: 0.0,
            margin_m: -0.1,
            side_margin_m: f64::NAN,
            actuator_delay_s: f64::INFINITY,
            seen_below_m: -1.0,
            ..GuardConfig::default()
        };
        let vehicle = VehicleConfig {
            length_m: 0.0,
            width_m: f64::NAN,
            ..VehicleConfig::default()
        };
        let rules = GuardRules::new(
            &guard,
            &TeleopConfig::default(),
            &vehicle,
            &ObstacleConfig::default(),
        );
        let keys: Vec<_> = rules
            .unwrap_err()
            .into_iter()
            .map(|fault| fault.key)
            .collect();
        assert_eq!(
            keys,
            [
                "teleop.guard.creep_mps",
                "teleop.guard.margin_m",
                "teleop.guard.side_margin_m",
                "teleop.guard.actuator_delay_s",
                "teleop.guard.seen_below_m",
                "vehicle.length_m",
                "vehicle.width_m",
            ]
        );
    }

    #[test]
    fn it_is_on_by_default_and_words_are_those_of_the_design() {
        let parsed: GuardConfig = toml::from_str("on_blind = \"stop\"").unwrap();
        assert!(parsed.enabled && parsed.on_blind == OnBlind::Stop);
        let default = GuardConfig::default();
        assert_eq!((default.on_blind, default.creep_mps), (OnBlind::Creep, 0.1));
        assert_eq!(default.check(), []);
        assert!(toml::from_str::<GuardConfig>("creep = 1.0").is_err());
    }
}
