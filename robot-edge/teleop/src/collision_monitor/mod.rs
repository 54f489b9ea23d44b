//! Collision monitor: limits the speed so that the vehicle stops before obstacles and unknown ground.
//!
//! Inputs are the last scan of each sensor ([`ObstacleScan`], filled by the localization thread) and a copy of the map
//! ([`LocalMap`], filled by the mapping thread). Both are plain data, and the monitor waits for neither. The output is
//! only a set of speed limits, so it can only make the vehicle slower (P9). In addition it reports what limits the
//! requested motion ([`Barrier`]); no limit depends on this report.
//!
//! The loop calls [`CollisionMonitor::output`] in each round, after the commands of the round and before its tick. All
//! parts reuse their buffers, so nothing is allocated after the first rounds.
//!
//! One round: predict the pose at which the vehicle obeys the present command (`predicted_pose`); find how far the
//! footprint can move from there along arcs before it touches a point (`footprint`, exact); find the speed from which
//! the vehicle stops within this distance (`allowed_speed`); combine the directions to limits of linear and angular
//! speed (`limit_solver`). Before ground that no sensor observed in time, the vehicle must be able to stop, or creep.
//!
//! Limits of the guarantee: it covers static obstacles only, and not those that the sensors cannot detect (glass,
//! objects below or above a level laser, objects thinner than the gap between beams). The vehicle must brake as
//! configured. Obstacles known only from the map are passed no nearer than half a cell, at creep speed a sixth. A boat
//! cannot brake: thrust is cut, and the guarantee is that it coasts no farther than `teleop.stop_decel_mps2` says,
//! without wind and current.

mod allowed_speed;
mod blockage;
mod config;
mod footprint;
mod limit_solver;
mod local_environment;
mod local_map;
mod monitor;
mod obstacle_scan;
mod predicted_pose;

pub use allowed_speed::Barrier;
pub use blockage::BlockageDetector;
pub use config::{CollisionMonitorConfig, CollisionMonitorRules, UnknownSpacePolicy};
pub use local_map::{CopyRequest, LocalMap};
pub use monitor::{CollisionMonitor, CollisionMonitorInput, UnavailableReason};
pub use obstacle_scan::ObstacleScan;
pub use predicted_pose::OdometrySample;

#[cfg(test)]
mod tests;
