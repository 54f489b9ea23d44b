//! How fast the vehicle goes, from one pose to the next.

use std::collections::VecDeque;

use measurement::pose::{self, Pose};
use measurement::time::{RobotDuration, RobotTime};
use teleop::Velocity;

/// Between poses closer than this, noise exceeds the motion, seconds.
const MIN_INTERVAL_S: f64 = 0.015;
/// Across a longer gap nothing is known, seconds.
const MAX_INTERVAL_S: f64 = 1.0;

/// Speeds from poses, in the vehicle's frame: those between the newest pose and one that is `window` older. Before the
/// second pose, and across gaps, they are unknown, so zero.
#[derive(Clone, Debug)]
pub struct VelocityEstimator {
    window: RobotDuration,
    /// From the newest that is at least as old as the window.
    poses: VecDeque<(RobotTime, Pose)>,
    velocity: Velocity,
}

impl VelocityEstimator {
    /// The longer the window the less noise, and the later a change of speed shows, by half of it.
    pub const fn new(window: RobotDuration) -> Self {
        Self {
            window,
            poses: VecDeque::new(),
            velocity: Velocity::ZERO,
        }
    }

    /// The velocity at the newest pose.
    pub fn update(&mut self, stamp: RobotTime, odom_from_base: &Pose) -> Velocity {
        if let Some(&(last, _)) = self.poses.back() {
            let elapsed_s = stamp.since(last).as_secs_f64();
            if (0.0..MIN_INTERVAL_S).contains(&elapsed_s) {
                return self.velocity;
            }
            if !(0.0..=MAX_INTERVAL_S).contains(&elapsed_s) {
                self.poses.clear();
            }
        }
        self.poses.push_back((stamp, *odom_from_base));
        while let Some(&(second, _)) = self.poses.get(1)
            && stamp.since(second) >= self.window
        {
            self.poses.pop_front();
        }
        self.velocity = match self.poses.front() {
            Some((first, pose)) if *first < stamp => {
                between(pose, odom_from_base, stamp.since(*first).as_secs_f64())
            }
            Some(_) | None => Velocity::ZERO,
        };
        self.velocity
    }
}

fn between(last: &Pose, next: &Pose, elapsed_s: f64) -> Velocity {
    let gone = next.translation.vector - last.translation.vector;
    let yaw_rad = pose::yaw_rad(next);
    let turned_rad = libm::remainder(yaw_rad - pose::yaw_rad(last), std::f64::consts::TAU);
    // The chord of an arc has the direction of its middle.
    let (sin, cos) = libm::sincos(yaw_rad - 0.5 * turned_rad);
    Velocity {
        linear_mps: (gone.x * cos + gone.y * sin) / elapsed_s,
        lateral_mps: (gone.y * cos - gone.x * sin) / elapsed_s,
        angular_radps: turned_rad / elapsed_s,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;

    #[test]
    fn speeds_are_those_between_poses_in_the_vehicles_frame() {
        let mut velocity_estimator = VelocityEstimator::new(RobotDuration::from_secs_f64(0.1));
        let pose = |y: f64, yaw_rad: f64| {
            Pose::from_parts(
                Translation3::new(0.0, y, 0.0),
                UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
            )
        };
        let mut speeds = |ms: i64, pose: Pose| {
            let at = RobotTime::from_nanos(ms * 1_000_000);
            let velocity = velocity_estimator.update(at, &pose);
            [velocity.linear_mps, velocity.angular_radps]
                .map(|speed| (speed * 100.0).round() as i32)
        };
        let up = std::f64::consts::FRAC_PI_2;
        // It looks along y, drives backwards along it, then turns to look along x.
        assert_eq!(speeds(0, pose(0.0, up)), [0, 0]);
        assert_eq!(speeds(500, pose(-1.0, up)), [-200, 0]);
        assert_eq!(speeds(500, pose(-1.0, up)), [-200, 0], "the same again");
        assert_eq!(speeds(505, pose(-1.1, up)), [-200, 0], "too close to tell");
        assert_eq!(speeds(1_000, pose(-1.0, 0.0)), [0, -314]);
        assert_eq!(speeds(9_000, pose(-50.0, 0.0)), [0, 0], "across a gap");
        assert_eq!(speeds(8_000, pose(-50.0, 0.0)), [0, 0], "back in time");
    }
    #[test]
    fn pose_noise_is_averaged_over_the_window() {
        let fastest = |window_s: f64| {
            let mut velocity_estimator =
                VelocityEstimator::new(RobotDuration::from_secs_f64(window_s));
            let speeds = (0..100_i64).map(|n| {
                let noise_m = if n % 2 == 0 { 0.01 } else { -0.01 };
                let pose = Pose::translation(n as f64 * 0.02 + noise_m, 0.0, 0.0);
                let velocity =
                    velocity_estimator.update(RobotTime::from_nanos(n * 20_000_000), &pose);
                velocity.linear_mps
            });
            speeds.fold(0.0_f64, f64::max)
        };
        assert!(fastest(0.02) > 1.9);
        assert!(fastest(0.5) < 1.05);
    }
}
