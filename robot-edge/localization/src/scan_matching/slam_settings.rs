//! Settings of simultaneous localization and mapping.

use super::loop_closure::ClosureSettings;
use super::scan_points::PointLimits;

/// Settings of [`ScanSlam`](super::slam::ScanSlam).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlamSettings {
    /// Hits that are used.
    pub points: PointLimits,
    /// Noise of odometry.
    pub odometry: MotionNoise,
    /// Noise of odometry by clouds.
    pub clouds: MotionNoise,
    /// Noise of the assumption of constant velocity, where there is no odometry.
    pub constant_velocity: MotionNoise,
    /// A scan becomes a keyframe after this way, metres.
    pub keyframe_m: f64,
    /// A scan becomes a keyframe after this turn, radians.
    pub keyframe_rad: f64,
    /// Way from the beginning of a submap to that of the next, metres; a submap is twice as long.
    pub submap_m: f64,
    /// The same in keyframes, for turns in place.
    pub submap_keyframes: u32,
    /// Below this share of inliers a scan does not determine the pose: with odometry, and without it, where a scan that shows mostly
    /// what is new fits wherever its few other points do.
    pub min_inliers: (f64, f64),
    /// Standard deviations of a pose in its submap beside the noise of its scan: metres and radians.
    pub pose_noise: (f64, f64),
    /// Standard deviation of a pose in its submap by this share of its difference to odometry.
    pub odometry_share: f64,
    /// Limit of the submaps that are kept, about 0.3 MB each.
    pub max_submaps: usize,
    /// Loop closure.
    pub closure: ClosureSettings,
}

/// Standard deviations of a motion between two scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNoise {
    /// Metres.
    pub m: f64,
    /// Metres per metre.
    pub m_per_m: f64,
    /// Radians.
    pub rad: f64,
    /// Radians per radian.
    pub rad_per_rad: f64,
    /// Radians per metre.
    pub rad_per_m: f64,
}

impl Default for SlamSettings {
    fn default() -> Self {
        Self {
            points: PointLimits {
                min_range_m: 0.1,
                max_range_m: 30.0,
                spacing_m: 0.03,
            },
            odometry: MotionNoise {
                m: 0.02,
                m_per_m: 0.2,
                rad: 1.0_f64.to_radians(),
                rad_per_rad: 0.3,
                rad_per_m: 10.0_f64.to_radians(),
            },
            clouds: MotionNoise {
                m: 0.005,
                m_per_m: 0.02,
                rad: 0.1_f64.to_radians(),
                rad_per_rad: 0.02,
                rad_per_m: 0.1_f64.to_radians(),
            },
            constant_velocity: MotionNoise {
                m: 0.08,
                m_per_m: 0.3,
                rad: 4.0_f64.to_radians(),
                rad_per_rad: 0.3,
                rad_per_m: 5.0_f64.to_radians(),
            },
            keyframe_m: 0.2,
            keyframe_rad: 10.0_f64.to_radians(),
            submap_m: 8.0,
            submap_keyframes: 80,
            min_inliers: (0.4, 0.7),
            pose_noise: (0.05, 1.0_f64.to_radians()),
            odometry_share: 0.5,
            max_submaps: 500,
            closure: ClosureSettings::default(),
        }
    }
}
