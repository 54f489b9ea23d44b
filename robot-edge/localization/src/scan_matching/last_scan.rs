//! The scan before, and what it and the other sensors say about the motion to the next one.

use measurement::time::RobotTime;
use nalgebra::{Isometry2, Matrix3, Vector3};

use super::slam::ScanInput;
use super::slam_settings::{MotionNoise, SlamSettings};

/// What is kept of a scan for the next one.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastScan {
    pub(super) stamp: RobotTime,
    /// The newest odometry, and the pose at the first scan that had it: it may stand still for some scans while the vehicle moves.
    pub(super) odometry: Option<(Isometry2<f64>, Isometry2<f64>)>,
    pub(super) local_from_base: Isometry2<f64>,
    /// Motion from the scan before, and its time in seconds.
    pub(super) motion: Isometry2<f64>,
    pub(super) motion_s: f64,
    pub(super) keyframe_local: Isometry2<f64>,
    pub(super) is_lost: bool,
}

/// Greatest growth of the noise by a gap between two scans.
const MAX_GROWTH: f64 = 5.0;
/// Odometry may be late, or stand still while the vehicle moves: its standard deviation grows by this share of the change of the
/// motion that it reports.
const LATE_SHARE: f64 = 0.5;

impl LastScan {
    /// Motion until the next scan, seconds until then, and the covariance of the motion; `growth` of the standard deviations.
    pub(super) fn predict(
        &self,
        input: &ScanInput<'_>,
        mut growth: f64,
        settings: &SlamSettings,
    ) -> (Isometry2<f64>, f64, Matrix3<f64>) {
        let time_s = input.stamp.since(self.stamp).as_secs_f64();
        // Stamps that repeat or leap say nothing about the speed.
        let share = time_s / self.motion_s;
        let share = if (0.2..5.0).contains(&share) {
            share
        } else {
            1.0
        };
        let way_m = self.motion.translation.vector * share;
        let constant = Isometry2::new(way_m, self.motion.rotation.angle() * share);
        let by_odometry = self.odometry.zip(input.odom_from_base);
        let by_odometry = by_odometry.map(|((before, local_before), now)| {
            if now == before {
                Isometry2::identity()
            } else {
                let local_now = local_before * before.inv_mul(&now);
                self.local_from_base.inv_mul(&local_now)
            }
        });
        let (motion, noise) = match by_odometry {
            Some(motion) if input.is_by_clouds => (motion, settings.clouds),
            Some(motion) if !input.is_heading_only => (motion, settings.odometry),
            _ => {
                growth *= (time_s / self.motion_s.max(0.05)).clamp(1.0, MAX_GROWTH);
                let noise = settings.constant_velocity;
                match by_odometry {
                    Some(turn) => (
                        Isometry2::new(way_m, turn.rotation.angle()),
                        MotionNoise {
                            rad: settings.odometry.rad,
                            rad_per_rad: settings.odometry.rad_per_rad,
                            rad_per_m: 0.0,
                            ..noise
                        },
                    ),
                    None => (constant, noise),
                }
            }
        };
        let (way_m, turn_rad) = (
            motion.translation.vector.norm(),
            motion.rotation.angle().abs(),
        );
        let change = constant.inv_mul(&motion);
        let late_share = if input.is_by_clouds { 0.0 } else { LATE_SHARE };
        let (late_m, late_rad) = (
            late_share * change.translation.vector.norm(),
            late_share * change.rotation.angle().abs(),
        );
        let sigma_m = noise.m + noise.m_per_m * way_m + late_m;
        let sigma_rad =
            noise.rad + noise.rad_per_rad * turn_rad + noise.rad_per_m * way_m + late_rad;
        let sigma = Vector3::new(sigma_m, sigma_m, sigma_rad) * growth;
        let variance = Matrix3::from_diagonal(&sigma.component_mul(&sigma));
        (motion, time_s, variance)
    }
}
