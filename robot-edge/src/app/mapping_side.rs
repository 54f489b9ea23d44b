//! The pipeline's side of a run: takes batches, records, maps, shows progress.

use std::sync::Arc;

use super::data_clock::DataClock;
use super::event_log::EventLog;
use super::feed::Batch;
use super::live_recording::LiveRecording;
use super::network::Network;
use super::outputs::Trajectory;
use super::recorder::Recorder;
use super::source::Item;
use crate::clock::Monotonic;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::{Measurement, Stream};
use crate::pipeline::{Pipeline, ScanObserver};
use crate::progress::{Progress, ProgressFigures};
use crate::recording::stamp_order::Ordered;
use crate::recording::writer::WriteError;
use crate::streaming::publisher::PublishError;

/// What takes the batches of a source.
pub(super) struct MappingSide {
    pub(super) pipeline: Pipeline,
    pub(super) network: Option<Network>,
    pub(super) recorder: Option<Recorder>,
    /// What records when operators want it.
    pub(super) live: Option<LiveRecording>,
    /// Why it ended by itself, as far as that was told.
    pub(super) told_problem: Option<String>,
    /// Why recording has ended before the run.
    pub(super) not_recorded: Option<WriteError>,
    /// Somebody may drive the vehicle.
    pub(super) is_driven: bool,
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
        if let Some(live) = &mut self.live {
            live.add_streams(&batch.new_streams);
        }
        self.streams.extend(batch.new_streams);
        for item in batch.items {
            match item {
                Item::Due(ordered) => self.take_ordered(ordered, batch.came)?,
                Item::Came { ordered, taken } => self.take_ordered(ordered, taken)?,
                Item::AtOnce(measurement) => {
                    self.record(&measurement)?;
                    self.push(measurement)?;
                }
                Item::Aside(measurement) => {
                    self.record(&measurement)?;
                }
                Item::Pause => {}
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

    fn push(&mut self, measurement: Measurement) -> Result<(), PublishError> {
        let watch = Watch {
            trajectory: &mut self.trajectory,
            network: self.network.as_mut(),
        };
        self.pipeline.push(measurement, watch)
    }

    /// Records a measurement. Whoever drives goes on doing so where the disk is full: recording ends, with an alarm, and
    /// the run says so when it ends.
    fn record(&mut self, measurement: &Measurement) -> Result<(), WriteError> {
        if let Some(live) = &mut self.live {
            live.add(measurement);
        }
        let stream = self.streams.get(usize::from(measurement.stream.0));
        let (Some(recorder), Some(stream)) = (&mut self.recorder, stream) else {
            return Ok(());
        };
        let Err(error) = recorder.write(stream, measurement) else {
            return Ok(());
        };
        if !self.is_driven {
            return Err(error);
        }
        self.recorder = None;
        tracing::error!(%error, "recording ends; driving goes on");
        if let Some(network) = &self.network {
            network.tell("recording_stopped", &error.to_string());
        }
        self.not_recorded = Some(error);
        Ok(())
    }

    /// Records and maps what could be known since `came`.
    fn take_ordered(&mut self, ordered: Ordered, came: Monotonic) -> anyhow::Result<()> {
        match ordered {
            Ordered::Measurement(measurement) => {
                self.record(&measurement)?;
                self.clock.see(measurement.stamp);
                if let Some(network) = &mut self.network {
                    network.came(measurement.stamp, came);
                }
                self.push(measurement)?;
                if let Some(network) = &mut self.network
                    && let Some(pose) = self.pipeline.placer().newest_pose()
                {
                    network.moved(pose);
                }
            }
            Ordered::ClockReset { from, .. } => {
                tracing::info!(%from, "the clock of the data started anew");
                self.clock.reset();
                if let Some(network) = &mut self.network {
                    network.reset_clock();
                }
                if let Some(live) = &mut self.live {
                    live.reset_clock();
                }
                if let Some(recorder) = &mut self.recorder {
                    recorder.reset_clock();
                }
                self.pipeline.reset_clock(Watch {
                    trajectory: &mut self.trajectory,
                    network: self.network.as_mut(),
                })?;
            }
        }
        Ok(())
    }

    /// The data has ended: maps what still waits.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn finish(&mut self, lost: u64) -> Result<(), PublishError> {
        let finished = self.pipeline.finish(Watch {
            trajectory: &mut self.trajectory,
            network: self.network.as_mut(),
        });
        self.tell_network(lost);
        self.progress.finish();
        finished
    }

    /// Starts and stops what operators record, and says how it is going.
    fn serve_recording(&mut self) {
        let (Some(live), Some(network)) = (&mut self.live, &self.network) else {
            return;
        };
        if let Some(is_wanted) = network.take_recording_wish() {
            live.record(is_wanted);
        }
        let state = live.state();
        network.show_recording(state.is_running);
        if self.told_problem != state.problem {
            if let Some(problem) = &state.problem {
                network.tell("recording_stopped", problem);
            }
            self.told_problem = state.problem;
        }
    }

    fn tell_network(&mut self, lost: u64) {
        self.serve_recording();
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

/// What is told of scans as they pass.
struct Watch<'a> {
    trajectory: &'a mut Trajectory,
    network: Option<&'a mut Network>,
}

impl ScanObserver for Watch<'_> {
    fn placed(&mut self, scan: &PosedScan, mapper: &Mapper) {
        if let Some(network) = &mut self.network {
            network.placed(scan, mapper);
        }
    }

    fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper) {
        self.trajectory.add(scan);
        if let Some(network) = &mut self.network {
            network.mapped(scan, mapper);
        }
    }
}
