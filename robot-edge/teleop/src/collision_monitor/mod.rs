//! The collision monitor: how fast the vehicle may go so that it stops before what is in its way.
//!
//! `network-and-teleop.md`, section "Collision monitor". It knows the posed points of the last sweep of each sensor and the
//! last map, both as plain data that others hand over, and waits for neither. It says how fast the vehicle may go and turn
//! and nothing else: what it says can only make the vehicle slower (P9). Beside that it tells what bounds the motion that is
//! asked for ([`Barrier`]), by which nothing is judged.
//!
//! The placing side fills a [`ObstacleScan`] with each sweep, the mapping side a [`LocalMap`] now and then, and both hand them
//! over; the loop asks [`CollisionMonitor::output`] in each round, after the commands of that round were taken and before its
//! tick.
//! Each keeps its memory, so that nothing is allocated once they have been filled. Whoever switches the guard off says
//! `CollisionMonitorOutput::Off` in its stead.
//!
//! A round places the vehicle where it will be when it obeys, which is where what it was told until now leads; sees how
//! far its footprint can move from there along arcs before it touches a point ([`clearance`], exact); and which speed that
//! leaves time to stop from ([`motion_direction`]). Where the footprint would come to ground that nobody has looked at, it must be
//! able to stop before that ground, or creep.
//!
//! What stands still is promised and what moves is not; nor what the sensors cannot see (glass, what is lower or higher
//! than a level laser, what is thinner than the gap between beams or hides behind what is as thin), nor that the vehicle
//! brakes as its configuration says. What is known only from the map is passed no nearer than half a cell, when creeping a
//! sixth. On a boat nothing brakes: thrust is cut, and what is promised is that it coasts no farther than
//! `teleop.stop_decel_mps2` says, without wind and current.

pub mod config;

pub mod local_map;
pub mod obstacle_scan;
pub mod predicted_pose;

pub mod clearance;
pub mod motion_direction;

mod barrier;
mod blockage;
mod command_history;
mod coverage;
mod direction_table;
mod limit_solver;
mod local_environment;
mod monitor;
mod overspeed;
mod speed_limit_context;
mod unavailable;

pub use barrier::{Barrier, BarrierKind};
pub use blockage::BlockageDetector;
pub use config::{CollisionMonitorConfig, CollisionMonitorRules, UnknownSpacePolicy};
pub use local_map::{CopyRequest, LocalMap};
pub use monitor::{CollisionMonitor, CollisionMonitorInput};
pub use obstacle_scan::ObstacleScan;
pub use predicted_pose::OdometrySample;
pub use unavailable::UnavailableReason;

#[cfg(test)]
mod tests;
