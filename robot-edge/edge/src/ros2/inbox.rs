//! A bounded queue of received messages.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use measurement::Stream;
use measurement::byte_limit::{ByteLimit, ReservedBytes};
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
    messages: Receiver<(RosMessage, ReservedBytes)>,
    dropped: Arc<AtomicU64>,
}

#[derive(Clone, Debug)]
pub(super) struct InboxSender {
    messages: SyncSender<(RosMessage, ReservedBytes)>,
    limit: ByteLimit,
    dropped: Arc<AtomicU64>,
}

impl Inbox {
    pub(super) fn new() -> (InboxSender, Self) {
        let (sender, messages) = sync_channel(MAX_MESSAGES);
        let dropped = Arc::new(AtomicU64::new(0));
        let sender = InboxSender {
            messages: sender,
            limit: ByteLimit::new(MAX_BYTES),
            dropped: Arc::clone(&dropped),
        };
        (sender, Self { messages, dropped })
    }

    pub fn take(&self, wait: Duration) -> Result<RosMessage, RecvTimeoutError> {
        let (message, _reserved) = match self.messages.try_recv() {
            Ok(message) => message,
            Err(_) if wait.is_zero() => return Err(RecvTimeoutError::Timeout),
            Err(_) => self.messages.recv_timeout(wait)?,
        };
        Ok(message)
    }

    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

impl InboxSender {
    /// Adds a message of `bytes` bytes if there is room; `make` is called only then.
    pub(super) fn offer(&self, bytes: usize, make: impl FnOnce() -> Option<RosMessage>) {
        let is_left = match self.limit.reserve(bytes) {
            Some(reserved) => {
                let Some(message) = make() else {
                    return;
                };
                self.messages.try_send((message, reserved)).is_ok()
            }
            None => false,
        };
        if !is_left {
            self.dropped.fetch_add(1, Ordering::Relaxed);
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
