//! The pipeline's side of a run: takes batches, records, maps, shows progress.

use std::sync::Arc;
use std::time::Duration;

use protocol::message::RecordingStatus;

use super::data_clock::DataClock;
use super::event_log::EventLog;
use super::feed::Batch;
use super::live_recording::{LiveRecording, Problem};
use super::network::Network;
use super::recorder::Recorder;
use super::source::Item;
use crate::clock::Monotonic;
use crate::config::Config;
use crate::keeping_up::{Change, KeepingUp};
use crate::localization::placer::PlacerSettings;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::{Measurement, Stream};
use crate::pipeline::{Checkpoint, Happening, Pipeline, ScanObserver, Standstill};
use crate::progress::{Progress, ProgressFigures};
use crate::recording::stamp_order::Ordered;
use crate::recording::writer::WriteError;
use crate::replay_control::{Mark, ReplayControl};
use crate::robot_time::RobotTime;
use crate::streaming::publisher::PublishError;
use crate::streaming::trajectory::SharedTrajectory;

/// What takes the batches of a source.
pub(super) struct MappingSide {
    pub(super) pipeline: Pipeline,
    pub(super) network: Option<Network>,
    pub(super) recorder: Option<Recorder>,
    /// What records when operators want it.
    pub(super) live: Option<LiveRecording>,
    /// Why it ended by itself, as far as that was told.
    pub(super) told_problem: Option<Problem>,
    /// Why recording has ended before the run.
    pub(super) not_recorded: Option<WriteError>,
    /// Somebody may drive the vehicle.
    pub(super) is_driven: bool,
    pub(super) trajectory: SharedTrajectory,
    pub(super) progress: Progress,
    pub(super) clock: DataClock,
    pub(super) started: Monotonic,
    /// The source's streams, by number.
    pub(super) streams: Vec<Stream>,
    /// What happened on the way, for the summary.
    pub(super) events: EventLog,
    pub(super) keeping_up: KeepingUp,
    /// Where a replay can be wound: what happens again is not told again.
    pub(super) marking: Option<Marking>,
}

/// Marks what happens on the time line of a replay.
pub(super) struct Marking {
    pub(super) control: ReplayControl,
    /// Time of the data since the first scan.
    pub(super) clock: DataClock,
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
        self.look_whether_it_keeps_up(batch.late, batch.came, &batch.items);
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

    /// Tells consoles where this machine does not keep up: whoever drives would see the past.
    fn look_whether_it_keeps_up(
        &mut self,
        late: Option<Duration>,
        came: Monotonic,
        items: &[Item],
    ) {
        let now = Monotonic::now();
        let live = items.iter().find_map(|item| match item {
            // Of some nobody knows when they came.
            Item::Came { taken, .. } => (*taken > Monotonic::default()).then(|| now.since(*taken)),
            Item::Due(_) | Item::AtOnce(_) | Item::Aside(_) | Item::Pause => None,
        });
        let Some(late) = live.or_else(|| Some(late? + now.since(came))) else {
            return;
        };
        let Some(network) = &self.network else { return };
        match self.keeping_up.look(late, now) {
            Some(Change::Behind(late)) => {
                let late_s = late.as_secs_f64();
                let message =
                    format!("The robot's machine does not keep up: maps are {late_s:.1} s behind");
                tracing::warn!(message);
                network.tell("too_slow", &message);
            }
            Some(Change::Up) => network.tell("keeps_up", "The robot's machine keeps up again"),
            None => {}
        }
    }

    fn push(&mut self, measurement: Measurement) -> Result<(), PublishError> {
        let watch = Watch {
            trajectory: &self.trajectory,
            network: self.network.as_mut(),
            marking: self.marking.as_ref(),
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
                let elapsed = self.clock.see(measurement.stamp);
                if let Some(network) = &mut self.network {
                    network.came(&measurement, came, elapsed);
                }
                self.push(measurement)?;
                self.tell_newest_pose();
            }
            Ordered::ClockReset { from, to } => {
                tracing::info!(%from, "the clock of the data started anew");
                self.clock.reset();
                if let Some(live) = &mut self.live {
                    live.reset_clock();
                }
                if let Some(recorder) = &mut self.recorder {
                    recorder.reset_clock();
                }
                let mapped = self.pipeline.reset_clock(Watch {
                    trajectory: &self.trajectory,
                    network: self.network.as_mut(),
                    marking: self.marking.as_ref(),
                });
                // Scans that waited tell where the vehicle was by the clock of before.
                if let Some(network) = &mut self.network {
                    network.reset_clock(to == RobotTime::MIN);
                }
                mapped?;
            }
        }
        Ok(())
    }

    fn tell_newest_pose(&mut self) {
        if let Some(network) = &mut self.network
            && let Some(pose) = self.pipeline.placer().newest_pose()
        {
            network.moved(pose);
        }
    }

    /// The data has ended: maps what still waits.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn finish(&mut self, lost: u64) -> Result<(), PublishError> {
        let finished = self.pipeline.finish(Watch {
            trajectory: &self.trajectory,
            network: self.network.as_mut(),
            marking: self.marking.as_ref(),
        });
        self.tell_newest_pose();
        self.tell_network(lost);
        self.progress.finish();
        finished
    }

    /// Publishes the maps as if the data ended here; `lost` by the source so far.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn stand_still(&mut self, lost: u64) -> Result<Standstill, PublishError> {
        let trajectory = &self.trajectory;
        let of_those_that_wait = |scan: &PosedScan| trajectory.lock().add_standing(scan);
        let mut standstill = self.pipeline.stand_still(of_those_that_wait)?;
        if let Some(network) = &mut self.network {
            if let Some((stamp, shores)) = standstill.shores.take() {
                network.shores(stamp, Arc::new(shores));
            }
            if let Some(pose) = standstill.newest_pose {
                network.moved(pose);
            }
        }
        self.tell_network(lost);
        Ok(standstill)
    }

    /// Takes back what was published for a standstill: the data goes on.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn go_on(&mut self, standstill: Standstill) -> Result<(), PublishError> {
        let mut trajectory = self.trajectory.lock();
        let scans = trajectory.scans();
        trajectory.wind(scans);
        drop(trajectory);
        self.pipeline.go_on(standstill)
    }

    /// The data begins anew, and with it the maps.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn begin_anew(
        &mut self,
        config: &Config,
        placer: PlacerSettings,
    ) -> Result<(), PublishError> {
        self.pipeline.begin_anew(config, placer)?;
        self.trajectory.lock().wind(0);
        self.clock = DataClock::default();
        self.streams.clear();
        if let Some(network) = &mut self.network {
            network.wind(&self.pipeline, self.clock.elapsed());
        }
        Ok(())
    }

    /// The data goes on where the maps were copied, so many scans from its beginning, and the clock of this side with them.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn go_back(
        &mut self,
        maps: &Checkpoint,
        clock: DataClock,
        scans: u64,
    ) -> Result<(), PublishError> {
        self.pipeline.go_back(maps)?;
        self.trajectory.lock().wind(scans);
        self.clock = clock;
        self.streams.clear();
        if let Some(network) = &mut self.network {
            network.wind(&self.pipeline, self.clock.elapsed());
            if let Some((stamp, shores)) = self.pipeline.known_shores() {
                network.shores(stamp, Arc::new(shores));
            }
        }
        Ok(())
    }

    /// Starts and stops what operators record, and says how it is going.
    fn serve_recording(&mut self) -> Option<RecordingStatus> {
        let (Some(live), Some(network)) = (&mut self.live, &self.network) else {
            return None;
        };
        if let Some(is_wanted) = network.take_recording_wish() {
            live.record(is_wanted);
        }
        let state = live.state();
        network.show_recording(state.is_running);
        let status = state.status();
        if self.told_problem != state.problem {
            if let Some(problem) = &state.problem {
                network.tell("recording_stopped", &problem.what);
            }
            self.told_problem = state.problem;
        }
        Some(status)
    }

    /// Gives consoles the octree's files that they asked for, while nothing is mapped.
    pub(super) fn serve_voxels(&self) {
        if let Some(network) = &self.network {
            network.serve_voxels(&self.pipeline, true);
        }
    }

    fn tell_network(&mut self, lost: u64) {
        let recording = self.serve_recording();
        for happening in self.pipeline.take_happenings() {
            let is_new = self
                .marking
                .as_ref()
                .is_none_or(|marking| marking.mark(&happening));
            if !is_new {
                continue;
            }
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
        match &mut self.network {
            Some(network) => network.update(&mut self.pipeline, &self.clock, lost, recording),
            None => drop(self.pipeline.take_changed_tiles()),
        }
    }
}

impl Marking {
    /// Whether this did not happen in an earlier round.
    fn mark(&self, happening: &Happening) -> bool {
        self.control.mark(Mark {
            at: self.clock.at(happening.stamp),
            kind: happening.kind,
            message: happening.message.clone(),
        })
    }
}

/// What is told of scans as they pass.
struct Watch<'a> {
    trajectory: &'a SharedTrajectory,
    network: Option<&'a mut Network>,
    marking: Option<&'a Marking>,
}

impl ScanObserver for Watch<'_> {
    fn placed(&mut self, scan: &PosedScan, mapper: &Mapper) {
        if let Some(network) = &mut self.network {
            network.placed(scan, mapper);
        }
    }

    fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper) {
        self.trajectory.lock().add(scan);
        if let Some(marking) = self.marking {
            let position_m = scan.odom_from_base.translation.vector;
            marking.control.pass([position_m.x, position_m.y]);
        }
        if let Some(network) = &mut self.network {
            network.mapped(scan, mapper);
        }
    }
}

#[cfg(test)]
mod tests;
