//! Settings of `[localization]`.

use serde::Deserialize;

/// Where beams are placed, and how long a scan waits for its pose.
///
/// All times are times of the data, never of a clock so that a replay at any speed gives the same poses.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LocalizationConfig {
    /// What poses are taken from.
    pub source: PoseSource,
    /// Frame in which the map stands still; where absent, what the pose source calls its own (`odom`).
    pub fixed_frame: Option<String>,
    /// Frame of the vehicle (REP-105).
    pub base_frame: String,
    /// Longest gap between two poses that is interpolated, seconds.
    pub max_gap_s: f64,
    /// How far the stream's stamps pass a scan's last beam before the scan stops waiting, seconds.
    pub max_pose_wait_s: f64,
    /// Farthest that a pose is extrapolated past the newest one, seconds.
    pub max_extrapolation_s: f64,
    /// How much of the past the transform buffer keeps, seconds (tf2's own default).
    pub buffer_s: f64,
    /// Most scans that wait for a pose; the oldest is dropped and counted when there are more.
    pub max_waiting_scans: usize,
    /// Window of the centred moving average over the attitude, for poses from wheels and of a satellite
    /// receiver, seconds; 0 is none.
    pub attitude_smoothing_s: f64,
    /// Consecutive poses that are farther apart than this, and than driving explains, are a jump, metres.
    pub jump_m: f64,
    /// What becomes of the maps at a jump.
    pub on_jump: OnJump,
}

/// What becomes of the maps when poses jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnJump {
    /// They stay as they are.
    Keep,
    /// They begin anew.
    Reset,
}

/// What poses are taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// The best of what the source offers.
    Auto,
    /// Transforms (`tf2_msgs/TFMessage`).
    Tf,
    /// Odometry and pose messages, CARMEN `ODOM` lines.
    Odometry,
    /// The pose that the log gives to each sweep (CARMEN).
    Log,
    /// Reckoned from wheel encoders and an attitude sensor.
    Wheels,
    /// Positions of a satellite receiver, with the attitude of an attitude sensor.
    Gps,
    /// The vehicle does not move.
    Static,
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            source: PoseSource::Auto,
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
