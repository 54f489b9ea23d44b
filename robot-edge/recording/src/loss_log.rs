//! What a reader could not read: counted by reason, the first few in words.

use measurement::drops::{DropCounts, DropReason};

/// Losses told in words; the rest is only counted.
const NOTES_LIMIT: usize = 20;

/// Counts of losses and the first [`NOTES_LIMIT`] of them in words.
#[derive(Debug, Default)]
pub struct LossLog {
    counts: DropCounts,
    notes: Vec<String>,
}

impl LossLog {
    /// Counts one loss; `note` says where and what, and is called only while there is room for words.
    pub fn add(&mut self, reason: DropReason, note: impl FnOnce() -> String) {
        self.count(reason);
        self.note(note);
    }

    /// Counts one loss without words.
    pub fn count(&mut self, reason: DropReason) {
        self.counts.add(reason);
    }

    /// Notes something that cost no data.
    pub fn note(&mut self, note: impl FnOnce() -> String) {
        if self.notes.len() < NOTES_LIMIT {
            self.notes.push(note());
        }
    }

    /// Losses by reason.
    pub const fn counts(&self) -> &DropCounts {
        &self.counts
    }

    /// What was said of the first losses.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }
}
