//! What the placing side hands over to the mapping side.

use std::time::Duration;

use super::feed::Batch;
use super::source::Item;
use crate::clock::Monotonic;
use crate::localization::geodesy::GeodeticPoint;
use crate::localization::placer::Placed;

/// One step of mapping, in the order of the data.
#[derive(Debug)]
pub(super) enum Step {
    /// The clock of the data starts anew; what waited by the old one follows.
    ClockReset,
    /// A scan or a jump of the poses, handed over at `since`. A scan was measured at `taken`, at the latest.
    Placed {
        placed: Placed,
        taken: Monotonic,
        since: Monotonic,
    },
    /// What there is up to here can be told.
    Told {
        lateness: Option<Lateness>,
        datum: Option<GeodeticPoint>,
    },
}

/// How late data is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lateness {
    /// So late it was …
    late: Duration,
    /// … when it came.
    came: Monotonic,
}

impl Lateness {
    /// Of a batch, where that matters.
    pub(super) fn of(batch: &Batch) -> Option<Self> {
        let live = batch.items.iter().find_map(|item| match item {
            // Of some nobody knows when they came.
            Item::Came { taken, .. } => (*taken > Monotonic::default()).then_some(Self {
                late: Duration::ZERO,
                came: *taken,
            }),
            Item::Due(_) | Item::AtOnce(_) | Item::Aside(_) | Item::Pause => None,
        });
        live.or_else(|| {
            Some(Self {
                late: batch.late?,
                came: batch.came,
            })
        })
    }

    /// So late it is by `now`.
    pub(super) fn at(self, now: Monotonic) -> Duration {
        self.late + now.since(self.came)
    }
}
