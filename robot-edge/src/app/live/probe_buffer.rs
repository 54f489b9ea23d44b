//! What came while it was looked for, as a recording, so that what is mapped is decided as for a replay.

use std::path::Path;

use crate::survey::Survey;
use measurement::Measurement;
use measurement::drops::DropCounts;
use recording::{Format, Position, RecordingError, RecordingReader, StreamSummary};

/// Measurements of some seconds.
pub(super) struct ProbeBuffer<'a> {
    pub(super) measurements: std::collections::vec_deque::Iter<'a, Measurement>,
    pub(super) streams: &'a [StreamSummary],
    pub(super) losses: &'a DropCounts,
    pub(super) loss_notes: &'a [String],
}

impl ProbeBuffer<'_> {
    /// What is in it; errors name it by `place`.
    ///
    /// # Errors
    /// None.
    pub(super) fn survey(mut self, place: &str) -> Result<Survey, RecordingError> {
        // They are ROS 2's messages in CDR, and say as much as those in an MCAP file.
        Survey::of_reader(Path::new(place), Format::Mcap, &mut self)
    }
}

impl RecordingReader for ProbeBuffer<'_> {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        Ok(self.measurements.next().cloned())
    }

    fn streams(&self) -> &[StreamSummary] {
        self.streams
    }

    fn losses(&self) -> &DropCounts {
        self.losses
    }

    fn loss_notes(&self) -> &[String] {
        self.loss_notes
    }

    fn position(&self) -> Position {
        Position {
            bytes_read: 0,
            bytes_total: 0,
        }
    }
}
