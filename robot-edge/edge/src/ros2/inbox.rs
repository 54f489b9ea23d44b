//! A bounded queue of received messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use measurement::Stream;
use measurement::time::Monotonic;
use measurement::time::RobotTime;

/// Maximum number of messages: two seconds of fast sensors.
const MAX_MESSAGES: usize = 4096;
const MAX_BYTES: usize = 64 << 20;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosMessage {
    pub stream: Stream,
    /// CDR after its encapsulation header.
    pub payload: Vec<u8>,
    /// Time of publication on the publisher's wall clock, if known.
    pub published: Option<RobotTime>,
    pub received_at: Monotonic,
}

#[derive(Debug)]
pub struct Inbox {
    messages: Receiver<RosMessage>,
    counters: Arc<Counters>,
}

#[derive(Clone, Debug)]
pub(super) struct InboxSender {
    messages: SyncSender<RosMessage>,
    counters: Arc<Counters>,
}

#[derive(Debug, Default)]
struct Counters {
    waiting_bytes: AtomicUsize,
    dropped: AtomicU64,
}

impl Inbox {
    pub(super) fn new() -> (InboxSender, Self) {
        let (sender, receiver) = sync_channel(MAX_MESSAGES);
        let counters = Arc::new(Counters::default());
        let sender = InboxSender {
            messages: sender,
            counters: Arc::clone(&counters),
        };
        let inbox = Self {
            messages: receiver,
            counters,
        };
        (sender, inbox)
    }

    pub fn take(&self, wait: Duration) -> Result<RosMessage, RecvTimeoutError> {
        let message = match self.messages.try_recv() {
            Ok(message) => message,
            Err(_) if wait.is_zero() => return Err(RecvTimeoutError::Timeout),
            Err(_) => self.messages.recv_timeout(wait)?,
        };
        let bytes = message.payload.len();
        self.counters
            .waiting_bytes
            .fetch_sub(bytes, Ordering::Relaxed);
        Ok(message)
    }

    pub fn dropped(&self) -> u64 {
        self.counters.dropped.load(Ordering::Relaxed)
    }
}

impl InboxSender {
    /// Adds a message of `bytes` bytes if there is room; `message` is called only then.
    pub(super) fn offer(&self, bytes: usize, make: impl FnOnce() -> Option<RosMessage>) {
        let Counters {
            waiting_bytes,
            dropped,
        } = &*self.counters;
        let waiting = waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let is_left = if waiting.saturating_add(bytes) > MAX_BYTES {
            false
        } else {
            let Some(message) = make() else {
                waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
                return;
            };
            self.messages.try_send(message).is_ok()
        };
        if !is_left {
            waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
            dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(bytes: usize) -> RosMessage {
        RosMessage {
            stream: Stream {
                name: "/scan".to_owned(),
                type_name: "sensor_msgs/LaserScan".to_owned(),
            },
            payload: vec![0; bytes],
            published: None,
            received_at: Monotonic::from_nanos(0),
        }
    }

    #[test]
    fn messages_and_bytes_are_bounded_and_the_rest_is_counted() {
        let (sender, inbox) = Inbox::new();
        for _ in 0..=MAX_MESSAGES {
            sender.offer(1, || Some(message(1)));
        }
        assert_eq!(inbox.dropped(), 1);
        for _ in 0..MAX_MESSAGES {
            inbox.take(Duration::ZERO).unwrap();
        }
        assert_eq!(inbox.take(Duration::ZERO), Err(RecvTimeoutError::Timeout));
        sender.offer(MAX_BYTES, || Some(message(MAX_BYTES)));
        sender.offer(1, || Some(message(1)));
        assert_eq!(inbox.dropped(), 2);
        assert_eq!(inbox.take(Duration::ZERO).unwrap().payload.len(), MAX_BYTES);
        sender.offer(MAX_BYTES, || None);
        sender.offer(1, || Some(message(1)));
        assert_eq!(inbox.dropped(), 2);
    }
}
