//! A planar range sensor on a vehicle: what it measures, where it sits, and how its mount moves.

use crate::pose::Pose;
use crate::simulation::laser::PlanarLaser;
use crate::simulation::tilt_servo::TiltServo;

/// A laser or a sonar on its mount.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeSensor {
    /// Its name among the vehicle's sensors, which is also its frame and that of its noise.
    pub name: &'static str,
    /// The stream of its scans.
    pub stream: &'static str,
    /// Its beams.
    pub planar: PlanarLaser,
    /// Where it is mounted; a tilting one at an angle of 0. The mount may have any attitude.
    pub base_from_mount: Pose,
    /// The servo that tilts it about its own origin; a fixed one has none.
    pub tilt: Option<TiltServo>,
}

impl RangeSensor {
    /// Where it is at `time_s`, seconds since the beginning.
    pub fn base_from_sensor(&self, time_s: f64) -> Pose {
        match &self.tilt {
            None => self.base_from_mount,
            Some(servo) => self.base_from_mount * servo.mount_from_sensor(time_s),
        }
    }
}
