//! From what is allowed on single headings to the greatest speeds of going and of turning.
//!
//! The arbiter moves each of the two towards what is asked, and brakes each, in its own time. So what is driven is no arc
//! but a mixture of the two that changes, and each mixture that may come about must be one to stop from.

use super::barrier::BarrierKind;
use super::compass::{ALL_AROUND, Axis, Compass, Part, STEPS, Travel};
use super::heading::Heading;
use super::outlook::{Allowed, Outlook};
use crate::teleop::velocity::Velocity;
use crate::teleop::verdict::GuardLimits;

/// Slower is standing still, metres per second of any point of the body.
const STANDING_MPS: f64 = 0.005;

/// A part that is slowed down beside another that is kept aims at so much of what is allowed: what is left leans more to the
/// other, and a heading that leans more is often allowed a hair less.
const AIM: f64 = 0.999;

/// It is aimed only beside a part that is at most this share of it: a mixture of more leaves its heading when both brake, and
/// needs the room that a half leaves.
const AIMED_BESIDE: f64 = 0.05;

/// How often that is tried.
const AIMS: usize = 3;

/// A judgement under way.
pub(super) struct Judgement<'a> {
    outlook: Outlook<'a>,
    compass: &'a Compass,
    radius_m: f64,
    allowed: [Option<Allowed>; ALL_AROUND],
    /// Greatest speeds along each axis so far, metres of travel per second.
    most_mps: [f64; 4],
    /// What is asked is slower for want of sight.
    is_blind: bool,
    /// Of what is asked, the heading that bounds it most.
    tightest: Option<Heading>,
}

impl<'a> Judgement<'a> {
    /// What is allowed along each axis alone.
    pub(super) fn new(outlook: Outlook<'a>, compass: &'a Compass) -> Self {
        let rules = outlook.rules;
        let radius_m = rules.footprint.radius_m();
        let turning_mps = rules.max_turn_rate_radps * radius_m;
        let mut judgement = Self {
            outlook,
            compass,
            radius_m,
            allowed: [None; ALL_AROUND],
            most_mps: [
                rules.max_speed_mps,
                turning_mps,
                rules.max_speed_mps,
                turning_mps,
            ],
            is_blind: outlook.is_stale,
            tightest: None,
        };
        for axis in Axis::ALL {
            let (_, allowed) = judgement.allowed(axis.towards(axis, 0));
            judgement.limit(axis, allowed.speed_mps);
        }
        judgement
    }

    /// Scales what is asked so that the vehicle can stop from every mixture of its going and its turning.
    pub(super) fn judge_request(&mut self, asked: Travel) {
        let exact = asked
            .heading(self.radius_m)
            .map(|(heading, _)| (heading, self.outlook.allowed(heading)));
        let mut share = 1.0_f64;
        for step in 0..=STEPS {
            let (heading, allowed) =
                self.allowed(asked.going.axis.towards(asked.turning.axis, step));
            share = self.tighten(share, &asked, heading, allowed);
        }
        if let Some((heading, allowed)) = exact {
            share = self.tighten(share, &asked, heading, allowed);
        }
        self.scale(&asked, share);
    }

    /// What bounds what is asked, and where, in the base frame; nothing where all of it is allowed.
    pub(super) fn barrier(&self) -> Option<(BarrierKind, [f64; 2])> {
        self.outlook.barrier(self.tightest?)
    }

    /// Brakes what the vehicle could no longer stop from.
    pub(super) fn judge_motion(&mut self, motion: Travel) {
        if let Some((heading, speed_mps)) = motion.heading(self.radius_m)
            && speed_mps >= STANDING_MPS
        {
            let allowed = self.outlook.allowed(heading);
            self.scale(&motion, allowed.speed_mps / speed_mps);
        }
    }

    /// While the vehicle still goes faster than is asked, it turns no faster than it can stop from, and the other way
    /// round.
    pub(super) fn judge_change(&mut self, motion: Travel, asked: Travel) {
        let capped = |part: Part| Part {
            speed_mps: part.speed_mps.min(self.most_mps[part.axis as usize]),
            ..part
        };
        let (going, turning) = (capped(asked.going), capped(asked.turning));
        if motion.going.speed_mps > going.speed_mps {
            self.limit_beside(motion.going, turning);
        }
        if motion.turning.speed_mps > turning.speed_mps {
            self.limit_beside(motion.turning, going);
        }
    }

    /// The limits so far.
    pub(super) fn limits(&self) -> GuardLimits {
        let most = |axis: Axis| {
            let most_mps = self.most_mps[axis as usize];
            if most_mps < STANDING_MPS {
                0.0
            } else {
                most_mps
            }
        };
        GuardLimits {
            forward_mps: most(Axis::Forward),
            reverse_mps: most(Axis::Back),
            left_radps: most(Axis::Left) / self.radius_m,
            right_radps: most(Axis::Right) / self.radius_m,
            is_blind: self.is_blind,
            excess: Velocity::ZERO,
        }
    }

    /// The lesser of a share of what is asked and what one heading leaves of it; where that is less, it is the tightest.
    fn tighten(&mut self, share: f64, asked: &Travel, heading: Heading, allowed: Allowed) -> f64 {
        let kept = self.share(asked, heading, allowed);
        if kept < share {
            self.tightest = Some(heading);
        }
        share.min(kept)
    }

    /// What may be kept of a motion for the sake of one heading between its axes.
    fn share(&mut self, asked: &Travel, heading: Heading, allowed: Allowed) -> f64 {
        let mixed_mps = asked.mixed_mps(heading);
        if mixed_mps < STANDING_MPS {
            return 1.0;
        }
        self.is_blind |= allowed.is_blind && allowed.speed_mps < mixed_mps;
        allowed.speed_mps / mixed_mps
    }

    /// Limits one part of the motion while the other one keeps its speed: to what its heading allows, where that can be found
    /// at once, else to the greatest of some shares of what it would be from which the vehicle can stop, with all that is less.
    fn limit_beside(&mut self, kept: Part, changing: Part) {
        if kept.speed_mps < STANDING_MPS || changing.speed_mps < STANDING_MPS {
            return;
        }
        let most_mps = self.most_beside_mps(kept, changing);
        if most_mps < changing.speed_mps {
            self.limit(changing.axis, most_mps);
        }
    }

    /// How fast the changing part may be; nothing is allowed that was not tried.
    fn most_beside_mps(&mut self, kept: Part, changing: Part) -> f64 {
        let safe_mps = self.safe_beside_mps(kept, changing.axis);
        let aimed_mps = self.aimed_beside_mps(kept, changing, safe_mps);
        let can_stop_at = |speed_mps: f64| {
            let part = Part {
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
    fn aimed_beside_mps(&self, kept: Part, changing: Part, safe_mps: f64) -> f64 {
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
    fn safe_beside_mps(&mut self, kept: Part, axis: Axis) -> f64 {
        for step in 1..STEPS {
            let (heading, allowed) = self.allowed(kept.axis.towards(axis, step));
            let (along, swing) = (heading.along.abs(), heading.swing);
            let (kept_share, share) = match kept.axis {
                Axis::Forward | Axis::Back => (along, swing),
                Axis::Left | Axis::Right => (swing, along),
            };
            let speed_mps = kept.speed_mps / kept_share;
            if speed_mps > allowed.speed_mps {
                return speed_mps * share;
            }
        }
        f64::INFINITY
    }

    fn can_stop_from(&self, one: Part, other: Part) -> bool {
        self.mixture(one, other)
            .is_none_or(|(mixed_mps, allowed_mps)| mixed_mps <= allowed_mps)
    }

    /// The speed of a motion of two parts, and what is allowed on its heading, metres of travel per second; nothing where it
    /// does not move.
    fn mixture(&self, one: Part, other: Part) -> Option<(f64, f64)> {
        let (going, turning) = match one.axis {
            Axis::Forward | Axis::Back => (one, other),
            Axis::Left | Axis::Right => (other, one),
        };
        let (heading, mixed_mps) = Travel { going, turning }.heading(self.radius_m)?;
        Some((mixed_mps, self.outlook.allowed(heading).speed_mps))
    }

    fn allowed(&mut self, number: usize) -> (Heading, Allowed) {
        let heading = self.compass.heading(number);
        let outlook = self.outlook;
        let allowed = self.allowed[number].get_or_insert_with(|| outlook.allowed(heading));
        (heading, *allowed)
    }

    fn scale(&mut self, motion: &Travel, share: f64) {
        if share < 1.0 {
            for part in [motion.going, motion.turning] {
                if part.speed_mps >= STANDING_MPS {
                    self.limit(part.axis, part.speed_mps * share);
                }
            }
        }
    }

    fn limit(&mut self, axis: Axis, speed_mps: f64) {
        let most_mps = &mut self.most_mps[axis as usize];
        *most_mps = most_mps.min(speed_mps);
    }
}

#[cfg(test)]
mod tests;
