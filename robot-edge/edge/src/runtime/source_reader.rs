//! Reads a source, paces it, and groups its items into batches.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::is_set;
use super::source::{Source, SourceItem, SourceLosses};
use crate::pacer::{Pacer, Rate, Skipped};
use measurement::Stream;
use measurement::time::Monotonic;
use network::clock;
use recording::time_sequencer::Ordered;
use recording::{Position, RecordingError};

const MAX_BATCH_ITEMS: usize = 64;

/// Maximum time between two batches; an empty one triggers a status update.
const MAX_BATCH_INTERVAL: Duration = Duration::from_millis(250);

/// Items on the way from the source to the pipeline.
pub(super) struct Batch {
    pub(super) items: Vec<SourceItem>,
    /// When the first item was due.
    pub(super) received_at: Monotonic,
    /// Delay of the source at that time; `None` if the data has no deadlines.
    pub(super) lag: Option<Duration>,
    /// The streams that were discovered since the last batch.
    pub(super) new_streams: Vec<Stream>,
    pub(super) position: Option<Position>,
    /// Messages that the source has lost so far.
    pub(super) lost: u64,
}

pub(super) struct SourceEnd {
    pub(super) lost: SourceLosses,
    pub(super) skipped: Skipped,
    /// The source was read to its end and not interrupted.
    pub(super) is_complete: bool,
    pub(super) result: Result<(), RecordingError>,
}

/// Reads `source` at `rate` until its end, an interrupt, or until `hand_over` returns false.
pub(super) fn read_source(
    source: &mut dyn Source,
    rate: Rate,
    interrupt: &AtomicBool,
    hand_over: impl FnMut(Batch) -> bool,
) -> SourceEnd {
    let mut pacer = Pacer::new(rate);
    let mut builder = BatchBuilder {
        items: Vec::with_capacity(MAX_BATCH_ITEMS),
        received_at: clock::now(),
        lag: None,
        sent_at: clock::now(),
        streams: 0,
        take: hand_over,
    };
    let result = read_all(source, rate, &mut pacer, interrupt, &mut builder);
    // The last items are passed on even after an error.
    builder.flush(source);
    SourceEnd {
        is_complete: result.is_ok() && !is_set(interrupt),
        lost: source.lost(),
        skipped: pacer.skipped(),
        result,
    }
}

fn read_all(
    source: &mut dyn Source,
    rate: Rate,
    pacer: &mut Pacer,
    interrupt: &AtomicBool,
    builder: &mut BatchBuilder<impl FnMut(Batch) -> bool>,
) -> Result<(), RecordingError> {
    while !is_set(interrupt) {
        let Some(item) = source.next()? else {
            return Ok(());
        };
        match &item {
            SourceItem::Timed(Ordered::Measurement(measurement)) => {
                let now = clock::now();
                let wait = pacer.wait(measurement.stamp, now);
                if matches!(rate, Rate::Times(_)) {
                    builder.lag = builder.lag.max(Some(pacer.lag()));
                }
                // Items that are due do not wait for the next one.
                if !wait.is_zero() && !builder.flush(source) {
                    return Ok(());
                }
                if !clock::sleep_until(now + wait, || is_set(interrupt)) {
                    return Ok(());
                }
            }
            SourceItem::Timed(Ordered::ClockReset { .. }) => pacer.reset(),
            SourceItem::Idle => {
                if builder.flush_if_due(source) {
                    continue;
                }
                return Ok(());
            }
            SourceItem::Immediate(_) | SourceItem::Unmapped(_) | SourceItem::Live { .. } => {}
        }
        if builder.items.is_empty() {
            builder.received_at = clock::now();
        }
        builder.items.push(item);
        if builder.items.len() >= MAX_BATCH_ITEMS && !builder.flush(source) {
            return Ok(());
        }
    }
    Ok(())
}

struct BatchBuilder<F> {
    items: Vec<SourceItem>,
    received_at: Monotonic,
    lag: Option<Duration>,
    sent_at: Monotonic,
    /// Number of streams that were passed on.
    streams: usize,
    take: F,
}

impl<F: FnMut(Batch) -> bool> BatchBuilder<F> {
    /// Passes the items on. Returns false if no more are wanted.
    fn flush(&mut self, source: &dyn Source) -> bool {
        self.items.is_empty() || self.send(source)
    }

    /// As [`Self::flush`], but sends an empty batch if the interval has passed.
    fn flush_if_due(&mut self, source: &dyn Source) -> bool {
        if self.items.is_empty() && clock::elapsed(self.sent_at) < MAX_BATCH_INTERVAL {
            return true;
        }
        if self.items.is_empty() {
            self.received_at = clock::now();
        }
        self.send(source)
    }

    fn send(&mut self, source: &dyn Source) -> bool {
        self.sent_at = clock::now();
        let new_streams = source.streams_from(self.streams);
        self.streams += new_streams.len();
        (self.take)(Batch {
            items: std::mem::replace(&mut self.items, Vec::with_capacity(MAX_BATCH_ITEMS)),
            received_at: self.received_at,
            lag: self.lag.take(),
            new_streams,
            position: source.position(),
            lost: source.lost_total(),
        })
    }
}
