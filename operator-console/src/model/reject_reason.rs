//! Messages that were not taken, by reason.

use std::collections::BTreeMap;

/// Why a message was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RejectReason {
    /// Its key is none of this protocol's, or of another robot.
    Key,
    /// It is no message of this protocol.
    Malformed,
    /// It speaks another version of the protocol: update one of the two programs.
    OtherProtocol,
    /// Longer than any message.
    Oversized,
    /// The console did not keep up.
    Overrun,
    /// Of a robot that has not yet told which run of it this is.
    BeforeJoin,
    /// Of a run of the robot that is over, or not yet announced.
    OtherBoot,
    /// Of a layer that was erased since.
    OldEpoch,
    /// Held already, or older than what is held.
    OldRevision,
    /// A tile that does not decode, or whose cells are not what its digest says.
    BadTile,
    /// A tile of a layer that the robot has not described.
    UnknownLayer,
}

impl RejectReason {
    /// For logs and panels.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Key => "foreign key",
            Self::Malformed => "malformed",
            Self::OtherProtocol => "other protocol version: update the older program",
            Self::Oversized => "oversized",
            Self::Overrun => "console too slow",
            Self::BeforeJoin => "before joining",
            Self::OtherBoot => "other boot",
            Self::OldEpoch => "erased layer",
            Self::OldRevision => "known already",
            Self::BadTile => "damaged tile",
            Self::UnknownLayer => "unknown layer",
        }
    }
}

/// Counts by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RejectCounts(BTreeMap<RejectReason, u64>);

impl RejectCounts {
    /// Counts one.
    pub fn add(&mut self, why: RejectReason) {
        self.add_many(why, 1);
    }

    /// Counts several.
    pub fn add_many(&mut self, why: RejectReason, count: u64) {
        if count > 0 {
            *self.0.entry(why).or_default() += count;
        }
    }

    /// How often `why` happened.
    pub fn count(&self, why: RejectReason) -> u64 {
        self.0.get(&why).copied().unwrap_or(0)
    }

    /// Every reason that happened, with its count.
    pub fn iter(&self) -> impl Iterator<Item = (RejectReason, u64)> {
        self.0.iter().map(|(why, count)| (*why, *count))
    }
}
