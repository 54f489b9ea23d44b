//! Recordings, simulated worlds and live sensors as one kind of source.

use std::collections::VecDeque;
use std::ops::ControlFlow;

use super::data_clock::DataClock;
use crate::driving::motors::SimulatedMotors;
use measurement::drops::DropCounts;
use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, MeasurementData, Stream};
use recording::time_sequencer::{Ordered, TimeSequencer};
use recording::{Position, RecordingError, RecordingReader};
use simulation::CommandedVelocity;
use simulation::SimulatedSource;
use teleop::Velocity;

/// What a source yields.
#[derive(Debug)]
pub(super) enum SourceItem {
    /// To be mapped when it is due.
    Timed(Ordered),
    /// To be mapped at once: what holds for all time, and poses from before the part that is replayed.
    Immediate(Measurement),
    /// Not to be mapped, for `--record` only.
    Unmapped(Measurement),
    /// To be mapped at once: it came, live.
    Live {
        /// What.
        ordered: Ordered,
        /// Since when it could have been known, on this machine's clock.
        measured_at: Monotonic,
    },
    /// There is no more at present.
    Idle,
}

/// What a source lost.
#[derive(Clone, Debug, Default)]
pub(super) struct SourceLosses {
    /// By reason.
    pub(super) counts: DropCounts,
    /// Scans among those that came too late to be put in order.
    pub(super) late_scans: u64,
    /// Stamps that contradicted the order of their stream and were changed.
    pub(super) stamp_repairs: u64,
    /// The first losses in words.
    pub(super) notes: Vec<String>,
}

/// Yields measurements in stamp order.
pub(super) trait Source: Send {
    /// The next item; `None` at the end.
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError>;

    /// The streams met so far, from number `from` on.
    fn streams_from(&self, from: usize) -> Vec<Stream>;

    /// How far reading has come; `None` where there is no end to come to.
    fn position(&self) -> Option<Position>;

    /// How much was lost so far.
    fn lost_total(&self) -> u64;

    /// What was lost so far.
    fn lost(&self) -> SourceLosses;
}

type Open = Box<dyn Fn() -> Result<Box<dyn RecordingReader>, RecordingError> + Send>;

/// A part of a recording, or all of it, once or over and over.
pub(super) struct ReplaySource {
    open: Open,
    range: Replay,
    reader: Box<dyn RecordingReader>,
    order: TimeSequencer,
    /// What is not mapped waits here for what is, so that a recording of both stays in order.
    unmapped: VecDeque<Measurement>,
    /// Mapped, and next behind the asides that go before it.
    pending: Option<SourceItem>,
    /// Nothing that is mapped comes any more.
    is_finished: bool,
    /// Runs from the first scan of the round.
    clock: DataClock,
    newest: RobotTime,
    earlier_loops: SourceLosses,
}

/// Asides that wait at most; beyond that the first goes ahead of its turn.
const MAX_UNMAPPED: usize = 10_000;

/// What is replayed.
#[derive(Clone, Debug)]
pub(super) struct Replay {
    /// Names of the streams that are mapped.
    pub(super) streams: Vec<String>,
    /// Whether scans are placed by the poses that the log gives them.
    pub(super) own_poses: bool,
    /// Scans before this are passed over, counted from the first.
    pub(super) start: RobotDuration,
    /// The replay ends this long behind its start.
    pub(super) duration: Option<RobotDuration>,
    /// Begin again at the end.
    pub(super) repeat: bool,
}

impl ReplaySource {
    /// What this round has lost so far, the first of it in words: where in the file, and what.
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

    /// From the beginning, as if nothing had been read.
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

    /// Time of the data from the first scan to the end of what is mapped. Reads all of it, and begins anew; a replay that
    /// repeats has no end.
    pub(super) fn length(&mut self) -> Result<RobotDuration, RecordingError> {
        while self.next()?.is_some() {}
        let length = self.clock.elapsed();
        self.restart()?;
        Ok(length)
    }

    /// Time of the data since the first scan of the round, up to the newest item.
    pub(super) const fn clock(&self) -> DataClock {
        self.clock
    }

    fn is_mapped(&self, measurement: &Measurement) -> bool {
        let stream = self.reader.streams().get(usize::from(measurement.stream.0));
        stream.is_some_and(|summary| self.range.streams.contains(&summary.stream.name))
    }

    /// What becomes of a measurement: nothing if it lies before the part that is replayed; the end of the
    /// round if it lies behind it.
    fn classify(&mut self, measurement: Measurement) -> ControlFlow<(), Option<SourceItem>> {
        if measurement.is_static_transform() {
            return ControlFlow::Continue(Some(SourceItem::Immediate(measurement)));
        }
        self.newest = self.newest.max(measurement.stamp);
        let is_scan = matches!(measurement.data, MeasurementData::Scan { .. });
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

    /// Poses before the start are needed for the first scans, but nobody waits for them.
    fn pose(&self, measurement: Measurement, elapsed: RobotDuration) -> SourceItem {
        if elapsed < self.range.start {
            SourceItem::Immediate(measurement)
        } else {
            SourceItem::Timed(Ordered::Measurement(measurement))
        }
    }

    /// Begins again at the beginning, unless the round had no scan to show.
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

    /// The next item that is mapped; asides that are met on the way are put aside.
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
            // What holds for all time goes first; a clock that starts anew and the end, last.
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
            // What lies before the part does not belong into a recording of it.
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

/// A simulated run, and the motors of its vehicle where somebody may drive it.
pub(super) struct SimulatedRun {
    pub(super) source: SimulatedSource,
    pub(super) motors: Option<SimulatedMotors>,
}

impl SimulatedRun {
    /// The vehicle does what its motors are told, from as soon as nothing has been measured yet.
    fn drive(&mut self) {
        let Some(motors) = &self.motors else { return };
        let at = self.source.frontier();
        let true_velocity = self.source.velocity(at);
        let command = motors.exchange(Velocity {
            linear_mps: true_velocity.forward_mps,
            angular_radps: true_velocity.turn_rate_radps,
        });
        let Velocity {
            linear_mps,
            angular_radps,
        } = command.velocity;
        let velocity = CommandedVelocity {
            linear_mps,
            angular_radps,
        };
        let stopped = if command.is_engaged && !self.source.is_driven() {
            self.source.take_over(at).map(drop)
        } else {
            Ok(())
        };
        // Never too far ahead: it is where measuring has come.
        if let Err(error) = stopped.and_then(|()| self.source.drive(at, velocity).map(drop)) {
            tracing::warn!(%error, "the simulated vehicle was not driven");
        }
    }
}

impl Source for SimulatedRun {
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        self.drive();
        Ok(self.source.next_measurement().map(|measurement| {
            if measurement.is_static_transform() {
                SourceItem::Immediate(measurement)
            } else {
                SourceItem::Timed(Ordered::Measurement(measurement))
            }
        }))
    }

    fn streams_from(&self, from: usize) -> Vec<Stream> {
        self.source.streams().iter().skip(from).cloned().collect()
    }

    fn position(&self) -> Option<Position> {
        None
    }

    fn lost_total(&self) -> u64 {
        0
    }

    fn lost(&self) -> SourceLosses {
        SourceLosses::default()
    }
}
