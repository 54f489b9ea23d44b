//! Settings of localization.

use serde::Deserialize;

/// Where the vehicle's pose comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseSource {
    /// The log's own poses where it has them, else tf where it reaches the sensor, else odometry.
    Auto,
    /// The pose that the log gives to each scan (CARMEN).
    Log,
    /// The transform tree (`/tf`, `/tf_static`).
    Tf,
    /// Odometry messages and the configured mounting of the sensor.
    Odometry,
    /// The vehicle stands still at the origin.
    Static,
}

/// Settings of localization (`algorithms.md` §0).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LocalizationConfig {
    /// Where poses come from.
    pub source: PoseSource,
    /// Frame of the map; by default `odom`, else `map`, else the root of the sensor's tree.
    pub fixed_frame: Option<String>,
    /// Frame of the vehicle.
    pub base_frame: String,
    /// Poses farther apart than this are not interpolated between, seconds.
    pub max_gap_s: f64,
    /// How far the data's stamps may pass a scan that waits for a pose, seconds.
    pub wait_s: f64,
    /// How far past the newest pose a scan may be placed, seconds.
    pub max_extrapolation_s: f64,
    /// How long poses are kept, seconds.
    pub buffer_s: f64,
    /// Scans that may wait for a pose at once.
    pub max_waiting_scans: usize,
}

impl Default for LocalizationConfig {
    fn default() -> Self {
        Self {
            source: PoseSource::Auto,
            fixed_frame: None,
            base_frame: "base_link".into(),
            max_gap_s: 0.5,
            wait_s: 0.1,
            max_extrapolation_s: 0.1,
            buffer_s: 10.0,
            max_waiting_scans: 256,
        }
    }
}
