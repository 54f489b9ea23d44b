//! The first stage of the pipeline: records measurements, registers scans, and publishes the state that does not depend on the maps.

use nalgebra::{Isometry2, Vector2};
use protocol::message::{MAX_CLOSURES, RecordingStatus};

use super::batching_channel::{InputDelay, MappingInput};
use super::live_recording::{LiveRecording, Problem};
use super::mapping_stage::{SharedMapFromOdom, SharedMapStats};
use super::recorder::Recorder;
use super::source::DataClock;
use super::source::SourceItem;
use super::source_reader::Batch;
use super::state_publisher::StatePublisher;
use crate::driving::MapRequest;
use crate::driving::velocity_estimator::VelocityEstimator;
use crate::progress::{Progress, ProgressFigures};
use crate::publishing::output_inputs::{OutputInputs, VehicleState};
use crate::summary::StageTimer;
use localization::registration::{RegistrationOutput, ScanRegistration};
use measurement::time::{Monotonic, RobotTime};
use measurement::{Measurement, Stream, Twist};
use network::clock;
use recording::time_sequencer::Ordered;
use recording::writer::WriteError;

/// Owns the registration and the recordings of a run.
pub(super) struct LocalizationStage {
    pub(super) registration: ScanRegistration,
    /// Processing time of the registration, per measurement.
    pub(super) timer: StageTimer,
    /// A member only to reuse its memory.
    pub(super) registered: Vec<RegistrationOutput>,
    pub(super) state_publisher: Option<StatePublisher>,
    pub(super) outputs: Vec<PoseOutput>,
    pub(super) recordings: Recordings,
    pub(super) progress: Progress,
    pub(super) clock: DataClock,
    pub(super) started: Monotonic,
    /// The source's streams, indexed by `StreamId`.
    pub(super) streams: Vec<Stream>,
    pub(super) maps: SharedMapStats,
}

/// Hands the newest pose over to the ROS 2 system or to Foxglove.
pub(super) struct PoseOutput {
    pub(super) inputs: OutputInputs,
    pub(super) map_from_odom: SharedMapFromOdom,
    pub(super) velocity_estimator: VelocityEstimator,
    pub(super) last_stamp: Option<RobotTime>,
    /// Another node publishes the pose of the vehicle in `odom`.
    pub(super) has_other_odom: bool,
}

impl PoseOutput {
    fn set(&mut self, registration: &ScanRegistration) {
        let Some((stamp, odom_from_base)) = registration.newest_pose() else {
            return;
        };
        if self.last_stamp.replace(stamp) == Some(stamp) {
            return;
        }
        let velocity = self.velocity_estimator.update(stamp, &odom_from_base);
        let is_searching = registration.supposed_map_from_odom().is_some();
        let mut map_from_odom = self.map_from_odom.get();
        // Where scans are matched, their `odom` is not that of the other node.
        if self.has_other_odom
            && let Some(other_from_base) = registration.prior_pose_at(stamp)
        {
            map_from_odom = map_from_odom * odom_from_base * other_from_base.inverse();
        }
        self.inputs.set_vehicle(VehicleState {
            stamp,
            odom_from_base,
            map_from_odom: (!is_searching).then_some(map_from_odom),
            twist: Twist {
                linear_mps: [velocity.linear_mps, velocity.lateral_mps, 0.0],
                angular_radps: [0.0, 0.0, velocity.angular_radps],
            },
        });
    }
}

/// The recordings of a run: `--record`, and those that operators start.
#[derive(Default)]
pub(super) struct Recordings {
    pub(super) recorder: Option<Recorder>,
    /// Why the recording of `--record` ended before the run.
    pub(super) error: Option<WriteError>,
    pub(super) live: Option<LiveRecording>,
    /// The last problem of `live` that was published.
    reported_problem: Option<Problem>,
    /// The vehicle can be driven: a failed recording does not end the run.
    pub(super) is_driven: bool,
}

pub(super) struct RecordingResult {
    /// Differences between the recording and the input, one sentence each.
    pub(super) notes: Vec<String>,
    pub(super) result: Result<(), WriteError>,
}

impl Recordings {
    fn add_streams(&mut self, streams: &[Stream]) {
        if let Some(live) = &mut self.live {
            live.add_streams(streams);
        }
    }

    fn reset_clock(&mut self) {
        if let Some(live) = &mut self.live {
            live.reset_clock();
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.reset_clock();
        }
    }

    /// Records a measurement. If the vehicle can be driven, an error ends the recording with an alarm, and not the run.
    fn write(
        &mut self,
        stream: Option<&Stream>,
        measurement: &Measurement,
        state_publisher: Option<&StatePublisher>,
    ) -> Result<(), WriteError> {
        if let Some(live) = &mut self.live {
            live.add(measurement);
        }
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
        if let Some(state_publisher) = state_publisher {
            state_publisher.publish_event("recording_stopped", &error.to_string());
        }
        self.error = Some(error);
        Ok(())
    }

    /// Ends the recordings and syncs them to the disk. If the run failed, a recording that an operator started is resumed by
    /// the next run.
    pub(super) fn end(&mut self, went_well: bool) -> RecordingResult {
        if let Some(live) = self.live.take()
            && went_well
        {
            live.finish();
        }
        let (notes, result) = match (self.error.take(), self.recorder.take()) {
            (Some(error), _) => (Vec::new(), Err(error)),
            (None, Some(recorder)) => (recorder.notes(), recorder.finish()),
            (None, None) => (Vec::new(), Ok(())),
        };
        RecordingResult { notes, result }
    }

    /// Starts and stops the recording that operators requested, and returns its status.
    fn update_live(&mut self, state_publisher: &StatePublisher) -> Option<RecordingStatus> {
        let live = self.live.as_mut()?;
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
}

impl LocalizationStage {
    /// A stage without network and recordings.
    pub(super) fn new(registration: ScanRegistration, maps: SharedMapStats) -> Self {
        Self {
            registration,
            timer: StageTimer::default(),
            registered: Vec::new(),
            state_publisher: None,
            outputs: Vec::new(),
            recordings: Recordings::default(),
            progress: Progress::new(true),
            clock: DataClock::default(),
            started: clock::now(),
            streams: Vec::new(),
            maps,
        }
    }

    /// Records and registers a batch. `send` passes the results to the mapping stage.
    pub(super) fn take(
        &mut self,
        batch: Batch,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let input_delay = InputDelay::of(&batch);
        self.recordings.add_streams(&batch.new_streams);
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
                    self.register(measurement);
                    self.send_registered(send)?;
                }
                SourceItem::Unmapped(measurement) => {
                    self.record(&measurement)?;
                }
                SourceItem::Idle => {}
            }
        }
        send(self.tick(input_delay))?;
        self.take_map_request(send)?;
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

    /// Passes the map so far on, where an operator wants it to be saved; searches for the vehicle where an operator says it is.
    fn take_map_request(
        &mut self,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Some(state_publisher) = &self.state_publisher else {
            return Ok(());
        };
        match state_publisher.take_map_request() {
            Some(MapRequest::Save(name)) => {
                if let Some(map) = self.registration.saved_map().map(Box::new) {
                    return send(MappingInput::SaveMap { name, map });
                }
                let message = "the map cannot be saved: no scans are matched (localization.source)";
                state_publisher.publish_event("map_not_saved", message);
            }
            Some(MapRequest::Locate(pose)) => {
                let [x_m, y_m, yaw_rad] =
                    [pose.x_mm, pose.y_mm, pose.yaw_mrad].map(|n| 0.001 * f64::from(n));
                let pose = Isometry2::new(Vector2::new(x_m, y_m), yaw_rad);
                let (kind, message) = if self.registration.locate(&pose) {
                    (
                        "location_set",
                        format!("the vehicle is searched for near {x_m:.1}, {y_m:.1}"),
                    )
                } else {
                    let message = "the vehicle is not searched for in a saved map (--map)";
                    ("location_not_set", message.to_owned())
                };
                state_publisher.publish_event(kind, &message);
                self.show_supposed_place();
            }
            None => {}
        }
        Ok(())
    }

    /// Consoles show the vehicle where it is supposed to be in the saved map that it is searched for in.
    pub(super) fn show_supposed_place(&self) {
        let supposed = self.registration.supposed_map_from_odom();
        if let Some((supposed, state_publisher)) = supposed.zip(self.state_publisher.as_ref()) {
            state_publisher.map_from_odom.set(supposed);
        }
    }

    /// Lets the mapping stage publish.
    pub(super) fn tick(&self, input_delay: Option<InputDelay>) -> MappingInput {
        MappingInput::Tick {
            input_delay,
            datum: self.registration.datum(),
        }
    }

    /// Records and registers a measurement that could have been received at `received_at` at the earliest.
    pub(super) fn take_ordered(
        &mut self,
        ordered: Ordered,
        received_at: Monotonic,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        match ordered {
            Ordered::Measurement(measurement) => {
                let elapsed = self.clock.advance(measurement.stamp);
                // Before recording, which may wait for the disk.
                if let Some(state_publisher) = &mut self.state_publisher {
                    state_publisher.on_measurement(&measurement, received_at, elapsed);
                }
                self.record(&measurement)?;
                self.register(measurement);
                // Before scans are sent, which may wait for the mapping stage.
                self.publish_newest_pose();
                self.send_registered(send)
            }
            Ordered::ClockReset { from, to } => {
                tracing::info!(%from, "the clock of the data was reset");
                self.clock.reset();
                self.recordings.reset_clock();
                self.registration.reset_clock(&mut self.registered);
                let sent = send(MappingInput::ClockReset).and_then(|()| self.send_registered(send));
                // The scans sent above have stamps of the old clock.
                if let Some(state_publisher) = &mut self.state_publisher {
                    state_publisher.reset_clock(to == RobotTime::MIN);
                }
                sent
            }
        }
    }

    /// Registers the waiting scans at the end of the data.
    pub(super) fn finish(
        &mut self,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.registration.finish(&mut self.registered);
        let sent = self.send_registered(send);
        self.publish_newest_pose();
        sent
    }

    fn register(&mut self, measurement: Measurement) {
        let started = clock::now();
        self.registration.push(measurement, &mut self.registered);
        self.timer.record(clock::elapsed(started));
    }

    /// Consoles and the collision monitor get a scan before the mapping stage, for which `send` may wait.
    fn send_registered(
        &mut self,
        send: &mut impl FnMut(MappingInput) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Self {
            registered,
            state_publisher,
            outputs,
            ..
        } = self;
        for output in registered.drain(..) {
            if let RegistrationOutput::Scan(scan) = &output {
                for PoseOutput { inputs, .. } in &*outputs {
                    inputs.offer_scan(scan);
                }
            }
            let measured_at = match (&output, &mut *state_publisher) {
                (RegistrationOutput::Scan(scan), Some(state_publisher)) => {
                    state_publisher.publish_scan(scan)
                }
                (RegistrationOutput::Jump(_), Some(state_publisher)) => {
                    state_publisher.on_pose_jump()
                }
                (RegistrationOutput::Corrected(_) | RegistrationOutput::Confidence(_), _)
                | (_, None) => Monotonic::default(),
            };
            send(MappingInput::Registered {
                output,
                measured_at,
                queued_at: clock::now(),
            })?;
        }
        Ok(())
    }

    fn record(&mut self, measurement: &Measurement) -> Result<(), WriteError> {
        let stream = self.streams.get(usize::from(measurement.stream.0));
        self.recordings
            .write(stream, measurement, self.state_publisher.as_ref())
    }

    fn publish_newest_pose(&mut self) {
        if let Some(state_publisher) = &mut self.state_publisher
            && let Some(pose) = self.registration.newest_pose()
        {
            state_publisher.publish_pose(pose);
        }
        for output in &mut self.outputs {
            output.set(&self.registration);
        }
    }

    /// Publishes the status. `lost`: messages that the source has lost.
    pub(super) fn publish_status(&mut self, lost: u64) {
        if let Some(state_publisher) = &mut self.state_publisher {
            let recording = self.recordings.update_live(state_publisher);
            let counts = self.registration.counts();
            if let Some(report) = self.registration.scan_localization() {
                let closures = self.registration.newest_closures(MAX_CLOSURES);
                state_publisher.publish_localization(&report, &closures);
            }
            state_publisher.publish_status(
                counts,
                &self.maps.get(),
                (&self.clock, lost),
                recording,
            );
        }
    }
}
