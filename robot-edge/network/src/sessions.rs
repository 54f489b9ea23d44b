//! The two Zenoh sessions: control and bulk.
//!
//! Two sessions instead of priorities: on one stream, priorities have no effect on the buffer of the socket, so that
//! small messages wait behind tiles.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{SendError, sync_channel};
use std::thread;
use std::time::Duration;

use measurement::time::Monotonic;
use serde_json::{Value, json};
use zenoh::{Config, Session, Wait};

use super::LinkError;
use super::endpoints::{Channel, attempts, listeners};
use super::security::{self, SettingsOfTls};
use crate::audit::Audit;
use crate::clock;
use crate::credentials::{Credentials, OperatorList};
use crate::random_id;

#[derive(Clone, Debug, Default)]
pub struct Endpoints {
    /// Control endpoints to listen on.
    pub listen: Vec<String>,
    /// Control endpoints to connect to.
    pub connect: Vec<String>,
    /// A Zenoh configuration (JSON5) that is overridden by these settings.
    pub zenoh_config: Option<PathBuf>,
    /// With credentials the sessions use mutual TLS; without, they are open to everyone.
    pub credentials: Option<Credentials>,
    /// Who may connect to a vehicle with credentials, besides routers.
    pub operators: OperatorList,
    /// Receives connections and disconnections.
    pub audit: Option<Audit>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Listens, and connects in the background without waiting.
    Edge,
    /// Connects to one robot or router, or returns an error.
    Console,
}

/// Time after which a console gives up an attempt to connect: TCP, TLS and Zenoh take five round trips, each 600 ms by satellite,
/// and certificates of both sides. A lost first packet is sent again after a second.
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(6);
/// Interval of attempts to connect.
pub const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// Time after which an attempt of an open session to connect again is given up, ms, and up to so much more, at random. The
/// listener of QUIC takes connections one after another, and 100 ms for each that was given up (Zenoh's `throttle_time`): where 50
/// vehicles and 20 consoles gave up after 4 s, all at once, it did not come to those that still waited. Less than the 10 s in which
/// Zenoh closes a session.
const RECONNECT_TIMEOUT_MS: u64 = 7000;
const RECONNECT_SPREAD_MS: u64 = 2000;

/// Bytes of a buffer in which messages of the control session are sent, and up to 16 of which a link keeps. Zenoh's 65,535 cost memory each
/// time that a link is lost; what is longer is sent in several.
const CONTROL_BATCH_BYTES: u16 = 16_384;

/// Head start of QUIC before TLS is tried in parallel: some round trips of a long link. A silent client can block the
/// QUIC listener, but not that of TLS.
const FALLBACK_DELAY: Duration = Duration::from_millis(600);
/// QUIC is preferred if it opens so long after TLS, or within as long as TLS took: where a packet is lost, QUIC sends the first one again
/// after a second, and control by TLS would wait for each lost packet as long as the session lasts.
const FALLBACK_WAIT: Duration = Duration::from_millis(1500);

/// Opens a session of Zenoh.
///
/// With credentials, the control session of a console uses QUIC, or TLS if QUIC does not answer.
pub fn open(side: Side, channel: Channel, endpoints: &Endpoints) -> Result<Session, LinkError> {
    let credentials = endpoints.credentials.as_ref();
    let listen = listeners(channel, &endpoints.listen, credentials.is_some())?;
    let mut attempt_list = attempts(channel, &endpoints.connect, credentials.is_some())?;
    let security = match (credentials, side) {
        (None, _) => SettingsOfTls::new(),
        (Some(credentials), Side::Edge) => {
            security::edge_settings(credentials, &endpoints.operators)
        }
        (Some(credentials), Side::Console) => security::console_settings(credentials),
    };
    if side == Side::Edge {
        // A vehicle retries in the background and would never use the second attempt.
        attempt_list.truncate(1);
    }
    let mut configs = Vec::with_capacity(attempt_list.len());
    for connect in attempt_list {
        let [random, ..] = random_id()?;
        let timeout_ms = RECONNECT_TIMEOUT_MS + RECONNECT_SPREAD_MS * u64::from(random) / 255;
        let settings = settings((side, channel), &listen, &connect, credentials.is_none())
            .chain([("transport/unicast/open_timeout", json!(timeout_ms))]);
        let file = endpoints.zenoh_config.as_deref();
        let config = config(settings.chain(security.clone()), file)?;
        configs.push((config, [&listen[..], &connect].concat().join(", ")));
    }
    let session = first_to_open(channel, configs)?;
    if side == Side::Console && credentials.is_some() {
        security::check_peers(&session, &endpoints.connect.join(", "))?;
    }
    if let Some(audit) = &endpoints.audit {
        security::audit_links(&session, channel, audit.clone())?;
    }
    Ok(session)
}

/// Opens sessions in turn: the next one starts when the previous ones have failed or after their head start. Returns
/// the first of the list, or another one that is open, if the first does not follow soon.
fn first_to_open(
    channel: Channel,
    attempt_list: Vec<(Config, String)>,
) -> Result<Session, LinkError> {
    let open = move |config: Config, endpoints: String| {
        zenoh::open(config).wait().map_err(|why| LinkError::Open {
            channel,
            endpoints,
            why,
        })
    };
    let count = attempt_list.len();
    let mut attempt_list = attempt_list.into_iter().enumerate();
    let (sender, opened) = sync_channel(count);
    let (began, mut underway) = (clock::now(), 0);
    let mut fallback: Option<(Session, Monotonic)> = None;
    loop {
        if let Some((n, (config, endpoints))) = attempt_list.next() {
            if count == 1 {
                return open(config, endpoints);
            }
            let sender = sender.clone();
            underway += 1;
            thread::spawn(move || {
                if let Err(SendError((_, Ok(late)))) = sender.send((n, open(config, endpoints))) {
                    // Another session was opened first.
                    drop(late.close().wait());
                }
            });
        }
        let until = fallback.as_ref().map(|(_, until)| *until);
        let wait = until.map_or(FALLBACK_DELAY, |until| until.since(clock::now()));
        match opened.recv_timeout(wait) {
            Ok((0, Ok(session))) => {
                if let Some((late, _)) = fallback {
                    thread::spawn(move || drop(late.close().wait()));
                }
                return Ok(session);
            }
            Ok((_, Ok(session))) => {
                underway -= 1;
                let until = clock::now() + FALLBACK_WAIT.max(clock::elapsed(began));
                fallback = Some((session, until));
            }
            Ok((_, Err(why))) => {
                underway -= 1;
                if underway == 0 && attempt_list.len() == 0 && fallback.is_none() {
                    return Err(why);
                }
            }
            Err(_none_yet) => {}
        }
        let is_due = |(_, until): &mut (_, Monotonic)| underway == 0 || clock::now() >= *until;
        if let Some((session, _)) = fallback.take_if(is_due) {
            tracing::warn!(
                "QUIC does not answer; control goes by TLS, where what is lost holds up what follows"
            );
            return Ok(session);
        }
    }
}

/// The settings that do not depend on credentials.
fn settings(
    (side, channel): (Side, Channel),
    listen: &[String],
    connect: &[String],
    is_open: bool,
) -> impl Iterator<Item = (&'static str, Value)> {
    // A robot with keys is reached at a known address and is not discoverable.
    let answers_scouts = is_open && side == Side::Edge && channel == Channel::Control;
    let retry_ms = RETRY_PERIOD.as_millis() as u64;
    let batch = ("transport/link/tx/batch_size", json!(CONTROL_BATCH_BYTES));
    let (mode, timeout_ms) = match side {
        Side::Edge => ("peer", -1),
        // A router forwards between clients, but not between peers without gossip.
        Side::Console => ("client", CONNECT_TIMEOUT.as_millis() as i64),
    };
    [
        ("mode", json!(mode)),
        ("listen/endpoints", json!(listen)),
        ("connect/endpoints", json!(connect)),
        ("connect/exit_on_failure", json!(false)),
        ("connect/timeout_ms", json!(timeout_ms)),
        (
            "connect/retry",
            json!({ "period_init_ms": retry_ms, "period_max_ms": retry_ms, "period_increase_factor": 1 }),
        ),
        ("open/return_conditions/connect_scouted", json!(false)),
        // A console discovers by an explicit scout; automatic connections are off.
        ("scouting/multicast/enabled", json!(answers_scouts)),
        ("scouting/multicast/listen", json!(answers_scouts)),
        ("scouting/multicast/autoconnect", json!([])),
        ("scouting/gossip/enabled", json!(false)),
        // 1000 ms was unstable on bad links. Safety does not depend on it.
        ("transport/link/tx/lease", json!(4000)),
        ("transport/link/rx/max_message_size", json!(4 << 20)),
        ("transport/shared_memory/enabled", json!(false)),
        ("adminspace/enabled", json!(false)),
    ]
    .into_iter()
    .chain((channel == Channel::Control).then_some(batch))
}

fn config(
    settings: impl Iterator<Item = (&'static str, Value)>,
    file: Option<&Path>,
) -> Result<Config, LinkError> {
    let mut config = match file {
        Some(path) => Config::from_file(path).map_err(|why| LinkError::Config {
            path: path.to_owned(),
            why,
        })?,
        None => Config::default(),
    };
    for (key, value) in settings {
        config
            .insert_json5(key, &value.to_string())
            .map_err(|why| LinkError::Setting { key, why })?;
    }
    Ok(config)
}
