//! What all decoders have in common: messages out of a stream of bytes with garbage between them.

use std::collections::BTreeMap;
use std::fmt;

/// Turns received bytes into messages.
///
/// A read may end in the middle of a message or contain several. Garbage is skipped and counted.
/// Datagrams are pushed one by one; a decoder of datagrams discards what a datagram leaves over.
pub trait Decoder {
    /// What the device sends.
    type Message;

    /// Adds received bytes. The decoder keeps a bounded number of them.
    fn push(&mut self, bytes: &[u8]);

    /// The next complete message; `None` if more bytes are needed.
    fn next_message(&mut self) -> Option<Self::Message>;

    /// What was dropped so far.
    fn dropped(&self) -> &Dropped;
}

/// Why received bytes gave no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DropReason {
    /// Bytes between messages.
    Garbage,
    /// A message that another one interrupts.
    CutOff,
    /// A wrong checksum.
    Checksum,
    /// A length that the protocol does not allow.
    Length,
    /// A field that is not what the protocol says: no number, out of range, not finite.
    Field,
    /// A message of a kind that this decoder does not know.
    UnknownKind,
    /// A message that the device sent, by its numbers or times, and that did not come.
    Lost,
}

impl fmt::Display for DropReason {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Garbage => "garbage",
            Self::CutOff => "cut_off",
            Self::Checksum => "checksum",
            Self::Length => "length",
            Self::Field => "field",
            Self::UnknownKind => "unknown_kind",
            Self::Lost => "lost",
        })
    }
}

/// Drops of a decoder by reason: bytes of garbage, messages of all others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Dropped(BTreeMap<DropReason, u64>);

impl Dropped {
    /// Counts `count` drops.
    pub fn add(&mut self, reason: DropReason, count: usize) {
        if count > 0 {
            let counted = self.0.entry(reason).or_default();
            *counted = counted.saturating_add(count as u64);
        }
    }

    /// Drops for this reason.
    pub fn count(&self, reason: DropReason) -> u64 {
        self.0.get(&reason).copied().unwrap_or_default()
    }

    /// All reasons that occurred.
    pub fn iter(&self) -> impl Iterator<Item = (DropReason, u64)> {
        self.0.iter().map(|(reason, count)| (*reason, *count))
    }
}
