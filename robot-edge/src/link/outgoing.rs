//! Numbers and stamps the messages that leave.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use protocol::tile::BootId;
use protocol::wire::{self, Header};
use serde::Serialize;

/// Makes messages of one run of the program.
#[derive(Clone, Debug)]
pub(super) struct Outgoing {
    boot: BootId,
    seq: Arc<AtomicU64>,
}

impl Outgoing {
    pub(super) fn new(boot: BootId) -> Self {
        Self {
            boot,
            seq: Arc::default(),
        }
    }

    /// The bytes of a message; `None` (and a log line) where it is too long to be one.
    pub(super) fn message<T: Serialize>(&self, robot_time_ns: i64, body: &T) -> Option<Vec<u8>> {
        let seq = self.seq.fetch_add(1, Ordering::Relaxed);
        let header = Header {
            boot: self.boot,
            seq,
            robot_time_ns,
        };
        wire::encode(&header, body)
            .inspect_err(|why| tracing::error!(%why, "a message was not sent"))
            .ok()
    }
}
