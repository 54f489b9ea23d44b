//! Messages between link and model, as bytes, and why the model rejects one.

use std::collections::BTreeMap;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestId(pub u64);

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Incoming {
    Sample {
        key: String,
        payload: Vec<u8>,
    },
    /// One of any number of replies to a request.
    Reply {
        request: RequestId,
        key: String,
        payload: Vec<u8>,
    },
    /// No more replies will come: the last one arrived or the request timed out.
    Ended {
        request: RequestId,
    },
    Lost {
        /// Because the console was too slow.
        overrun: u64,
        /// Because they exceeded the size limit.
        oversized: u64,
    },
    /// Whether the robot's presence token is there. For display only.
    Presence(bool),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenSessions {
    /// Small, urgent messages.
    pub control: bool,
    /// Maps.
    pub bulk: bool,
}

impl OpenSessions {
    pub const BOTH: Self = Self {
        control: true,
        bulk: true,
    };
    pub const NONE: Self = Self {
        control: false,
        bulk: false,
    };
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outgoing {
    Get {
        request: RequestId,
        key: String,
        payload: Vec<u8>,
        is_bulk: bool,
    },
    /// Sends a message over the control session.
    Put { key: String, payload: Vec<u8> },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RejectReason {
    /// Its key is not of this protocol, or of another robot.
    Key,
    Malformed,
    /// Another version of the protocol: one of the two programs must be updated.
    OtherProtocol,
    Oversized,
    /// The console was too slow.
    Overrun,
    /// The robot has not announced its run yet.
    BeforeJoin,
    /// From a run of the robot that is over or not yet announced.
    OtherBoot,
    /// From a layer that was erased since.
    OldEpoch,
    /// Not newer than what is held.
    OldRevision,
    /// A tile that does not decode or does not match its digest.
    BadTile,
    /// A tile of a layer that the robot has not described.
    UnknownLayer,
}

impl RejectReason {
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

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RejectCounts(BTreeMap<RejectReason, u64>);

impl RejectCounts {
    pub fn add(&mut self, why: RejectReason, count: u64) {
        if count > 0 {
            *self.0.entry(why).or_default() += count;
        }
    }

    pub fn count(&self, why: RejectReason) -> u64 {
        self.0.get(&why).copied().unwrap_or(0)
    }

    pub fn iter(&self) -> impl Iterator<Item = (RejectReason, u64)> {
        self.0.iter().map(|(why, count)| (*why, *count))
    }
}
