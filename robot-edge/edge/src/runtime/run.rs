//! One run: sets up the pipeline, reads a source, and writes the outputs.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, anyhow};
use drivers::status::DeviceStatuses;
use protocol::tile::BootId;

use super::driving::DrivePlan;
use super::is_set;
use super::live_recording::LiveRecording;
use super::localization_stage::{PoseOutput, RecordingResult};
use super::mapping_stage::EventLog;
use super::network::{Network, RobotDescription, velocity_estimator};
use super::network_plan::NetworkPlan;
use super::outputs::{self, SETUP};
use super::pipeline::Pipeline;
use super::recorder::{Recorder, SyncPolicy};
use super::saved_map;
use super::source::Source;
use super::source_reader::{Batch, SourceEnd, read_source};
use super::state_publisher::StatePublisher;
use super::tilt_control::TiltControl;
use crate::cli::MapOptions;
use crate::config::Config;
use crate::exit::UsageError;
use crate::exit::{Exit, Interrupted};
#[cfg(feature = "foxglove")]
use crate::foxglove::{FoxgloveOutput, Names};
use crate::pacer::Rate;
use crate::progress::Progress;
use crate::publishing::output_inputs::{OutputInputs, OutputSources};
use crate::ros2::{PlannerSession, RosOutput, RosTarget};
use crate::service_manager::ServiceManager;
use crate::summary::{Event, Summary};
use localization::registration::{PoseOrigin, RegistrationSettings};
use localization::scan_localization::Continuation;
use measurement::time::RobotTime;
use network::clock;
use network::random_id;
use recording::new_file::{self, NewFile};
use recording::writer::WriteError;

pub(super) struct Run<'a> {
    /// Name of the recording or world.
    pub(super) source: String,
    /// Title of the pictures.
    pub(super) title: String,
    pub(super) config: &'a Config,
    pub(super) registration: RegistrationSettings,
    pub(super) rate: Rate,
    /// Live measurements; otherwise the time of the data applies.
    pub(super) is_live: bool,
    pub(super) network: Option<NetworkPlan>,
    pub(super) drive: DrivePlan,
    pub(super) record: Option<PathBuf>,
    pub(super) export: Option<PathBuf>,
    pub(super) map: &'a MapOptions,
    pub(super) summary: Option<PathBuf>,
    pub(super) quiet: bool,
    /// The earliest stamp of the data, if it is known.
    pub(super) earliest: Option<RobotTime>,
    /// Decisions before the run.
    pub(super) events: Vec<Event>,
    /// Devices that are read without a middleware.
    pub(super) devices: Option<DeviceStatuses>,
    pub(super) tilt: Option<TiltControl>,
    /// Where maps and poses are published, if `[ros2_output]` names topics.
    pub(super) ros: Option<RosTarget>,
    /// Where Foxglove connects to.
    pub(super) foxglove: Option<SocketAddr>,
}

struct Files {
    recorder: Option<Recorder>,
    /// Why `--record` writes nothing.
    recording_error: Option<WriteError>,
    log: Option<NewFile>,
    /// Notes of file names that differ from the requested ones.
    notes: Vec<Event>,
}

impl Run<'_> {
    /// Maps the whole source and writes the requested outputs.
    ///
    /// After an error, all outputs that can be written are written; the first error is returned.
    pub(super) fn execute(
        self,
        source: &mut dyn Source,
        interrupt: &AtomicBool,
        out: &mut dyn Write,
    ) -> anyhow::Result<Exit> {
        let mut pipeline = self.start()?;
        let can_drive = self.drive.can_drive();
        let threads = self.config.mapping.threads;
        // Driving must not wait for mapping.
        let (end, taken) = if threads > 1 || can_drive {
            let from_source = |take: &mut dyn FnMut(Batch) -> bool| {
                read_source(source, self.rate, interrupt, take)
            };
            pipeline.run_pipelined(from_source, threads, can_drive)?
        } else {
            let mut taken = Ok(());
            let end = read_source(source, self.rate, interrupt, |batch| {
                if taken.is_ok() {
                    taken = pipeline.take(batch);
                }
                taken.is_ok()
            });
            (end, taken)
        };
        let finished = pipeline.finish_run(end.lost.counts.total());
        let wall_s = clock::elapsed(pipeline.localization.started).as_secs_f64();
        if is_set(interrupt) {
            // The motors stop before the recordings are synced, which may take long.
            pipeline.mapping.end_driving();
        }
        // Recordings first: serving and exporting may take long and be killed.
        let went_well = taken.is_ok() && finished.is_ok() && end.result.is_ok();
        let recorded = pipeline.localization.recordings.end(went_well);
        if let Some(network) = &pipeline.mapping.network
            && went_well
        {
            network.wait_for_consoles(&pipeline.mapping.maps, self.quiet, || {
                pipeline.mapping.serve_ros();
                is_set(interrupt)
            });
        }
        // Ctrl-C is the normal end of a map that is served, and of a vehicle that can be driven.
        let is_at_its_end = end.is_complete || self.drive.can_drive();
        let kept_serving = self
            .network
            .as_ref()
            .is_some_and(NetworkPlan::keeps_serving)
            && is_at_its_end;
        let interrupted = is_set(interrupt) && !kept_serving;
        pipeline.mapping.end_driving();
        let outputs_written =
            self.write_outputs(pipeline, recorded, &end, (wall_s, interrupted), out);
        taken?;
        finished?;
        end.result?;
        let summary = outputs_written?;
        if interrupted {
            return Err(Interrupted.into());
        }
        if summary.scans.mapped == 0 {
            return Err(nothing_mapped_error(&summary));
        }
        Ok(Exit::Done)
    }

    /// Reports unwritable outputs and the decisions before mapping starts.
    pub(super) fn start(&self) -> anyhow::Result<Pipeline> {
        outputs::prepare(self.export.as_deref(), self.summary.as_deref())?;
        self.check_map()?;
        let Files {
            recorder,
            recording_error,
            log,
            notes,
        } = self.open_files()?;
        if !self.quiet {
            for event in self.events.iter().chain(&notes) {
                writeln!(io::stderr(), "{}: {}", event.kind, event.message)?;
            }
        }
        // Only the summary needs the encoded size.
        let encode = self.summary.is_some();
        let boot = BootId(random_id()?);
        let mut registration = self.registration.clone();
        let mut kept = None;
        if let Some(folder) = &self.map.folder {
            let (saved, scans) = saved_map::load(folder)?;
            let saved = Arc::new(saved);
            let near = self.map.near.map(|near| near.0);
            registration.continuation = Some(Continuation { saved, near });
            kept = Some(scans);
        }
        let mut pipeline = Pipeline::going_on(self.config, registration, (boot, encode), kept)?
            .with_tilt_control(self.tilt.clone());
        let opened = match &self.network {
            Some(plan) => {
                let description = RobotDescription {
                    source: if self.is_live { "" } else { &self.title },
                    is_live: self.is_live,
                    localization: &self.registration,
                    can_record: self.drive.can_record(),
                    devices: self.devices.as_ref(),
                };
                Network::open(
                    plan,
                    self.config,
                    &description,
                    boot,
                    &pipeline.mapping.maps,
                    (&self.drive, log),
                    self.quiet,
                )?
            }
            None => None,
        };
        let (network, state_publisher) = opened.unzip();
        if !network.as_ref().is_some_and(Network::is_driven) {
            ServiceManager::from_environment().ready_without_watchdog();
        }
        let trajectory = network
            .as_ref()
            .map(Network::trajectory)
            .unwrap_or_default();
        let live = match &network {
            Some(network) => self
                .drive
                .recording(network.robot(), &self.config.vehicle.name)?,
            None => None,
        };
        if let Some(network) = &network {
            let is_resumed = live.as_ref().is_some_and(LiveRecording::is_resumed);
            self.publish_start_events(network, &notes, recording_error.as_ref(), is_resumed);
        }
        if let Some(why) = &recording_error {
            tracing::error!(%why, "nothing is recorded; driving goes on");
        }
        let Pipeline {
            localization,
            mapping,
        } = &mut pipeline;
        localization.state_publisher = state_publisher.map(|state_publisher| StatePublisher {
            map_from_odom: mapping.map_from_odom.clone(),
            ..state_publisher
        });
        localization.show_supposed_place();
        localization.progress = Progress::new(self.quiet);
        localization.started = clock::now();
        let recordings = &mut localization.recordings;
        recordings.recorder = recorder;
        recordings.error = recording_error;
        recordings.live = live;
        recordings.is_driven = self.drive.can_drive();
        mapping.network = network;
        mapping.trajectory = trajectory;
        mapping.saved_maps = self.drive.maps().map(std::path::Path::to_path_buf);
        mapping.events = EventLog::with_events(notes);
        mapping.is_live = self.is_real_time_run();
        self.start_ros_output(&mut pipeline)?;
        self.start_planner(&mut pipeline)?;
        self.start_foxglove(&mut pipeline)?;
        Ok(pipeline)
    }

    fn start_ros_output(&self, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        let Some(target) = self
            .ros
            .clone()
            .filter(|_| !self.config.ros2_output.is_empty())
        else {
            return Ok(());
        };
        let has_other_odom = !self.config.ros2_output.odom_to_base;
        let sources = self.output_sources(pipeline, has_other_odom);
        let frames = (
            self.odom_frame(),
            self.config.localization.base_frame.as_str(),
        );
        let ros = RosOutput::start(&self.config.ros2_output, frames, target, sources)
            .context("no thread can be had to publish to ROS 2")?;
        pipeline.mapping.ros = Some(ros);
        Ok(())
    }

    fn start_planner(&self, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        let (Some(config), Some(target), Some(exchange)) =
            (&self.config.planner, self.ros.clone(), &self.drive.planner)
        else {
            return Ok(());
        };
        let has_other_odom = !self.config.ros2_output.odom_to_base;
        let inputs = self.output_sources(pipeline, has_other_odom).inputs;
        let frames = [
            self.config.ros2_output.map_frame.as_str(),
            self.odom_frame(),
        ];
        let planner = PlannerSession::start(config, frames, target, (exchange.clone(), inputs))
            .context("no thread can be had for the planner")?;
        pipeline.mapping.planner = Some(planner);
        Ok(())
    }

    #[cfg(not(feature = "foxglove"))]
    fn start_foxglove(&self, _pipeline: &mut Pipeline) -> Result<(), UsageError> {
        match self.foxglove {
            Some(_) => Err(UsageError(
                "--foxglove is not in this program: build it with `--features foxglove`".to_owned(),
            )),
            None => Ok(()),
        }
    }

    #[cfg(feature = "foxglove")]
    fn start_foxglove(&self, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        let Some(at) = self.foxglove else {
            return Ok(());
        };
        let sensors = self.config.range_sensors();
        let names = Names {
            vehicle: self.config.vehicle.name.clone(),
            odom: self.odom_frame().to_owned(),
            base: self.config.localization.base_frame.clone(),
            sensors: sensors
                .iter()
                .map(|sensor| sensor.name.to_owned())
                .collect(),
        };
        let sources = self.output_sources(pipeline, false);
        let output = FoxgloveOutput::start(at, names, sources)?;
        if !self.quiet {
            writeln!(io::stderr(), "foxglove: ws://{}", output.address())?;
        }
        pipeline.mapping.foxglove = Some(output);
        Ok(())
    }

    fn odom_frame(&self) -> &str {
        match &self.config.localization.fixed_frame {
            Some(configured) => configured,
            None => match self.registration.origin.prior() {
                PoseOrigin::Tf { fixed_frame } => fixed_frame,
                _ => "odom",
            },
        }
    }

    /// What an output publishes of; the stages hand over to it.
    fn output_sources(&self, pipeline: &mut Pipeline, has_other_odom: bool) -> OutputSources {
        let Pipeline {
            localization,
            mapping,
        } = pipeline;
        let inputs = OutputInputs::default();
        localization.outputs.push(PoseOutput {
            inputs: inputs.clone(),
            map_from_odom: mapping.map_from_odom.clone(),
            velocity_estimator: velocity_estimator(self.config),
            last_stamp: None,
            has_other_odom,
        });
        mapping.outputs.push(inputs.clone());
        OutputSources {
            inputs,
            store: mapping.maps.publisher().shared_store(),
            trajectory: mapping.trajectory.clone(),
        }
    }

    /// A map is saved and gone on in only where scans are matched.
    fn check_map(&self) -> Result<(), UsageError> {
        let matches_scans = matches!(self.registration.origin, PoseOrigin::Scans { .. });
        if !matches_scans && *self.map != MapOptions::default() {
            return Err(UsageError(
                "--map and --save-map need poses from matched scans: --set localization.source=scan+wheels, or another of \"scan\", \
                 \"scan+imu\" and \"scan+gps\""
                    .to_owned(),
            ));
        }
        self.map
            .save_map
            .as_deref()
            .map_or(Ok(()), saved_map::refuse_existing)
    }

    /// Existing files are not overwritten.
    fn open_files(&self) -> anyhow::Result<Files> {
        let vehicle = &self.config.vehicle.name;
        let recorder = self
            .record
            .as_ref()
            .map(|path| Recorder::create(path, vehicle, self.sync_policy(), self.earliest))
            .transpose();
        let (recorder, recording_error) = match recorder {
            Ok(recorder) => (recorder, None),
            // A recording error does not stop driving.
            Err(low @ WriteError::DiskLow { .. }) if self.drive.can_drive() => (None, Some(low)),
            Err(error) => return Err(error.into()),
        };
        let log = self.drive.create_log()?;
        let recording = recorder.as_ref().map(Recorder::path);
        let logged = log.as_ref().map(|log| log.path.clone());
        let opened = [
            ("--record", self.record.as_deref(), recording),
            ("--drive-log", self.drive.log(), logged),
        ];
        let notes = opened
            .into_iter()
            .filter_map(|(option, asked, path)| new_file::note(option, asked?, &path?))
            .map(|message| Event {
                stamp_s: None,
                kind: SETUP.to_owned(),
                message,
            })
            .collect();
        Ok(Files {
            recorder,
            recording_error,
            log,
            notes,
        })
    }

    /// Sends the decisions of the start to the consoles; important ones wait for the first console.
    fn publish_start_events(
        &self,
        network: &Network,
        notes: &[Event],
        recording_error: Option<&WriteError>,
        is_resumed: bool,
    ) {
        for event in &self.events {
            network.publish_event(&event.kind, &event.message);
        }
        for note in notes {
            network.publish_or_queue_event(&note.kind, note.message.clone());
        }
        if let Some(why) = recording_error {
            network.publish_or_queue_event("recording_stopped", why.to_string());
        }
        if is_resumed {
            let message =
                "recording goes on: the run before was cut off while an operator recorded";
            network.publish_or_queue_event("recording", message.to_owned());
        }
    }

    const fn sync_policy(&self) -> SyncPolicy {
        match self.rate {
            Rate::Times(_) if self.drive.can_drive() => SyncPolicy::Background,
            Rate::Times(_) => SyncPolicy::Inline,
            Rate::Max => SyncPolicy::OnDemand,
        }
    }

    /// Whether late data is useless: real sensors, and a simulation that is driven in real time. Any other source
    /// is mapped completely.
    fn is_real_time_run(&self) -> bool {
        self.is_live || (self.drive.can_drive() && self.rate.is_real_time())
    }

    /// Writes all outputs that can be written; the first error is returned.
    fn write_outputs(
        &self,
        mut pipeline: Pipeline,
        recorded: RecordingResult,
        end: &SourceEnd,
        (wall_s, interrupted): (f64, bool),
        out: &mut dyn Write,
    ) -> anyhow::Result<Summary> {
        let mut summary = outputs::summary(&pipeline);
        summary.recording.clone_from(&self.source);
        summary.vehicle.clone_from(&self.config.vehicle.name);
        summary.set_times(pipeline.localization.clock.elapsed().as_secs_f64(), wall_s);
        summary.events.clone_from(&self.events);
        let happened = std::mem::take(&mut pipeline.mapping.events);
        summary.events.extend(happened.into_events());
        summary.add_source_end(end, interrupted);
        summary.add_recorder_notes(recorded.notes);
        if let Some(ros) = pipeline.mapping.ros.take() {
            summary.add_ros_drops(&ros.finish());
        }
        if let Some(planner) = pipeline.mapping.planner.take() {
            summary.add_goals(planner.finish());
        }

        let exported = self.export.as_ref().map_or(Ok(Vec::new()), |dir| {
            // Consoles may still request the trajectory.
            let trajectory = pipeline.mapping.trajectory.lock().poses();
            let of = (self.title.as_str(), &self.config.vehicle);
            outputs::export(dir, &pipeline, &trajectory, of)
        });
        let saved = self.map.save_map.as_ref().map_or(Ok(()), |folder| {
            let map = pipeline.localization.registration.saved_map();
            let kept = pipeline.mapping.maps.kept_scans();
            let saved = map
                .zip(kept)
                .map(|(map, kept)| saved_map::save(folder, &map, kept.snapshot()?));
            saved
                .unwrap_or(Ok(()))
                .with_context(|| format!("{}: the map cannot be saved", folder.display()))
        });
        let summarised = self.summary.as_ref().map_or(Ok(()), |path| {
            summary
                .write(path)
                .with_context(|| format!("{}: cannot write the summary", path.display()))
        });
        if !self.quiet {
            outputs::print_summary(&summary, exported.as_deref().unwrap_or_default(), out)?;
        }
        recorded.result?;
        exported?;
        saved?;
        summarised?;
        Ok(summary)
    }
}

pub(super) fn nothing_mapped_error(summary: &Summary) -> anyhow::Error {
    let scans = &summary.scans;
    let reasons: Vec<_> = scans
        .dropped
        .iter()
        .map(|(reason, n)| format!("{n} {reason}"))
        .collect();
    match scans.came_in {
        0 => anyhow!("{}: no scan came in, so there is no map", summary.recording),
        n => anyhow!(
            "{}: none of its {n} scans could be mapped ({}); `robot-edge info` says what it holds",
            summary.recording,
            reasons.join(", ")
        ),
    }
}
