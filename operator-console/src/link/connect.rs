//! The two sessions to a robot: opened and kept open in the background, used without blocking.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use network::LinkError;
use network::endpoints::Channel;
use network::sessions::Endpoints;
use protocol::keys::{self, RobotId, Topic};
use protocol::wire::MAX_MESSAGE_BYTES;
use zenoh::bytes::ZBytes;
use zenoh::handlers::CallbackDrop;
use zenoh::key_expr::KeyExpr;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{ConsolidationMode, Reply};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use super::driving::{DrivingLink, Tap};
use super::{Transport, close_in_background, keep_open, open_bulk_again};
use crate::lock;
use crate::model::{Incoming, OpenSessions, Outgoing, RequestId};

const MAX_OUTGOING: usize = 64;
/// A later answer is requested again: slow links need time, and the model detects a lost link.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);

pub(super) struct Connections {
    state: Arc<State>,
    outgoing: SyncSender<Outgoing>,
}

pub(super) struct State {
    robot: RobotId,
    incoming: SyncSender<Incoming>,
    /// By [`Channel`]; `None` while it is not open.
    sessions: [Mutex<Option<Session>>; 2],
    problems: Mutex<[Option<String>; 2]>,
    /// Endpoints of the control session, and its present transport.
    asked: Vec<String>,
    transport: Mutex<Option<Transport>>,
    overrun: AtomicU64,
    oversized: AtomicU64,
    is_closing: AtomicBool,
    tap: Arc<Tap>,
}

impl Connections {
    pub(super) fn start(
        robot: RobotId,
        endpoints: &Endpoints,
        incoming: SyncSender<Incoming>,
    ) -> (Self, DrivingLink) {
        let (tap, heard) = Tap::new();
        let state = Arc::new(State {
            robot,
            incoming,
            sessions: <[_; 2]>::default(),
            problems: Mutex::default(),
            asked: endpoints.connect.clone(),
            transport: Mutex::default(),
            overrun: AtomicU64::new(0),
            oversized: AtomicU64::new(0),
            is_closing: AtomicBool::new(false),
            tap: Arc::clone(&tap),
        });
        for channel in [Channel::Control, Channel::Bulk] {
            let (state, endpoints) = (Arc::clone(&state), endpoints.clone());
            thread::spawn(move || keep_open(&state, channel, &endpoints));
        }
        thread::spawn({
            let (state, endpoints) = (Arc::clone(&state), endpoints.clone());
            move || open_bulk_again(&state, &endpoints)
        });
        let (outgoing, to_send) = sync_channel(MAX_OUTGOING);
        thread::spawn({
            let state = Arc::clone(&state);
            move || send_all(&state, &to_send)
        });
        let driving = DrivingLink::start(tap, heard, {
            let state = Arc::clone(&state);
            move || lock(state.session(Channel::Control)).clone()
        });
        (Self { state, outgoing }, driving)
    }

    pub(super) fn teleop_answers(&self) -> u64 {
        self.state.tap.answers()
    }

    /// Sends a message or request. If the queue is full, a request ends unanswered.
    pub(super) fn send(&self, outgoing: Outgoing) {
        if let Err(TrySendError::Full(outgoing) | TrySendError::Disconnected(outgoing)) =
            self.outgoing.try_send(outgoing)
        {
            self.state.not_asked(&outgoing);
        }
    }

    pub(super) fn open_sessions(&self) -> OpenSessions {
        OpenSessions {
            control: lock(self.state.session(Channel::Control)).is_some(),
            bulk: lock(self.state.session(Channel::Bulk)).is_some(),
        }
    }

    pub(super) fn problem(&self) -> Option<String> {
        lock(&self.state.problems).iter().flatten().next().cloned()
    }

    pub(super) fn transport(&self) -> Option<Transport> {
        *lock(&self.state.transport)
    }

    /// Determines the present transport: a session may reconnect by another.
    pub(super) fn update_transport(&self) {
        let session = lock(self.state.session(Channel::Control)).clone();
        let transport = session.and_then(|session| Transport::of(&session, &self.state.asked));
        // Without a link the last transport stays.
        if transport.is_some() {
            *lock(&self.state.transport) = transport;
        }
    }

    pub(super) fn take_lost(&self) -> Option<Incoming> {
        let overrun = self.state.overrun.swap(0, Ordering::Relaxed);
        let oversized = self.state.oversized.swap(0, Ordering::Relaxed);
        (overrun + oversized > 0).then_some(Incoming::Lost { overrun, oversized })
    }

    pub(super) fn close(&self) {
        self.state.is_closing.store(true, Ordering::Relaxed);
        for session in &self.state.sessions {
            let open = lock(session).take();
            open.into_iter().for_each(close_in_background);
        }
    }
}

impl State {
    pub(super) fn session(&self, channel: Channel) -> &Mutex<Option<Session>> {
        &self.sessions[channel as usize]
    }

    pub(super) fn is_closing(&self) -> bool {
        self.is_closing.load(Ordering::Relaxed)
    }

    pub(super) fn set_problem(&self, channel: Channel, problem: Option<String>) {
        lock(&self.problems)[channel as usize] = problem;
    }

    fn hand_over(&self, incoming: Incoming) {
        if self.incoming.try_send(incoming).is_err() {
            self.overrun.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn bytes(&self, payload: &ZBytes) -> Option<Vec<u8>> {
        if payload.len() > MAX_MESSAGE_BYTES {
            self.oversized.fetch_add(1, Ordering::Relaxed);
            return None;
        }
        Some(payload.to_bytes().into_owned())
    }

    /// `topic` is set where the teleop client is informed first.
    fn take_sample(&self, sample: &Sample, topic: Option<Topic>) {
        if let Some(payload) = self.bytes(sample.payload()) {
            match topic {
                Some(Topic::Pose) => self.tap.take_pose(&payload),
                Some(Topic::Status) => self.tap.take_status(&payload),
                _ => {}
            }
            let key = sample.key_expr().as_str().to_owned();
            self.hand_over(Incoming::Sample { key, payload });
        }
    }

    fn not_asked(&self, outgoing: &Outgoing) {
        // A view needs no report: the next one follows in half a second.
        if let Outgoing::Get { request, .. } = outgoing {
            self.hand_over(Incoming::Ended { request: *request });
        }
    }
}

pub(super) fn subscribe(
    state: &Arc<State>,
    channel: Channel,
    session: Session,
) -> Result<Session, LinkError> {
    let robot = &state.robot;
    let keys = match channel {
        Channel::Control => [
            Topic::Pose,
            Topic::Status,
            Topic::Localization,
            Topic::Plan,
            Topic::Event,
            Topic::MapHead,
        ]
        .map(|topic| (topic.key(robot), Some(topic)))
        .to_vec(),
        Channel::Bulk => vec![
            (keys::all_changes(robot), None),
            (Topic::Shores.key(robot), Some(Topic::Shores)),
            (Topic::Scan.key(robot), Some(Topic::Scan)),
        ],
    };
    for (key, topic) in keys {
        let state = Arc::clone(state);
        session
            .declare_subscriber(key.clone())
            .callback(move |sample| state.take_sample(&sample, topic))
            .background()
            .wait()
            .map_err(|why| LinkError::Declare { what: key, why })?;
    }
    if channel == Channel::Control {
        let key = Topic::Alive.key(robot);
        let state = Arc::clone(state);
        session
            .liveliness()
            .declare_subscriber(key.clone())
            .history(true)
            .callback(move |token| {
                state.hand_over(Incoming::Presence(token.kind() == SampleKind::Put));
            })
            .background()
            .wait()
            .map_err(|why| LinkError::Declare { what: key, why })?;
    }
    Ok(session)
}

fn send_all(state: &Arc<State>, outgoing: &Receiver<Outgoing>) {
    for outgoing in outgoing {
        if state.is_closing() {
            return;
        }
        if let Err(why) = send(state, &outgoing) {
            tracing::debug!(%why, "not sent");
            state.not_asked(&outgoing);
        }
    }
}

fn send(state: &Arc<State>, outgoing: &Outgoing) -> Result<(), zenoh::Error> {
    match outgoing {
        Outgoing::Put { key, payload } => {
            let Some(session) = lock(state.session(Channel::Control)).clone() else {
                return Ok(());
            };
            session
                .put(key.clone(), payload.clone())
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::InteractiveHigh)
                .wait()
        }
        Outgoing::Get {
            request,
            key,
            payload,
            is_bulk,
        } => {
            let channel = if *is_bulk {
                Channel::Bulk
            } else {
                Channel::Control
            };
            let Some(session) = lock(state.session(channel)).clone() else {
                state.not_asked(outgoing);
                return Ok(());
            };
            let (request, on_reply, on_end) = (*request, Arc::clone(state), Arc::clone(state));
            session
                .get(KeyExpr::try_from(key.clone())?)
                .payload(payload.clone())
                // All replies to one request have the same key; none replaces another.
                .consolidation(ConsolidationMode::None)
                .congestion_control(CongestionControl::Drop)
                .timeout(ANSWER_TIMEOUT)
                .with(CallbackDrop {
                    callback: move |reply: Reply| take_reply(&on_reply, request, &reply),
                    drop: move || on_end.hand_over(Incoming::Ended { request }),
                })
                .wait()
        }
    }
}

fn take_reply(state: &State, request: RequestId, reply: &Reply) {
    match reply.result() {
        Ok(sample) => {
            if let Some(payload) = state.bytes(sample.payload()) {
                let key = sample.key_expr().as_str().to_owned();
                state.hand_over(Incoming::Reply {
                    request,
                    key,
                    payload,
                });
            }
        }
        Err(why) => {
            tracing::debug!(why = %String::from_utf8_lossy(&why.payload().to_bytes()), "no answer");
        }
    }
}
