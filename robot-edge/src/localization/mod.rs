//! Where was each beam? Measurements in stamp order in, [`crate::mapping::posed_scan::PosedScan`]s out.
//!
//! Pure: time is the data's own. See `algorithms.md` §0 for the rules.

pub mod config;

pub mod attitude_smoothing;
pub mod attitude_track;
pub mod beam_fan;
pub mod beam_projection;
pub mod beam_range;
pub mod dead_reckoning;
pub mod geodesy;
pub mod joined_samples;
pub mod placer;
pub mod pose_jump;
pub mod pose_track;
pub mod satellite_positioning;
pub mod tilt;
pub mod transform_buffer;
pub mod wheel_odometer;
