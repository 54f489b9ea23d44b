//! From the allowed speeds in single directions to the limits of the two axes in use: linear speed, and angular or
//! lateral speed.
//!
//! The arbiter changes both independently. The path is therefore not one arc: the mixture of the
//! two changes, and the vehicle must be able to stop from each mixture that may occur.

use crate::collision_monitor::allowed_speed::{AllowedSpeed, SpeedLimitContext};
use crate::collision_monitor::config::CollisionMonitorRules;
use crate::collision_monitor::footprint::{MotionDirection, MotionPlane};
use crate::interface::SpeedLimits;
use crate::motion::Velocity;
use protocol::message::BarrierKind;

/// Speeds below this count as standstill, metres per second of any point of the body.
const STANDSTILL_MPS: f64 = 0.005;

/// If one axis is reduced and the other is kept, the direction of motion turns towards the kept one, where slightly less
/// may be allowed. The reduced axis is therefore set to this share of its limit.
const REDUCED_SHARE: f64 = 0.999;

/// This is done only if the kept axis is at most this share of the reduced one. Above it, braking on both axes changes
/// the direction so much that only half of the limit is safe.
const MAX_KEPT_SHARE: f64 = 0.05;

const SOLVER_STEPS: usize = 3;

pub(super) struct LimitSolver<'a> {
    context: SpeedLimitContext<'a>,
    directions: &'a DirectionTable,
    allowed: [Option<AllowedSpeed>; ALL_DIRECTIONS],
    /// Greatest speeds along each axis so far, metres of travel per second.
    most_mps: [f64; 4],
    in_unknown_space: bool,
    /// The direction that limits the requested motion most.
    limiting_direction: Option<MotionDirection>,
}

impl<'a> LimitSolver<'a> {
    /// Starts with the limits along each axis alone.
    pub(super) fn new(context: SpeedLimitContext<'a>, directions: &'a DirectionTable) -> Self {
        let rules = context.rules;
        let second_mps = match directions.plane {
            MotionPlane::Turning { radius_m } => rules.max_turn_rate_radps * radius_m,
            MotionPlane::Sideways => rules.max_speed_mps,
        };
        let mut solver = Self {
            context,
            directions,
            allowed: [None; ALL_DIRECTIONS],
            most_mps: [
                rules.max_speed_mps,
                second_mps,
                rules.max_speed_mps,
                second_mps,
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

    /// Scales the request so that the vehicle can stop from every mixture of its linear and angular speed.
    pub(super) fn limit_request(&mut self, requested: AxisSpeeds) {
        let exact = requested
            .direction(self.directions.plane)
            .map(|(direction, _)| (direction, self.context.allowed(direction)));
        let mut share = 1.0_f64;
        for step in 0..=STEPS {
            let (direction, allowed) =
                self.allowed(requested.first.axis.towards(requested.second.axis, step));
            share = self.tighten_share(share, &requested, direction, allowed);
        }
        if let Some((direction, allowed)) = exact {
            share = self.tighten_share(share, &requested, direction, allowed);
        }
        self.scale(&requested, share);
    }

    /// What limits the request, and where, in the base frame; absent if all of it is allowed.
    pub(super) fn barrier(&self) -> Option<(BarrierKind, [f64; 2])> {
        self.context.barrier(self.limiting_direction?)
    }

    /// Limits a motion from which the vehicle could no longer stop.
    pub(super) fn limit_motion(&mut self, motion: AxisSpeeds) {
        if let Some((direction, speed_mps)) = motion.direction(self.directions.plane)
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
        let (first, second) = (capped(requested.first), capped(requested.second));
        if motion.first.speed_mps > first.speed_mps {
            self.limit_beside(motion.first, second);
        }
        if motion.second.speed_mps > second.speed_mps {
            self.limit_beside(motion.second, first);
        }
    }

    pub(super) fn limits(&self) -> SpeedLimits {
        let most = |axis: DriveAxis| {
            let most_mps = self.most_mps[axis as usize];
            if most_mps < STANDSTILL_MPS {
                0.0
            } else {
                most_mps
            }
        };
        let second = [DriveAxis::Left, DriveAxis::Right].map(most);
        let ([left_mps, right_mps], [left_radps, right_radps]) = match self.directions.plane {
            MotionPlane::Turning { radius_m } => ([0.0; 2], second.map(|speed| speed / radius_m)),
            MotionPlane::Sideways => (second, [0.0; 2]),
        };
        SpeedLimits {
            forward_mps: most(DriveAxis::Forward),
            reverse_mps: most(DriveAxis::Back),
            left_mps,
            right_mps,
            left_radps,
            right_radps,
            in_unknown_space: self.in_unknown_space,
            overspeed: Velocity::ZERO,
        }
    }

    /// The lesser of a share of what is asked and what one heading leaves of it; where that is less, it is the
    /// tightest.
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

    /// Limits one axis (`changing`) while the other (`kept`) keeps its speed.
    fn limit_beside(&mut self, kept: AxisSpeed, changing: AxisSpeed) {
        if kept.speed_mps < STANDSTILL_MPS || changing.speed_mps < STANDSTILL_MPS {
            return;
        }
        let most_mps = self.most_beside_mps(kept, changing);
        if most_mps < changing.speed_mps {
            self.limit(changing.axis, most_mps);
        }
    }

    /// The greatest speed of the changing axis from which the vehicle can stop: the solved one, or a half or a quarter of
    /// the requested one where that is more. Each result was checked.
    fn most_beside_mps(&mut self, kept: AxisSpeed, changing: AxisSpeed) -> f64 {
        let safe_mps = self.safe_beside_mps(kept, changing.axis);
        let solved_mps = self.solved_beside_mps(kept, changing, safe_mps);
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
            .find(|&share_mps| solved_mps >= share_mps || can_stop_at(share_mps))
            .map_or(solved_mps, |share_mps| solved_mps.max(share_mps))
    }

    /// The requested speed of the changing axis if the vehicle can stop from it. Otherwise, if the kept axis is much
    /// slower, the speed that the direction of both allows, found in a few steps. 0 if none is found. A turn that is only
    /// noise thus hardly slows the vehicle.
    fn solved_beside_mps(&self, kept: AxisSpeed, changing: AxisSpeed, safe_mps: f64) -> f64 {
        let mut part = changing;
        for step in 0..=SOLVER_STEPS {
            let Some((mixed_mps, allowed_mps)) = self.mixture(kept, part) else {
                break;
            };
            let is_beside_little = kept.speed_mps <= MAX_KEPT_SHARE * part.speed_mps;
            if mixed_mps <= allowed_mps {
                let is_good = part.speed_mps <= safe_mps && (step == 0 || is_beside_little);
                return if is_good { part.speed_mps } else { 0.0 };
            }
            if !is_beside_little {
                break;
            }
            part.speed_mps *= REDUCED_SHARE * allowed_mps / mixed_mps;
        }
        0.0
    }

    /// The greatest speed of the other axis according to the direction table.
    fn safe_beside_mps(&mut self, kept: AxisSpeed, axis: DriveAxis) -> f64 {
        for step in 1..STEPS {
            let (direction, allowed) = self.allowed(kept.axis.towards(axis, step));
            let (first, second) = (direction.along.abs(), direction.second_share());
            let (kept_share, share) = match kept.axis {
                DriveAxis::Forward | DriveAxis::Back => (first, second),
                DriveAxis::Left | DriveAxis::Right => (second, first),
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

    /// The speed of a motion along two axes, and the allowed speed in its direction, metres of travel per second. `None`
    /// if it does not move.
    fn mixture(&self, one: AxisSpeed, other: AxisSpeed) -> Option<(f64, f64)> {
        let (first, second) = match one.axis {
            DriveAxis::Forward | DriveAxis::Back => (one, other),
            DriveAxis::Left | DriveAxis::Right => (other, one),
        };
        let (direction, mixed_mps) =
            AxisSpeeds { first, second }.direction(self.directions.plane)?;
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
            for part in [motion.first, motion.second] {
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

/// From one axis to the next, the first of them included: 15 degrees apart.
pub(super) const STEPS: usize = 6;

pub(super) const ALL_DIRECTIONS: usize = 4 * STEPS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DriveAxis {
    Forward,
    Left,
    Back,
    Right,
}

/// Headings from forward over left, each by its number.
#[derive(Clone, Debug)]
pub(super) struct DirectionTable {
    pub(super) plane: MotionPlane,
    headings: [MotionDirection; ALL_DIRECTIONS],
}

/// A motion in metres per second of travel: along x, and along the second axis of its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AxisSpeeds {
    pub(super) first: AxisSpeed,
    pub(super) second: AxisSpeed,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AxisSpeed {
    pub(super) axis: DriveAxis,
    /// Metres of travel per second, not negative.
    pub(super) speed_mps: f64,
}

impl DriveAxis {
    pub(super) const ALL: [Self; 4] = [Self::Forward, Self::Left, Self::Back, Self::Right];

    /// Number of a heading some steps from this axis towards one beside it.
    pub(super) const fn towards(self, beside: Self, step: usize) -> usize {
        let (from, to) = (self as usize * STEPS, beside as usize * STEPS);
        let is_next = (from + STEPS) % ALL_DIRECTIONS == to;
        let back = if is_next { step } else { ALL_DIRECTIONS - step };
        (from + back) % ALL_DIRECTIONS
    }
}

impl DirectionTable {
    pub(super) fn new(plane: MotionPlane) -> Self {
        let headings = std::array::from_fn(|number| {
            let angle = std::f64::consts::FRAC_PI_2 * (number % STEPS) as f64 / STEPS as f64;
            let (cos, sin) = (libm::cos(angle), libm::sin(angle));
            // Axes are exact: their headings neither drift to a side nor along.
            let (first, second) = match number / STEPS {
                0 => (cos, sin),
                1 => (-sin, cos),
                2 => (-cos, -sin),
                _ => (sin, -cos),
            };
            MotionDirection::in_plane(first, second, plane)
        });
        Self { plane, headings }
    }

    pub(super) const fn direction(&self, number: usize) -> MotionDirection {
        self.headings[number]
    }
}

impl AxisSpeeds {
    /// A motion in a plane, at most as fast as the vehicle can be.
    pub(super) fn of(
        velocity: Velocity,
        plane: MotionPlane,
        rules: &CollisionMonitorRules,
    ) -> Self {
        let axis = |speed: f64, [positive, negative]: [DriveAxis; 2], most: f64, radius_m: f64| {
            AxisSpeed {
                axis: if speed < 0.0 { negative } else { positive },
                speed_mps: speed.abs().min(most) * radius_m,
            }
        };
        let second = [DriveAxis::Left, DriveAxis::Right];
        Self {
            first: axis(
                velocity.linear_mps,
                [DriveAxis::Forward, DriveAxis::Back],
                rules.max_speed_mps,
                1.0,
            ),
            second: match plane {
                MotionPlane::Turning { radius_m } => axis(
                    velocity.angular_radps,
                    second,
                    rules.max_turn_rate_radps,
                    radius_m,
                ),
                MotionPlane::Sideways => {
                    axis(velocity.lateral_mps, second, rules.max_speed_mps, 1.0)
                }
            },
        }
    }

    /// Its direction and speed of travel; `None` where it does not move.
    pub(super) fn direction(&self, plane: MotionPlane) -> Option<(MotionDirection, f64)> {
        let signed = |part: AxisSpeed, negative: DriveAxis| {
            if part.axis == negative {
                -part.speed_mps
            } else {
                part.speed_mps
            }
        };
        let first_m = signed(self.first, DriveAxis::Back);
        let second_m = signed(self.second, DriveAxis::Right);
        MotionDirection::of(first_m, second_m, plane)
    }

    /// The greatest speed on a heading between its axes that is a mixture of at most its two parts.
    pub(super) fn mixed_mps(&self, direction: MotionDirection) -> f64 {
        let most = |part: AxisSpeed, share: f64| {
            if share > 0.0 {
                part.speed_mps / share
            } else {
                f64::INFINITY
            }
        };
        most(self.first, direction.along.abs()).min(most(self.second, direction.second_share()))
    }
}

#[cfg(test)]
mod tests;
