//! The vehicle on the network: Zenoh sessions on one side, the tile store and plain state on the other.
//!
//! Zenoh brings its own runtime; the link itself is blocking threads, none of which mapping ever waits for: state, tiles,
//! small answers, tiles asked for, and one that opens the sessions anew where other people may connect.

use std::path::PathBuf;

mod commands;
pub mod config;
pub mod edge;
pub mod endpoints;
mod error;
pub mod publish_state;
pub mod ros2;
pub mod security;
pub mod sessions;

mod open_sessions;
mod outgoing;
mod queries;
mod scan_push;
mod streams;
mod views;

pub use error::LinkError;

/// What of Zenoh's own log is for who runs a vehicle, in the syntax of `tracing_subscriber::EnvFilter`: errors, not
/// warnings of settings that are meant; and nothing of subscribers that are withdrawn although access control had kept
/// them from this robot, as with every console that joins one with keys (its issue 1562).
pub const LOG_FILTER: &str = "zenoh=error,zenoh::net::routing::hat::broker=off";

/// 16 bytes that nobody has had before: the identity of one run of a program.
///
/// # Errors
/// Where the operating system has no random numbers to give.
pub fn random_id() -> Result<[u8; 16], LinkError> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(LinkError::NoRandomness)?;
    Ok(bytes)
}

/// The Zenoh configuration to use: what the command line names, else what `ZENOH_CONFIG` does.
pub fn zenoh_config_file(option: Option<PathBuf>) -> Option<PathBuf> {
    option.or_else(|| {
        std::env::var_os("ZENOH_CONFIG")
            .filter(|path| !path.is_empty())
            .map(PathBuf::from)
    })
}
