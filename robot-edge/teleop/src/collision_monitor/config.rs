//! Settings of `[teleop.collision_monitor]`, and the rules that are made of them.

use std::time::Duration;

use serde::Deserialize;

use crate::collision_monitor::footprint::{Braking, Footprint, Margins};
use crate::config::{SettingError, TeleopConfig, out_of_range};
use mapping::obstacle::ObstacleConfig;
use mapping::vehicle::VehicleConfig;

const ROUND_S: f64 = 0.02;

/// How long the vehicle may go on with what it knew before its sensors fell silent, seconds.
const STALE_ALLOWANCE_S: f64 = 0.5;

/// Ground must have been looked at within so long where the configuration does not say, seconds.
const MAX_GROUND_AGE_LAND_S: f64 = 3.0;
/// A boat is slower to change its course, and little on open water moves fast.
const MAX_GROUND_AGE_WATER_S: f64 = 10.0;

/// The collision monitor.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CollisionMonitorConfig {
    /// Whether it limits anything.
    pub enabled: bool,
    /// What it does where nothing is known of what lies ahead.
    pub unknown_space_policy: UnknownSpacePolicy,
    /// Speed where nothing is known, and close beside things, metres per second.
    pub creep_mps: f64,
    /// What stays free ahead of the vehicle when it has stopped, metres.
    pub margin_m: f64,
    /// What stays free beside it, metres; a third of it where it creeps.
    pub side_margin_m: f64,
    /// From a command to the motors until the vehicle obeys, seconds.
    pub actuator_delay_s: f64,
    /// A beam observes free ground only where it is lower than this above the ground, metres.
    pub ground_visible_below_m: f64,
    /// Above `creep_mps` the ground in the way must have been looked at within so long, seconds; absent: 3 on land, 10
    /// on water.
    pub max_ground_age_s: Option<f64>,
    /// Whether the sensors distinguish "no echo" from "window blocked" themselves: a beam without an echo then proves
    /// free space like one with an echo.
    pub treat_no_return_as_free: bool,
    /// Greatest speed where only beams without an echo say that the way is free, metres per second; 0 where they never
    /// do. They do while their sensor has had echoes of anything within the last second.
    pub no_return_speed_mps: f64,
    /// Water that stays under the keel of a boat, metres: shallower water is an obstacle, seen now or mapped. Absent: what
    /// a beam hits above the keel is one, and mapped depths are not asked.
    pub min_depth_m: Option<f64>,
}

/// What the collision monitor does where nothing is known of what lies ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UnknownSpacePolicy {
    /// It allows `creep_mps`.
    Creep,
    /// It allows no motion there.
    Stop,
}

impl Default for CollisionMonitorConfig {
    fn default() -> Self {
        Self {
            enabled: true,
            unknown_space_policy: UnknownSpacePolicy::Creep,
            creep_mps: 0.1,
            margin_m: 0.1,
            side_margin_m: 0.03,
            actuator_delay_s: 0.1,
            ground_visible_below_m: 0.3,
            max_ground_age_s: None,
            treat_no_return_as_free: false,
            no_return_speed_mps: 0.5,
            min_depth_m: None,
        }
    }
}

impl CollisionMonitorConfig {
    /// Everything that is wrong with the values; empty where nothing is.
    pub fn check(&self) -> Vec<SettingError> {
        let space = "it is left free around the vehicle";
        let unknown = "it is the speed at which nothing is known";
        let delay = "the vehicle goes on for as long before it brakes";
        let visible = "beams that are higher than this have not seen what lies on the ground";
        let age = "ground that was looked at longer ago may have changed";
        let no_return = "it is the speed where only beams without an echo say that the way is free";
        let depth = "it is the water that stays under the keel";
        let age_s = self.max_ground_age_s.unwrap_or(MAX_GROUND_AGE_LAND_S);
        let below_m = self.ground_visible_below_m;
        out_of_range(
            "teleop.collision_monitor",
            [
                ("creep_mps", self.creep_mps, 0.01..=0.5, unknown),
                ("margin_m", self.margin_m, 0.0..=10.0, space),
                ("side_margin_m", self.side_margin_m, 0.0..=1.0, space),
                ("actuator_delay_s", self.actuator_delay_s, 0.0..=5.0, delay),
                ("ground_visible_below_m", below_m, 0.0..=10.0, visible),
                ("max_ground_age_s", age_s, 0.2..=30.0, age),
                (
                    "min_depth_m",
                    self.min_depth_m.unwrap_or_default(),
                    0.0..=100.0,
                    depth,
                ),
                (
                    "no_return_speed_mps",
                    self.no_return_speed_mps,
                    0.0..=10.0,
                    no_return,
                ),
            ],
        )
    }
}

/// Which heights are in the vehicle's way, metres above the ground plane or the water.
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// Settings that were checked, in the form that the collision monitor uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollisionMonitorRules {
    pub(super) enabled: bool,
    pub(super) unknown_space_policy: UnknownSpacePolicy,
    pub(super) creep_mps: f64,
    pub(super) margins: Margins,
    pub(super) footprint: Footprint,
    pub(super) braking: Braking,
    pub(super) actuator_delay: Duration,
    pub(super) max_speed_mps: f64,
    pub(super) max_turn_rate_radps: f64,
    pub(super) heights: Heights,
    pub(super) ground_visible_below_m: f64,
    pub(super) max_ground_age: Duration,
    pub(super) treat_no_return_as_free: bool,
    pub(super) no_return_speed_mps: f64,
    pub(super) is_boat: bool,
    least_water_m: Option<f64>,
}

impl CollisionMonitorRules {
    /// Depth of the water below which a mapped cell is an obstacle, metres; absent where none is.
    pub const fn least_water_m(&self) -> Option<f64> {
        self.least_water_m
    }

    /// Whether the vehicle floats.
    pub const fn is_boat(&self) -> bool {
        self.is_boat
    }

    /// The rules of a vehicle, or what is wrong with its settings. Those of the arbiter are taken as valid.
    pub fn new(
        settings: &CollisionMonitorConfig,
        teleop: &TeleopConfig,
        vehicle: &VehicleConfig,
        obstacle: &ObstacleConfig,
    ) -> Result<Self, Vec<SettingError>> {
        let mut faults = settings.check();
        let footprint = "the collision monitor keeps the footprint free";
        faults.extend(out_of_range(
            "vehicle",
            [
                ("length_m", vehicle.length_m, 0.01..=1000.0, footprint),
                ("width_m", vehicle.width_m, 0.01..=1000.0, footprint),
            ],
        ));
        if !faults.is_empty() {
            return Err(faults);
        }
        let keel_m = vehicle.bottom_z_m - settings.min_depth_m.unwrap_or_default();
        Ok(Self {
            enabled: settings.enabled,
            unknown_space_policy: settings.unknown_space_policy,
            creep_mps: settings.creep_mps,
            margins: Margins {
                ahead_m: settings.margin_m.max(settings.side_margin_m),
                side_m: settings.side_margin_m,
            },
            footprint: Footprint::centred(vehicle.length_m, vehicle.width_m)
                .moved_ahead(vehicle.footprint_offset_m),
            braking: Braking {
                reaction_s: ROUND_S,
                decel_mps2: teleop.stop_decel_mps2,
                decel_radps2: teleop.stop_decel_radps2,
            },
            actuator_delay: Duration::from_secs_f64(settings.actuator_delay_s),
            max_speed_mps: vehicle.max_speed_mps,
            max_turn_rate_radps: vehicle.max_turn_rate_radps,
            heights: Heights {
                h_pos_m: obstacle.h_pos_m,
                top_m: vehicle.bottom_z_m + vehicle.height_m,
                h_neg_m: obstacle.h_neg_m,
                keel_m: teleop.is_boat.then_some(keel_m),
            },
            ground_visible_below_m: settings.ground_visible_below_m,
            max_ground_age: Duration::from_secs_f64(settings.max_ground_age_s.unwrap_or(
                if teleop.is_boat {
                    MAX_GROUND_AGE_WATER_S
                } else {
                    MAX_GROUND_AGE_LAND_S
                },
            )),
            treat_no_return_as_free: settings.treat_no_return_as_free,
            no_return_speed_mps: settings.no_return_speed_mps,
            is_boat: teleop.is_boat,
            least_water_m: settings.min_depth_m.map(|_| -keel_m),
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
        self.reach_m()
            + (STALE_ALLOWANCE_S + self.actuator_delay.as_secs_f64()) * self.max_speed_mps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_named() {
        let settings = CollisionMonitorConfig {
            creep_mps: 0.0,
            margin_m: -0.1,
            side_margin_m: f64::NAN,
            actuator_delay_s: f64::INFINITY,
            ground_visible_below_m: -1.0,
            ..CollisionMonitorConfig::default()
        };
        let vehicle = VehicleConfig {
            length_m: 0.0,
            width_m: f64::NAN,
            ..VehicleConfig::default()
        };
        let rules = CollisionMonitorRules::new(
            &settings,
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
                "teleop.collision_monitor.creep_mps",
                "teleop.collision_monitor.margin_m",
                "teleop.collision_monitor.side_margin_m",
                "teleop.collision_monitor.actuator_delay_s",
                "teleop.collision_monitor.ground_visible_below_m",
                "vehicle.length_m",
                "vehicle.width_m",
            ]
        );
    }

    #[test]
    fn it_is_on_by_default_and_words_are_those_of_the_design() {
        let parsed: CollisionMonitorConfig =
            toml::from_str("unknown_space_policy = \"stop\"").unwrap();
        assert!(parsed.enabled && parsed.unknown_space_policy == UnknownSpacePolicy::Stop);
        let default = CollisionMonitorConfig::default();
        assert_eq!(
            (default.unknown_space_policy, default.creep_mps),
            (UnknownSpacePolicy::Creep, 0.1)
        );
        assert_eq!(default.check(), []);
        assert!(toml::from_str::<CollisionMonitorConfig>("creep = 1.0").is_err());
    }
}
