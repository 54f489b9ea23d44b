//! Recordings and simulated worlds as one kind of source.

use crate::drops::DropCounts;
use crate::measurement::{Measurement, MeasurementData, Stream};
use crate::recording::stamp_order::{Ordered, StampOrder};
use crate::recording::{Position, RecordingError, RecordingReader};
use crate::robot_time::{RobotDuration, RobotTime};
use crate::simulation::SimulatedSource;

/// Yields measurements in stamp order.
pub(super) trait Source: Send {
    /// The next item; `None` at the end.
    fn next(&mut self) -> Result<Option<Ordered>, RecordingError>;

    /// The streams met so far.
    fn streams(&self) -> Vec<Stream>;

    /// Whether the item that was yielded last is of the part that is asked for. What comes before is needed
    /// for its poses, but nobody waits for it.
    fn has_begun(&self) -> bool;

    /// How far reading has come; `None` where there is no end to come to.
    fn position(&self) -> Option<Position>;

    /// What the source itself lost, by reason, and the first of it in words.
    fn losses(&self) -> (DropCounts, Vec<String>);

    /// Stamps that contradicted the order of their stream and were changed to fit it.
    fn stamp_repairs(&self) -> u64;
}

/// A part of a recording, or all of it, once or over and over.
pub(super) struct Replayed {
    open: Box<dyn Fn() -> Result<Box<dyn RecordingReader>, RecordingError> + Send>,
    reader: Box<dyn RecordingReader>,
    order: StampOrder,
    part: Part,
    repeat: bool,
    first: Option<RobotTime>,
    has_begun: bool,
    /// What earlier rounds of a repeated replay lost.
    lost_before: DropCounts,
    /// The stamps they changed.
    repairs_before: u64,
}

/// Which part of a recording is replayed, counted from its first scan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// Scans before this are passed over.
    pub(super) start: RobotDuration,
    /// The replay ends this long behind its start.
    pub(super) duration: Option<RobotDuration>,
}

impl Replayed {
    pub(super) fn new(
        open: impl Fn() -> Result<Box<dyn RecordingReader>, RecordingError> + Send + 'static,
        part: Part,
        repeat: bool,
    ) -> Result<Self, RecordingError> {
        Ok(Self {
            reader: open()?,
            open: Box::new(open),
            order: StampOrder::default(),
            part,
            repeat,
            first: None,
            has_begun: part.begins_at_once(),
            lost_before: DropCounts::default(),
            repairs_before: 0,
        })
    }

    /// Begins again at the beginning: the clock of the data jumps back.
    fn rewind(&mut self, from: RobotTime, to: RobotTime) -> Result<Ordered, RecordingError> {
        self.lost_before.merge(self.reader.losses());
        self.lost_before.merge(self.order.drops());
        self.repairs_before += self.reader.stamp_repairs();
        self.reader = (self.open)()?;
        self.order = StampOrder::default();
        self.has_begun = self.part.begins_at_once();
        Ok(Ordered::ClockReset { from, to })
    }

    /// Whether a measurement belongs to the part that is replayed. Poses before it are needed for its
    /// first scans.
    fn place_in_part(&mut self, measurement: &Measurement) -> Place {
        let is_scan = matches!(measurement.data, MeasurementData::Scan { .. });
        if is_scan {
            self.first.get_or_insert(measurement.stamp);
        }
        let Some(first) = self.first else {
            return Place::Within;
        };
        let since_start = measurement.stamp.since(first + self.part.start);
        self.has_begun |= since_start >= RobotDuration::ZERO;
        if self
            .part
            .duration
            .is_some_and(|duration| since_start > duration)
        {
            Place::Behind
        } else if is_scan && since_start < RobotDuration::ZERO {
            Place::Before
        } else {
            Place::Within
        }
    }
}

impl Part {
    /// Whether it begins with the first measurement, of whatever kind.
    fn begins_at_once(self) -> bool {
        self.start == RobotDuration::ZERO
    }
}

enum Place {
    Before,
    Within,
    Behind,
}

impl Source for Replayed {
    fn next(&mut self) -> Result<Option<Ordered>, RecordingError> {
        let mut newest = None;
        loop {
            let reader = &mut self.reader;
            let item = self.order.next_from(|| reader.next_measurement())?;
            let place = match &item {
                Some(Ordered::Measurement(measurement)) => {
                    newest = Some(measurement.stamp);
                    self.place_in_part(measurement)
                }
                Some(Ordered::ClockReset { .. }) => Place::Within,
                None => Place::Behind,
            };
            match (place, self.first) {
                (Place::Before, _) => {}
                (Place::Within, _) => return Ok(item),
                // A recording without a single scan would turn for ever.
                (Place::Behind, Some(first)) if self.repeat => {
                    return self.rewind(newest.unwrap_or(first), first).map(Some);
                }
                (Place::Behind, _) => return Ok(None),
            }
        }
    }

    fn streams(&self) -> Vec<Stream> {
        self.reader
            .streams()
            .iter()
            .map(|summary| summary.stream.clone())
            .collect()
    }

    fn has_begun(&self) -> bool {
        self.has_begun
    }

    fn position(&self) -> Option<Position> {
        (!self.repeat).then(|| self.reader.position())
    }

    fn losses(&self) -> (DropCounts, Vec<String>) {
        let mut losses = self.lost_before.clone();
        losses.merge(self.reader.losses());
        losses.merge(self.order.drops());
        (losses, self.reader.loss_notes().to_vec())
    }

    fn stamp_repairs(&self) -> u64 {
        self.repairs_before + self.reader.stamp_repairs()
    }
}

/// A simulated run.
pub(super) struct Simulated(pub(super) SimulatedSource);

impl Source for Simulated {
    fn next(&mut self) -> Result<Option<Ordered>, RecordingError> {
        Ok(self.0.next_measurement().map(Ordered::Measurement))
    }

    fn streams(&self) -> Vec<Stream> {
        self.0.streams().to_vec()
    }

    fn has_begun(&self) -> bool {
        true
    }

    fn position(&self) -> Option<Position> {
        None
    }

    fn losses(&self) -> (DropCounts, Vec<String>) {
        (DropCounts::default(), Vec::new())
    }

    fn stamp_repairs(&self) -> u64 {
        0
    }
}
