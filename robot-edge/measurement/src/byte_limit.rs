//! Limit of the bytes in a queue whose number of items is not enough of one.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The bytes that the items of a queue may have together. Clones share them.
#[derive(Clone, Debug)]
pub struct ByteLimit {
    max: usize,
    reserved: Arc<AtomicUsize>,
}

/// Bytes of one item in the queue, free again when this is dropped.
#[derive(Debug)]
pub struct ReservedBytes {
    bytes: usize,
    reserved: Arc<AtomicUsize>,
}

impl ByteLimit {
    /// Of so many bytes.
    pub fn new(max: usize) -> Self {
        Self {
            max,
            reserved: Arc::default(),
        }
    }

    /// `None` if they do not fit.
    pub fn reserve(&self, bytes: usize) -> Option<ReservedBytes> {
        let add = |reserved: usize| reserved.checked_add(bytes).filter(|sum| *sum <= self.max);
        self.reserved
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, add)
            .ok()?;
        Some(ReservedBytes {
            bytes,
            reserved: Arc::clone(&self.reserved),
        })
    }
}

impl Drop for ReservedBytes {
    fn drop(&mut self) {
        self.reserved.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_reserved_up_to_the_limit_and_freed() {
        let limit = ByteLimit::new(10);
        let six = limit.reserve(6).unwrap();
        let four = limit.clone().reserve(4).unwrap();
        assert!(limit.reserve(0).is_some());
        assert!(limit.reserve(1).is_none());
        assert!(limit.reserve(usize::MAX).is_none());
        drop(four);
        assert!(limit.reserve(5).is_none());
        drop(six);
        assert!(limit.reserve(10).is_some());
    }
}
