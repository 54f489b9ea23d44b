//! The source's side of a run: reads, paces and hands over in batches.

use std::sync::atomic::AtomicBool;

use super::is_set;
use super::source::Source;
use crate::clock::{self, Monotonic};
use crate::drops::DropCounts;
use crate::measurement::Stream;
use crate::pacer::{Pacer, Rate, Skipped};
use crate::recording::stamp_order::Ordered;
use crate::recording::{Position, RecordingError};

/// Items in a batch: a channel's locks cost more than an item does.
const BATCH: usize = 64;

/// Items on their way from the source to the pipeline.
pub(super) struct Batch {
    pub(super) items: Vec<Ordered>,
    /// The streams met so far, which the items' stream numbers index.
    pub(super) streams: Vec<Stream>,
    /// How far reading has come.
    pub(super) position: Option<Position>,
    /// What the source has lost so far.
    pub(super) lost: u64,
}

/// How a source ended.
pub(super) struct SourceEnd {
    pub(super) losses: DropCounts,
    /// The first losses in words.
    pub(super) notes: Vec<String>,
    pub(super) skipped: Skipped,
    pub(super) result: Result<(), RecordingError>,
}

/// Reads `source` to its end, at `rate`, until interrupted or until `hand_over` says that nobody takes any
/// more.
pub(super) fn feed(
    source: &mut dyn Source,
    rate: Rate,
    interrupt: &AtomicBool,
    mut hand_over: impl FnMut(Batch) -> bool,
) -> SourceEnd {
    let mut pacer = Pacer::new(rate);
    let mut items = Vec::with_capacity(BATCH);
    let mut send = |items: &mut Vec<Ordered>, source: &dyn Source| {
        let batch = Batch {
            items: std::mem::replace(items, Vec::with_capacity(BATCH)),
            streams: source.streams(),
            position: source.position(),
            lost: source.losses().0.total(),
        };
        hand_over(batch)
    };
    let result = loop {
        if is_set(interrupt) {
            break Ok(());
        }
        match source.next() {
            Ok(Some(item)) => {
                if let Ordered::Measurement(measurement) = &item {
                    let now = Monotonic::now();
                    let wait = pacer.wait(measurement.stamp, now);
                    // What is due already must not wait for what is not.
                    if !wait.is_zero() && !items.is_empty() && !send(&mut items, source) {
                        break Ok(());
                    }
                    if !clock::sleep_until(now + wait, || is_set(interrupt)) {
                        break Ok(());
                    }
                }
                items.push(item);
                if items.len() >= BATCH && !send(&mut items, source) {
                    break Ok(());
                }
            }
            Ok(None) => break Ok(()),
            Err(err) => break Err(err),
        }
    };
    if !items.is_empty() {
        send(&mut items, source);
    }
    let (losses, notes) = source.losses();
    SourceEnd {
        losses,
        notes,
        skipped: pacer.skipped(),
        result,
    }
}
