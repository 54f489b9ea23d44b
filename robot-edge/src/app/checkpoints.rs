//! How a recording is wound back without being mapped from its beginning: copies of the maps, taken on the way.
//!
//! A copy costs a few hundredths of a second and up to a few hundred megabytes, so there are few: none where all of the
//! recording is mapped in a moment, and where they grow too many or too large, every second one goes.

use std::time::Duration;

use super::pipeline::PipelineCheckpoint;
use crate::replay_control::ReplayTrail;
use measurement::time::RobotDuration;

/// Mapping for so long is not done twice for a step back.
const MIN_INTERVAL: Duration = Duration::from_millis(1500);
/// Taking copies costs at most one part in so many of the time.
const MAX_COST_DIVISOR: u32 = 20;
/// Copies that are kept, and their memory, bytes.
pub(super) const MAX_CHECKPOINTS: usize = 24;
const MAX_BYTES: usize = 512_000_000;

/// A copy of the maps.
pub(super) struct ReplayCheckpoint {
    /// Time of the data that is in them, from the first scan.
    pub(super) at: RobotDuration,
    /// Items of the source that are in them.
    pub(super) items: u64,
    pub(super) trail: ReplayTrail,
    pub(super) pipeline: PipelineCheckpoint,
}

/// The copies of one recording, in its order.
pub(super) struct Checkpoints {
    pub(super) kept: Vec<ReplayCheckpoint>,
    /// Time that mapping takes from one to the next.
    pub(super) interval: Duration,
    /// Time that mapping took since the last.
    since_last: Duration,
}

impl Checkpoints {
    pub(super) const fn new() -> Self {
        Self {
            kept: Vec::new(),
            interval: MIN_INTERVAL,
            since_last: Duration::ZERO,
        }
    }

    /// Mapping up to `at` took so much time more; whether a copy is due.
    pub(super) fn is_due(&mut self, at: RobotDuration, took: Duration) -> bool {
        if self.kept.last().is_some_and(|last| at <= last.at) {
            return false;
        }
        self.since_last += took;
        self.since_last >= self.interval
    }

    /// Keeps a copy, behind all others, which took so long to take.
    pub(super) fn keep(&mut self, kept: ReplayCheckpoint, took: Duration) {
        self.kept.push(kept);
        self.since_last = Duration::ZERO;
        self.interval = self.interval.max(MAX_COST_DIVISOR * took);
        while self.kept.len() > MAX_CHECKPOINTS
            || (self.bytes() > MAX_BYTES && !self.kept.is_empty())
        {
            self.thin();
        }
    }

    /// The last copy up to `to`.
    pub(super) fn latest_until(&self, to: RobotDuration) -> Option<&ReplayCheckpoint> {
        let behind = self.kept.partition_point(|kept| kept.at <= to);
        self.kept.get(behind.checked_sub(1)?)
    }

    fn bytes(&self) -> usize {
        self.kept.iter().map(|kept| kept.pipeline.bytes()).sum()
    }

    /// Of two neighbours the later one stays: a single one that is too large goes.
    fn thin(&mut self) {
        let mut index = 0;
        self.kept.retain(|_| {
            index += 1;
            index % 2 == 0
        });
        self.interval *= 2;
    }
}
