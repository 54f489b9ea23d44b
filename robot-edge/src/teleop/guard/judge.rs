//! The guard of one vehicle, round by round.

use std::time::Duration;

use super::barrier::Barrier;
use super::compass::{Compass, Travel};
use super::config::{GuardRules, OnBlind};
use super::excess::excess;
use super::judgement::Judgement;
use super::lack::Lack;
use super::local_map::LocalMap;
use super::outlook::Outlook;
use super::placement::{OLDEST, Odometry};
use super::surroundings::Surroundings;
use super::sweep::GuardSweep;
use super::told::Told;
use crate::clock::Monotonic;
use crate::teleop::velocity::Velocity;
use crate::teleop::verdict::{GuardLimits, GuardVerdict};

/// What the guard knows in a round.
#[derive(Clone, Copy, Debug)]
pub struct GuardInput<'a> {
    /// The last sweep of each sensor.
    pub sweeps: &'a [GuardSweep],
    /// The last map, where there is one.
    pub map: Option<&'a LocalMap>,
    /// The newest pose and measured speed; absent before the first.
    pub odometry: Option<Odometry>,
    /// What the motors were told in the last round.
    pub told: Velocity,
    /// What the operator asks now.
    pub requested: Velocity,
}

/// The guard of one vehicle. Of earlier rounds it judges by what the motors were told, and by nothing else.
#[derive(Clone, Debug)]
pub struct CollisionGuard {
    rules: GuardRules,
    compass: Compass,
    surroundings: Surroundings,
    told: Told,
    last_round: Option<Monotonic>,
    lack: Option<Lack>,
    barrier: Option<Barrier>,
}

impl CollisionGuard {
    /// A guard that keeps to `rules`.
    pub fn new(rules: GuardRules) -> Self {
        Self {
            rules,
            compass: Compass::new(rules.footprint.radius_m()),
            surroundings: Surroundings::new(&rules),
            told: Told::new(OLDEST + rules.actuator_delay),
            last_round: None,
            lack: None,
            barrier: None,
        }
    }

    /// The rules that it keeps to.
    pub const fn rules(&self) -> &GuardRules {
        &self.rules
    }

    /// What it lacked in the last round, where it could not judge then.
    pub const fn lack(&self) -> Option<Lack> {
        self.lack
    }

    /// What bounded the motion that was asked for in the last round; none where nothing did, or where it could not judge.
    pub const fn barrier(&self) -> Option<Barrier> {
        self.barrier
    }

    /// How long ago the ground beside the vehicle was looked at last: ahead, to the left, behind, to the right; absent where
    /// nobody has looked.
    pub const fn side_ages(&self) -> [Option<Duration>; 4] {
        self.surroundings.side_ages
    }

    /// Its word of this round. Where the operator asks for no number, it judges as if they asked for nothing.
    pub fn verdict(&mut self, input: &GuardInput<'_>, now: Monotonic) -> GuardVerdict {
        self.barrier = None;
        if !self.rules.enabled {
            return GuardVerdict::Off;
        }
        let limits = self.limits(input, now);
        self.lack = limits.err();
        limits.map_or(GuardVerdict::Stale, GuardVerdict::Limits)
    }

    fn limits(&mut self, input: &GuardInput<'_>, now: Monotonic) -> Result<GuardLimits, Lack> {
        let since = self.last_round.replace(now).unwrap_or(now);
        if !input.told.is_finite() {
            return Err(Lack::Number);
        }
        self.told.tell(since, input.told);
        // Without a pose nothing can be placed, and creeping would be a guess.
        let obeys = (self.rules.actuator_delay, self.rules.is_boat);
        let odometry = input.odometry.ok_or(Lack::Pose(None))?;
        let vehicle = odometry.placement(&self.told, obeys, now)?;
        let measured = odometry.measured;
        let is_stale = input.sweeps.iter().all(|sweep| sweep.is_stale(now));
        if is_stale && self.rules.on_blind == OnBlind::Stop {
            return Err(Lack::Sweeps);
        }
        let known = (input.sweeps, input.map);
        self.surroundings.gather(&self.rules, known, vehicle, now);
        let outlook = Outlook {
            rules: &self.rules,
            around: &self.surroundings,
            is_stale,
        };
        let mut judgement = Judgement::new(outlook, &self.compass);
        let requested = if input.requested.is_finite() {
            input.requested
        } else {
            Velocity::ZERO
        };
        let travel = |velocity| Travel::of(velocity, &self.rules);
        judgement.judge_request(travel(requested));
        self.barrier = judgement.barrier().map(|(kind, point)| Barrier {
            position_in_odom: vehicle.to_odom(point),
            kind,
        });
        for motion in [measured, input.told] {
            judgement.judge_motion(travel(motion));
            judgement.judge_change(travel(motion), travel(requested));
        }
        let limits = judgement.limits();
        Ok(GuardLimits {
            excess: if self.rules.is_boat {
                excess(&limits, measured, &self.rules)
            } else {
                Velocity::ZERO
            },
            ..limits
        })
    }
}
