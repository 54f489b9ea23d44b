//! Motion limits: speed, acceleration and jerk towards the requested velocity, and the stopping ramp.
//!
//! A tick adds `acceleration · dt` to the speed, so that the acceleration and jerk between two outputs are exactly
//! those decided here, whatever `dt` was.

use std::time::Duration;

use crate::locomotion::{Locomotion, LocomotionMode};

/// Speed and acceleration closer to what is asked than this are that, metres or radians per second.
const CONVERGED: f64 = 1e-9;

/// Longest time for which one tick speeds up: a late round must not be made up for.
const MAX_STEP: Duration = Duration::from_millis(40);

/// Limits of one axis, in metres (along x) or radians (about z); all above zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AxisLimits {
    /// Greatest speed, per second.
    pub(crate) speed: f64,
    /// Greatest acceleration that commands cause, per second squared.
    pub(crate) accel: f64,
    /// Greatest change of acceleration, per second cubed.
    pub(crate) jerk: f64,
    /// Deceleration of stops, per second squared, at least `accel`; the jerk limit does not apply to it.
    pub(crate) stop_decel: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Axis {
    /// Metres or radians per second.
    pub(crate) speed: f64,
    /// Per second squared; zero during and after a stopping ramp, where no jerk limit applies.
    pub(crate) accel: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Motion {
    /// Along x, metres.
    pub(crate) linear: Axis,
    /// Along y, metres.
    pub(crate) lateral: Axis,
    /// About z, radians.
    pub(crate) angular: Axis,
}

/// The greatest speed of one axis in either direction; never negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Caps {
    positive: f64,
    negative: f64,
}

/// The greatest speeds of all axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionCaps {
    /// Along x.
    pub linear: Caps,
    /// Along y.
    pub lateral: Caps,
    /// About z.
    pub angular: Caps,
}

/// Limits of the axes of a vehicle; lateral motion has those of linear motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotionLimits {
    pub(crate) linear: AxisLimits,
    pub(crate) angular: AxisLimits,
}

/// What the next tick of [`Motion`] is to come nearer to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotionTarget {
    /// What is asked, within every limit.
    pub(crate) target: Velocity,
    /// Greatest speeds, which the jerk limit does not stretch. Where it is faster, it brakes as in a stop: that is what
    /// these limits were computed with.
    pub(crate) caps: MotionCaps,
    /// Greatest turn rate at a linear speed.
    pub(crate) turn_rate_at: (Locomotion, LocomotionMode),
}

impl Caps {
    /// No limit.
    pub const NONE: Self = Self {
        positive: f64::INFINITY,
        negative: f64::INFINITY,
    };

    /// No motion.
    pub const STOP: Self = Self {
        positive: 0.0,
        negative: 0.0,
    };

    /// The greatest speeds up and down; what is negative or not a number counts as zero.
    pub const fn new(positive: f64, negative: f64) -> Self {
        // `max` takes zero where the other is not a number.
        Self {
            positive: positive.max(0.0),
            negative: negative.max(0.0),
        }
    }

    /// At most `cap` in either direction.
    #[must_use]
    pub const fn at_most(self, cap: f64) -> Self {
        Self {
            positive: self.positive.min(cap),
            negative: self.negative.min(cap),
        }
    }

    /// The greatest speed in the direction of `speed`.
    pub fn towards(self, speed: f64) -> f64 {
        if speed < 0.0 {
            self.negative
        } else {
            self.positive
        }
    }
}

impl Axis {
    /// The next speed towards `target` after `dt_s` seconds.
    ///
    /// The acceleration is the greatest from which it can still fall to zero, at the greatest jerk, before `target` is
    /// passed: `a·dt + a²/2j ≤ gap`. What remains to be added while it falls in steps is less than the `a²/2j` of
    /// continuous time, so that `target` is not passed whatever the steps to come.
    #[must_use]
    pub(crate) fn follow(self, target: f64, dt_s: f64, limits: &AxisLimits) -> Self {
        if dt_s <= 0.0 {
            return self;
        }
        let gap = target - self.speed;
        // The positive solution of the above, without the difference of two large numbers.
        let landing =
            2.0 * gap.abs() / (dt_s + (dt_s * dt_s + 2.0 * gap.abs() / limits.jerk).sqrt());
        let wanted = landing.min(limits.accel).copysign(gap);
        let change = limits.jerk * dt_s;
        let accel = wanted.clamp(self.accel - change, self.accel + change);
        let speed = (self.speed + accel * dt_s).clamp(-limits.speed, limits.speed);
        // Where it comes to rest at the target, not where it passes it: `a²/2j` is what is still to be added.
        if (target - speed).abs() < CONVERGED && accel * accel <= 2.0 * limits.jerk * CONVERGED {
            return Self {
                speed: target,
                accel: 0.0,
            };
        }
        Self { speed, accel }
    }

    /// The next speed of a stopping ramp that ends at `floor`, in the present direction.
    #[must_use]
    pub(crate) fn brake(self, floor: f64, dt_s: f64, limits: &AxisLimits) -> Self {
        let slower = (self.speed.abs() - limits.stop_decel * dt_s).max(floor);
        Self {
            speed: slower.min(self.speed.abs()).copysign(self.speed),
            accel: 0.0,
        }
    }

    fn towards(self, target: f64, caps: Caps, dt: Duration, limits: &AxisLimits) -> Self {
        let cap = caps.towards(self.speed);
        if self.speed.abs() > cap {
            return self.brake(cap, dt.as_secs_f64(), limits);
        }
        let next = self.follow(target, dt.min(MAX_STEP).as_secs_f64(), limits);
        let cap = caps.towards(next.speed);
        if next.speed.abs() > cap {
            // It was speeding up when the cap came down: letting go of that gently would pass the cap.
            return Self {
                speed: cap.copysign(next.speed),
                accel: 0.0,
            };
        }
        next
    }
}

impl MotionCaps {
    /// The same for every axis.
    pub const fn all(caps: Caps) -> Self {
        Self {
            linear: caps,
            lateral: caps,
            angular: caps,
        }
    }
}

impl Motion {
    pub(crate) const fn velocity(self) -> Velocity {
        Velocity {
            linear_mps: self.linear.speed,
            lateral_mps: self.lateral.speed,
            angular_radps: self.angular.speed,
        }
    }

    pub(crate) fn is_zero(self) -> bool {
        let axes = [self.linear, self.lateral, self.angular];
        axes.iter().all(|axis| axis.speed.abs() <= 0.0)
    }

    /// The motion `dt` later, nearer to `aim`.
    #[must_use]
    pub(crate) fn towards(self, aim: &MotionTarget, dt: Duration, limits: &MotionLimits) -> Self {
        let MotionTarget { target, caps, .. } = aim;
        let [linear, lateral] = [
            (self.linear, target.linear_mps, caps.linear),
            (self.lateral, target.lateral_mps, caps.lateral),
        ]
        .map(|(axis, target, caps)| axis.towards(target, caps, dt, &limits.linear));
        let (locomotion, mode) = aim.turn_rate_at;
        let turn_rate = locomotion.max_turn_rate_radps(mode, linear.speed);
        let caps = caps.angular.at_most(turn_rate);
        let angular = self
            .angular
            .towards(target.angular_radps, caps, dt, &limits.angular);
        Self {
            linear,
            lateral,
            angular,
        }
    }

    /// The motion `dt` later on the stopping ramp: zero after `speed / stop_decel`.
    #[must_use]
    pub(crate) fn stopping(self, dt: Duration, limits: &MotionLimits) -> Self {
        let dt_s = dt.as_secs_f64();
        Self {
            linear: self.linear.brake(0.0, dt_s, &limits.linear),
            lateral: self.lateral.brake(0.0, dt_s, &limits.linear),
            angular: self.angular.brake(0.0, dt_s, &limits.angular),
        }
    }
}

/// Below this, metres per second and radians per second alike, a request asks for nothing.
const NEUTRAL: f64 = 1e-3;
/// Slower than this, in the same units, is standing still: no motor controller here resolves it.
const STANDING: f64 = 1e-6;

/// A velocity in the base frame (x forward, y left, z up).
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Velocity {
    /// Along x, metres per second; negative backwards.
    pub linear_mps: f64,
    /// Along y, metres per second; positive to the left.
    pub lateral_mps: f64,
    /// About z, radians per second; positive to the left.
    pub angular_radps: f64,
}

impl Velocity {
    /// Standing still, as far as that can be asked for.
    pub const ZERO: Self = Self::new(0.0, 0.0);

    /// Metres per second along x, radians per second about z; nothing along y.
    pub const fn new(linear_mps: f64, angular_radps: f64) -> Self {
        Self {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps,
        }
    }

    /// The speed over ground, metres per second.
    pub fn ground_speed_mps(self) -> f64 {
        libm::hypot(self.linear_mps, self.lateral_mps)
    }

    /// Neither infinite nor not-a-number.
    pub const fn is_finite(self) -> bool {
        self.linear_mps.is_finite()
            && self.lateral_mps.is_finite()
            && self.angular_radps.is_finite()
    }

    /// Nothing is pressed.
    pub const fn is_neutral(self) -> bool {
        self.is_below(NEUTRAL)
    }

    /// Nothing is asked of motors; never true of what is not a number.
    pub const fn is_zero(self) -> bool {
        self.is_below(STANDING)
    }

    const fn is_below(self, speed: f64) -> bool {
        self.linear_mps.abs() < speed
            && self.lateral_mps.abs() < speed
            && self.angular_radps.abs() < speed
    }

    /// All parts times `factor`, so that the path keeps its shape.
    #[must_use]
    pub const fn scaled(self, factor: f64) -> Self {
        Self {
            linear_mps: self.linear_mps * factor,
            lateral_mps: self.lateral_mps * factor,
            angular_radps: self.angular_radps * factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LIMITS: AxisLimits = AxisLimits {
        speed: 1.5,
        accel: 0.5,
        jerk: 2.0,
        stop_decel: 1.0,
    };

    /// Targets, each for a number of steps of given lengths.
    fn targets() -> impl Strategy<Value = Vec<(f64, Vec<f64>)>> {
        let steps = prop::collection::vec(0.002..0.04, 1..60);
        prop::collection::vec((-1.5..1.5, steps), 1..6)
    }

    proptest! {
        #[test]
        fn a_target_is_never_passed_from_rest(target in -1.5..1.5, steps in prop::collection::vec(0.002..0.04, 1..400)) {
            let mut axis = Axis::default();
            for dt_s in steps {
                axis = axis.follow(target, dt_s, &LIMITS);
                prop_assert!(axis.speed.abs() <= f64::abs(target) + 1e-12);
                prop_assert!(axis.speed * target >= 0.0);
            }
        }

        #[test]
        fn acceleration_and_jerk_are_kept_whatever_is_asked(targets in targets()) {
            let mut axis = Axis::default();
            for (target, steps) in targets {
                for dt_s in steps {
                    let next = axis.follow(target, dt_s, &LIMITS);
                    let accel = (next.speed - axis.speed) / dt_s;
                    prop_assert!(accel.abs() <= LIMITS.accel + 1e-6);
                    prop_assert!((accel - axis.accel).abs() <= LIMITS.jerk * dt_s + 1e-6);
                    prop_assert!(next.speed.abs() <= LIMITS.speed);
                    axis = next;
                }
            }
        }

        #[test]
        fn a_target_is_reached(start in -1.5..1.5, target in -1.5..1.5) {
            let mut axis = Axis { speed: start, accel: 0.0 };
            // Up to 3 m/s at 0.5 m/s² with 0.25 s to build up the acceleration, and as much to let it go.
            for _ in 0..400 {
                axis = axis.follow(target, 0.02, &LIMITS);
            }
            prop_assert_eq!(axis, Axis { speed: target, accel: 0.0 });
        }

        #[test]
        fn the_stopping_ramp_takes_speed_over_deceleration(speed in -1.5..1.5, dt_ms in 2_u64..50) {
            let mut axis = Axis { speed, accel: 0.3 };
            let mut millis = 0;
            while axis.speed.abs() > 0.0 {
                let next = axis.brake(0.0, dt_ms as f64 / 1000.0, &LIMITS);
                prop_assert!(next.speed.abs() < axis.speed.abs());
                prop_assert!(next.speed * speed >= 0.0);
                axis = next;
                millis += dt_ms;
            }
            let exact_s = f64::abs(speed) / LIMITS.stop_decel;
            prop_assert!((millis as f64) / 1000.0 < exact_s + dt_ms as f64 / 1000.0 + 1e-9);
        }
    }

    #[test]
    fn above_a_cap_it_brakes_and_does_not_fall_below() {
        let fast = Axis {
            speed: -1.0,
            accel: -0.2,
        };
        let tick = Duration::from_millis(20);
        let caps = Caps::new(0.0, 0.5);
        let braked = fast.towards(-0.5, caps, tick, &LIMITS);
        assert_eq!(
            braked,
            Axis {
                speed: -0.98,
                accel: 0.0
            }
        );
        let late = fast.towards(-0.5, caps, Duration::from_hours(1), &LIMITS);
        assert_eq!(
            late,
            Axis {
                speed: -0.5,
                accel: 0.0
            }
        );
    }

    #[test]
    fn a_cap_ahead_does_not_keep_it_from_going_back() {
        let caps = Caps::new(0.0, f64::NAN).at_most(1.0);
        assert_eq!((caps.towards(1.0), caps.towards(-1.0)), (0.0, 0.0));
        let caps = Caps::new(-1.0, 0.3);
        let back = Axis::default().towards(-0.5, caps, Duration::from_millis(20), &LIMITS);
        assert!(back.speed < 0.0, "{back:?}");
        let ahead = Axis::default().towards(0.5, caps, Duration::from_millis(20), &LIMITS);
        assert_eq!(ahead, Axis::default());
    }

    #[test]
    fn speeding_up_ends_at_a_cap_that_comes_down() {
        let rising = Axis {
            speed: 0.49,
            accel: 0.5,
        };
        let capped = rising.towards(
            0.491,
            Caps::NONE.at_most(0.491),
            Duration::from_millis(20),
            &LIMITS,
        );
        assert_eq!(
            capped,
            Axis {
                speed: 0.491,
                accel: 0.0
            }
        );
    }

    #[test]
    fn a_late_tick_is_not_made_up_for() {
        let start = Axis {
            speed: 0.0,
            accel: 0.5,
        };
        let late = start.towards(1.5, Caps::NONE, Duration::from_secs(1), &LIMITS);
        assert!((late.speed - 0.02).abs() < 1e-12);
    }
}
