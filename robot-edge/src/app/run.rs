//! One run: a source, the pipeline, and what is left behind.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, anyhow};
use protocol::tile::BootId;

use super::data_clock::DataClock;
use super::driving::DrivePlan;
use super::event_log::EventLog;
use super::is_set;
use super::live_recording::LiveRecording;
use super::localization_stage::{LocalizationStage, RecordingResult};
use super::map_stats::SharedMapStats;
use super::mapping_stage::MappingStage;
use super::network::{Network, RobotDescription};
use super::network_plan::NetworkPlan;
use super::output_checks;
use super::outputs::{self, SETUP};
use super::pipeline::PipelineStages;
use super::recorder::{Recorder, SyncPolicy};
use super::source::Source;
use super::source_reader::{Batch, SourceEnd, read_source};
use crate::clock;
use crate::config::Config;
use crate::exit::{Exit, Interrupted};
use crate::link::random_id;
use crate::overload::OverloadMonitor;
use crate::pacer::Rate;
use crate::pipeline::Maps;
use crate::progress::Progress;
use crate::service_manager::ServiceManager;
use crate::summary::{Event, StageTimer, Summary};
use localization::registration::{RegistrationSettings, ScanRegistration};
use measurement::time::RobotTime;
use recording::new_file::{self, NewFile};
use recording::writer::WriteError;

/// What a run is made of.
pub(super) struct Run<'a> {
    /// The recording or world as it was named.
    pub(super) source: String,
    /// Heads the pictures.
    pub(super) title: String,
    pub(super) config: &'a Config,
    pub(super) registration: RegistrationSettings,
    pub(super) rate: Rate,
    /// Measurements come when they come; else by the time of the data.
    pub(super) is_live: bool,
    /// How it is on the network, if at all.
    pub(super) network: Option<NetworkPlan>,
    /// What moves the vehicle, where it can be driven.
    pub(super) drive: DrivePlan,
    pub(super) record: Option<PathBuf>,
    pub(super) export: Option<PathBuf>,
    pub(super) summary: Option<PathBuf>,
    pub(super) quiet: bool,
    /// The earliest stamp of the data, where it is known.
    pub(super) earliest: Option<RobotTime>,
    /// What was decided before the run.
    pub(super) events: Vec<Event>,
}

/// What a run writes into while it lasts.
struct Files {
    recorder: Option<Recorder>,
    /// Why nothing is recorded although it was asked for.
    recording_error: Option<WriteError>,
    log: Option<NewFile>,
    /// Names that differ from those asked for.
    notes: Vec<Event>,
}

impl Run<'_> {
    /// Maps all that the source yields and writes what was asked for.
    ///
    /// Whatever fails, all that can still be written is; the first failure is returned at the end.
    pub(super) fn execute(
        self,
        source: &mut dyn Source,
        interrupt: &AtomicBool,
        out: &mut dyn Write,
    ) -> anyhow::Result<Exit> {
        let mut pipeline = self.start()?;
        let can_drive = self.drive.can_drive();
        let threads = self.config.mapping.threads;
        // What is driven must not wait for what is mapped.
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
        let finished = pipeline.finish(end.lost.counts.total());
        let wall_s = clock::elapsed(pipeline.localization.started).as_secs_f64();
        if is_set(interrupt) {
            // Nothing moves any more by poses that are not measured any more, however long the disk takes.
            pipeline.mapping.end_driving();
        }
        // What cannot be made anew comes first: maps may be served for hours, an export may take long, and both be ended.
        let went_well = taken.is_ok() && finished.is_ok() && end.result.is_ok();
        let recorded = pipeline.localization.end_recordings(went_well);
        if let Some(network) = &pipeline.mapping.network
            && went_well
        {
            network.wait_for_consoles(&pipeline.mapping.maps, self.quiet, || is_set(interrupt));
        }
        // Whoever served the map until Ctrl-C asked for nothing else.
        // What is driven waits to be driven on: nothing else ends it.
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

    /// What cannot be written should be known before an hour of mapping, and so should what was decided.
    pub(super) fn start(&self) -> anyhow::Result<PipelineStages> {
        output_checks::prepare(self.export.as_deref(), self.summary.as_deref())?;
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
        // The summary says what streaming would have cost, which nobody else needs to know.
        let encode = self.summary.is_some();
        let boot = BootId(random_id()?);
        let maps = Maps::new(self.config, boot, encode)?;
        let opened = match &self.network {
            Some(plan) => {
                let description = RobotDescription {
                    source: &self.title,
                    is_live: self.is_live,
                    localization: &self.registration,
                    can_record: self.drive.can_record(),
                };
                Network::open(
                    plan,
                    self.config,
                    &description,
                    boot,
                    &maps,
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
        let stats = SharedMapStats::default();
        Ok(PipelineStages {
            localization: LocalizationStage {
                registration: ScanRegistration::new(self.registration.clone()),
                timer: StageTimer::default(),
                placed: Vec::new(),
                state_publisher,
                recorder,
                live,
                reported_problem: None,
                recording_error,
                is_driven: self.drive.can_drive(),
                progress: Progress::new(self.quiet),
                clock: DataClock::default(),
                started: clock::now(),
                streams: Vec::new(),
                maps: stats.clone(),
            },
            mapping: MappingStage {
                maps,
                network,
                trajectory,
                events: EventLog::with_events(notes),
                overload: OverloadMonitor::default(),
                is_live: self.is_real_time_run(),
                is_dropping: false,
                timeline: None,
                stats,
            },
        })
    }

    /// Opens what the run writes into while it lasts; what an earlier run has written stays.
    fn open_files(&self) -> anyhow::Result<Files> {
        let vehicle = &self.config.vehicle.name;
        let recorder = self
            .record
            .as_ref()
            .map(|path| Recorder::create(path, vehicle, self.sync_policy(), self.earliest))
            .transpose();
        let (recorder, recording_error) = match recorder {
            Ok(recorder) => (recorder, None),
            // What is driven is not held up by what records it.
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

    /// Tells consoles what was decided at the start; what matters, the first that comes.
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

    /// Who syncs what is recorded.
    const fn sync_policy(&self) -> SyncPolicy {
        match self.rate {
            Rate::Times(_) if self.drive.can_drive() => SyncPolicy::Background,
            Rate::Times(_) => SyncPolicy::Inline,
            Rate::Max => SyncPolicy::OnDemand,
        }
    }

    /// Whether what is late is of no use: real sensors, and a simulation in which somebody drives in real time. All else is mapped
    /// whole, however long that takes.
    fn is_real_time_run(&self) -> bool {
        self.is_live || (self.drive.can_drive() && self.rate.is_real_time())
    }

    /// Writes all outputs that can be written; the first failure is returned.
    fn write_outputs(
        &self,
        mut pipeline: PipelineStages,
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

        let exported = self.export.as_ref().map_or(Ok(Vec::new()), |dir| {
            // Consoles may still ask for it.
            let trajectory = pipeline.mapping.trajectory.lock().poses();
            outputs::export(dir, &pipeline, &trajectory, &self.title)
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
