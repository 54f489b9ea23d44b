//! What bounds a motion: the place and what it is, for whoever is held back and wants to know why.
//!
//! It informs and no more: limits are judged without it.

use super::clearance::Margins;
use super::motion_direction::MotionDirection;
use super::speed_limit_context::SpeedLimitContext;

/// What bounds the motion that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barrier {
    /// Metres.
    pub position_in_odom: [f64; 2],
    /// How the guard knows of it.
    pub kind: BarrierKind,
}

/// How the guard knows of what bounds a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BarrierKind {
    /// A beam of the last sweeps hit it.
    Detected,
    /// An obstacle on the map that no beam hits now.
    Mapped,
    /// Ground that nobody has seen, or seen too long ago.
    Unknown,
    /// A sonar's beam found the water too shallow.
    Shallow,
    /// Ground that only beams without an echo call free.
    NoReturn,
}

/// Points to which the travel differs by less are alike, metres: a wall ahead is one, though its points are never quite as far.
const SAME_TRAVEL_TOLERANCE_M: f64 = 0.01;

/// A point that the vehicle would come to.
struct Contact {
    travel_m: f64,
    point: [f64; 2],
}

impl SpeedLimitContext<'_> {
    /// What makes the speed on a heading what it is, and where, in the base frame; nothing where that is free, or where
    /// no sensor tells what is around.
    ///
    /// It looks at every point again: to be asked only where the heading is bounded.
    pub(super) fn barrier(&self, direction: MotionDirection) -> Option<(BarrierKind, [f64; 2])> {
        let bounds = self.bounds(direction);
        if bounds.is_limited_by_obstacle() {
            let [hits, mapped] = self.clear_margins(bounds.side_share);
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
        if hits[hits.len() - shallows..].contains(&point) {
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
