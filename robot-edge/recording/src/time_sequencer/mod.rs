//! Puts measurements of a recording or of live sensors in the order of their stamps.
//!
//! An item is released when the newest stamp exceeds its own by `window`. A wrong stamp must not make other items
//! late, so a step of stamps that is longer than the window, forward or back, is accepted only when the next item of
//! the same sequence confirms it; until then the item waits aside:
//!
//! - forward: one stamp far in the future does not make the items after it late; a pause in the recording is
//!   accepted after two items.
//! - back: one old stamp is late; a bag played twice or a restarted simulation begins a new clock period with its
//!   own order.
//!
//! Transforms do not move the data's clock: localization dates them into the future (AMCL by 1 s, its
//! `transform_tolerance`), which would leave nothing of the window to the other streams.

use std::collections::{BTreeMap, HashMap, VecDeque};

use measurement::drops::{DropCounts, DropReason};
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, StreamId};

/// How far items may be out of order by default: transforms and scans of one instant are logged less than
/// this apart.
pub const DEFAULT_WINDOW: RobotDuration = RobotDuration::from_millis(1000);

/// Sources whose stamps are followed each on its own.
const MAX_SEQUENCES: usize = 4096;

/// Output of a [`TimeSequencer`].
#[derive(Clone, Debug, PartialEq)]
pub enum Ordered {
    /// The next measurement. Its stamp is not before that of the previous output, except for measurements that do not
    /// wait (static transforms, scans with their own pose; in [`TimeSequencer::live`] also late ones) and after an
    /// [`Ordered::ClockReset`].
    Measurement(Measurement),
    /// The data's clock went back: what is known by stamp (poses above all) no longer holds.
    ClockReset {
        /// The newest stamp before.
        from: RobotTime,
        /// The first stamp after.
        to: RobotTime,
    },
}

/// Puts measurements in stamp order; equal stamps keep the order in which they came.
///
/// Static transforms hold for all time, and a scan that brings its own pose (CARMEN) waits for none: both
/// pass at once, in file order. A CARMEN log may stamp its odometry by another clock than its scans.
/// What is older than what already left is dropped and counted as [`DropReason::Late`].
#[derive(Debug)]
pub struct TimeSequencer {
    /// A longer step of stamps is not believed at once.
    window: RobotDuration,
    /// How long items wait for older ones.
    max_wait: RobotDuration,
    /// A late item that is still in order within its own sequence is released immediately instead of being dropped.
    releases_late: bool,
    buffered: ReorderBuffer,
    suspects: Vec<Suspect>,
    out: VecDeque<Ordered>,
    period: ClockPeriod,
    arrivals: u64,
    drops: DropCounts,
    late_scans: u64,
}

/// State since the last clock reset.
#[derive(Debug, Default)]
struct ClockPeriod {
    /// The greatest stamp that is believed.
    newest: Option<RobotTime>,
    /// The stamp that left last.
    last_released: Option<RobotTime>,
    newest_of: HashMap<StampSequence, RobotTime>,
}

/// Stamps that follow each other: those of a stream, or the transforms of one child in it, because many programs
/// publish to one tf topic.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct StampSequence {
    stream: StreamId,
    /// Of transforms.
    child: Option<FrameId>,
}

/// An item whose stamp took a step that nothing has confirmed.
#[derive(Debug)]
struct Suspect {
    sequence: StampSequence,
    step: Step,
    arrival: u64,
    measurement: Measurement,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Usual,
    Ahead,
    Back,
}

impl Default for TimeSequencer {
    fn default() -> Self {
        Self::new(DEFAULT_WINDOW)
    }
}

impl TimeSequencer {
    /// An empty one that puts right what is out of order by up to `window` of the data's time.
    pub fn new(window: RobotDuration) -> Self {
        Self {
            window,
            max_wait: window,
            releases_late: false,
            buffered: ReorderBuffer::default(),
            suspects: Vec::new(),
            out: VecDeque::new(),
            period: ClockPeriod::default(),
            arrivals: 0,
            drops: DropCounts::default(),
            late_scans: 0,
        }
    }

    /// One for data that is mapped as it comes: items wait for older ones no longer than `max_wait`, and what comes later
    /// than that goes on out of order, for a vehicle must see; the order within each sequence holds.
    pub fn live(max_wait: RobotDuration) -> Self {
        Self {
            max_wait,
            releases_late: true,
            ..Self::default()
        }
    }

    /// The oldest stamp of what waits, unless it is one that was not believed, so far ahead that its time may never come.
    pub fn oldest_buffered_stamp(&self) -> Option<RobotTime> {
        let reach = self.period.newest? + self.window;
        self.buffered.oldest_stamp().filter(|first| *first <= reach)
    }

    /// Items up to `stamp`, which is one of `oldest_buffered_stamp`, wait no longer.
    pub fn release_until(&mut self, stamp: RobotTime) {
        while self
            .buffered
            .oldest_stamp()
            .is_some_and(|first| first <= stamp)
        {
            self.release_first();
        }
    }

    /// Takes the next measurement in file order.
    pub fn push(&mut self, measurement: Measurement) {
        if needs_no_order(&measurement) {
            self.out.push_back(Ordered::Measurement(measurement));
            return;
        }
        let arrival = self.arrivals;
        self.arrivals += 1;
        let sequence = self.sequence_of(&measurement);
        self.check_stamp(sequence, arrival, measurement);
        self.accept_suspects_in_reach();
        self.release();
    }

    /// The next item that is ready.
    pub fn pop(&mut self) -> Option<Ordered> {
        self.out.pop_front()
    }

    /// Gives back the item that [`TimeSequencer::pop`] gave last.
    pub fn put_back(&mut self, item: Ordered) {
        self.out.push_front(item);
    }

    /// The source has ended: nothing waits any longer.
    pub fn finish(&mut self) {
        let suspects = std::mem::take(&mut self.suspects);
        let (back, ahead): (Vec<_>, Vec<_>) =
            suspects.into_iter().partition(|s| s.step == Step::Back);
        for suspect in ahead {
            self.insert(suspect.arrival, suspect.measurement);
        }
        if let [first, _, ..] = &back[..] {
            // Two sequences agree.
            self.start_period(first.measurement.stamp);
            for suspect in back {
                self.insert(suspect.arrival, suspect.measurement);
            }
        } else {
            for suspect in back {
                self.drop_late(&suspect.measurement);
            }
        }
        self.release_all();
    }

    /// Drops so far.
    pub const fn drops(&self) -> &DropCounts {
        &self.drops
    }

    /// Scans among what was dropped as late.
    pub const fn late_scans(&self) -> u64 {
        self.late_scans
    }

    fn drop_late(&mut self, measurement: &Measurement) {
        self.drops.add(DropReason::Late);
        self.late_scans += u64::from(measurement.data.is_scan());
    }

    fn sequence_of(&self, measurement: &Measurement) -> StampSequence {
        let child = match &measurement.data {
            MeasurementData::Transform { child, .. } => Some(child.clone()),
            _ => None,
        };
        let stream = measurement.stream;
        let sequence = StampSequence { stream, child };
        if self.period.newest_of.len() < MAX_SEQUENCES
            || self.period.newest_of.contains_key(&sequence)
        {
            return sequence;
        }
        let child = sequence.child.map(|_| "".into());
        StampSequence { stream, child }
    }

    fn insert(&mut self, arrival: u64, measurement: Measurement) {
        if self
            .period
            .last_released
            .is_some_and(|last_released| measurement.stamp < last_released)
        {
            self.drop_late(&measurement);
            return;
        }
        self.buffered.insert(arrival, measurement);
    }

    fn start_period(&mut self, to: RobotTime) {
        self.release_all();
        let from = self
            .period
            .newest
            .max(self.period.last_released)
            .unwrap_or(to);
        self.out.push_back(Ordered::ClockReset { from, to });
        self.period = ClockPeriod::default();
    }

    fn release(&mut self) {
        let Some(newest) = self.period.newest else {
            return;
        };
        let until = newest - self.max_wait;
        while self.buffered.is_over_limit()
            || self.buffered.oldest_stamp().is_some_and(|s| s <= until)
        {
            self.release_first();
        }
    }

    fn release_all(&mut self) {
        while self.buffered.oldest_stamp().is_some() {
            self.release_first();
        }
    }

    fn release_first(&mut self) {
        if let Some(measurement) = self.buffered.pop_first() {
            self.period.last_released = Some(measurement.stamp);
            self.out.push_back(Ordered::Measurement(measurement));
        }
    }
}

const fn moves_clock(sequence: &StampSequence) -> bool {
    matches!(sequence, StampSequence { child: None, .. })
}

/// Measurements that need no order relative to others.
const fn needs_no_order(measurement: &Measurement) -> bool {
    let brings_its_pose = matches!(
        measurement.data,
        MeasurementData::Scan {
            own_pose: Some(_),
            ..
        }
    );
    measurement.is_static_transform() || brings_its_pose
}

impl TimeSequencer {
    /// Believes a measurement, or puts it aside.
    fn check_stamp(&mut self, sequence: StampSequence, arrival: u64, measurement: Measurement) {
        let step = self.step(&sequence, measurement.stamp);
        let suspect = self
            .suspects
            .iter()
            .position(|suspect| suspect.sequence == sequence)
            .map(|index| self.suspects.remove(index));
        let confirmed = suspect.as_ref().is_some_and(|suspect| suspect.step == step);
        if let Some(suspect) = suspect {
            match (suspect.step, confirmed) {
                (Step::Ahead, true) if measurement.stamp < suspect.measurement.stamp => {
                    self.accept(sequence.clone(), arrival, measurement);
                    let Suspect {
                        arrival,
                        measurement,
                        ..
                    } = suspect;
                    return self.check_stamp(sequence, arrival, measurement);
                }
                (Step::Ahead, true) => {
                    self.accept(sequence.clone(), suspect.arrival, suspect.measurement);
                    return self.check_stamp(sequence, arrival, measurement);
                }
                (Step::Back, true) => {
                    self.start_period(suspect.measurement.stamp);
                    let mut first = vec![suspect];
                    first.extend(self.suspects.extract_if(.., |s| s.step == Step::Back));
                    first.sort_unstable_by_key(|s| s.arrival);
                    for suspect in first {
                        self.accept(suspect.sequence, suspect.arrival, suspect.measurement);
                    }
                    return self.check_stamp(sequence, arrival, measurement);
                }
                (Step::Back, false) => self.drop_late(&suspect.measurement),
                // It keeps its place in the order but does not move the clock.
                (Step::Ahead | Step::Usual, _) => self.insert(suspect.arrival, suspect.measurement),
            }
        }
        if step == Step::Usual {
            self.accept(sequence, arrival, measurement);
        } else {
            self.suspects.push(Suspect {
                sequence,
                step,
                arrival,
                measurement,
            });
        }
    }

    fn step(&self, sequence: &StampSequence, stamp: RobotTime) -> Step {
        let newest_of_sequence = self.period.newest_of.get(sequence);
        if newest_of_sequence.is_some_and(|&newest| stamp < newest - self.window) {
            return Step::Back;
        }
        let is_ahead = |newest| stamp > newest + self.window;
        if moves_clock(sequence) && self.period.newest.is_some_and(is_ahead) {
            return Step::Ahead;
        }
        Step::Usual
    }

    fn accept(&mut self, sequence: StampSequence, arrival: u64, measurement: Measurement) {
        let stamp = measurement.stamp;
        if moves_clock(&sequence) {
            self.period.newest = self.period.newest.max(Some(stamp));
        }
        let newest_of_sequence = self.period.newest_of.entry(sequence).or_insert(stamp);
        let is_in_order = stamp >= *newest_of_sequence;
        *newest_of_sequence = stamp.max(*newest_of_sequence);
        if self.releases_late
            && is_in_order
            && self
                .period
                .last_released
                .is_some_and(|last_released| stamp < last_released)
        {
            self.out.push_back(Ordered::Measurement(measurement));
        } else {
            self.insert(arrival, measurement);
        }
    }

    /// Accepts suspects that are no longer ahead of the clock.
    fn accept_suspects_in_reach(&mut self) {
        let Some(newest) = self.period.newest else {
            return;
        };
        let reach = newest + self.window;
        while let Some(index) = self
            .suspects
            .iter()
            .position(|s| s.step == Step::Ahead && s.measurement.stamp <= reach)
        {
            let suspect = self.suspects.remove(index);
            self.accept(suspect.sequence, suspect.arrival, suspect.measurement);
        }
    }
}

const MAX_BUFFERED: usize = 20_000;

/// Limit on buffered heap bytes.
const MAX_BUFFERED_BYTES: usize = 128 << 20;

/// Measurements by stamp.
#[derive(Debug, Default)]
struct ReorderBuffer {
    /// By stamp and arrival, so equal stamps keep their order.
    items: BTreeMap<(RobotTime, u64), Measurement>,
    payload_bytes: usize,
}

impl ReorderBuffer {
    /// Takes the measurement that was the `arrival`-th to come.
    fn insert(&mut self, arrival: u64, measurement: Measurement) {
        self.payload_bytes += measurement.data.payload_bytes();
        self.items.insert((measurement.stamp, arrival), measurement);
    }

    fn oldest_stamp(&self) -> Option<RobotTime> {
        self.items.first_key_value().map(|((stamp, _), _)| *stamp)
    }

    fn pop_first(&mut self) -> Option<Measurement> {
        let (_, measurement) = self.items.pop_first()?;
        self.payload_bytes -= measurement.data.payload_bytes();
        Some(measurement)
    }

    /// Whether the oldest must leave although its time has not come.
    fn is_over_limit(&self) -> bool {
        self.items.len() > MAX_BUFFERED || self.payload_bytes > MAX_BUFFERED_BYTES
    }
}

#[cfg(test)]
mod tests;
