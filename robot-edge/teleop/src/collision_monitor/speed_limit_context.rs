//! How fast the vehicle may move on one heading, given what is around it.

use super::clearance::Margins;
use super::config::{CollisionMonitorRules, UnknownSpacePolicy};
use super::local_environment::LocalEnvironment;
use super::motion_direction::MotionDirection;

/// Share of the margin at the sides that is left where the vehicle creeps.
const CREEPING_SIDE: f64 = 1.0 / 3.0;

/// What is around, and the rules.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpeedLimitContext<'a> {
    pub(super) rules: &'a CollisionMonitorRules,
    pub(super) environment: &'a LocalEnvironment,
    /// No sensor tells what is around now.
    pub(super) is_stale: bool,
}

/// What is allowed on one heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AllowedSpeed {
    /// Metres of travel per second.
    pub(super) speed_mps: f64,
    /// It would be more if the ground had been seen.
    pub(super) in_unknown_space: bool,
}

/// What bounds the speed on one heading, metres of travel per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SpeedBounds {
    creep_mps: f64,
    /// By what is known to stand there.
    clear_mps: f64,
    /// By ground that no beam with an echo has seen.
    confirmed_mps: f64,
    /// By ground that nobody has seen.
    observed_mps: f64,
    /// On ground that only misses call free.
    no_return_speed_mps: f64,
    /// On ground that nobody has seen.
    unknown_mps: f64,
    /// Share of the margins at the sides with which `clear_mps` is what it is.
    pub(super) side_share: f64,
}

impl SpeedBounds {
    fn allowed(self) -> AllowedSpeed {
        AllowedSpeed {
            speed_mps: self.clear_mps.min(self.on_ground_mps()),
            in_unknown_space: self.on_observed_ground_mps() < self.creep_mps
                && self.on_observed_ground_mps() < self.clear_mps,
        }
    }

    /// Whether ground that nobody has seen bounds it, rather than ground that no beam with an echo has seen.
    pub(super) fn is_limited_by_unknown(self) -> bool {
        self.observed_mps < self.no_return_speed_mps && self.observed_mps >= self.confirmed_mps
    }

    /// Whether what stands there bounds it, rather than ground that nobody has seen.
    pub(super) fn is_limited_by_obstacle(self) -> bool {
        self.clear_mps <= self.on_ground_mps()
    }

    fn on_ground_mps(self) -> f64 {
        self.on_observed_ground_mps().max(self.unknown_mps)
    }

    fn on_observed_ground_mps(self) -> f64 {
        self.confirmed_mps
            .max(self.observed_mps.min(self.no_return_speed_mps))
    }
}

impl SpeedLimitContext<'_> {
    /// The greatest speed of travel on a heading from which the vehicle stops before what is known to stand there, and
    /// before ground that nobody has seen, unless it creeps.
    pub(super) fn allowed(&self, direction: MotionDirection) -> AllowedSpeed {
        self.bounds(direction).allowed()
    }

    pub(super) fn bounds(&self, direction: MotionDirection) -> SpeedBounds {
        let travel_mps = direction.along.abs() + direction.swing;
        let creep_mps = self.rules.creep_mps / travel_mps;
        let mut side_share = 1.0;
        let mut clear_mps = self.speed_mps(direction, self.clear_m(direction, side_share));
        if clear_mps < creep_mps {
            // Beside a wall, too near for anything but to creep along it.
            let beside_mps = self.speed_mps(direction, self.clear_m(direction, CREEPING_SIDE));
            if beside_mps > clear_mps && beside_mps < creep_mps {
                side_share = CREEPING_SIDE;
            }
            clear_mps = clear_mps.max(beside_mps.min(creep_mps));
        }
        let confirmed_mps = self.speed_on_mps(direction, &self.environment.unconfirmed);
        let observed_mps = self.speed_on_mps(direction, &self.environment.unknown);
        let unknown_mps = match self.rules.unknown_space_policy {
            UnknownSpacePolicy::Creep => creep_mps,
            UnknownSpacePolicy::Stop => 0.0,
        };
        SpeedBounds {
            creep_mps,
            clear_mps,
            confirmed_mps,
            observed_mps,
            no_return_speed_mps: self.rules.no_return_speed_mps / travel_mps,
            unknown_mps,
            side_share,
        }
    }

    fn speed_mps(&self, direction: MotionDirection, travel_m: f64) -> f64 {
        direction.speed_for_mps(travel_m, &self.rules.braking)
    }

    /// Travel until the vehicle touches what is known, with a share of the margin at its sides.
    fn clear_m(&self, direction: MotionDirection, side_share: f64) -> f64 {
        let [hits, mapped] = self.clear_margins(side_share);
        let to_hit_m = self.free_m(hits, direction, &self.environment.hits);
        to_hit_m.min(self.free_m(mapped, direction, &self.environment.mapped))
    }

    /// Margins of what beams hit, and of what is mapped.
    pub(super) fn clear_margins(&self, side_share: f64) -> [Margins; 2] {
        let Margins { ahead_m, side_m } = self.rules.margins;
        let half_cell_m = 0.5 * self.environment.mapped_cell_m;
        let hits = Margins {
            ahead_m,
            side_m: side_share * side_m,
        };
        // What is mapped lies anywhere in its cell.
        let mapped = Margins {
            ahead_m: ahead_m.max(half_cell_m),
            side_m: side_share * side_m.max(half_cell_m),
        };
        [hits, mapped]
    }

    /// The speed from which the vehicle stops before ground that begins at these points.
    fn speed_on_mps(&self, direction: MotionDirection, points: &[[f64; 2]]) -> f64 {
        if self.is_stale {
            return 0.0;
        }
        self.speed_mps(
            direction,
            self.free_m(self.unknown_margins(), direction, points),
        )
    }

    pub(super) fn unknown_margins(&self) -> Margins {
        Margins {
            // Half a cell that the body reaches into counts as seen, and another lies before the centre of the next one.
            ahead_m: 1.5 * self.environment.unknown_cell_m,
            side_m: 0.0,
        }
    }

    pub(super) fn free_m(
        &self,
        margins: Margins,
        direction: MotionDirection,
        points: &[[f64; 2]],
    ) -> f64 {
        self.rules
            .footprint
            .free_travel_m(margins, direction, points)
    }
}
