//! Received bytes that wait for the rest of their message.

use std::marker::PhantomData;

use crate::{Decoder, DropReason, Dropped};

/// Largest number of bytes that are kept.
pub(crate) const CAPACITY: usize = 64 * 1024;

/// What is at the front of the buffer.
pub enum Front<M> {
    /// The beginning of a message.
    Incomplete,
    /// This many bytes that the protocol allows between messages.
    Blank(usize),
    /// Nothing that can be used: this many bytes are skipped.
    Skip(DropReason, usize),
    /// A message of this many bytes.
    Message(M, usize),
}

/// Bytes of a stream, and the count of what was dropped from it.
#[derive(Debug, Default)]
pub(crate) struct ReadBuffer {
    bytes: Vec<u8>,
    start: usize,
    pub(crate) dropped: Dropped,
}

impl ReadBuffer {
    /// Adds received bytes. Beyond [`CAPACITY`] the oldest are dropped.
    pub(crate) fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.start);
        self.start = 0;
        let (lost, kept) = bytes.split_at(bytes.len().saturating_sub(CAPACITY));
        let excess = (self.bytes.len() + kept.len()).saturating_sub(CAPACITY);
        self.bytes.drain(..excess);
        self.dropped.add(DropReason::Garbage, lost.len() + excess);
        self.bytes.extend_from_slice(kept);
    }

    /// The next message. `front` is given at least one byte; it must not revoke with more bytes what
    /// it said of fewer.
    pub(crate) fn next_message<M>(&mut self, front: impl Fn(&[u8]) -> Front<M>) -> Option<M> {
        while let rest @ [_, ..] = self.bytes.get(self.start..)? {
            match front(rest) {
                Front::Incomplete => break,
                Front::Blank(length) => self.start += length.clamp(1, rest.len()),
                Front::Skip(reason, length) => {
                    let length = length.clamp(1, rest.len());
                    let count = if reason == DropReason::Garbage {
                        length
                    } else {
                        1
                    };
                    self.dropped.add(reason, count);
                    self.start += length;
                }
                Front::Message(message, length) => {
                    self.start += length.min(rest.len());
                    return Some(message);
                }
            }
        }
        None
    }
}

/// A message that is understood without those before it.
pub trait Framed: Sized {
    /// What is at the front of `bytes`, of which there is at least one. With more bytes it must not revoke what it
    /// said of fewer.
    fn front(bytes: &[u8]) -> Front<Self>;
}

/// Decodes a stream of such messages.
#[derive(Debug)]
pub struct StreamDecoder<M>(ReadBuffer, PhantomData<M>);

impl<M> Default for StreamDecoder<M> {
    fn default() -> Self {
        Self(ReadBuffer::default(), PhantomData)
    }
}

impl<M: Framed> Decoder for StreamDecoder<M> {
    type Message = M;

    fn push(&mut self, bytes: &[u8]) {
        self.0.push(bytes);
    }

    fn next_message(&mut self) -> Option<M> {
        self.0.next_message(M::front)
    }

    fn dropped(&self) -> &Dropped {
        &self.0.dropped
    }
}

/// Bytes before the first place where `mark`, or its beginning at the very end, stands.
pub(crate) fn before_mark(bytes: &[u8], mark: &[u8]) -> usize {
    let starts_mark = |at: &usize| {
        let rest = &bytes[*at..];
        rest.starts_with(mark) || (rest.len() < mark.len() && mark.starts_with(rest))
    };
    (0..bytes.len()).find(starts_mark).unwrap_or(bytes.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_is_found_whole_or_begun() {
        for (bytes, expected) in [
            (&b""[..], 0),
            (b"xy", 2),
            (b"xAB", 1),
            (b"xA", 1),
            (b"xAA", 2),
            (b"xAxAB", 3),
            (b"ABx", 0),
        ] {
            assert_eq!(before_mark(bytes, b"AB"), expected, "{bytes:?}");
        }
    }

    #[test]
    fn the_oldest_bytes_beyond_the_capacity_are_dropped() {
        let mut buffer = ReadBuffer::default();
        buffer.push(&vec![1; CAPACITY]);
        buffer.push(&[2; 10]);
        assert_eq!(buffer.bytes.len(), CAPACITY);
        assert_eq!(buffer.dropped.count(DropReason::Garbage), 10);
        buffer.push(&vec![3; CAPACITY + 5]);
        assert_eq!(buffer.bytes.len(), CAPACITY);
        assert_eq!(
            buffer.dropped.count(DropReason::Garbage),
            (10 + CAPACITY + 5) as u64
        );
        let first = buffer.next_message(|bytes| Front::Message(bytes[0], 1));
        assert_eq!(first, Some(3));
    }
}
