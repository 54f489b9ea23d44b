//! Link to one robot and its model.
//!
//! Zenoh's threads put messages into a bounded queue. One thread drains it into the model, sends what the model
//! requests, and wakes the window if something visible changed. So a frozen window does not block the link, and a robot
//! that stands still costs no frames.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use connect::{Connections, State, subscribe};
use measurement::time::Monotonic;
use network::LinkError;
use network::clock;
use network::endpoints::{Channel, attempts};
use network::sessions::{self, CONNECT_TIMEOUT, Endpoints, RETRY_PERIOD, Side};
use zenoh::{Session, Wait as _};

use crate::lock;
use crate::model::{ConsoleModel, Incoming, ModelSettings};

mod connect;
mod discovery;
mod driving;
mod known_robots;

pub use discovery::{AddressState, Discovery, SEEN_RECENTLY};
pub use driving::DrivingLink;
pub use known_robots::{DiscoveredRobot, FleetState, FoundRobot};

/// Filter for Zenoh's log in the syntax of `tracing_subscriber::EnvFilter`: errors only, without warnings about
/// intended settings and about messages for a session that closes.
pub const LOG_FILTER: &str = "zenoh=error,zenoh::api::session=off";

/// Limit of queued messages. Beyond it they are dropped and counted, and important ones are requested again.
const MAX_WAITING: usize = 4096;
/// Messages applied before the model's lock is released.
const BATCH: usize = 64;
const TICK: Duration = Duration::from_millis(20);
const LINK_PERIOD: Duration = Duration::from_secs(1);
const WAKE_PERIOD: Duration = Duration::from_millis(33);
/// Without other changes for this long, pushed tiles and scans wait for the next periodic frame.
const CALM_AFTER: Duration = Duration::from_secs(2);

/// Dropping it closes the link.
pub struct RobotSession {
    model: Arc<Mutex<ConsoleModel>>,
    connections: Arc<Connections>,
    driving: Option<DrivingLink>,
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Clone)]
pub struct ModelHandle {
    model: Arc<Mutex<ConsoleModel>>,
    is_left: Arc<AtomicBool>,
}

impl ModelHandle {
    #[cfg(test)]
    pub(crate) fn of(model: ConsoleModel) -> Self {
        Self {
            model: Arc::new(Mutex::new(model)),
            is_left: Arc::default(),
        }
    }

    /// Locks the model: link and window wait meanwhile.
    pub fn lock(&self) -> MutexGuard<'_, ConsoleModel> {
        lock(&self.model)
    }

    pub fn is_left(&self) -> bool {
        self.is_left.load(Ordering::Relaxed)
    }

    #[cfg(test)]
    pub(crate) fn leave(&self) {
        self.is_left.store(true, Ordering::Relaxed);
    }
}

impl RobotSession {
    /// Starts to connect until the robot answers, and returns at once. `wake` is called when something visible changed.
    pub fn open(
        settings: ModelSettings,
        endpoints: &Endpoints,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let (sender, received) = sync_channel(MAX_WAITING);
        let robot = settings.robot.clone();
        let model = Arc::new(Mutex::new(ConsoleModel::new(settings)));
        let (connections, driving) = Connections::start(robot, endpoints, sender);
        let connections = Arc::new(connections);
        let is_closing = Arc::new(AtomicBool::new(false));
        let thread = thread::spawn({
            let (model, connections, is_closing) = (
                Arc::clone(&model),
                Arc::clone(&connections),
                Arc::clone(&is_closing),
            );
            move || run(&model, &connections, &received, &is_closing, wake)
        });
        Self {
            model,
            connections,
            driving: Some(driving),
            is_closing,
            thread: Some(thread),
        }
    }

    pub fn model(&self) -> MutexGuard<'_, ConsoleModel> {
        lock(&self.model)
    }

    pub fn handle(&self) -> ModelHandle {
        ModelHandle {
            model: Arc::clone(&self.model),
            is_left: Arc::clone(&self.is_closing),
        }
    }

    pub const fn take_driving(&mut self) -> Option<DrivingLink> {
        self.driving.take()
    }

    /// Whether the control session is open. It reconnects by itself; if that takes long and another transport is
    /// possible, it is opened again.
    pub fn is_connected(&self) -> bool {
        self.connections.open_sessions().control
    }

    pub fn transport(&self) -> Option<Transport> {
        self.connections.transport()
    }

    pub fn problem(&self) -> Option<String> {
        self.connections.problem()
    }
}

impl Drop for RobotSession {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        // Closing waits for the network in the background.
        self.connections.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the link's thread failed");
        }
    }
}

fn run(
    model: &Mutex<ConsoleModel>,
    connections: &Connections,
    received: &Receiver<Incoming>,
    is_closing: &AtomicBool,
    wake: impl Fn(),
) {
    let (mut seen, mut seen_sensor_updates) = (None, 0);
    let (mut woken, mut stirred) = (Monotonic::default(), Monotonic::default());
    let mut next_tick = clock::now();
    let mut looked_at_links = Monotonic::default();
    while !is_closing.load(Ordering::Relaxed) {
        let first = match received.recv_timeout(next_tick.since(clock::now())) {
            Ok(first) => Some(first),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let now = clock::now();
        let mut guard = lock(model);
        for incoming in first.into_iter().chain(received.try_iter().take(BATCH)) {
            guard.apply(incoming, now);
        }
        if let Some(lost) = connections.take_lost() {
            guard.apply(lost, now);
        }
        let sessions = connections.open_sessions();
        let outgoing = guard.outgoing(sessions, now);
        let changes = Some((
            guard.changes(),
            connections.teleop_answers(),
            sessions,
            connections.problem(),
            // Silence needs a frame although no message comes.
            guard.connection().state(now),
        ));
        let sensor_updates = guard.sensor_updates();
        drop(guard);
        for outgoing in outgoing {
            connections.send(outgoing);
        }
        if now.since(looked_at_links) >= LINK_PERIOD {
            looked_at_links = now;
            connections.update_transport();
        }
        if changes != seen {
            stirred = now;
        }
        let is_calm = now.since(stirred) >= CALM_AFTER;
        let is_new = changes != seen || (!is_calm && sensor_updates != seen_sensor_updates);
        if is_new && now.since(woken) >= WAKE_PERIOD {
            (seen, seen_sensor_updates, woken) = (changes, sensor_updates, now);
            wake();
        }
        next_tick = now + TICK;
    }
}

/// What bulk may take longer to open than a quarter more than control.
const BULK_MARGIN: Duration = Duration::from_millis(150);
/// A network that passes TLS passes QUIC a moment later.
const COMING_BACK: Duration = Duration::from_millis(200);

/// Opens the session of `channel`, and again if its link is lost and another transport is possible.
fn keep_open(state: &Arc<State>, channel: Channel, endpoints: &Endpoints) {
    let has_keys = endpoints.credentials.is_some();
    let has_other_way =
        attempts(channel, &endpoints.connect, has_keys).is_ok_and(|ways| ways.len() > 1);
    let mut is_first = true;
    while let Some(session) = open_with_retries(state, channel, endpoints, is_first) {
        is_first = false;
        if !has_other_way || !wait_until_lost(state, &session) {
            return;
        }
        tracing::info!("the link is lost; opening it again with any transport");
        let taken = lock(state.session(channel)).take();
        taken.into_iter().for_each(close_in_background);
    }
}

fn wait_until_lost(state: &State, session: &Session) -> bool {
    let mut lost_since = None;
    while !state.is_closing() {
        let has_link = session.info().links().wait().next().is_some();
        if is_lost(&mut lost_since, has_link, clock::now()) {
            return true;
        }
        clock::sleep_until(clock::now() + RETRY_PERIOD, || state.is_closing());
    }
    false
}

/// Retries until the session is open; `None` if another attempt was faster, or the console closes.
fn open_with_retries(
    state: &Arc<State>,
    channel: Channel,
    endpoints: &Endpoints,
    mut is_first: bool,
) -> Option<Session> {
    while !state.is_closing() {
        match open(channel, endpoints, is_first)
            .and_then(|session| use_first(state, channel, session))
        {
            Ok(session) => return session,
            Err(why) => {
                tracing::debug!(%why, "not connected yet");
                // Locked until the problem is set, or it would stay if another attempt opens meanwhile.
                let slot = lock(state.session(channel));
                if slot.is_some() {
                    return None;
                }
                state.set_problem(channel, Some(in_words(&why, channel, endpoints)));
            }
        }
        is_first = false;
        clock::sleep_until(clock::now() + RETRY_PERIOD, || state.is_closing());
    }
    None
}

/// Uses a session that has opened; `None` if another attempt was faster, or the console closes.
fn use_first(
    state: &Arc<State>,
    channel: Channel,
    session: Session,
) -> Result<Option<Session>, LinkError> {
    let is_late = |slot: &Option<Session>| state.is_closing() || slot.is_some();
    if is_late(&lock(state.session(channel))) {
        close_in_background(session);
        return Ok(None);
    }
    let session = subscribe(state, channel, session)?;
    let mut slot = lock(state.session(channel));
    if is_late(&slot) {
        close_in_background(session);
        return Ok(None);
    }
    *slot = Some(session.clone());
    state.set_problem(channel, None);
    Ok(Some(session))
}

/// Opens bulk a second time beside the first attempt, where that takes clearly longer than control did: TCP sends a lost first
/// packet again only after a second.
fn open_bulk_again(state: &Arc<State>, endpoints: &Endpoints) {
    let is_over = || state.is_closing() || lock(state.session(Channel::Bulk)).is_some();
    let began = clock::now();
    while lock(state.session(Channel::Control)).is_none() {
        if !clock::sleep_until(clock::now() + TICK, is_over) {
            return;
        }
    }
    // Control by QUIC takes four round trips, bulk by TLS five. Of a robot that came late only the last attempt counts.
    let quarter = clock::elapsed(began).min(CONNECT_TIMEOUT) / 4;
    if !clock::sleep_until(clock::now() + quarter + BULK_MARGIN, is_over) {
        return;
    }
    let opened = open(Channel::Bulk, endpoints, true);
    if let Err(why) = opened.and_then(|session| use_first(state, Channel::Bulk, session)) {
        tracing::debug!(%why, "no second session for maps");
    }
}

/// Opens the session once. If nothing answered before and TLS does now, QUIC is tried once more: the robot or the
/// network may have come up between both attempts.
fn open(channel: Channel, endpoints: &Endpoints, is_first: bool) -> Result<Session, LinkError> {
    let session = sessions::open(Side::Console, channel, endpoints)?;
    let is_second_best = Transport::of(&session, &endpoints.connect) == Some(Transport::TlsInstead);
    if is_first || !is_second_best {
        return Ok(session);
    }
    thread::sleep(COMING_BACK);
    match sessions::open(Side::Console, channel, endpoints) {
        Ok(again) => {
            close_in_background(session);
            Ok(again)
        }
        Err(_lost_again) => Ok(session),
    }
}

fn close_in_background(session: Session) {
    thread::spawn(move || close(&session));
}

/// May wait for the network.
fn close(session: &Session) {
    if let Err(why) = session.close().wait() {
        tracing::debug!(%why, "a session did not close");
    }
}

fn in_words(why: &LinkError, channel: Channel, asked: &Endpoints) -> String {
    match (why, channel) {
        // The error names the last attempt only: report all endpoints.
        (LinkError::Open { .. }, Channel::Control) => {
            format!("no answer at {}; trying again", asked.connect.join(", "))
        }
        (LinkError::Open { endpoints, .. }, Channel::Bulk) => {
            format!("no answer at {endpoints}, where maps come from; trying again")
        }
        _ => why.to_string(),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Secured; a loss delays nothing.
    Quic,
    Tls,
    /// TLS, as QUIC did not answer.
    TlsInstead,
    /// Unsecured.
    Tcp,
    /// Another, from a Zenoh configuration.
    Other,
}

impl Transport {
    /// Transport of the session's first link; `asked` are the requested endpoints.
    fn of(session: &Session, asked: &[String]) -> Option<Self> {
        let link = session.info().links().wait().next()?;
        let locator = link.dst().to_string();
        Some(Self::of_locator(&locator, asked))
    }

    fn of_locator(locator: &str, asked: &[String]) -> Self {
        let (protocol, _) = locator.split_once('/').unwrap_or_default();
        match protocol {
            "quic" => Self::Quic,
            "tls" if asked.iter().any(|endpoint| endpoint.starts_with("quic/")) => Self::TlsInstead,
            "tls" => Self::Tls,
            "tcp" => Self::Tcp,
            _ => Self::Other,
        }
    }
}

/// Zenoh reconnects by the same transport only. If a network starts to drop UDP, QUIC never returns: after this time
/// the session is opened again with any transport.
const LOST_FOR: Duration = Duration::from_secs(1);

/// Returns whether the link has been lost for too long. `since`: the beginning of the loss, for the next call.
fn is_lost(since: &mut Option<Monotonic>, has_link: bool, now: Monotonic) -> bool {
    if has_link {
        *since = None;
        return false;
    }
    now.since(*since.get_or_insert(now)) >= LOST_FOR
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    #[test]
    fn unrequested_transport_is_reported() {
        let quic = ["quic/boat:7447".to_owned()];
        let tls = ["tls/boat:7447".to_owned()];
        let of = |locator: &str, asked: &[String]| Transport::of_locator(locator, asked);
        assert_eq!(of("quic/10.0.0.5:7447", &quic), Transport::Quic);
        assert_eq!(of("tls/10.0.0.5:7447", &quic), Transport::TlsInstead);
        assert_eq!(of("tls/10.0.0.5:7447", &tls), Transport::Tls);
        assert_eq!(of("tcp/10.0.0.5:7447", &[]), Transport::Tcp);
        assert_eq!(of("unixsock-stream/a", &[]), Transport::Other);
    }

    #[test]
    fn short_interruption_keeps_the_session() {
        let mut since = None;
        for (ms, has_link, is_over) in [
            (10_000, true, false),
            (10_500, false, false),
            (11_400, false, false),
            (11_450, true, false),
            (11_600, false, false),
            (12_500, false, false),
            (12_600, false, true),
            (12_700, true, false),
            (12_800, false, false),
        ] {
            let is_lost = is_lost(&mut since, has_link, at(ms));
            assert_eq!(is_lost, is_over, "{ms} ms");
        }
    }
}
