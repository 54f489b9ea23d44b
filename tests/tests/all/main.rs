//! Edge and console together, and rules of the source.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "clippy.toml allows these in tests, but not in their helpers"
)]

mod layering;
mod pose_jump;
mod recordings_index;

mod simulated_run;

#[cfg(target_os = "linux")]
mod rig;

mod determinism;
mod eviction;
mod experiments;
mod fleet;
mod killed_run;
mod link;
mod rng;
mod security;
mod skip;

#[cfg(target_os = "linux")]
mod live;
#[cfg(target_os = "linux")]
mod teleop;

/// The edge's emulator, which [`live`] includes, imports it from the crate root.
#[cfg(target_os = "linux")]
use robot_edge::clock;
