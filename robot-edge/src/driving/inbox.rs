//! From the network to the loop: what operators send waits here, and a flood is dropped here.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use protocol::keys::{OperatorId, OperatorTopic};
use protocol::message::{Answer, Drive};
use protocol::signed::Envelope;

use teleop::RequestKind;

/// Messages that wait for the loop at most. It takes all of them every 20 ms, or as they come.
const CAPACITY: usize = 256;

/// Sends the answer to a request; must not wait.
pub type Reply = Box<dyn FnOnce(Answer) + Send>;

/// One message of an operator, as it arrived.
pub struct Incoming {
    /// What kind of wish, by its key.
    pub topic: OperatorTopic,
    /// Whose, by its key.
    pub operator: OperatorId,
    /// A signed message, or anything else.
    pub bytes: Vec<u8>,
    /// Where the answer goes, if one is waited for.
    pub reply: Option<Reply>,
}

/// Where the network leaves what operators send.
#[derive(Clone, Debug)]
pub struct Inbox {
    sender: SyncSender<Incoming>,
    dropped: Arc<AtomicU64>,
}

/// The loop's end of an [`Inbox`].
#[derive(Debug)]
pub struct InboxReceiver {
    pub(super) receiver: Receiver<Incoming>,
    dropped: Arc<AtomicU64>,
}

impl Inbox {
    /// An empty inbox and its other end.
    pub fn new() -> (Self, InboxReceiver) {
        let (sender, receiver) = sync_channel(CAPACITY);
        let dropped = Arc::new(AtomicU64::new(0));
        let inbox_receiver = InboxReceiver {
            receiver,
            dropped: Arc::clone(&dropped),
        };
        (Self { sender, dropped }, inbox_receiver)
    }

    /// Leaves a message for the loop, at once: where there is no room for it, it is dropped and counted, and whoever
    /// sent it hears nothing, which means "again".
    pub fn offer(&self, incoming: Incoming) {
        if self.sender.try_send(incoming).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl InboxReceiver {
    /// Messages for which there was no room, since the last call.
    pub(super) fn take_dropped(&self) -> u64 {
        self.dropped.swap(0, Ordering::Relaxed)
    }
}

impl Incoming {
    /// What it asks for, as its key says and what it claims: a driving command can carry an emergency stop.
    pub(super) fn request_kind(&self) -> RequestKind {
        match self.topic {
            OperatorTopic::Drive if self.carries_estop() => RequestKind::EStop,
            OperatorTopic::Drive => RequestKind::Drive,
            OperatorTopic::EStop => RequestKind::EStop,
            OperatorTopic::Reset => RequestKind::Reset,
            OperatorTopic::Lease => RequestKind::Lease,
            OperatorTopic::Set => RequestKind::Setting,
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
