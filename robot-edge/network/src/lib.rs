//! What vehicles and consoles share beside the protocol: the clock, keys and certificates, the audit log, and Zenoh
//! sessions with TLS and access control.
//!
//! [`credentials`] define who may connect and drive; [`security`] turns them into settings of Zenoh.

use std::path::PathBuf;

pub mod allocator;
pub mod audit;
pub mod certificate_probe;
pub mod clock;
pub mod credentials;
pub mod endpoints;
mod error;
pub mod program_code;
pub mod security;
pub mod sessions;

pub use error::{LinkError, without_source_places};

/// The filter for Zenoh's log, in the syntax of `tracing_subscriber::EnvFilter`: errors, but not its warnings about
/// intended settings, and not those about withdrawn subscribers that access control had denied, which occur with every
/// console (Zenoh issue 1562).
pub const LOG_FILTER: &str = "zenoh=error,zenoh::net::routing::hat::broker=off";

/// 16 random bytes: the identity of one run of a program.
pub fn random_id() -> Result<[u8; 16], LinkError> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(LinkError::NoRandomness)?;
    Ok(bytes)
}

/// The Zenoh configuration of the command line, or else of `ZENOH_CONFIG`.
pub fn zenoh_config_file(option: Option<PathBuf>) -> Option<PathBuf> {
    option.or_else(|| {
        std::env::var_os("ZENOH_CONFIG")
            .filter(|path| !path.is_empty())
            .map(PathBuf::from)
    })
}
