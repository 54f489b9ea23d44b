//! To be filled.

pub mod config;
pub mod occupancy_config;
