//! Where the vehicle is and was.

use std::collections::VecDeque;

use measurement::time::Monotonic;
use protocol::export::StampedPose;
use protocol::message::Pose;

use super::trail::Trail;
use super::visible_change::pose_changed;

/// Poses kept for the export; a longer run is thinned to every second pose, again and again.
const MAX_POSES: usize = 500_000;

/// The vehicle as the robot tells of it.
#[derive(Clone, Debug, Default)]
pub struct Vehicle {
    pose: Option<(Pose, i64, Monotonic)>,
    trail: Trail,
    poses: Vec<StampedPose>,
    stride: u64,
    received: u64,
    /// The pose that was last worth a frame.
    drawn: Option<Pose>,
}

impl Vehicle {
    /// The newest pose and when it arrived.
    pub fn pose(&self) -> Option<(Pose, Monotonic)> {
        self.pose.map(|(pose, _, at)| (pose, at))
    }

    /// The stamp of the newest pose, nanoseconds by the clock of the robot's data.
    pub fn stamp_ns(&self) -> Option<i64> {
        self.pose.map(|(_, stamp_ns, _)| stamp_ns)
    }

    /// Heading: the angle of the vehicle's x axis in `odom`, radians, counter-clockwise from x.
    pub fn heading_rad(&self) -> Option<f64> {
        self.pose.map(|(pose, _, _)| {
            let [x, y, z, w] = pose.quaternion_xyzw.map(f64::from);
            libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        })
    }

    /// Where it was, oldest first, metres in `odom`.
    pub const fn trail(&self) -> &VecDeque<[f64; 2]> {
        self.trail.points_m()
    }

    /// The poses that arrived, one for each stamp, oldest first.
    pub fn poses(&self) -> &[StampedPose] {
        &self.poses
    }

    /// Takes a pose; whether the vehicle looks otherwise than when that was so last.
    pub(super) fn take(&mut self, pose: Pose, stamp_ns: i64, now: Monotonic) -> bool {
        let before = self.pose.replace((pose, stamp_ns, now));
        if before.is_none_or(|(_, before_ns, _)| before_ns != stamp_ns) {
            self.keep(pose, stamp_ns);
        }
        let [x, y, _] = pose.position_m;
        self.trail.add(stamp_ns, [x, y]);
        let pose_changed = self.drawn.is_none_or(|drawn| pose_changed(&drawn, &pose));
        if pose_changed {
            self.drawn = Some(pose);
        }
        pose_changed
    }

    /// The way so far, where it is known better than from poses that arrived: oldest first, metres in `odom`.
    pub(super) fn show_trail(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.trail.replace(points_m);
    }

    /// The vehicle was there too, which was not heard: stamps, nanoseconds, and metres in `odom`, oldest first.
    pub(super) fn fill_trail(&mut self, known: &[(i64, [f64; 2])]) {
        let newest_ns = self.pose.map_or(i64::MAX, |(_, stamp_ns, _)| stamp_ns);
        self.trail.fill(known, newest_ns);
    }

    /// Another run of the robot began: it is somewhere else now.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }

    fn keep(&mut self, pose: Pose, stamp_ns: i64) {
        let stride = self.stride.max(1);
        if self.received.is_multiple_of(stride) {
            if self.poses.len() >= MAX_POSES {
                let mut index = 0u64;
                self.poses.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
                self.stride = stride * 2;
            }
            self.poses.push(StampedPose::new(
                stamp_ns,
                pose.position_m,
                pose.quaternion_xyzw.map(f64::from),
            ));
        }
        self.received += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, z: f32, w: f32) -> Pose {
        Pose {
            position_m: [x, 0.0, 0.0],
            quaternion_xyzw: [0.0, 0.0, z, w],
            speed_mps: 0.0,
            turn_rate_radps: 0.0,
            token: None,
        }
    }

    #[test]
    fn poses_that_differ_too_little_for_the_trail_are_kept_for_the_export() {
        let mut vehicle = Vehicle::default();
        let now = Monotonic::default();
        assert!(vehicle.take(pose(0.0, 0.0, 1.0), 0, now));
        assert!(!vehicle.take(pose(0.0, 0.0, 1.0), 1, now));
        assert!(vehicle.take(pose(0.05, 0.0, 1.0), 2, now));
        assert_eq!((vehicle.trail().len(), vehicle.poses().len()), (1, 3));
    }

    #[test]
    fn many_steps_that_nobody_sees_are_seen_in_the_end() {
        let mut vehicle = Vehicle::default();
        let now = Monotonic::default();
        let seen = (0..10).filter(|step| {
            let x = 0.0005 * f64::from(*step);
            vehicle.take(pose(x, 0.0, 1.0), i64::from(*step), now)
        });
        // At 0, 2 and 4 mm.
        assert_eq!(seen.collect::<Vec<_>>(), [0, 4, 8]);
    }

    #[test]
    fn heading_is_the_yaw_of_the_quaternion() {
        let mut vehicle = Vehicle::default();
        let half = std::f32::consts::FRAC_1_SQRT_2;
        vehicle.take(pose(0.0, half, half), 0, Monotonic::default());
        let heading_rad = vehicle.heading_rad().unwrap();
        assert!((heading_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
    }
}
