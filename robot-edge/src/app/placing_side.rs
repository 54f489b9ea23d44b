//! The first stage of a run: takes batches, records, places scans, and tells at once what cannot wait for a map.

use protocol::message::RecordingStatus;

use super::data_clock::DataClock;
use super::feed::Batch;
use super::live_recording::{LiveRecording, Problem};
use super::map_figures::SharedMapFigures;
use super::network::Herald;
use super::recorder::Recorder;
use super::source::Item;
use super::step::{Lateness, Step};
use crate::clock::Monotonic;
use crate::localization::placer::{BeamPlacer, Placed};
use crate::measurement::{Measurement, Stream};
use crate::progress::{Progress, ProgressFigures};
use crate::recording::stamp_order::Ordered;
use crate::recording::writer::WriteError;
use crate::robot_time::RobotTime;
use crate::summary::StageTimer;

/// What takes the batches of a source.
pub(super) struct PlacingSide {
    pub(super) placer: BeamPlacer,
    /// Time spent in placing, per measurement.
    pub(super) time: StageTimer,
    /// Kept for its memory.
    pub(super) placed: Vec<Placed>,
    pub(super) herald: Option<Herald>,
    pub(super) recorder: Option<Recorder>,
    /// What records when operators want it.
    pub(super) live: Option<LiveRecording>,
    /// Why it ended by itself, as far as that was told.
    pub(super) told_problem: Option<Problem>,
    /// Why recording has ended before the run.
    pub(super) not_recorded: Option<WriteError>,
    /// Somebody may drive the vehicle.
    pub(super) is_driven: bool,
    pub(super) progress: Progress,
    pub(super) clock: DataClock,
    pub(super) started: Monotonic,
    /// The source's streams, by number.
    pub(super) streams: Vec<Stream>,
    /// Of the mapping side.
    pub(super) maps: SharedMapFigures,
}

/// What became of the recording that was asked for, if one was.
pub(super) struct Recorded {
    /// How it differs from what came in, in words.
    pub(super) notes: Vec<String>,
    /// Why it is not whole.
    pub(super) result: Result<(), WriteError>,
}

impl PlacingSide {
    /// Records and places a batch; what is to be mapped is handed over step by step.
    ///
    /// # Errors
    /// Where the recording cannot be written, and whatever stops `hand_over`.
    pub(super) fn take(
        &mut self,
        batch: Batch,
        hand_over: &mut impl FnMut(Step) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let lateness = Lateness::of(&batch);
        if let Some(live) = &mut self.live {
            live.add_streams(&batch.new_streams);
        }
        self.streams.extend(batch.new_streams);
        for item in batch.items {
            match item {
                Item::Due(ordered) => self.take_ordered(ordered, batch.came, hand_over)?,
                Item::Came { ordered, taken } => self.take_ordered(ordered, taken, hand_over)?,
                Item::AtOnce(measurement) => {
                    self.record(&measurement)?;
                    self.place(measurement);
                    self.hand_over_placed(hand_over)?;
                }
                Item::Aside(measurement) => {
                    self.record(&measurement)?;
                }
                Item::Pause => {}
            }
        }
        hand_over(self.told(lateness))?;
        self.tell_status(batch.lost);
        let maps = self.maps.get();
        let not_mapped = self.placer.counts().dropped_scans.total() + maps.dropped_scans.total();
        let figures = ProgressFigures {
            data_s: self.clock.elapsed().as_secs_f64(),
            wall_s: self.started.elapsed().as_secs_f64(),
            scans: maps.scans_mapped,
            drops: batch.lost + not_mapped,
        };
        self.progress.update(batch.position, &figures);
        Ok(())
    }

    /// All up to here can be told.
    pub(super) fn told(&self, lateness: Option<Lateness>) -> Step {
        Step::Told {
            lateness,
            datum: self.placer.datum(),
        }
    }

    /// Records and places what could be known since `came`.
    pub(super) fn take_ordered(
        &mut self,
        ordered: Ordered,
        came: Monotonic,
        hand_over: &mut impl FnMut(Step) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        match ordered {
            Ordered::Measurement(measurement) => {
                let elapsed = self.clock.see(measurement.stamp);
                // Before it is recorded, for which a disk may take its time.
                if let Some(herald) = &mut self.herald {
                    herald.came(&measurement, came, elapsed);
                }
                self.record(&measurement)?;
                self.place(measurement);
                // Before scans are handed over, which may wait for the maps.
                self.tell_newest_pose();
                self.hand_over_placed(hand_over)
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
                self.placer.reset_clock(&mut self.placed);
                let handed_over =
                    hand_over(Step::ClockReset).and_then(|()| self.hand_over_placed(hand_over));
                // Scans that waited tell where the vehicle was by the clock of before.
                if let Some(herald) = &mut self.herald {
                    herald.reset_clock(to == RobotTime::MIN);
                }
                handed_over
            }
        }
    }

    /// The data has ended: places what still waits.
    ///
    /// # Errors
    /// Whatever stops `hand_over`.
    pub(super) fn finish(
        &mut self,
        hand_over: &mut impl FnMut(Step) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.placer.finish(&mut self.placed);
        let handed_over = self
            .hand_over_placed(hand_over)
            .and_then(|()| hand_over(self.told(None)));
        self.tell_newest_pose();
        handed_over
    }

    fn place(&mut self, measurement: Measurement) {
        let started = Monotonic::now();
        self.placer.push(measurement, &mut self.placed);
        self.time.record(started.elapsed());
    }

    /// Whoever watches and the guard hear of a scan before it is handed over: that may wait for the maps.
    fn hand_over_placed(
        &mut self,
        hand_over: &mut impl FnMut(Step) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Self { placed, herald, .. } = self;
        for placed in placed.drain(..) {
            let taken = match (&placed, &mut *herald) {
                (Placed::Scan(scan), Some(herald)) => herald.placed(scan),
                (Placed::Jump(_), Some(herald)) => herald.jumped(),
                (Placed::Scan(_) | Placed::Jump(_), None) => Monotonic::default(),
            };
            let since = Monotonic::now();
            hand_over(Step::Placed {
                placed,
                taken,
                since,
            })?;
        }
        Ok(())
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
        if let Some(herald) = &self.herald {
            herald.tell("recording_stopped", &error.to_string());
        }
        self.not_recorded = Some(error);
        Ok(())
    }

    /// Nothing more comes: brings what is recorded to its end, on the disk. Where the run did not go well, what an operator
    /// records goes on with the next one.
    pub(super) fn end_recordings(&mut self, went_well: bool) -> Recorded {
        if let Some(live) = self.live.take()
            && went_well
        {
            live.end();
        }
        let (notes, result) = match (self.not_recorded.take(), self.recorder.take()) {
            (Some(error), _) => (Vec::new(), Err(error)),
            (None, Some(recorder)) => (recorder.notes(), recorder.finish()),
            (None, None) => (Vec::new(), Ok(())),
        };
        Recorded { notes, result }
    }

    fn tell_newest_pose(&mut self) {
        if let Some(herald) = &mut self.herald
            && let Some(pose) = self.placer.newest_pose()
        {
            herald.moved(pose);
        }
    }

    /// Starts and stops what operators record, and says how it is going.
    fn serve_recording(&mut self) -> Option<RecordingStatus> {
        let (Some(live), Some(herald)) = (&mut self.live, &self.herald) else {
            return None;
        };
        if let Some(is_wanted) = herald.take_recording_wish() {
            live.record(is_wanted);
        }
        let state = live.state();
        herald.show_recording(state.is_running);
        let status = state.status();
        if self.told_problem != state.problem {
            if let Some(problem) = &state.problem {
                herald.tell("recording_stopped", &problem.what);
            }
            self.told_problem = state.problem;
        }
        Some(status)
    }

    /// Tells consoles how it is going; `lost` by the source so far.
    pub(super) fn tell_status(&mut self, lost: u64) {
        let recording = self.serve_recording();
        if let Some(herald) = &mut self.herald {
            let counts = self.placer.counts();
            herald.tell_status(counts, &self.maps.get(), (&self.clock, lost), recording);
        }
    }
}
