//! Why there is no link.

use std::path::PathBuf;

use super::endpoints::Channel;
use crate::credentials::CredentialsError;

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// An endpoint that names no port.
    #[error(
        "endpoint {0:?} is not `PROTOCOL/HOST:PORT` with a port from 1 to 65534, for example tcp/192.168.1.20:7447, or quic/192.168.1.20:7447 with --keys"
    )]
    Endpoint(String),
    /// An endpoint that does not fit `--keys`, or their lack.
    #[error("endpoint {endpoint:?}: {why}")]
    Protocol {
        /// The endpoint.
        endpoint: String,
        /// What does not fit.
        why: &'static str,
    },
    /// Keys, certificates or lists that cannot be used.
    #[error(transparent)]
    Credentials(#[from] CredentialsError),
    /// Somebody answers who is no vehicle and no router of the fleet.
    #[error(
        "whoever answers at {endpoints} shows the certificate of {name}, not of a vehicle or router of this fleet"
    )]
    Stranger {
        /// Where.
        endpoints: String,
        /// Who it says it is.
        name: String,
    },
    /// A Zenoh configuration that cannot be read.
    #[error("{path}: not a Zenoh configuration: {why}", path = path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What Zenoh says.
        why: zenoh::Error,
    },
    /// Zenoh refused.
    #[error("the {channel:?} session cannot be opened ({endpoints}): {why}")]
    Open {
        /// Which.
        channel: Channel,
        /// Where.
        endpoints: String,
        /// What Zenoh says.
        why: zenoh::Error,
    },
    /// A setting of ours that this version of Zenoh does not know.
    #[error("Zenoh does not take the setting {key}: {why}")]
    Setting {
        /// Which.
        key: &'static str,
        /// What Zenoh says.
        why: zenoh::Error,
    },
    /// A key or a handler was refused.
    #[error("Zenoh refused {what}: {why}")]
    Declare {
        /// What was to be declared.
        what: String,
        /// What Zenoh says.
        why: zenoh::Error,
    },
    /// No identity can be made.
    #[error("the operating system gives no random numbers: {0}")]
    NoRandomness(getrandom::Error),
    /// zstd refused.
    #[error("tiles cannot be encoded: {0}")]
    Encoder(std::io::Error),
}
