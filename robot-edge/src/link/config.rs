//! Settings of `[link]`.

use serde::Deserialize;

/// How the robot is reached. What the command line says comes first.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinkConfig {
    /// Control endpoint to listen on, `tcp/HOST:PORT`; bulk is the next port. Without one: this machine only,
    /// and a port that is taken is no reason not to map.
    pub listen: Option<String>,
    /// Control endpoint of a router to connect to.
    pub connect: Option<String>,
}
