//! What a reader could not read: counted by reason, the first few in words.

use crate::drops::{DropCounts, DropReason};

/// Losses told in words; the rest is only counted.
const NOTES_LIMIT: usize = 20;

/// Counts of losses and the first [`NOTES_LIMIT`] of them in words.
#[derive(Debug, Default)]
pub(crate) struct LossLog {
    counts: DropCounts,
    notes: Vec<String>,
}

impl LossLog {
    /// Counts one loss; `note` says where and what, and is called only while there is room for words.
    pub(crate) fn add(&mut self, reason: DropReason, note: impl FnOnce() -> String) {
        self.count(reason);
        self.note(note);
    }

    /// Counts one loss without words.
    pub(crate) fn count(&mut self, reason: DropReason) {
        self.counts.add(reason);
    }

    /// Notes something that cost no data.
    pub(crate) fn note(&mut self, note: impl FnOnce() -> String) {
        if self.notes.len() < NOTES_LIMIT {
            self.notes.push(note());
        }
    }

    pub(crate) const fn counts(&self) -> &DropCounts {
        &self.counts
    }

    pub(crate) fn notes(&self) -> &[String] {
        &self.notes
    }
}
