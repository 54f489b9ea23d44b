//! One run: a source, the pipeline, and what is left behind.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::sync_channel;

use anyhow::{Context as _, anyhow};
use protocol::tile::BootId;

use super::background::give_way;
use super::data_clock::DataClock;
use super::driving::DrivePlan;
use super::event_log::EventLog;
use super::feed::{Batch, SourceEnd, feed};
use super::is_set;
use super::mapping_side::MappingSide;
use super::network::{Network, Subject};
use super::network_plan::NetworkPlan;
use super::outputs;
use super::recorder::Recorder;
use super::source::Source;
use super::writable;
use crate::clock::Monotonic;
use crate::config::Config;
use crate::exit::{Exit, Interrupted};
use crate::keeping_up::KeepingUp;
use crate::link::random_id;
use crate::localization::placer::PlacerSettings;
use crate::pacer::Rate;
use crate::pipeline::Pipeline;
use crate::progress::Progress;
use crate::robot_time::RobotTime;
use crate::summary::{Event, Summary};

/// What a run is made of.
pub(super) struct Run<'a> {
    /// The recording or world as it was named.
    pub(super) source: String,
    /// Heads the pictures.
    pub(super) title: String,
    pub(super) config: &'a Config,
    pub(super) placer: PlacerSettings,
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

/// Batches that wait for the pipeline; a source that is faster waits for room, so nothing is dropped.
const BATCHES: usize = 8;

impl Run<'_> {
    /// Maps all that the source yields and writes what was asked for.
    ///
    /// Whatever fails, all that can still be written is; the first failure is returned at the end.
    pub(super) fn go(
        self,
        source: &mut dyn Source,
        interrupt: &AtomicBool,
        out: &mut dyn Write,
    ) -> anyhow::Result<Exit> {
        let mut side = self.start()?;
        if self.drive.can_drive() {
            give_way();
        }
        // What is driven must not wait for what is mapped.
        let (end, taken) = if self.config.mapping.threads > 1 || self.drive.can_drive() {
            let _pool = pool_around_this_thread(self.config.mapping.threads);
            map_in_two_threads(source, self.rate, interrupt, &mut side)?
        } else {
            let mut taken = Ok(());
            let end = feed(source, self.rate, interrupt, |batch| {
                if taken.is_ok() {
                    taken = side.take(batch);
                }
                taken.is_ok()
            });
            (end, taken)
        };
        let finished = side.finish(end.lost.counts.total());
        let wall_s = side.started.elapsed().as_secs_f64();
        let went_well = taken.is_ok() && finished.is_ok() && end.result.is_ok();
        if let Some(network) = &side.network
            && went_well
        {
            network.take_leave(&side.pipeline, self.quiet, || is_set(interrupt));
        }
        // Whoever served the map until Ctrl-C asked for nothing else.
        // What is driven waits to be driven on: nothing else ends it.
        let is_at_its_end = end.is_complete || self.drive.can_drive();
        let stayed = self.network.as_ref().is_some_and(NetworkPlan::stays) && is_at_its_end;
        let interrupted = is_set(interrupt) && !stayed;
        let left = self.leave_behind(side, &end, wall_s, interrupted, out);
        taken?;
        finished?;
        end.result?;
        let summary = left?;
        if interrupted {
            return Err(Interrupted.into());
        }
        if summary.scans.mapped == 0 {
            return Err(nothing_mapped(&summary));
        }
        Ok(Exit::Done)
    }

    /// What cannot be written should be known before an hour of mapping, and so should what was decided.
    pub(super) fn start(&self) -> anyhow::Result<MappingSide> {
        writable::prepare(self.export.as_deref(), self.summary.as_deref())?;
        let in_real_time = matches!(self.rate, Rate::Times(_));
        let recorder = match &self.record {
            Some(path) => {
                let vehicle = &self.config.vehicle.name;
                Some(Recorder::create(
                    path,
                    vehicle,
                    in_real_time,
                    self.earliest,
                )?)
            }
            None => None,
        };
        if !self.quiet {
            for event in &self.events {
                writeln!(io::stderr(), "{}: {}", event.kind, event.message)?;
            }
        }
        // The summary says what streaming would have cost, which nobody else needs to know.
        let encode = self.summary.is_some();
        let boot = BootId(random_id()?);
        let pipeline = Pipeline::new(self.config, self.placer.clone(), boot, encode)?;
        let network = match &self.network {
            Some(plan) => {
                let subject = Subject {
                    source: &self.title,
                    is_live: self.is_live,
                    placing: &self.placer,
                    can_record: self.drive.can_record(),
                };
                Network::open(
                    plan,
                    self.config,
                    &subject,
                    boot,
                    &pipeline,
                    &self.drive,
                    self.quiet,
                )?
            }
            None => None,
        };
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
        for event in &self.events {
            if let Some(network) = &network {
                network.tell(&event.kind, &event.message);
            }
        }
        Ok(MappingSide {
            pipeline,
            network,
            recorder,
            live,
            told_problem: None,
            not_recorded: None,
            is_driven: self.drive.can_drive(),
            trajectory,
            progress: Progress::new(self.quiet),
            clock: DataClock::default(),
            started: Monotonic::now(),
            streams: Vec::new(),
            events: EventLog::default(),
            keeping_up: KeepingUp::default(),
            marking: None,
        })
    }

    /// Writes all outputs that can be written; the first failure is returned.
    fn leave_behind(
        &self,
        side: MappingSide,
        end: &SourceEnd,
        wall_s: f64,
        interrupted: bool,
        out: &mut dyn Write,
    ) -> anyhow::Result<Summary> {
        let mut summary = outputs::summary(&side.pipeline);
        summary.recording.clone_from(&self.source);
        summary.vehicle.clone_from(&self.config.vehicle.name);
        summary.set_times(side.clock.elapsed().as_secs_f64(), wall_s);
        summary.events.clone_from(&self.events);
        summary.events.extend(side.events.into_events());
        summary.add_source_end(end, interrupted);

        let recorded = match (side.not_recorded, side.recorder) {
            (Some(error), _) => Err(error),
            (None, Some(recorder)) => {
                summary.add_recorder_notes(recorder.notes());
                recorder.finish()
            }
            (None, None) => Ok(()),
        };
        let exported = self.export.as_ref().map_or(Ok(Vec::new()), |dir| {
            // Consoles may still ask for it.
            let way = side.trajectory.lock().poses();
            outputs::export(dir, &side.pipeline, &way, &self.title)
        });
        let summarised = self.summary.as_ref().map_or(Ok(()), |path| {
            summary
                .write(path)
                .with_context(|| format!("{}: cannot write the summary", path.display()))
        });
        if !self.quiet {
            outputs::tell(&summary, exported.as_deref().unwrap_or_default(), out)?;
        }
        recorded?;
        exported?;
        summarised?;
        Ok(summary)
    }
}

/// Makes this thread, which maps, one of those that share the work of a scan: were it outside of their pool, it would
/// have to wake two others for each scan and sleep itself, which costs as much as the second core gains.
///
/// Where that fails, rayon's own pool shares the work, for the same maps.
pub(super) fn pool_around_this_thread(threads: usize) -> Option<rayon::ThreadPool> {
    if threads < 2 {
        return None;
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .use_current_thread()
        .thread_name(|number| format!("mapping-{number}"))
        .build();
    pool.inspect_err(|error| tracing::warn!(%error, "mapping without threads of its own"))
        .ok()
}

fn map_in_two_threads(
    source: &mut dyn Source,
    rate: Rate,
    interrupt: &AtomicBool,
    side: &mut MappingSide,
) -> anyhow::Result<(SourceEnd, anyhow::Result<()>)> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Batch>(BATCHES);
        let feeding =
            scope.spawn(move || feed(source, rate, interrupt, |batch| sender.send(batch).is_ok()));
        let taken = receiver.iter().try_for_each(|batch| side.take(batch));
        // Or a feeder that waits for room would wait for ever.
        drop(receiver);
        let end = feeding
            .join()
            .map_err(|_panic| anyhow!("the reading thread failed"))?;
        Ok((end, taken))
    })
}

pub(super) fn nothing_mapped(summary: &Summary) -> anyhow::Error {
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
