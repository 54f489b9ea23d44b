//! Settings of `[link]`.

use std::path::PathBuf;

use serde::Deserialize;

/// How the robot is reached. What the command line says comes first.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinkConfig {
    /// Control endpoint to listen on, `quic/HOST:PORT` with keys, `tcp/HOST:PORT` without; bulk is the next port.
    /// Without one: this machine only, and a port that is taken is no reason not to map.
    pub listen: Option<String>,
    /// Control endpoint of a router to connect to.
    pub connect: Option<String>,
    /// The vehicle's folder of `robot-edge keys`.
    pub keys: Option<PathBuf>,
    /// Audit log: a file to which lines of JSON are added. Without one, nothing is written down.
    pub audit_log: Option<PathBuf>,
}
