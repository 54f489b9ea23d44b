//! The pipeline's side of a run: takes batches, records, maps, shows progress.

use std::sync::Arc;

use super::data_clock::DataClock;
use super::event_log::EventLog;
use super::feed::Batch;
use super::network::Network;
use super::outputs::Trajectory;
use super::recorder::Recorder;
use super::source::Item;
use crate::clock::Monotonic;
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::{Measurement, Stream};
use crate::pipeline::Pipeline;
use crate::progress::{Progress, ProgressFigures};
use crate::recording::stamp_order::Ordered;
use crate::streaming::publisher::PublishError;

/// What takes the batches of a source.
pub(super) struct MappingSide {
    pub(super) pipeline: Pipeline,
    pub(super) network: Option<Network>,
    pub(super) recorder: Option<Recorder>,
    pub(super) trajectory: Trajectory,
    pub(super) progress: Progress,
    pub(super) clock: DataClock,
    pub(super) started: Monotonic,
    /// The source's streams, by number.
    pub(super) streams: Vec<Stream>,
    /// What happened on the way, for the summary.
    pub(super) events: EventLog,
}

impl MappingSide {
    /// Records and maps a batch.
    ///
    /// # Errors
    /// Where the recording cannot be written or publishing stopped.
    pub(super) fn take(&mut self, batch: Batch) -> anyhow::Result<()> {
        self.streams.extend(batch.new_streams);
        for item in batch.items {
            let trajectory = &mut self.trajectory;
            let network = self.network.as_ref();
            let mapped = |scan: &PosedScan| {
                trajectory.add(scan);
                if let Some(network) = network {
                    network.moved(scan);
                }
            };
            match item {
                Item::Due(Ordered::Measurement(measurement)) => {
                    record(&mut self.recorder, &self.streams, &measurement)?;
                    self.clock.see(measurement.stamp);
                    self.pipeline.push(measurement, mapped)?;
                }
                Item::Due(Ordered::ClockReset { from, .. }) => {
                    tracing::info!(%from, "the clock of the data started anew");
                    self.clock.reset();
                    if let Some(recorder) = &mut self.recorder {
                        recorder.reset_clock();
                    }
                    self.pipeline.reset_clock(mapped)?;
                }
                Item::AtOnce(measurement) => {
                    record(&mut self.recorder, &self.streams, &measurement)?;
                    self.pipeline.push(measurement, mapped)?;
                }
                Item::Aside(measurement) => {
                    record(&mut self.recorder, &self.streams, &measurement)?;
                }
            }
        }
        self.tell_network(batch.lost);
        let figures = ProgressFigures {
            data_s: self.clock.elapsed().as_secs_f64(),
            wall_s: self.started.elapsed().as_secs_f64(),
            scans: self.pipeline.report().scans_mapped,
            drops: batch.lost + self.pipeline.placer().counts().dropped_scans.total(),
        };
        self.progress.update(batch.position, &figures);
        Ok(())
    }

    /// The data has ended: maps what still waits.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn finish(&mut self, lost: u64) -> Result<(), PublishError> {
        let trajectory = &mut self.trajectory;
        let network = self.network.as_ref();
        let finished = self.pipeline.finish(|scan| {
            trajectory.add(scan);
            if let Some(network) = network {
                network.moved(scan);
            }
        });
        self.tell_network(lost);
        self.progress.finish();
        finished
    }

    fn tell_network(&mut self, lost: u64) {
        for happening in self.pipeline.take_happenings() {
            if let Some(network) = &self.network {
                network.tell(happening.kind, &happening.message);
            }
            self.events.add(happening);
        }
        if let Some(network) = &self.network
            && let Some((stamp, shores)) = self.pipeline.take_shores()
        {
            network.shores(stamp, Arc::new(shores));
        }
        match &self.network {
            Some(network) => network.update(&mut self.pipeline, &self.clock, lost),
            None => drop(self.pipeline.take_changed_tiles()),
        }
    }
}

fn record(
    recorder: &mut Option<Recorder>,
    streams: &[Stream],
    measurement: &Measurement,
) -> anyhow::Result<()> {
    let stream = streams.get(usize::from(measurement.stream.0));
    if let (Some(recorder), Some(stream)) = (recorder, stream) {
        recorder.write(stream, measurement)?;
    }
    Ok(())
}
