//! An autopilot with `ArduPilot` Rover that drives the vehicle, over `MAVLink`.
//!
//! The motor guard owns the link. It sends velocities at a fixed rate and forwards what it receives, unparsed; the edge
//! reads it ([`drivers::mavlink`]). Nothing is acknowledged: that the vehicle obeys is known from its heartbeats alone.

pub mod config;
#[cfg(target_os = "linux")]
pub mod link;
#[cfg(target_os = "linux")]
pub mod obstacle_pipe;

pub use config::MavlinkConfig;
#[cfg(target_os = "linux")]
pub use link::MavlinkLink;
