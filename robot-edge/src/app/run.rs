//! One run: a source, the pipeline, and what is left behind.

use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::sync_channel;

use anyhow::{Context as _, bail};
use protocol::tile::BootId;

use super::feed::{Batch, SourceEnd, feed};
use super::is_set;
use super::outputs::{self, Trajectory};
use super::recorder::Recorder;
use super::source::Source;
use super::writable;
use crate::clock::Monotonic;
use crate::config::Config;
use crate::exit::{Exit, Interrupted};
use crate::localization::placer::PlacerSettings;
use crate::mapping::posed_scan::PosedScan;
use crate::pacer::Rate;
use crate::pipeline::Pipeline;
use crate::progress::{Progress, ProgressFigures};
use crate::recording::stamp_order::Ordered;
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
    pub(super) record: Option<PathBuf>,
    pub(super) export: Option<PathBuf>,
    pub(super) summary: Option<PathBuf>,
    pub(super) quiet: bool,
    /// What was decided before the run.
    pub(super) events: Vec<Event>,
}

/// Batches that wait for the pipeline; a source that is faster waits for room, so nothing is dropped.
const BATCHES: usize = 8;

impl Run<'_> {
    /// Maps all that the source yields and writes what was asked for.
    pub(super) fn go(
        self,
        source: &mut dyn Source,
        interrupt: &AtomicBool,
        out: &mut dyn Write,
    ) -> anyhow::Result<Exit> {
        writable::prepare(self.export.as_deref(), self.summary.as_deref())?;
        let recorder = self.record.as_ref().map(|path| {
            Recorder::create(
                path,
                &self.config.vehicle.name,
                matches!(self.rate, Rate::Times(_)),
            )
        });
        // The summary says what streaming would have cost, which nobody else needs to know.
        let encode = self.summary.is_some();
        let mut mapping = Mapping {
            pipeline: Pipeline::new(self.config, self.placer.clone(), BootId([0; 16]), encode)?,
            recorder: recorder.transpose()?,
            trajectory: Trajectory::new(),
            progress: Progress::new(self.quiet),
            started: Monotonic::now(),
        };
        let (end, taken) = if self.config.mapping.threads > 1 {
            map_in_two_threads(source, self.rate, interrupt, &mut mapping)?
        } else {
            let mut taken = Ok(());
            let end = feed(source, self.rate, interrupt, |batch| {
                taken = mapping.take(batch);
                taken.is_ok()
            });
            (end, taken)
        };
        let trajectory = &mut mapping.trajectory;
        mapping.pipeline.finish(|scan| trajectory.add(scan))?;
        mapping.progress.finish();
        // Whatever ended the run, what was mapped until then is not lost.
        let summary = self.leave_behind(mapping, &end, is_set(interrupt), out);
        taken?;
        let summary = summary?;
        end.result?;
        if is_set(interrupt) {
            return Err(Interrupted.into());
        }
        self.is_mapped(&summary)?;
        Ok(Exit::Done)
    }

    /// An empty map is no success that a script should go on with.
    fn is_mapped(&self, summary: &Summary) -> anyhow::Result<()> {
        let scans = &summary.scans;
        if scans.mapped > 0 {
            return Ok(());
        }
        if scans.came_in == 0 {
            bail!("{}: not one scan came in, so there is no map", self.source);
        }
        let reasons: Vec<_> = scans
            .dropped
            .iter()
            .map(|(reason, n)| format!("{n} {reason}"))
            .collect();
        bail!(
            "{}: none of its {} scans could be mapped (dropped: {})",
            self.source,
            scans.came_in,
            reasons.join(", ")
        )
    }

    fn leave_behind(
        &self,
        mapping: Mapping,
        end: &SourceEnd,
        interrupted: bool,
        out: &mut dyn Write,
    ) -> anyhow::Result<Summary> {
        // Each is written though another cannot be; the first error is told.
        let recorded = mapping.recorder.map_or(Ok(()), Recorder::finish);
        let wall_s = mapping.started.elapsed().as_secs_f64();
        let (pipeline, trajectory) = (&mapping.pipeline, &mapping.trajectory);
        let exported = match &self.export {
            Some(dir) => outputs::export(dir, pipeline, trajectory, &self.title),
            None => Ok(Vec::new()),
        };
        let mut summary = outputs::summary(&mapping.pipeline);
        summary.recording.clone_from(&self.source);
        summary.vehicle.clone_from(&self.config.vehicle.name);
        summary.set_times(end.elapsed.as_secs_f64(), wall_s);
        summary.events.clone_from(&self.events);
        summary.add_source_end(end, interrupted);
        let summarised = match &self.summary {
            Some(path) => summary
                .write(path)
                .with_context(|| format!("{}: cannot write the summary", path.display())),
            None => Ok(()),
        };
        recorded?;
        let files = exported?;
        summarised?;
        if !self.quiet {
            outputs::tell(&summary, &files, out)?;
        }
        Ok(summary)
    }
}

fn map_in_two_threads(
    source: &mut dyn Source,
    rate: Rate,
    interrupt: &AtomicBool,
    mapping: &mut Mapping,
) -> anyhow::Result<(SourceEnd, anyhow::Result<()>)> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel::<Batch>(BATCHES);
        let feeding =
            scope.spawn(move || feed(source, rate, interrupt, |batch| sender.send(batch).is_ok()));
        let taken = receiver.iter().try_for_each(|batch| mapping.take(batch));
        // Or a feeder that waits for room would wait for ever.
        drop(receiver);
        let end = feeding
            .join()
            .map_err(|_panic| anyhow::anyhow!("the reading thread failed"))?;
        Ok((end, taken))
    })
}

/// The pipeline's side of a run.
struct Mapping {
    pipeline: Pipeline,
    recorder: Option<Recorder>,
    trajectory: Trajectory,
    progress: Progress,
    started: Monotonic,
}

impl Mapping {
    fn take(&mut self, batch: Batch) -> anyhow::Result<()> {
        for item in batch.items {
            let trajectory = &mut self.trajectory;
            let mapped = |scan: &PosedScan| trajectory.add(scan);
            match item {
                Ordered::Measurement(measurement) => {
                    if let Some(recorder) = &mut self.recorder
                        && let Some(stream) = batch.streams.get(usize::from(measurement.stream.0))
                    {
                        recorder.write(stream, &measurement)?;
                    }
                    self.pipeline.push(measurement, mapped)?;
                }
                Ordered::ClockReset { .. } => {
                    self.pipeline.reset_clock(mapped)?;
                }
            }
        }
        let scans = self.pipeline.report().scans_mapped;
        let figures = ProgressFigures {
            data_s: batch.elapsed.as_secs_f64(),
            wall_s: self.started.elapsed().as_secs_f64(),
            scans,
            drops: batch.lost + self.pipeline.placer().counts().dropped_scans.total(),
        };
        self.progress.update(batch.position, &figures);
        Ok(())
    }
}
