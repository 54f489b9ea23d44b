//! What has come and was not taken yet, in bounded memory.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use crate::clock::Monotonic;
use crate::measurement::Stream;
use crate::robot_time::RobotTime;

/// Messages that wait at most: two seconds of fast sensors.
const MAX_MESSAGES: usize = 4096;
/// Bytes of them.
const MAX_BYTES: usize = 64 << 20;

/// One message as it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// Topic and type.
    pub stream: Stream,
    /// CDR behind its encapsulation header.
    pub message: Vec<u8>,
    /// When it was published, on the publisher's wall clock, where it says so.
    pub published: Option<RobotTime>,
    /// When it came, on this machine's clock.
    pub came: Monotonic,
}

/// The end from which messages are taken.
#[derive(Debug)]
pub struct Inbox {
    messages: Receiver<Heard>,
    counters: Arc<Counters>,
}

/// The end at which they are left.
#[derive(Clone, Debug)]
pub(super) struct Slot {
    messages: SyncSender<Heard>,
    counters: Arc<Counters>,
}

#[derive(Debug, Default)]
struct Counters {
    waiting_bytes: AtomicUsize,
    overflown: AtomicU64,
}

impl Inbox {
    pub(super) fn new() -> (Slot, Self) {
        let (sender, receiver) = sync_channel(MAX_MESSAGES);
        let counters = Arc::new(Counters::default());
        let slot = Slot {
            messages: sender,
            counters: Arc::clone(&counters),
        };
        let inbox = Self {
            messages: receiver,
            counters,
        };
        (slot, inbox)
    }

    /// The next message, if one comes within `wait`.
    ///
    /// # Errors
    /// Where none has come, or none can come any more.
    pub fn take(&self, wait: Duration) -> Result<Heard, RecvTimeoutError> {
        let heard = match self.messages.try_recv() {
            Ok(heard) => heard,
            Err(_) if wait.is_zero() => return Err(RecvTimeoutError::Timeout),
            Err(_) => self.messages.recv_timeout(wait)?,
        };
        let bytes = heard.message.len();
        self.counters
            .waiting_bytes
            .fetch_sub(bytes, Ordering::Relaxed);
        Ok(heard)
    }

    /// Messages that found no room so far.
    pub fn overflown(&self) -> u64 {
        self.counters.overflown.load(Ordering::Relaxed)
    }
}

impl Slot {
    /// Leaves a message of `bytes` bytes, where there is room; only then it is made.
    pub(super) fn offer(&self, bytes: usize, make: impl FnOnce() -> Option<Heard>) {
        let Counters {
            waiting_bytes,
            overflown,
        } = &*self.counters;
        let waiting = waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let is_left = if waiting.saturating_add(bytes) > MAX_BYTES {
            false
        } else {
            let Some(heard) = make() else {
                waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
                return;
            };
            self.messages.try_send(heard).is_ok()
        };
        if !is_left {
            waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
            overflown.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(bytes: usize) -> Heard {
        Heard {
            stream: Stream {
                name: "/scan".to_owned(),
                type_name: "sensor_msgs/LaserScan".to_owned(),
            },
            message: vec![0; bytes],
            published: None,
            came: Monotonic::from_nanos(0),
        }
    }

    #[test]
    fn messages_and_bytes_are_bounded_and_the_rest_is_counted() {
        let (slot, inbox) = Inbox::new();
        for _ in 0..=MAX_MESSAGES {
            slot.offer(1, || Some(heard(1)));
        }
        assert_eq!(inbox.overflown(), 1);
        for _ in 0..MAX_MESSAGES {
            inbox.take(Duration::ZERO).unwrap();
        }
        assert_eq!(inbox.take(Duration::ZERO), Err(RecvTimeoutError::Timeout));
        slot.offer(MAX_BYTES, || Some(heard(MAX_BYTES)));
        slot.offer(1, || Some(heard(1)));
        assert_eq!(inbox.overflown(), 2);
        assert_eq!(inbox.take(Duration::ZERO).unwrap().message.len(), MAX_BYTES);
        slot.offer(MAX_BYTES, || None);
        slot.offer(1, || Some(heard(1)));
        assert_eq!(inbox.overflown(), 2);
    }
}
