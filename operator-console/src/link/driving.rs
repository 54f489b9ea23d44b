//! Direct path between teleop client and robot: tokens and answers bypass the model's queue, commands bypass requests
//! for tiles. The teleop client never waits for the network.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use network::clock;
use protocol::keys::OperatorTopic;
use protocol::message::{Answer, Pose, Status};
use protocol::wire;
use zenoh::handlers::CallbackDrop;
use zenoh::key_expr::KeyExpr;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::query::{ConsolidationMode, Reply};
use zenoh::{Session, Wait};

use crate::lock;
use crate::teleop_client::{LatestPose, RequestNumber, SignedMessage, TeleopMessage};

/// Limit of queued commands: a third of a second. If the link hangs for longer, the robot would reject older ones.
const MAX_COMMANDS: usize = 16;
const MAX_MESSAGES: usize = 64;
/// A later answer is dropped. The emergency stop is repeated meanwhile.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(3);

/// Filled by the link's callbacks, drained by the teleop client.
#[derive(Debug)]
pub(super) struct Tap {
    newest: Mutex<Option<LatestPose>>,
    messages: SyncSender<TeleopMessage>,
    /// Number of answers: a change needs a frame.
    answers: AtomicU64,
}

pub struct DrivingLink {
    tap: Arc<Tap>,
    messages: Receiver<TeleopMessage>,
    commands: SyncSender<SignedMessage>,
    unsent: Arc<AtomicUsize>,
}

impl Tap {
    pub(super) fn new() -> (Arc<Self>, Receiver<TeleopMessage>) {
        let (sender, messages) = sync_channel(MAX_MESSAGES);
        let tap = Self {
            newest: Mutex::default(),
            messages: sender,
            answers: AtomicU64::new(0),
        };
        (Arc::new(tap), messages)
    }

    pub(super) fn answers(&self) -> u64 {
        self.answers.load(Ordering::Relaxed)
    }

    /// The model rejects and counts invalid poses.
    pub(super) fn take_pose(&self, bytes: &[u8]) {
        let Ok((header, pose)) = wire::decode::<Pose>(bytes) else {
            return;
        };
        let newest = LatestPose {
            boot: header.boot,
            token: pose.token,
            velocity: [pose.speed_mps, pose.lateral_mps, pose.turn_rate_radps],
            at: clock::now(),
        };
        let mut slot = lock(&self.newest);
        let is_overtaken = slot.is_some_and(|before| {
            let (before_n, n) = (before.token.map(|of| of.n), pose.token.map(|of| of.n));
            before.boot == newest.boot && n < before_n
        });
        if !is_overtaken {
            *slot = Some(newest);
        }
    }

    pub(super) fn take_status(&self, bytes: &[u8]) {
        if let Ok((header, status)) = wire::decode::<Status>(bytes) {
            self.forward(TeleopMessage::Status {
                boot: header.boot,
                teleop: status.teleop.map(Box::new),
            });
        }
    }

    fn take_reply(&self, request: RequestNumber, reply: &Reply) {
        let Ok(sample) = reply.result() else {
            return;
        };
        match wire::decode::<Answer>(&sample.payload().to_bytes()) {
            Ok((header, answer)) => {
                self.forward(TeleopMessage::Answer {
                    request,
                    boot: header.boot,
                    answer,
                });
                self.answers.fetch_add(1, Ordering::Relaxed);
            }
            Err(why) => tracing::warn!(%why, "an answer cannot be read"),
        }
    }

    fn forward(&self, message: TeleopMessage) {
        // A full queue loses nothing that matters: statuses repeat, and a lost answer times out.
        let _is_full = self.messages.try_send(message);
    }
}

impl DrivingLink {
    /// Starts to send over what `session` returns, which is `None` without a link.
    pub(super) fn start(
        tap: Arc<Tap>,
        messages: Receiver<TeleopMessage>,
        session: impl Fn() -> Option<Session> + Send + 'static,
    ) -> Self {
        let (commands, to_send) = sync_channel(MAX_COMMANDS);
        let unsent = Arc::new(AtomicUsize::new(0));
        thread::spawn({
            let (tap, unsent) = (Arc::clone(&tap), Arc::clone(&unsent));
            move || {
                for message in to_send {
                    hand_over(&tap, session(), message);
                    unsent.fetch_sub(1, Ordering::Release);
                }
            }
        });
        Self {
            tap,
            messages,
            commands,
            unsent,
        }
    }

    pub fn newest(&self) -> Option<LatestPose> {
        *lock(&self.tap.newest)
    }

    pub fn messages(&self) -> impl Iterator<Item = TeleopMessage> + '_ {
        self.messages.try_iter().take(MAX_MESSAGES)
    }

    /// Passes a message to Zenoh once and now, or drops it. Never blocks.
    pub fn send(&self, message: SignedMessage) {
        self.unsent.fetch_add(1, Ordering::Release);
        if let Err(TrySendError::Full(message) | TrySendError::Disconnected(message)) =
            self.commands.try_send(message)
        {
            self.unsent.fetch_sub(1, Ordering::Release);
            tracing::warn!(topic = ?message.topic, "the link hangs: a command was dropped");
            if let Some(request) = message.request {
                self.tap.forward(TeleopMessage::NoAnswer { request });
            }
        }
    }

    /// Waits until Zenoh has all messages, at most for `longest`.
    pub fn flush(&self, longest: Duration) {
        let started = clock::now();
        while self.unsent.load(Ordering::Acquire) > 0 && clock::elapsed(started) < longest {
            thread::sleep(Duration::from_millis(1));
        }
    }
}

fn hand_over(tap: &Arc<Tap>, session: Option<Session>, message: SignedMessage) {
    let request = message.request;
    let sent = session.ok_or_else(|| "there is no session".into());
    if let Err(why) = sent.and_then(|session| send(tap, &session, message)) {
        tracing::debug!(%why, "a command was not sent");
        if let Some(request) = request {
            tap.forward(TeleopMessage::NoAnswer { request });
        }
    }
}

fn send(tap: &Arc<Tap>, session: &Session, message: SignedMessage) -> Result<(), zenoh::Error> {
    let SignedMessage {
        topic,
        key,
        payload,
        request,
    } = message;
    let Some(request) = request else {
        debug_assert_eq!(topic, OperatorTopic::Drive, "all else is asked");
        return session
            .put(key, payload)
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::RealTime)
            .express(true)
            // By QUIC a datagram: lost ones are not repeated and delay nothing.
            .reliability(Reliability::BestEffort)
            .wait();
    };
    let (on_reply, on_end) = (Arc::clone(tap), Arc::clone(tap));
    session
        .get(KeyExpr::try_from(key)?)
        .payload(payload)
        .consolidation(ConsolidationMode::None)
        .congestion_control(CongestionControl::Drop)
        .priority(Priority::RealTime)
        .express(true)
        .timeout(ANSWER_TIMEOUT)
        .with(CallbackDrop {
            callback: move |reply: Reply| on_reply.take_reply(request, &reply),
            // After the answer, if there was one.
            drop: move || on_end.forward(TeleopMessage::NoAnswer { request }),
        })
        .wait()
}
