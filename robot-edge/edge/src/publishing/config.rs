//! Settings of `[streaming]`.

use serde::Deserialize;

/// How much of the map is published, and how often.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StreamingConfig {
    /// What tiles may take of the link, kilobits (10³ bits) per second.
    pub budget_kbps: u32,
    /// Most memory for the tile store, megabytes (10⁶ bytes).
    pub tile_store_mb: u32,
    /// Time of the data between two publications of changed tiles, seconds.
    pub publish_period_s: f64,
}

impl Default for StreamingConfig {
    fn default() -> Self {
        Self {
            budget_kbps: 256,
            tile_store_mb: 256,
            publish_period_s: 1.0,
        }
    }
}
