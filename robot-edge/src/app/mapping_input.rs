//! What the placing side hands over to the mapping side.

use std::time::Duration;

use super::source::SourceItem;
use super::source_reader::Batch;
use localization::geodesy::GeodeticPoint;
use localization::registration::RegistrationOutput;
use measurement::time::Monotonic;

/// One step of mapping, in the order of the data.
#[derive(Debug)]
pub(super) enum MappingInput {
    /// The clock of the data starts anew; what waited by the old one follows.
    ClockReset,
    /// A scan or a jump of the poses, handed over at `since`. A scan was measured at `measured_at`, at the latest.
    Registered {
        placed: RegistrationOutput,
        measured_at: Monotonic,
        since: Monotonic,
    },
    /// What there is up to here can be told.
    Tick {
        input_delay: Option<InputDelay>,
        datum: Option<GeodeticPoint>,
    },
}

/// How late data is.
#[derive(Clone, Copy, Debug)]
pub(super) struct InputDelay {
    /// So late it was …
    lag: Duration,
    /// … when it came.
    received_at: Monotonic,
}

impl InputDelay {
    /// Of a batch, where that matters.
    pub(super) fn of(batch: &Batch) -> Option<Self> {
        let live = batch.items.iter().find_map(|item| match item {
            // Of some nobody knows when they came.
            SourceItem::Live { measured_at, .. } => (*measured_at > Monotonic::default())
                .then_some(Self {
                    lag: Duration::ZERO,
                    received_at: *measured_at,
                }),
            SourceItem::Timed(_)
            | SourceItem::Immediate(_)
            | SourceItem::Unmapped(_)
            | SourceItem::Idle => None,
        });
        live.or_else(|| {
            Some(Self {
                lag: batch.lag?,
                received_at: batch.received_at,
            })
        })
    }

    /// So late it is by `now`.
    pub(super) fn at(self, now: Monotonic) -> Duration {
        self.lag + now.since(self.received_at)
    }
}
