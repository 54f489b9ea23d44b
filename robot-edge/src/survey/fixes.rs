//! Satellite fixes: how many, and how many of them are positions.

use measurement::{GeodeticFix, StreamId};

/// The fixes of one stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixSurvey {
    /// Which stream.
    pub stream: StreamId,
    /// How many messages.
    pub count: u64,
    /// How many of them the receiver says to be a fix.
    pub fixed: u64,
    /// The first that is one.
    pub first: Option<GeodeticFix>,
}

impl FixSurvey {
    pub(super) const fn new(stream: StreamId) -> Self {
        Self {
            stream,
            count: 0,
            fixed: 0,
            first: None,
        }
    }

    pub(super) fn add(&mut self, fix: &GeodeticFix) {
        self.count += 1;
        if fix.status >= 0 {
            self.fixed += 1;
            self.first.get_or_insert(*fix);
        }
    }
}
