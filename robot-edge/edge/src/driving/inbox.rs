//! Inputs of the loop: messages of operators (with rate limit and removal of repeated emergency stops) and commands
//! given at the vehicle.

use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use protocol::keys::{OperatorId, OperatorTopic};
use protocol::message::{Answer, Drive};
use protocol::signed::Envelope;

use measurement::time::Monotonic;

/// Greatest number of waiting messages. The loop takes them every 20 ms or as they arrive.
const CAPACITY: usize = 256;

/// Sends the answer to a request; must not block.
pub type Reply = Box<dyn FnOnce(Answer) + Send>;

pub struct Incoming {
    pub topic: OperatorTopic,
    pub operator: OperatorId,
    /// A signed message, or anything else.
    pub bytes: Vec<u8>,
    pub reply: Option<Reply>,
}

#[derive(Clone, Debug)]
pub struct Inbox {
    sender: SyncSender<Incoming>,
    dropped: Arc<AtomicU64>,
}

#[derive(Debug)]
pub struct InboxReceiver {
    pub(super) receiver: Receiver<Incoming>,
    dropped: Arc<AtomicU64>,
}

impl Inbox {
    pub fn new() -> (Self, InboxReceiver) {
        let (sender, receiver) = sync_channel(CAPACITY);
        let dropped = Arc::new(AtomicU64::new(0));
        let inbox_receiver = InboxReceiver {
            receiver,
            dropped: Arc::clone(&dropped),
        };
        (Self { sender, dropped }, inbox_receiver)
    }

    /// Queues a message without waiting. If the queue is full, the message is dropped and counted; its sender gets no
    /// answer and repeats it.
    pub fn offer(&self, incoming: Incoming) {
        if self.sender.try_send(incoming).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl InboxReceiver {
    pub(super) fn take_dropped(&self) -> u64 {
        self.dropped.swap(0, Ordering::Relaxed)
    }
}

impl Incoming {
    /// What it requests. A drive command can carry an emergency stop.
    pub(super) fn request_kind(&self) -> OperatorTopic {
        match self.topic {
            OperatorTopic::Drive if self.carries_estop() => OperatorTopic::EStop,
            OperatorTopic::Drive => OperatorTopic::Drive,
            OperatorTopic::EStop => OperatorTopic::EStop,
            OperatorTopic::Reset => OperatorTopic::Reset,
            OperatorTopic::Lease => OperatorTopic::Lease,
            OperatorTopic::Set => OperatorTopic::Set,
        }
    }

    fn carries_estop(&self) -> bool {
        let claimed = Envelope::parse(&self.bytes)
            .and_then(|envelope| envelope.unverified_command::<Drive>());
        claimed.is_ok_and(|drive| drive.estop.is_some())
    }
}

impl fmt::Debug for Incoming {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Incoming")
            .field("topic", &self.topic)
            .field("operator", &self.operator)
            .field("bytes", &self.bytes.len())
            .finish_non_exhaustive()
    }
}

/// A command given at the vehicle by a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LocalCommand {
    /// Stop and stay stopped: SIGUSR2.
    Stop,
    /// End an emergency stop or a fault: SIGUSR1.
    Reset,
}

#[derive(Clone, Debug, Default)]
pub struct LocalCommands {
    stop: Arc<AtomicBool>,
    reset: Arc<AtomicBool>,
}

impl LocalCommands {
    /// Handles signals from now on.
    #[cfg(unix)]
    pub fn by_signals() -> io::Result<Self> {
        use signal_hook::consts::{SIGUSR1, SIGUSR2};
        let commands = Self::default();
        for (signal, flag) in [(SIGUSR2, &commands.stop), (SIGUSR1, &commands.reset)] {
            signal_hook::flag::register(signal, Arc::clone(flag))?;
        }
        Ok(commands)
    }

    /// Nothing: this system has no such signals.
    #[cfg(not(unix))]
    pub fn by_signals() -> io::Result<Self> {
        Ok(Self::default())
    }

    /// The commands since the last call. Stop is the last, so that it takes effect.
    pub(super) fn take(&self) -> impl Iterator<Item = LocalCommand> {
        let take =
            |flag: &AtomicBool, command| flag.swap(false, Ordering::Relaxed).then_some(command);
        let reset = take(&self.reset, LocalCommand::Reset);
        let stop = take(&self.stop, LocalCommand::Stop);
        reset.into_iter().chain(stop)
    }
}

/// Messages that an operator may send a second ("Security": 100/s).
const PER_SECOND: f64 = 100.0;
/// Messages that may come at once, after a pause of the link.
const BURST: f64 = 25.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct RateLimiter {
    left: f64,
    at: Monotonic,
}

impl RateLimiter {
    pub(super) const fn new(now: Monotonic) -> Self {
        Self {
            left: BURST,
            at: now,
        }
    }

    pub(super) fn allows(&mut self, now: Monotonic) -> bool {
        let elapsed: Duration = now.since(self.at);
        self.at = self.at.max(now);
        self.left = (self.left + PER_SECOND * elapsed.as_secs_f64()).min(BURST);
        let is_allowed = self.left >= 1.0;
        if is_allowed {
            self.left -= 1.0;
        }
        is_allowed
    }
}

const REMEMBERED_PRESSES: usize = 64;

/// The last presses of emergency stops.
///
/// A console repeats a press ten times a second until it is acknowledged. What a stalled link delivers after the reset
/// must not stop the vehicle again, and a new press must.
#[derive(Clone, Debug)]
pub(super) struct EStopDeduplicator {
    recent: [Option<u64>; REMEMBERED_PRESSES],
    next: usize,
}

impl EStopDeduplicator {
    pub(super) const fn new() -> Self {
        Self {
            recent: [None; REMEMBERED_PRESSES],
            next: 0,
        }
    }

    /// Whether this press is a repetition; records it.
    pub(super) fn is_duplicate(&mut self, press: u64) -> bool {
        let is_known = self.recent.contains(&Some(press));
        if !is_known {
            self.recent[self.next] = Some(press);
            self.next = (self.next + 1) % REMEMBERED_PRESSES;
        }
        is_known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_a_second_pass_and_no_more() {
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let mut rate = RateLimiter::new(at(0));
        let passed = |rate: &mut RateLimiter, step_us: u64, from_ms: u64| {
            let times = (0..1_000_000 / step_us).map(|n| n * step_us * 1000);
            let times = times.map(|nanos| Monotonic::from_nanos(from_ms * 1_000_000 + nanos));
            times.filter(|&now| rate.allows(now)).count()
        };
        // What a console sends that drives: 50 a second, all of them.
        assert_eq!(passed(&mut rate, 20_000, 0), 50);
        let flood = passed(&mut rate, 100, 1000);
        assert!((100..=126).contains(&flood), "{flood} of 10,000");
        // Time that goes back fills nothing.
        while rate.allows(at(2000)) {}
        assert!(!rate.allows(at(0)) && !rate.allows(at(2000)));
    }

    #[test]
    fn a_repetition_is_known_and_a_new_press_is_not() {
        let mut estop_deduplicator = EStopDeduplicator::new();
        assert!(!estop_deduplicator.is_duplicate(0), "any number is a press");
        assert!(estop_deduplicator.is_duplicate(0));
        for press in 1..=REMEMBERED_PRESSES as u64 {
            assert!(!estop_deduplicator.is_duplicate(press));
        }
        assert!(
            !estop_deduplicator.is_duplicate(0),
            "forgotten: stopping is the safe side"
        );
    }

    #[test]
    #[cfg(unix)]
    fn stop_takes_precedence_over_reset_among_signals() {
        let commands = LocalCommands::by_signals().unwrap();
        assert_eq!(commands.take().count(), 0);
        for signal in [signal_hook::consts::SIGUSR2, signal_hook::consts::SIGUSR1] {
            signal_hook::low_level::raise(signal).unwrap();
        }
        let taken: Vec<_> = commands.take().collect();
        assert_eq!(taken, [LocalCommand::Reset, LocalCommand::Stop]);
        assert_eq!(commands.take().count(), 0);
    }
}
