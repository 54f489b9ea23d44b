//! The source's side of a run: reads, paces and hands over in batches.

use std::sync::atomic::AtomicBool;

use super::data_clock::{DataClock, is_timed};
use super::is_set;
use super::source::Source;
use crate::clock::{Monotonic, sleep_until};
use crate::drops::DropCounts;
use crate::measurement::Stream;
use crate::pacer::{Pacer, Rate, Skipped};
use crate::recording::stamp_order::Ordered;
use crate::recording::{Position, RecordingError};
use crate::robot_time::RobotDuration;

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
    /// Time of the data that has passed.
    pub(super) elapsed: RobotDuration,
}

/// How a source ended.
pub(super) struct SourceEnd {
    pub(super) losses: DropCounts,
    /// The first losses in words.
    pub(super) notes: Vec<String>,
    pub(super) stamp_repairs: u64,
    pub(super) skipped: Skipped,
    /// Time of the data that has passed.
    pub(super) elapsed: RobotDuration,
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
    let mut clock = DataClock::default();
    let mut items = Vec::with_capacity(BATCH);
    let mut send = |items: &mut Vec<Ordered>, source: &dyn Source, clock: &DataClock| {
        let batch = Batch {
            items: std::mem::replace(items, Vec::with_capacity(BATCH)),
            streams: source.streams(),
            position: source.position(),
            lost: source.losses().0.total(),
            elapsed: clock.elapsed(),
        };
        hand_over(batch)
    };
    let result = loop {
        if is_set(interrupt) {
            break Ok(());
        }
        match source.next() {
            Ok(Some(item)) => {
                match &item {
                    Ordered::Measurement(measurement)
                        if is_timed(measurement) && source.has_begun() =>
                    {
                        let now = Monotonic::now();
                        let wait = pacer.wait(measurement.stamp, now);
                        // What is due already must not wait for what is not.
                        if !wait.is_zero() && !items.is_empty() && !send(&mut items, source, &clock)
                        {
                            break Ok(());
                        }
                        if !sleep_until(now + wait, || is_set(interrupt)) {
                            break Ok(());
                        }
                        clock.see(measurement.stamp);
                    }
                    Ordered::Measurement(_) => {}
                    Ordered::ClockReset { .. } => {
                        pacer.restart();
                        clock.reset();
                    }
                }
                items.push(item);
                if items.len() >= BATCH && !send(&mut items, source, &clock) {
                    break Ok(());
                }
            }
            Ok(None) => break Ok(()),
            Err(err) => break Err(err),
        }
    };
    if !items.is_empty() {
        send(&mut items, source, &clock);
    }
    let (losses, notes) = source.losses();
    SourceEnd {
        losses,
        notes,
        stamp_repairs: source.stamp_repairs(),
        skipped: pacer.skipped(),
        elapsed: clock.elapsed(),
        result,
    }
}
