//! Localization: poses of the vehicle, and registration of its scans (docs/methods.md, section 0).
//!
//! [`registration::ScanRegistration`] takes measurements in stamp order and returns
//! [`mapping::registered_scan::RegisteredScan`]s. Pure: all times are of the data, never of a
//! clock, so that any replay speed gives the same poses.

#![warn(missing_docs)]

pub mod attitude;
pub mod beam_projection;
pub mod cloud_matching;
mod cloud_projection;
mod cloud_walls;
pub mod dead_reckoning;
pub mod gnss_positioning;
pub mod pose_buffer;
pub mod registration;
mod sample_synchronizer;
pub mod scan_localization;
pub mod scan_matching;
#[cfg(test)]
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
#[cfg(test)]
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
#[cfg(test)]
mod test_data;
pub mod tilt;
mod transform_buffer;

use serde::Deserialize;

/// Settings of `[localization]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LocalizationConfig {
    /// Source of the poses.
    pub source: PoseSource,
    /// The sensor whose scans are matched; default: the first level planar laser, else the first lidar, else the first tilted laser.
    pub scan_sensor: Option<String>,
    /// Fixed frame of the map; default: the one of the pose source (`odom`).
    pub fixed_frame: Option<String>,
    /// Frame of the vehicle (REP-105).
    pub base_frame: String,
    /// Longest gap between two poses that is interpolated, seconds.
    pub max_gap_s: f64,
    /// Time of the data that a scan waits for a pose after its last beam, seconds.
    pub max_pose_wait_s: f64,
    /// Longest extrapolation of a pose, seconds.
    pub max_extrapolation_s: f64,
    /// History of the transform buffer, seconds (as in tf2).
    pub buffer_s: f64,
    /// Limit of the scans that wait for a pose; beyond it the oldest is dropped.
    pub max_waiting_scans: usize,
    /// Window of the centred moving average of the attitude, for wheels and GNSS, seconds; 0
    /// disables it.
    pub attitude_smoothing_s: f64,
    /// A step between two poses above this plus the greatest possible motion is a pose jump,
    /// metres.
    pub jump_m: f64,
    /// Effect of a pose jump on the maps.
    pub on_jump: OnJump,
}

/// Effect of a pose jump on the maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnJump {
    /// The maps are kept.
    Keep,
    /// All maps are erased.
    Reset,
}

/// Source of the poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// The best one that the source offers.
    Auto,
    /// Transforms (`tf2_msgs/TFMessage`).
    Tf,
    /// Odometry and pose messages, CARMEN `ODOM` lines.
    Odometry,
    /// The pose in each scan of a CARMEN log.
    Log,
    /// Dead reckoning by wheel encoders and an attitude sensor.
    Wheels,
    /// GNSS positions and an attitude sensor.
    Gps,
    /// The vehicle does not move.
    Static,
    /// Scan matching alone.
    Scan,
    /// Scan matching, and the best of odometry, transforms, the poses in a log and wheel encoders that the source offers.
    #[serde(rename = "scan+wheels")]
    ScanWheels,
    /// Scan matching, and an attitude sensor.
    #[serde(rename = "scan+imu")]
    ScanImu,
    /// Scan matching, GNSS positions and an attitude sensor.
    #[serde(rename = "scan+gps")]
    ScanGps,
}

impl PoseSource {
    /// Whether scans are matched.
    pub const fn matches_scans(self) -> bool {
        matches!(
            self,
            Self::Scan | Self::ScanWheels | Self::ScanImu | Self::ScanGps
        )
    }
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            source: PoseSource::Auto,
            scan_sensor: None,
            fixed_frame: None,
            base_frame: "base_link".to_owned(),
            max_gap_s: 0.5,
            max_pose_wait_s: 0.1,
            max_extrapolation_s: 0.1,
            buffer_s: 10.0,
            max_waiting_scans: 256,
            attitude_smoothing_s: 0.1,
            jump_m: 1.0,
            on_jump: OnJump::Keep,
        }
    }
}
