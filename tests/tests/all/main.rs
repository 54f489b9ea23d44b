//! Edge and console together, and what the source may not contain.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "all of it is tests, helpers included, which clippy.toml's leave for tests does not see"
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

/// Where the edge's emulator, which [`live`] borrows, expects it.
#[cfg(target_os = "linux")]
use robot_edge::clock;
