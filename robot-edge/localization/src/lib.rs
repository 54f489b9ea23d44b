//! Where was each beam? Measurements in stamp order in, [`mapping::registered_scan::RegisteredScan`]s out.
//!
//! Pure: time is the data's own. See `algorithms.md` §0 for the rules.

#![warn(missing_docs)]

pub mod config;

pub mod attitude_filter;
pub mod attitude_smoothing;
pub mod beam_fan;
pub mod beam_projection;
pub mod beam_range;
pub mod dead_reckoning;
pub mod geodesy;
pub mod gnss_positioning;
pub mod pose_buffer;
pub mod pose_jump;
pub mod registration;
pub mod sample_synchronizer;
pub mod tilt;
pub mod transform_buffer;
pub mod wheel_odometer;
