//! Wheels: a drive whose own controller turns them as fast as it is told.

use super::lag_share;
use crate::velocity::{CommandedVelocity, PlanarVelocity};

/// Wheels of two sides, each with a motor and a controller of its speed: differential drives and skid drives.
///
/// The controller makes up for what skidding takes, so that a skid drive differs by slower turning only. Wheels
/// do not slip sideways. A hill does not slow it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelDrive {
    /// Of speed along the ground, metres.
    pub linear: Axis,
    /// Of turning, radians.
    pub angular: Axis,
}

/// How a speed follows what is asked: a first-order lag within limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Greatest speed in either direction, per second.
    pub max_speed: f64,
    /// Greatest acceleration and deceleration, per second squared.
    pub max_acceleration: f64,
    /// Time constant of the lag, seconds; above 0.
    pub lag_s: f64,
}

/// A speed this near to what is asked is what is asked, m/s or rad/s: friction ends what a lag never would.
const ARRIVED: f64 = 1e-4;

impl WheelDrive {
    pub(super) fn after(
        &self,
        velocity: PlanarVelocity,
        command: CommandedVelocity,
        duration_s: f64,
    ) -> PlanarVelocity {
        let command = command.at_most(self.linear.max_speed, self.angular.max_speed);
        let (linear, angular) = (&self.linear, &self.angular);
        PlanarVelocity {
            forward_mps: linear.after(velocity.forward_mps, command.linear_mps, duration_s),
            left_mps: 0.0,
            turn_rate_radps: angular.after(
                velocity.turn_rate_radps,
                command.angular_radps,
                duration_s,
            ),
        }
    }
}

impl Axis {
    fn after(&self, speed: f64, target: f64, duration_s: f64) -> f64 {
        let gap = target - speed;
        if gap.abs() < ARRIVED {
            return target;
        }
        let most = self.max_acceleration * duration_s;
        speed + (gap * lag_share(self.lag_s, duration_s)).clamp(-most, most)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these values are exact")]

    use super::*;

    const AXIS: Axis = Axis {
        max_speed: 1.2,
        max_acceleration: 2.0,
        lag_s: 0.1,
    };

    /// Speeds at multiples of 5 ms.
    fn run(from: f64, target: f64, steps: usize) -> Vec<f64> {
        let next = |speed: &f64| Some(AXIS.after(*speed, target, 0.005));
        std::iter::successors(Some(from), next)
            .take(steps)
            .collect()
    }

    #[test]
    fn small_changes_lag_and_large_ones_keep_the_acceleration() {
        // 0.1 m/s over 0.1 s is half of the acceleration: after one time constant 63 % are done.
        let small = run(0.0, 0.1, 21);
        assert!(
            (small[20] - 0.1 * (1.0 - libm::exp(-1.0))).abs() < 1e-12,
            "{small:?}"
        );
        // From 1 m/s the brakes hold 2 m/s² until 0.2 m/s, which the lag takes from there.
        let stop = run(1.0, 0.0, 400);
        assert!((stop[60] - 0.4).abs() < 1e-12, "{}", stop[60]);
        assert!(
            stop.windows(2)
                .all(|pair| pair[0] - pair[1] <= 0.01 + 1e-12)
        );
        assert!(
            stop.windows(2)
                .all(|pair| pair[1] <= pair[0] && pair[1] >= 0.0)
        );
        assert_eq!(stop[399], 0.0);
    }

    #[test]
    fn more_than_the_vehicle_can_do_is_what_it_can_do() {
        let wheels = WheelDrive {
            linear: AXIS,
            angular: AXIS,
        };
        let command = CommandedVelocity {
            linear_mps: -9.0,
            angular_radps: 9.0,
        };
        let mut velocity = PlanarVelocity::default();
        for _ in 0..1000 {
            velocity = wheels.after(velocity, command, 0.005);
        }
        assert_eq!(
            [velocity.forward_mps, velocity.turn_rate_radps],
            [-1.2, 1.2]
        );
    }
}
