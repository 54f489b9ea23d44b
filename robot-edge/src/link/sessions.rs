//! The two Zenoh sessions of each side: control and bulk.
//!
//! Two sessions, not one with priorities: on one stream, priorities do nothing against the socket's own
//! buffer, and small messages wait behind tiles.

use std::path::{Path, PathBuf};
use std::time::Duration;

use zenoh::{Config, Session, Wait};

use super::LinkError;
use super::endpoints::{Channel, on_channel};

/// How to reach others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Endpoints {
    /// Control endpoints to listen on.
    pub listen: Vec<String>,
    /// Control endpoints to connect to.
    pub connect: Vec<String>,
    /// A Zenoh configuration (JSON5) that ours is laid over.
    pub zenoh_config: Option<PathBuf>,
}

/// Which side of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Listens, and goes on connecting in the background: a robot does not wait for anybody.
    Edge,
    /// Connects to one robot or router, and has given up when this returns an error.
    Console,
}

/// How long a console tries to connect before it says so.
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Between two attempts to connect.
pub const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// Bulk's own buffer in the kernel: what is in it can be neither replaced nor overtaken.
const BULK_SEND_BUFFER: &str = "so_sndbuf=32768";

/// Opens one session.
///
/// # Errors
/// Where an endpoint is malformed, the port is taken, nobody answers in time (consoles) or the configuration
/// cannot be read.
pub fn open(side: Side, channel: Channel, endpoints: &Endpoints) -> Result<Session, LinkError> {
    let mut listen = on_channel(channel, &endpoints.listen)?;
    let connect = on_channel(channel, &endpoints.connect)?;
    if channel == Channel::Bulk {
        listen = listen.into_iter().map(with_small_buffer).collect();
    }
    let config = config(
        side,
        channel,
        &listen,
        &connect,
        endpoints.zenoh_config.as_deref(),
    )?;
    zenoh::open(config).wait().map_err(|why| LinkError::Open {
        channel,
        endpoints: [listen, connect].concat().join(", "),
        why,
    })
}

fn with_small_buffer(endpoint: String) -> String {
    if endpoint.contains('#') {
        endpoint
    } else {
        format!("{endpoint}#{BULK_SEND_BUFFER}")
    }
}

fn config(
    side: Side,
    channel: Channel,
    listen: &[String],
    connect: &[String],
    file: Option<&Path>,
) -> Result<Config, LinkError> {
    let mut config = match file {
        Some(path) => Config::from_file(path).map_err(|why| LinkError::Config {
            path: path.to_owned(),
            why,
        })?,
        None => Config::default(),
    };
    let list = |endpoints: &[String]| serde_json::Value::from(endpoints.to_vec()).to_string();
    let answers_scouts = side == Side::Edge && channel == Channel::Control;
    let retry_ms = RETRY_PERIOD.as_millis();
    let (mode, timeout_ms) = match side {
        Side::Edge => ("\"peer\"", "-1".to_owned()),
        // A router does not route between peers that do not gossip; to a client it does.
        Side::Console => ("\"client\"", CONNECT_TIMEOUT.as_millis().to_string()),
    };
    for (key, value) in [
        ("mode", mode.to_owned()),
        ("listen/endpoints", list(listen)),
        ("connect/endpoints", list(connect)),
        ("connect/exit_on_failure", "false".to_owned()),
        ("connect/timeout_ms", timeout_ms),
        (
            "connect/retry",
            format!(
                "{{ period_init_ms: {retry_ms}, period_max_ms: {retry_ms}, period_increase_factor: 1 }}"
            ),
        ),
        ("open/return_conditions/connect_scouted", "false".to_owned()),
        // Discovery is an explicit scout of the console's; nobody connects to whom it was not told to.
        ("scouting/multicast/enabled", answers_scouts.to_string()),
        ("scouting/multicast/listen", answers_scouts.to_string()),
        ("scouting/multicast/autoconnect", "[]".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        // 1000 ms flapped on harsh links. Safety never rests on it.
        ("transport/link/tx/lease", "4000".to_owned()),
        ("transport/link/rx/max_message_size", (4 << 20).to_string()),
        ("transport/shared_memory/enabled", "false".to_owned()),
        ("adminspace/enabled", "false".to_owned()),
    ] {
        config
            .insert_json5(key, &value)
            .map_err(|why| LinkError::Setting { key, why })?;
    }
    Ok(config)
}
