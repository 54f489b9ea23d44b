//! The first stage of a run: takes batches, records, places scans, and tells at once what cannot wait for a map.

use protocol::message::RecordingStatus;

use super::data_clock::DataClock;
use super::live_recording::{LiveRecording, Problem};
use super::map_stats::SharedMapStats;
use super::mapping_input::{InputDelay, MappingInput};
use super::network::StatePublisher;
use super::recorder::Recorder;
use super::source::SourceItem;
use super::source_reader::Batch;
use crate::clock;
use crate::progress::{Progress, ProgressFigures};
use crate::summary::StageTimer;
use localization::registration::{RegistrationOutput, ScanRegistration};
use measurement::time::Monotonic;
use measurement::time::RobotTime;
use measurement::{Measurement, Stream};
use recording::time_sequencer::Ordered;
use recording::writer::WriteError;

/// What takes the batches of a source.
pub(super) struct LocalizationStage {
    pub(super) registration: ScanRegistration,
    /// Time spent in placing, per measurement.
    pub(super) timer: StageTimer,
    /// Kept for its memory.
    pub(super) placed: Vec<RegistrationOutput>,
    pub(super) state_publisher: Option<StatePublisher>,
    pub(super) recorder: Option<Recorder>,
    /// What records when operators want it.
    pub(super) live: Option<LiveRecording>,
    /// Why it ended by itself, as far as that was told.
    pub(super) reported_problem: Option<Problem>,
    /// Why recording has ended before the run.
    pub(super) recording_error: Option<WriteError>,
    /// Somebody may drive the vehicle.
    pub(super) is_driven: bool,
    pub(super) progress: Progress,
    pub(super) clock: DataClock,
    pub(super) started: Monotonic,
    /// The source's streams, by number.
    pub(super) streams: Vec<Stream>,
    /// Of the mapping side.
    pub(super) maps: SharedMapStats,
}

/// What became of the recording that was asked for, if one was.
pub(super) struct RecordingResult {
    /// How it differs from what came in, in words.
    pub(super) notes: Vec<String>,
    /// Why it is not whole.
    pub(super) result: Result<(), WriteError>,
}

impl LocalizationStage {
    /// Records and places a batch; what is to be mapped is handed over step by step.
    ///
    /// # Errors
    /// Where the recording cannot be written, and whatever stops `send`.
    pub(super) fn take(
        &mut self,
        batch: Batch,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let input_delay = InputDelay::of(&batch);
        if let Some(live) = &mut self.live {
            live.add_streams(&batch.new_streams);
        }
        self.streams.extend(batch.new_streams);
        for item in batch.items {
            match item {
                SourceItem::Timed(ordered) => {
                    self.take_ordered(ordered, batch.received_at, send)?;
                }
                SourceItem::Live {
                    ordered,
                    measured_at,
                } => self.take_ordered(ordered, measured_at, send)?,
                SourceItem::Immediate(measurement) => {
                    self.record(&measurement)?;
                    self.place(measurement);
                    self.send_registered(send)?;
                }
                SourceItem::Unmapped(measurement) => {
                    self.record(&measurement)?;
                }
                SourceItem::Idle => {}
            }
        }
        send(self.tick(input_delay))?;
        self.publish_status(batch.lost);
        let maps = self.maps.get();
        let not_mapped =
            self.registration.counts().dropped_scans.total() + maps.dropped_scans.total();
        let stats = ProgressFigures {
            data_s: self.clock.elapsed().as_secs_f64(),
            wall_s: clock::elapsed(self.started).as_secs_f64(),
            scans: maps.scans_mapped,
            drops: batch.lost + not_mapped,
        };
        self.progress.update(batch.position, &stats);
        Ok(())
    }

    /// All up to here can be told.
    pub(super) fn tick(&self, input_delay: Option<InputDelay>) -> MappingInput {
        MappingInput::Tick {
            input_delay,
            datum: self.registration.datum(),
        }
    }

    /// Records and places what could be known since `received_at`.
    pub(super) fn take_ordered(
        &mut self,
        ordered: Ordered,
        received_at: Monotonic,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        match ordered {
            Ordered::Measurement(measurement) => {
                let elapsed = self.clock.advance(measurement.stamp);
                // Before it is recorded, for which a disk may take its time.
                if let Some(state_publisher) = &mut self.state_publisher {
                    state_publisher.on_measurement(&measurement, received_at, elapsed);
                }
                self.record(&measurement)?;
                self.place(measurement);
                // Before scans are handed over, which may wait for the maps.
                self.publish_newest_pose();
                self.send_registered(send)
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
                self.registration.reset_clock(&mut self.placed);
                let handed_over =
                    send(MappingInput::ClockReset).and_then(|()| self.send_registered(send));
                // Scans that waited tell where the vehicle was by the clock of before.
                if let Some(state_publisher) = &mut self.state_publisher {
                    state_publisher.reset_clock(to == RobotTime::MIN);
                }
                handed_over
            }
        }
    }

    /// The data has ended: places what still waits.
    ///
    /// # Errors
    /// Whatever stops `send`.
    pub(super) fn finish(
        &mut self,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.registration.finish(&mut self.placed);
        let handed_over = self
            .send_registered(send)
            .and_then(|()| send(self.tick(None)));
        self.publish_newest_pose();
        handed_over
    }

    fn place(&mut self, measurement: Measurement) {
        let started = clock::now();
        self.registration.push(measurement, &mut self.placed);
        self.timer.record(clock::elapsed(started));
    }

    /// Whoever watches and the guard hear of a scan before it is handed over: that may wait for the maps.
    fn send_registered(
        &mut self,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Self {
            placed,
            state_publisher,
            ..
        } = self;
        for placed in placed.drain(..) {
            let measured_at = match (&placed, &mut *state_publisher) {
                (RegistrationOutput::Scan(scan), Some(state_publisher)) => {
                    state_publisher.publish_scan(scan)
                }
                (RegistrationOutput::Jump(_), Some(state_publisher)) => {
                    state_publisher.on_pose_jump()
                }
                (RegistrationOutput::Scan(_) | RegistrationOutput::Jump(_), None) => {
                    Monotonic::default()
                }
            };
            let since = clock::now();
            send(MappingInput::Registered {
                placed,
                measured_at,
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
        if let Some(state_publisher) = &self.state_publisher {
            state_publisher.publish_event("recording_stopped", &error.to_string());
        }
        self.recording_error = Some(error);
        Ok(())
    }

    /// Nothing more comes: brings what is recorded to its end, on the disk. Where the run did not go well, what an operator
    /// records goes on with the next one.
    pub(super) fn end_recordings(&mut self, went_well: bool) -> RecordingResult {
        if let Some(live) = self.live.take()
            && went_well
        {
            live.finish();
        }
        let (notes, result) = match (self.recording_error.take(), self.recorder.take()) {
            (Some(error), _) => (Vec::new(), Err(error)),
            (None, Some(recorder)) => (recorder.notes(), recorder.finish()),
            (None, None) => (Vec::new(), Ok(())),
        };
        RecordingResult { notes, result }
    }

    fn publish_newest_pose(&mut self) {
        if let Some(state_publisher) = &mut self.state_publisher
            && let Some(pose) = self.registration.newest_pose()
        {
            state_publisher.publish_pose(pose);
        }
    }

    /// Starts and stops what operators record, and says how it is going.
    fn update_recording(&mut self) -> Option<RecordingStatus> {
        let (Some(live), Some(state_publisher)) = (&mut self.live, &self.state_publisher) else {
            return None;
        };
        if let Some(is_wanted) = state_publisher.take_recording_request() {
            live.record(is_wanted);
        }
        let state = live.state();
        state_publisher.set_recording(state.is_running);
        let status = state.status();
        if self.reported_problem != state.problem {
            if let Some(problem) = &state.problem {
                state_publisher.publish_event("recording_stopped", &problem.what);
            }
            self.reported_problem = state.problem;
        }
        Some(status)
    }

    /// Tells consoles how it is going; `lost` by the source so far.
    pub(super) fn publish_status(&mut self, lost: u64) {
        let recording = self.update_recording();
        if let Some(state_publisher) = &mut self.state_publisher {
            let counts = self.registration.counts();
            state_publisher.publish_status(
                counts,
                &self.maps.get(),
                (&self.clock, lost),
                recording,
            );
        }
    }
}
