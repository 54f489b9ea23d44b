//! P6 and the table's "Driving again if age recovers": whether what is pressed may move anything.

use std::time::Duration;

use super::millis;
use measurement::time::Monotonic;

const GRACE: Duration = millis(200);

/// Whether the holder's pressed key counts, by what was seen of their commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub(super) struct Licence {
    is_given: bool,
    /// It was lost at that moment by age or release, so that a young press soon after brings it back.
    pub(super) lost: Option<Monotonic>,
    pub(super) neutral_since: Option<Monotonic>,
}

impl Licence {
    pub(super) const fn is_given(self) -> bool {
        self.is_given
    }

    /// After anything that calls for release and press.
    pub(super) fn lock(&mut self) {
        *self = Self::default();
    }

    pub(super) fn neutral(&mut self, now: Monotonic) {
        self.lose(now);
        self.neutral_since.get_or_insert(now);
    }

    /// `may_recover`: the vehicle still moves, and the guard sees.
    pub(super) fn press(&mut self, now: Monotonic, neutral: Duration, may_recover: bool) {
        if self.is_given {
            return;
        }
        let is_soon = self.lost.is_some_and(|lost| now.since(lost) <= GRACE);
        let was_neutral = self.neutral_since.take();
        if is_soon && may_recover || was_neutral.is_some_and(|since| now.since(since) >= neutral) {
            self.lock();
            self.is_given = true;
        }
    }

    /// The last command is too old.
    pub(super) fn too_old(&mut self, now: Monotonic) {
        self.lose(now);
        self.neutral_since = None;
    }

    /// The guard does not see.
    pub(super) fn monitor_unavailable(&mut self) {
        if self.is_given {
            self.lock();
        }
    }

    /// The vehicle stands.
    pub(super) fn stand(&mut self) {
        if !self.is_given {
            self.lost = None;
        }
    }

    fn lose(&mut self, now: Monotonic) {
        if self.is_given {
            self.is_given = false;
            self.lost = Some(now);
        }
    }
}
