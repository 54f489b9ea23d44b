//! From what is allowed on single headings to the greatest speeds of going and of turning.
//!
//! The arbiter moves each of the two towards what is asked, and brakes each, in its own time. So what is driven is no arc
//! but a mixture of the two that changes, and each mixture that may come about must be one to stop from.

use super::barrier::BarrierKind;
use super::direction_table::{
    ALL_DIRECTIONS, AxisSpeed, AxisSpeeds, DirectionTable, DriveAxis, STEPS,
};
use super::motion_direction::MotionDirection;
use super::speed_limit_context::{AllowedSpeed, SpeedLimitContext};
use crate::speed_limits::SpeedLimits;
use crate::velocity::Velocity;

/// Slower is standing still, metres per second of any point of the body.
const STANDSTILL_MPS: f64 = 0.005;

/// A part that is slowed down beside another that is kept aims at so much of what is allowed: what is left leans more to the
/// other, and a heading that leans more is often allowed a hair less.
const AIM: f64 = 0.999;

/// It is aimed only beside a part that is at most this share of it: a mixture of more leaves its heading when both brake, and
/// needs the room that a half leaves.
const AIMED_BESIDE: f64 = 0.05;

/// How often that is tried.
const AIMS: usize = 3;

/// A judgement under way.
pub(super) struct LimitSolver<'a> {
    context: SpeedLimitContext<'a>,
    directions: &'a DirectionTable,
    radius_m: f64,
    allowed: [Option<AllowedSpeed>; ALL_DIRECTIONS],
    /// Greatest speeds along each axis so far, metres of travel per second.
    most_mps: [f64; 4],
    /// What is asked is slower for want of sight.
    in_unknown_space: bool,
    /// Of what is asked, the heading that bounds it most.
    limiting_direction: Option<MotionDirection>,
}

impl<'a> LimitSolver<'a> {
    /// What is allowed along each axis alone.
    pub(super) fn new(context: SpeedLimitContext<'a>, directions: &'a DirectionTable) -> Self {
        let rules = context.rules;
        let radius_m = rules.footprint.radius_m();
        let turning_mps = rules.max_turn_rate_radps * radius_m;
        let mut solver = Self {
            context,
            directions,
            radius_m,
            allowed: [None; ALL_DIRECTIONS],
            most_mps: [
                rules.max_speed_mps,
                turning_mps,
                rules.max_speed_mps,
                turning_mps,
            ],
            in_unknown_space: context.is_stale,
            limiting_direction: None,
        };
        for axis in DriveAxis::ALL {
            let (_, allowed) = solver.allowed(axis.towards(axis, 0));
            solver.limit(axis, allowed.speed_mps);
        }
        solver
    }

    /// Scales what is asked so that the vehicle can stop from every mixture of its going and its turning.
    pub(super) fn limit_request(&mut self, requested: AxisSpeeds) {
        let exact = requested
            .direction(self.radius_m)
            .map(|(direction, _)| (direction, self.context.allowed(direction)));
        let mut share = 1.0_f64;
        for step in 0..=STEPS {
            let (direction, allowed) =
                self.allowed(requested.going.axis.towards(requested.turning.axis, step));
            share = self.tighten_share(share, &requested, direction, allowed);
        }
        if let Some((direction, allowed)) = exact {
            share = self.tighten_share(share, &requested, direction, allowed);
        }
        self.scale(&requested, share);
    }

    /// What bounds what is asked, and where, in the base frame; nothing where all of it is allowed.
    pub(super) fn barrier(&self) -> Option<(BarrierKind, [f64; 2])> {
        self.context.barrier(self.limiting_direction?)
    }

    /// Brakes what the vehicle could no longer stop from.
    pub(super) fn limit_motion(&mut self, motion: AxisSpeeds) {
        if let Some((direction, speed_mps)) = motion.direction(self.radius_m)
            && speed_mps >= STANDSTILL_MPS
        {
            let allowed = self.context.allowed(direction);
            self.scale(&motion, allowed.speed_mps / speed_mps);
        }
    }

    /// While the vehicle still goes faster than is asked, it turns no faster than it can stop from, and the other way
    /// round.
    pub(super) fn limit_change(&mut self, motion: AxisSpeeds, requested: AxisSpeeds) {
        let capped = |part: AxisSpeed| AxisSpeed {
            speed_mps: part.speed_mps.min(self.most_mps[part.axis as usize]),
            ..part
        };
        let (going, turning) = (capped(requested.going), capped(requested.turning));
        if motion.going.speed_mps > going.speed_mps {
            self.limit_beside(motion.going, turning);
        }
        if motion.turning.speed_mps > turning.speed_mps {
            self.limit_beside(motion.turning, going);
        }
    }

    /// The limits so far.
    pub(super) fn limits(&self) -> SpeedLimits {
        let most = |axis: DriveAxis| {
            let most_mps = self.most_mps[axis as usize];
            if most_mps < STANDSTILL_MPS {
                0.0
            } else {
                most_mps
            }
        };
        SpeedLimits {
            forward_mps: most(DriveAxis::Forward),
            reverse_mps: most(DriveAxis::Back),
            left_radps: most(DriveAxis::Left) / self.radius_m,
            right_radps: most(DriveAxis::Right) / self.radius_m,
            in_unknown_space: self.in_unknown_space,
            overspeed: Velocity::ZERO,
        }
    }

    /// The lesser of a share of what is asked and what one heading leaves of it; where that is less, it is the tightest.
    fn tighten_share(
        &mut self,
        share: f64,
        requested: &AxisSpeeds,
        direction: MotionDirection,
        allowed: AllowedSpeed,
    ) -> f64 {
        let kept = self.share(requested, direction, allowed);
        if kept < share {
            self.limiting_direction = Some(direction);
        }
        share.min(kept)
    }

    /// What may be kept of a motion for the sake of one heading between its axes.
    fn share(
        &mut self,
        requested: &AxisSpeeds,
        direction: MotionDirection,
        allowed: AllowedSpeed,
    ) -> f64 {
        let mixed_mps = requested.mixed_mps(direction);
        if mixed_mps < STANDSTILL_MPS {
            return 1.0;
        }
        self.in_unknown_space |= allowed.in_unknown_space && allowed.speed_mps < mixed_mps;
        allowed.speed_mps / mixed_mps
    }

    /// Limits one part of the motion while the other one keeps its speed: to what its heading allows, where that can be found
    /// at once, else to the greatest of some shares of what it would be from which the vehicle can stop, with all that is less.
    fn limit_beside(&mut self, kept: AxisSpeed, changing: AxisSpeed) {
        if kept.speed_mps < STANDSTILL_MPS || changing.speed_mps < STANDSTILL_MPS {
            return;
        }
        let most_mps = self.most_beside_mps(kept, changing);
        if most_mps < changing.speed_mps {
            self.limit(changing.axis, most_mps);
        }
    }

    /// How fast the changing part may be; nothing is allowed that was not tried.
    fn most_beside_mps(&mut self, kept: AxisSpeed, changing: AxisSpeed) -> f64 {
        let safe_mps = self.safe_beside_mps(kept, changing.axis);
        let aimed_mps = self.aimed_beside_mps(kept, changing, safe_mps);
        let can_stop_at = |speed_mps: f64| {
            let part = AxisSpeed {
                speed_mps,
                ..changing
            };
            speed_mps <= safe_mps && self.can_stop_from(kept, part)
        };
        let shares = [0.5, 0.25].map(|share| share * changing.speed_mps);
        shares
            .into_iter()
            .find(|&share_mps| aimed_mps >= share_mps || can_stop_at(share_mps))
            .map_or(aimed_mps, |share_mps| aimed_mps.max(share_mps))
    }

    /// The speed of the changing part from which the vehicle can stop: all of it where it can; else, beside a part that is small
    /// against it, what the heading of the mixture allows, found in a few steps; 0 where that finds none. So a turn that is
    /// only noise takes nothing of going but what it is allowed less.
    fn aimed_beside_mps(&self, kept: AxisSpeed, changing: AxisSpeed, safe_mps: f64) -> f64 {
        let mut part = changing;
        for aim in 0..=AIMS {
            let Some((mixed_mps, allowed_mps)) = self.mixture(kept, part) else {
                break;
            };
            let is_beside_little = kept.speed_mps <= AIMED_BESIDE * part.speed_mps;
            if mixed_mps <= allowed_mps {
                let is_good = part.speed_mps <= safe_mps && (aim == 0 || is_beside_little);
                return if is_good { part.speed_mps } else { 0.0 };
            }
            if !is_beside_little {
                break;
            }
            part.speed_mps *= AIM * allowed_mps / mixed_mps;
        }
        0.0
    }

    /// How fast the other part may be as far as the headings of the compass tell.
    fn safe_beside_mps(&mut self, kept: AxisSpeed, axis: DriveAxis) -> f64 {
        for step in 1..STEPS {
            let (direction, allowed) = self.allowed(kept.axis.towards(axis, step));
            let (along, swing) = (direction.along.abs(), direction.swing);
            let (kept_share, share) = match kept.axis {
                DriveAxis::Forward | DriveAxis::Back => (along, swing),
                DriveAxis::Left | DriveAxis::Right => (swing, along),
            };
            let speed_mps = kept.speed_mps / kept_share;
            if speed_mps > allowed.speed_mps {
                return speed_mps * share;
            }
        }
        f64::INFINITY
    }

    fn can_stop_from(&self, one: AxisSpeed, other: AxisSpeed) -> bool {
        self.mixture(one, other)
            .is_none_or(|(mixed_mps, allowed_mps)| mixed_mps <= allowed_mps)
    }

    /// The speed of a motion of two parts, and what is allowed on its heading, metres of travel per second; nothing where it
    /// does not move.
    fn mixture(&self, one: AxisSpeed, other: AxisSpeed) -> Option<(f64, f64)> {
        let (going, turning) = match one.axis {
            DriveAxis::Forward | DriveAxis::Back => (one, other),
            DriveAxis::Left | DriveAxis::Right => (other, one),
        };
        let (direction, mixed_mps) = AxisSpeeds { going, turning }.direction(self.radius_m)?;
        Some((mixed_mps, self.context.allowed(direction).speed_mps))
    }

    fn allowed(&mut self, number: usize) -> (MotionDirection, AllowedSpeed) {
        let direction = self.directions.direction(number);
        let context = self.context;
        let allowed = self.allowed[number].get_or_insert_with(|| context.allowed(direction));
        (direction, *allowed)
    }

    fn scale(&mut self, motion: &AxisSpeeds, share: f64) {
        if share < 1.0 {
            for part in [motion.going, motion.turning] {
                if part.speed_mps >= STANDSTILL_MPS {
                    self.limit(part.axis, part.speed_mps * share);
                }
            }
        }
    }

    fn limit(&mut self, axis: DriveAxis, speed_mps: f64) {
        let most_mps = &mut self.most_mps[axis as usize];
        *most_mps = most_mps.min(speed_mps);
    }
}

#[cfg(test)]
mod tests;
