//! A planar range sensor on a vehicle, with its mount.

use nalgebra::{Vector2, Vector3};

use crate::laser::PlanarLaser;
use crate::tilt_servo::TiltServo;
use measurement::pose::Pose;
use measurement::scan::Scan;

/// A laser or a sonar on its mount.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeSensor {
    /// Its name among the vehicle's sensors, which is also its frame and that of its noise.
    pub name: &'static str,
    pub stream: &'static str,
    pub planar: PlanarLaser,
    /// Where it is mounted; a tilting one at an angle of 0. The mount may have any attitude.
    pub base_from_mount: Pose,
    /// The servo that tilts it about its own origin; a fixed one has none.
    pub tilt: Option<TiltServo>,
    /// Posts of the vehicle within its view.
    pub own_posts: &'static [Post],
}

/// An upright post on the vehicle, in its base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Post {
    pub at_m: [f64; 2],
    pub radius_m: f64,
    /// From its foot to its top, metres above the base frame.
    pub heights_m: [f64; 2],
}

impl RangeSensor {
    pub(crate) fn base_from_sensor(&self, time_s: f64) -> Pose {
        match &self.tilt {
            None => self.base_from_mount,
            Some(servo) => self.base_from_mount * servo.mount_from_sensor(time_s),
        }
    }

    /// Makes the beams of a sweep that began at `time_s` end at the vehicle's own posts.
    pub(crate) fn add_own_posts(&self, scan: &mut Scan, time_s: f64) {
        if self.own_posts.is_empty() {
            return;
        }
        for (beam, range_m) in (0..).zip(&mut scan.ranges_m) {
            let after_s = f64::from(beam) * f64::from(self.planar.time_increment_s);
            let base_from_sensor = self.base_from_sensor(time_s + after_s);
            let origin = base_from_sensor.translation.vector;
            let direction = base_from_sensor.rotation * self.planar.direction(beam);
            let posts = self.own_posts.iter();
            let nearest_m = posts
                .filter_map(|post| post.distance_m(&origin, &direction))
                .fold(f64::INFINITY, f64::min);
            if nearest_m < f64::from(*range_m) {
                *range_m = self.planar.reading(nearest_m);
            }
        }
    }
}

impl Post {
    fn distance_m(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let level = direction.xy();
        let along = level.try_normalize(1e-9)?;
        let to = Vector2::from(self.at_m) - origin.xy();
        let (ahead_m, aside_m) = (along.dot(&to), along.perp(&to));
        let inside_m2 = self.radius_m * self.radius_m - aside_m * aside_m;
        if ahead_m <= 0.0 || inside_m2 <= 0.0 {
            return None;
        }
        let distance_m = (ahead_m - inside_m2.sqrt()) / level.norm();
        let height_m = origin.z + direction.z * distance_m;
        let [foot_m, top_m] = self.heights_m;
        (foot_m..=top_m).contains(&height_m).then_some(distance_m)
    }
}
