//! The allowed speed in one direction of motion, given the surroundings, and what limits it (the barrier).

use crate::collision_monitor::config::{CollisionMonitorRules, UnknownSpacePolicy};
use crate::collision_monitor::footprint::{Margins, MotionDirection};
use crate::collision_monitor::local_environment::LocalEnvironment;
use protocol::message::BarrierKind;

/// Share of the margin at the sides that is left where the vehicle creeps.
const CREEPING_SIDE: f64 = 1.0 / 3.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct SpeedLimitContext<'a> {
    pub(super) rules: &'a CollisionMonitorRules,
    pub(super) environment: &'a LocalEnvironment,
    pub(super) is_stale: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AllowedSpeed {
    /// Metres of travel per second.
    pub(super) speed_mps: f64,
    pub(super) in_unknown_space: bool,
}

/// The speed limits in one direction by cause, metres of travel per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SpeedBounds {
    creep_mps: f64,
    /// The vehicle stops before the first obstacle.
    before_obstacles_mps: f64,
    /// It creeps where it touches passable vegetation.
    before_vegetation_mps: f64,
    /// It stops before the first ground that no beam with a return has crossed.
    before_unconfirmed_ground_mps: f64,
    /// It stops before the first ground that no beam has crossed.
    before_unknown_ground_mps: f64,
    /// Configured for ground that only beams without a return have crossed.
    on_unconfirmed_ground_mps: f64,
    /// Configured for ground that no beam has crossed.
    on_unknown_ground_mps: f64,
    /// Share of the margins at the sides used for `before_obstacles_mps`.
    pub(super) side_share: f64,
}

impl SpeedBounds {
    fn allowed(self) -> AllowedSpeed {
        AllowedSpeed {
            speed_mps: self.before_known_mps().min(self.for_the_ground_mps()),
            in_unknown_space: self.for_known_ground_mps() < self.creep_mps
                && self.for_known_ground_mps() < self.before_known_mps(),
        }
    }

    /// Whether the limit is unknown ground, not ground without a return.
    pub(super) fn is_limited_by_unknown(self) -> bool {
        self.before_unknown_ground_mps < self.on_unconfirmed_ground_mps
            && self.before_unknown_ground_mps >= self.before_unconfirmed_ground_mps
    }

    /// Whether the limit is an obstacle or vegetation, not the ground.
    pub(super) fn is_limited_by_obstacle(self) -> bool {
        self.before_known_mps() <= self.for_the_ground_mps()
    }

    fn is_limited_by_vegetation(self) -> bool {
        self.before_vegetation_mps < self.before_obstacles_mps
    }

    fn before_known_mps(self) -> f64 {
        self.before_obstacles_mps.min(self.before_vegetation_mps)
    }

    fn for_the_ground_mps(self) -> f64 {
        self.for_known_ground_mps().max(self.on_unknown_ground_mps)
    }

    fn for_known_ground_mps(self) -> f64 {
        self.before_unconfirmed_ground_mps.max(
            self.before_unknown_ground_mps
                .min(self.on_unconfirmed_ground_mps),
        )
    }
}

impl SpeedLimitContext<'_> {
    /// The greatest speed of travel from which the vehicle stops before known obstacles and, unless it creeps, before
    /// unknown ground.
    pub(super) fn allowed(&self, direction: MotionDirection) -> AllowedSpeed {
        self.bounds(direction).allowed()
    }

    pub(super) fn bounds(&self, direction: MotionDirection) -> SpeedBounds {
        let travel_mps = libm::hypot(direction.along, direction.across) + direction.swing;
        let creep_mps = self.rules.creep_mps / travel_mps;
        let mut side_share = 1.0;
        let mut before_obstacles_mps =
            self.speed_mps(direction, self.travel_to_obstacle_m(direction, side_share));
        if before_obstacles_mps < creep_mps {
            // Too near to a wall for anything but creeping along it.
            let beside_mps = self.speed_mps(
                direction,
                self.travel_to_obstacle_m(direction, CREEPING_SIDE),
            );
            if beside_mps > before_obstacles_mps && beside_mps < creep_mps {
                side_share = CREEPING_SIDE;
            }
            before_obstacles_mps = before_obstacles_mps.max(beside_mps.min(creep_mps));
        }
        let [_, mapped] = self.obstacle_margins(1.0);
        let to_vegetation_m = self.free_m(mapped, direction, &self.environment.vegetation);
        let before_vegetation_mps = self.speed_mps(direction, to_vegetation_m).max(creep_mps);
        let before_unconfirmed_ground_mps =
            self.speed_before_mps(direction, &self.environment.unconfirmed);
        let before_unknown_ground_mps = self.speed_before_mps(direction, &self.environment.unknown);
        let on_unknown_ground_mps = match self.rules.unknown_space_policy {
            UnknownSpacePolicy::Creep => creep_mps,
            UnknownSpacePolicy::Stop => 0.0,
        };
        SpeedBounds {
            creep_mps,
            before_obstacles_mps,
            before_vegetation_mps,
            before_unconfirmed_ground_mps,
            before_unknown_ground_mps,
            on_unconfirmed_ground_mps: self.rules.no_return_speed_mps / travel_mps,
            on_unknown_ground_mps,
            side_share,
        }
    }

    fn speed_mps(&self, direction: MotionDirection, travel_m: f64) -> f64 {
        direction.speed_for_mps(travel_m, &self.rules.braking)
    }

    /// Travel until the vehicle touches what is known, with a share of the margin at its sides.
    fn travel_to_obstacle_m(&self, direction: MotionDirection, side_share: f64) -> f64 {
        let [hits, mapped] = self.obstacle_margins(side_share);
        let to_hit_m = self.free_m(hits, direction, &self.environment.hits);
        to_hit_m.min(self.free_m(mapped, direction, &self.environment.mapped))
    }

    /// Margins of what beams hit, and of what is mapped.
    pub(super) fn obstacle_margins(&self, side_share: f64) -> [Margins; 2] {
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
    fn speed_before_mps(&self, direction: MotionDirection, points: &[[f64; 2]]) -> f64 {
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
            // Half a cell under the body counts as observed; another half lies before the centre of the next cell.
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

/// What bounds the motion that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barrier {
    /// Metres.
    pub position_in_odom: [f64; 2],
    /// How the collision monitor knows of it.
    pub kind: BarrierKind,
}

/// Points to which the travel differs by less are alike, metres: a wall ahead is one, though its points are never quite
/// as far.
const SAME_TRAVEL_TOLERANCE_M: f64 = 0.01;

struct Contact {
    travel_m: f64,
    point: [f64; 2],
}

impl SpeedLimitContext<'_> {
    /// What limits the speed in a direction, and where, in the base frame; absent if nothing does or all scans are too
    /// old. It is information for the operator only: limits do not depend on it.
    ///
    /// It checks every point again; call it only for a limited direction.
    pub(super) fn barrier(&self, direction: MotionDirection) -> Option<(BarrierKind, [f64; 2])> {
        let bounds = self.bounds(direction);
        if bounds.is_limited_by_obstacle() {
            let [hits, mapped] = self.obstacle_margins(bounds.side_share);
            if bounds.is_limited_by_vegetation() {
                let vegetation = &self.environment.vegetation;
                let [_, mapped] = self.obstacle_margins(1.0);
                let contact = self.first_contact(mapped, direction, vegetation)?;
                return Some((BarrierKind::Vegetation, contact.point));
            }
            let hit = self.first_contact(hits, direction, &self.environment.hits);
            let mapped = self.first_contact(mapped, direction, &self.environment.mapped);
            let contact = match (hit, mapped) {
                (Some(hit), Some(mapped)) if mapped.travel_m < hit.travel_m => {
                    (BarrierKind::Mapped, mapped.point)
                }
                (Some(hit), _) => (self.kind_of_hit(hit.point), hit.point),
                (None, mapped) => (BarrierKind::Mapped, mapped?.point),
            };
            return Some(contact);
        }
        if self.is_stale {
            return None;
        }
        let unknown = &self.environment.unknown;
        let points = if bounds.is_limited_by_unknown() {
            unknown
        } else {
            &self.environment.unconfirmed
        };
        let point = self
            .first_contact(self.unknown_margins(), direction, points)?
            .point;
        let kind = if unknown.contains(&point) {
            BarrierKind::Unknown
        } else {
            BarrierKind::NoReturn
        };
        Some((kind, point))
    }

    fn kind_of_hit(&self, point: [f64; 2]) -> BarrierKind {
        let (hits, shallows) = (&self.environment.hits, self.environment.shallows);
        if hits[..self.environment.contacts].contains(&point) {
            BarrierKind::Contact
        } else if hits[hits.len() - shallows..].contains(&point) {
            BarrierKind::Shallow
        } else {
            BarrierKind::Detected
        }
    }

    /// The point that the footprint with its margins touches first; of several that are alike, the one nearest to the
    /// vehicle's middle.
    fn first_contact(
        &self,
        margins: Margins,
        direction: MotionDirection,
        points: &[[f64; 2]],
    ) -> Option<Contact> {
        let travel_m = self.free_m(margins, direction, points);
        if travel_m.is_infinite() {
            return None;
        }
        let from_middle_m2 = |[x, y]: [f64; 2]| x * x + y * y;
        let is_first = |point: &[f64; 2]| {
            let alone = std::slice::from_ref(point);
            self.free_m(margins, direction, alone) <= travel_m + SAME_TRAVEL_TOLERANCE_M
        };
        let first = points.iter().copied().filter(is_first);
        let point = first.min_by(|&a, &b| from_middle_m2(a).total_cmp(&from_middle_m2(b)))?;
        Some(Contact { travel_m, point })
    }
}
