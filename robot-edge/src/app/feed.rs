//! The source's side of a run: reads, paces and hands over in batches.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::is_set;
use super::source::{Item, Lost, Source};
use crate::clock::{self, Monotonic};
use crate::measurement::Stream;
use crate::pacer::{Pacer, Rate, Skipped};
use crate::recording::stamp_order::Ordered;
use crate::recording::{Position, RecordingError};

/// Items in a batch: a channel's locks cost more than an item does.
const BATCH: usize = 64;

/// Without anything that came, a batch goes over this often: who takes them also tells how it is going.
const TICK: Duration = Duration::from_millis(250);

/// Items on their way from the source to the pipeline.
pub(super) struct Batch {
    pub(super) items: Vec<Item>,
    /// When the first of them was due.
    pub(super) came: Monotonic,
    /// How late the source was by then; `None` where nothing says when data is due, or how late it is does not matter.
    pub(super) late: Option<Duration>,
    /// The streams met since the last batch, whose numbers the items carry.
    pub(super) new_streams: Vec<Stream>,
    /// How far reading has come.
    pub(super) position: Option<Position>,
    /// How much the source has lost so far.
    pub(super) lost: u64,
}

/// How a source ended.
pub(super) struct SourceEnd {
    pub(super) lost: Lost,
    pub(super) skipped: Skipped,
    /// Whether the source was read to its end, and not interrupted.
    pub(super) is_complete: bool,
    pub(super) result: Result<(), RecordingError>,
}

/// Reads `source` to its end, at `rate`, until interrupted or until `hand_over` says that nobody takes any
/// more.
pub(super) fn feed(
    source: &mut dyn Source,
    rate: Rate,
    interrupt: &AtomicBool,
    hand_over: impl FnMut(Batch) -> bool,
) -> SourceEnd {
    let mut pacer = Pacer::new(rate);
    let mut hand = Hand {
        items: Vec::with_capacity(BATCH),
        came: Monotonic::now(),
        late: None,
        over_at: Monotonic::now(),
        streams: 0,
        take: hand_over,
    };
    let result = feed_all(source, rate, &mut pacer, interrupt, &mut hand);
    // Whoever took items up to now takes the last ones too, or has its own reason not to.
    hand.over(source);
    SourceEnd {
        is_complete: result.is_ok() && !is_set(interrupt),
        lost: source.lost(),
        skipped: pacer.skipped(),
        result,
    }
}

fn feed_all(
    source: &mut dyn Source,
    rate: Rate,
    pacer: &mut Pacer,
    interrupt: &AtomicBool,
    hand: &mut Hand<impl FnMut(Batch) -> bool>,
) -> Result<(), RecordingError> {
    while !is_set(interrupt) {
        let Some(item) = source.next()? else {
            return Ok(());
        };
        match &item {
            Item::Due(Ordered::Measurement(measurement)) => {
                let now = Monotonic::now();
                let wait = pacer.wait(measurement.stamp, now);
                if matches!(rate, Rate::Times(_)) {
                    hand.late = hand.late.max(Some(pacer.late()));
                }
                // What is due already must not wait for what is not.
                if !wait.is_zero() && !hand.over(source) {
                    return Ok(());
                }
                if !clock::sleep_until(now + wait, || is_set(interrupt)) {
                    return Ok(());
                }
            }
            Item::Due(Ordered::ClockReset { .. }) => pacer.reset(),
            Item::Pause => {
                if hand.pause(source) {
                    continue;
                }
                return Ok(());
            }
            Item::AtOnce(_) | Item::Aside(_) | Item::Came { .. } => {}
        }
        if hand.items.is_empty() {
            hand.came = Monotonic::now();
        }
        hand.items.push(item);
        if hand.items.len() >= BATCH && !hand.over(source) {
            return Ok(());
        }
    }
    Ok(())
}

struct Hand<F> {
    items: Vec<Item>,
    came: Monotonic,
    late: Option<Duration>,
    /// When the last batch went.
    over_at: Monotonic,
    /// Streams that were handed over.
    streams: usize,
    take: F,
}

impl<F: FnMut(Batch) -> bool> Hand<F> {
    /// Hands over what there is; whether more is wanted.
    fn over(&mut self, source: &dyn Source) -> bool {
        self.items.is_empty() || self.go(source)
    }

    /// The same where there is no more at present: now and then an empty batch goes.
    fn pause(&mut self, source: &dyn Source) -> bool {
        if self.items.is_empty() && self.over_at.elapsed() < TICK {
            return true;
        }
        if self.items.is_empty() {
            self.came = Monotonic::now();
        }
        self.go(source)
    }

    fn go(&mut self, source: &dyn Source) -> bool {
        self.over_at = Monotonic::now();
        let new_streams = source.streams_from(self.streams);
        self.streams += new_streams.len();
        (self.take)(Batch {
            items: std::mem::replace(&mut self.items, Vec::with_capacity(BATCH)),
            came: self.came,
            late: self.late.take(),
            new_streams,
            position: source.position(),
            lost: source.lost_total(),
        })
    }
}
