//! Edge and console together, and rules of the source.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "clippy.toml allows these in tests, but not in their helpers"
)]

mod experiments;
mod layering;
mod pipeline;

mod rng;
#[path = "../../../robot-edge/recording/src/shared_data.rs"]
mod shared_data;
mod skip;

mod fleet;
mod killed_run;
mod link;
mod live;
#[cfg(target_os = "linux")]
mod package;
mod processes;
mod python;
mod security;
mod teleop;
