//! Recordings, simulated worlds and live sensors as one kind of source.

use std::collections::VecDeque;
use std::ops::ControlFlow;

use measurement::drops::DropCounts;
use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, MeasurementData, Stream};
use recording::time_sequencer::{Ordered, TimeSequencer};
use recording::{Position, RecordingError, RecordingReader};

#[derive(Debug)]
pub(super) enum SourceItem {
    /// To be mapped at its stamp, as far as the rate says.
    Timed(Ordered),
    /// To be mapped at once: static transforms, and poses before the replayed part.
    Immediate(Measurement),
    /// Not mapped; for `--record` only.
    Unmapped(Measurement),
    /// A live measurement, to be mapped at once.
    Live {
        ordered: Ordered,
        /// The earliest time at which it could have been received.
        measured_at: Monotonic,
    },
    /// Nothing is available at present.
    Idle,
}

#[derive(Clone, Debug, Default)]
pub(super) struct SourceLosses {
    pub(super) counts: DropCounts,
    /// Scans that arrived too late to be ordered.
    pub(super) late_scans: u64,
    /// Stamps that contradicted the order of their stream and were corrected.
    pub(super) stamp_repairs: u64,
    /// The first losses, one sentence each.
    pub(super) notes: Vec<String>,
}

/// Yields measurements in the order of their stamps.
pub(super) trait Source: Send {
    /// The next item; `None` at the end.
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError>;

    /// The streams known so far, from number `from` on.
    fn streams_from(&self, from: usize) -> Vec<Stream>;

    /// The reading position; `None` if the source has no end.
    fn position(&self) -> Option<Position>;

    fn lost_total(&self) -> u64;

    fn lost(&self) -> SourceLosses;
}

type Open = Box<dyn Fn() -> Result<Box<dyn RecordingReader>, RecordingError> + Send>;

/// A part of a recording, or all of it, once or in a loop.
pub(super) struct ReplaySource {
    open: Open,
    range: Replay,
    reader: Box<dyn RecordingReader>,
    order: TimeSequencer,
    /// Measurements that are not mapped wait here for mapped ones, so that a recording of both is in order.
    unmapped: VecDeque<Measurement>,
    /// The next mapped item, which waits for unmapped ones with earlier stamps.
    pending: Option<SourceItem>,
    is_finished: bool,
    /// Starts at the first scan of the loop.
    clock: DataClock,
    newest: RobotTime,
    earlier_loops: SourceLosses,
}

/// Maximum length of `unmapped`; beyond it, the first one is released out of order.
const MAX_UNMAPPED: usize = 10_000;

#[derive(Clone, Debug)]
pub(super) struct Replay {
    /// Names of the mapped streams.
    pub(super) streams: Vec<String>,
    /// Whether scans are registered with the poses in the log.
    pub(super) own_poses: bool,
    /// Scans before this time since the first scan are skipped.
    pub(super) start: RobotDuration,
    /// Duration of the replay from `start`.
    pub(super) duration: Option<RobotDuration>,
    /// Restart at the end.
    pub(super) repeat: bool,
}

impl ReplaySource {
    /// The first losses of this loop: position in the file and reason.
    pub(super) fn loss_notes(&self) -> &[String] {
        self.reader.loss_notes()
    }

    pub(super) fn new(open: Open, range: Replay) -> Result<Self, RecordingError> {
        Ok(Self {
            reader: open()?,
            open,
            range,
            order: TimeSequencer::default(),
            unmapped: VecDeque::new(),
            pending: None,
            is_finished: false,
            clock: DataClock::default(),
            newest: RobotTime::MIN,
            earlier_loops: SourceLosses::default(),
        })
    }

    /// Restarts at the beginning, without history.
    pub(super) fn restart(&mut self) -> Result<(), RecordingError> {
        self.reader = (self.open)()?;
        self.order = TimeSequencer::default();
        self.unmapped.clear();
        self.pending = None;
        self.is_finished = false;
        self.clock = DataClock::default();
        self.newest = RobotTime::MIN;
        self.earlier_loops = SourceLosses::default();
        Ok(())
    }

    /// Time of the data from the first scan to the last mapped item. Reads all of it, and restarts; a replay in a
    /// loop has no end.
    pub(super) fn length(&mut self) -> Result<RobotDuration, RecordingError> {
        while self.next()?.is_some() {}
        let length = self.clock.elapsed();
        self.restart()?;
        Ok(length)
    }

    /// Time of the data since the first scan of the loop.
    pub(super) const fn clock(&self) -> DataClock {
        self.clock
    }

    fn is_mapped(&self, measurement: &Measurement) -> bool {
        let stream = self.reader.streams().get(usize::from(measurement.stream.0));
        stream.is_some_and(|summary| self.range.streams.contains(&summary.stream.name))
    }

    /// `Continue(None)`: the measurement is before the replayed part. `Break`: it is after it, so that the loop
    /// ends.
    fn classify(&mut self, measurement: Measurement) -> ControlFlow<(), Option<SourceItem>> {
        if measurement.is_static_transform() {
            return ControlFlow::Continue(Some(SourceItem::Immediate(measurement)));
        }
        self.newest = self.newest.max(measurement.stamp);
        let is_scan = measurement.data.is_scan();
        if !is_scan && !self.clock.has_started() {
            return ControlFlow::Continue(Some(self.pose(measurement, RobotDuration::ZERO)));
        }
        let elapsed = self.clock.advance(measurement.stamp);
        if self
            .range
            .duration
            .is_some_and(|duration| elapsed > self.range.start + duration)
        {
            ControlFlow::Break(())
        } else if !is_scan {
            ControlFlow::Continue(Some(self.pose(measurement, elapsed)))
        } else if elapsed < self.range.start {
            ControlFlow::Continue(None)
        } else {
            ControlFlow::Continue(Some(SourceItem::Timed(Ordered::Measurement(measurement))))
        }
    }

    /// Poses before the start are needed for the first scans, without pacing.
    fn pose(&self, measurement: Measurement, elapsed: RobotDuration) -> SourceItem {
        if elapsed < self.range.start {
            SourceItem::Immediate(measurement)
        } else {
            SourceItem::Timed(Ordered::Measurement(measurement))
        }
    }

    /// Restarts at the beginning, unless the loop had no scan.
    fn next_loop(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        if !self.range.repeat
            || self.clock.elapsed() < self.range.start
            || !self.clock.has_started()
        {
            return Ok(None);
        }
        let from = self.newest;
        self.earlier_loops = self.lost();
        self.reader = (self.open)()?;
        self.order = TimeSequencer::default();
        self.clock = DataClock::default();
        self.newest = RobotTime::MIN;
        Ok(Some(SourceItem::Timed(Ordered::ClockReset {
            from,
            to: RobotTime::MIN,
        })))
    }

    /// The next mapped item; unmapped ones are put into `unmapped`.
    fn next_mapped(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        loop {
            if let Some(ordered) = self.order.pop() {
                match ordered {
                    Ordered::Measurement(measurement) => {
                        let stamp = measurement.stamp;
                        match self.classify(measurement) {
                            ControlFlow::Continue(Some(item)) => return Ok(Some(item)),
                            ControlFlow::Continue(None) => continue,
                            ControlFlow::Break(()) => {
                                self.unmapped
                                    .retain(|measurement| measurement.stamp < stamp);
                                return self.next_loop();
                            }
                        }
                    }
                    reset @ Ordered::ClockReset { .. } => {
                        self.clock.reset();
                        self.newest = RobotTime::MIN;
                        return Ok(Some(SourceItem::Timed(reset)));
                    }
                }
            }
            match self.reader.next_measurement()? {
                Some(measurement) if !self.is_mapped(&measurement) => {
                    self.unmapped.push_back(measurement);
                    if self.unmapped.len() > MAX_UNMAPPED {
                        return Ok(self.unmapped.pop_front().map(SourceItem::Unmapped));
                    }
                }
                Some(mut measurement) => {
                    if let MeasurementData::Scan { own_pose, .. } = &mut measurement.data
                        && !self.range.own_poses
                    {
                        *own_pose = None;
                    }
                    self.order.push(measurement);
                }
                None => {
                    self.order.finish();
                    match self.order.pop() {
                        Some(ordered) => self.order.put_back(ordered),
                        None => return self.next_loop(),
                    }
                }
            }
        }
    }
}

impl Source for ReplaySource {
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        if self.pending.is_none() && !self.is_finished {
            self.pending = self.next_mapped()?;
            self.is_finished = self.pending.is_none();
        }
        let due_stamp = match &self.pending {
            Some(SourceItem::Timed(Ordered::Measurement(measurement))) => measurement.stamp,
            Some(SourceItem::Immediate(pose)) if !pose.is_static_transform() => pose.stamp,
            // Static transforms go first; a clock reset and the end go last.
            Some(
                SourceItem::Immediate(_)
                | SourceItem::Unmapped(_)
                | SourceItem::Live { .. }
                | SourceItem::Idle,
            ) => RobotTime::MIN,
            Some(SourceItem::Timed(Ordered::ClockReset { .. })) | None => RobotTime::MAX,
        };
        let is_due = |measurement: &Measurement| measurement.stamp <= due_stamp;
        while self.unmapped.front().is_some_and(is_due) {
            let measurement = self.unmapped.pop_front().map(SourceItem::Unmapped);
            // Measurements before the replayed part are not recorded.
            if self.clock.elapsed() >= self.range.start {
                return Ok(measurement);
            }
        }
        Ok(self.pending.take())
    }

    fn streams_from(&self, from: usize) -> Vec<Stream> {
        let streams = self.reader.streams().iter().skip(from);
        streams.map(|summary| summary.stream.clone()).collect()
    }

    fn position(&self) -> Option<Position> {
        (!self.range.repeat).then(|| self.reader.position())
    }

    fn lost_total(&self) -> u64 {
        self.earlier_loops.counts.total()
            + self.reader.losses().total()
            + self.order.drops().total()
    }

    fn lost(&self) -> SourceLosses {
        let mut lost = self.earlier_loops.clone();
        lost.counts.merge(self.reader.losses());
        lost.counts.merge(self.order.drops());
        lost.late_scans += self.order.late_scans();
        lost.stamp_repairs += self.reader.stamp_repairs();
        if lost.notes.is_empty() {
            lost.notes = self.reader.loss_notes().to_vec();
        }
        lost
    }
}

/// Elapsed time of the data, across clock resets: sums the steps between stamps; backward steps count as zero.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DataClock {
    newest: Option<RobotTime>,
    elapsed: RobotDuration,
}

impl DataClock {
    /// Advances to `stamp` and returns the time since the first one.
    pub(super) fn advance(&mut self, stamp: RobotTime) -> RobotDuration {
        let newest = *self.newest.get_or_insert(stamp);
        if stamp > newest {
            self.elapsed = self.elapsed + stamp.since(newest);
            self.newest = Some(stamp);
        }
        self.elapsed
    }

    /// Keeps the elapsed time at a clock reset.
    pub(super) const fn reset(&mut self) {
        self.newest = None;
    }

    /// The elapsed time at `stamp`, which is before the newest one.
    pub(super) fn at(&self, stamp: RobotTime) -> RobotDuration {
        let Some(newest) = self.newest else {
            return self.elapsed;
        };
        let before = newest.since(stamp).max(RobotDuration::ZERO);
        let nanos = self.elapsed.as_nanos().saturating_sub(before.as_nanos());
        RobotDuration::from_nanos(nanos.max(0))
    }

    pub(super) const fn has_started(&self) -> bool {
        self.newest.is_some()
    }

    pub(super) const fn elapsed(&self) -> RobotDuration {
        self.elapsed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_adds_up_over_clocks() {
        let at = |ms: i64| RobotTime::from_nanos(ms * 1_000_000);
        let mut clock = DataClock::default();
        for ms in [500_000, 500_100, 500_050, 500_200] {
            clock.advance(at(ms));
        }
        clock.reset();
        for ms in [0, 100] {
            clock.advance(at(ms));
        }
        assert_eq!(clock.elapsed(), RobotDuration::from_millis(300));
        for (stamp_ms, elapsed_ms) in [(100, 300), (40, 240), (900, 300), (-1000, 0)] {
            assert_eq!(
                clock.at(at(stamp_ms)),
                RobotDuration::from_millis(elapsed_ms)
            );
        }
    }
}
