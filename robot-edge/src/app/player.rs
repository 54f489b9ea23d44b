//! A recording that is paused, wound and paced while it is mapped.
//!
//! As [`super::source_reader`], but on one thread with the maps, so that a pause stops them at once, and so that winding back
//! can begin them anew.

mod seek;

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::checkpoints::Checkpoints;
use super::is_set;
use super::mapping_stage::TimelineRecorder;
use super::outputs;
use super::pipeline::{PipelineStages, join_mapping_pool};
use super::run::{Run, nothing_mapped_error};
use super::source::{ReplaySource, Source as _, SourceItem};
use super::source_reader::Batch;
use crate::clock;
use crate::config::Config;
use crate::pacer::{MAX_GAP, Pacer, Rate};
use crate::pipeline::PausedSnapshot;
use crate::replay_control::{
    Length, RateMeter, ReplayCommands, ReplayControl, ReplayProgress, TimelineMark,
};
use localization::registration::RegistrationSettings;
use measurement::time::Monotonic;
use measurement::time::RobotDuration;
use recording::time_sequencer::Ordered;

/// Items in a batch, at most.
const MAX_BATCH_ITEMS: usize = 64;
/// Mapping a batch should take no longer: a wish waits for its end.
const MAX_BATCH_TIME: Duration = Duration::from_millis(20);
/// Whoever stands still looks up this often.
const PAUSED_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Replays `source` as `control` wants it, until interrupted.
///
/// # Errors
/// Where reading or publishing stopped, or nothing of the recording could be mapped.
pub(super) fn play(
    run: &Run<'_>,
    source: ReplaySource,
    control: &ReplayControl,
    interrupt: &AtomicBool,
) -> anyhow::Result<()> {
    let mut player = Player::new(run, source, control, interrupt)?;
    let _pool = join_mapping_pool(run.config.mapping.threads);
    while !is_set(interrupt) {
        player.step()?;
    }
    Ok(())
}

struct Player<'a> {
    source: ReplaySource,
    pipeline: PipelineStages,
    source_name: String,
    config: &'a Config,
    registration: &'a RegistrationSettings,
    control: &'a ReplayControl,
    interrupt: &'a AtomicBool,
    batch: Vec<SourceItem>,
    /// Items after which a batch is mapped.
    batch_size: usize,
    /// When the first of the batch was due.
    received_at: Monotonic,
    /// Streams that mapping knows.
    streams: usize,
    /// Items of the source that are mapped.
    items: u64,
    checkpoints: Checkpoints,
    /// What the source has lost in this round.
    lost: u64,
    /// How much of that it has put into words.
    loss_notes: usize,
    /// Taken from the source, and behind the position.
    next: Option<(SourceItem, RobotDuration)>,
    /// Up to here the recording is mapped.
    position: RobotDuration,
    /// Where the newest data is; behind it, a position may lie in a gap.
    newest: RobotDuration,
    seeking: Option<RobotDuration>,
    has_ended: bool,
    /// What was published so that the map is that of the position.
    paused_snapshot: Option<PausedSnapshot>,
    pacer: Pacer,
    /// The rate of `pacer`.
    pacer_rate: Rate,
    meter: RateMeter,
}

impl<'a> Player<'a> {
    fn new(
        run: &'a Run<'_>,
        source: ReplaySource,
        control: &'a ReplayControl,
        interrupt: &'a AtomicBool,
    ) -> anyhow::Result<Self> {
        let mut pipeline = run.start()?;
        pipeline.mapping.timeline = Some(TimelineRecorder {
            control: control.clone(),
            clock: source.clock(),
        });
        Ok(Self {
            source,
            pipeline,
            source_name: run.source.clone(),
            config: run.config,
            registration: &run.registration,
            control,
            interrupt,
            batch: Vec::with_capacity(MAX_BATCH_ITEMS),
            batch_size: MAX_BATCH_ITEMS,
            received_at: clock::now(),
            streams: 0,
            items: 0,
            checkpoints: Checkpoints::new(),
            lost: 0,
            loss_notes: 0,
            next: None,
            position: RobotDuration::ZERO,
            newest: RobotDuration::ZERO,
            seeking: None,
            has_ended: false,
            paused_snapshot: None,
            pacer: Pacer::new(run.rate),
            pacer_rate: run.rate,
            meter: RateMeter::default(),
        })
    }

    fn step(&mut self) -> anyhow::Result<()> {
        let commands = self.control.take_commands();
        if let Some(to) = commands.seek {
            self.seek(to)?;
        }
        if self.seeking.is_some() {
            return self.advance(commands);
        }
        if self.has_ended && commands.is_looping && !commands.is_paused {
            self.restart()?;
        }
        if self.has_ended || commands.is_paused {
            self.wait_paused(commands)
        } else {
            self.advance(commands)
        }
    }

    fn wait_paused(&mut self, commands: ReplayCommands) -> anyhow::Result<()> {
        self.process_batch()?;
        let paused_snapshot = match self.paused_snapshot.take() {
            Some(paused_snapshot) => paused_snapshot,
            None => self.pipeline.publish_paused(self.source.lost_total())?,
        };
        self.pipeline.mapping.serve_octree_files(&paused_snapshot);
        self.paused_snapshot = Some(paused_snapshot);
        self.meter.reset();
        // When it goes on, what comes next is due at once.
        self.pacer.reset();
        self.report_progress();
        let interrupt = self.interrupt;
        self.control
            .sleep_until(clock::now() + PAUSED_POLL_INTERVAL, commands, || {
                is_set(interrupt)
            });
        Ok(())
    }

    /// Takes one item, if its time has come.
    fn advance(&mut self, commands: ReplayCommands) -> anyhow::Result<()> {
        if let Some(paused_snapshot) = self.paused_snapshot.take() {
            self.pipeline.mapping.resume(paused_snapshot)?;
        }
        let Some((item, elapsed)) = self.next_item()? else {
            return self.end();
        };
        if let Some(to) = self.seeking {
            if elapsed > to {
                self.next = Some((item, elapsed));
                self.process_batch()?;
                self.position = to;
                self.seeking = None;
                self.meter.reset();
                self.pacer.reset();
                self.report_progress();
                return Ok(());
            }
        } else if let SourceItem::Timed(Ordered::Measurement(measurement)) = &item {
            if self.pacer_rate != commands.rate {
                self.pacer = Pacer::new(commands.rate);
                self.pacer_rate = commands.rate;
            }
            let now = clock::now();
            let wait = self.pacer.wait(measurement.stamp, now);
            if !wait.is_zero() {
                // What is due already must not wait for what is not.
                self.process_batch()?;
                let interrupt = self.interrupt;
                let is_due = self
                    .control
                    .sleep_until(now + wait, commands, || is_set(interrupt));
                if !is_due {
                    self.next = Some((item, elapsed));
                    return Ok(());
                }
            }
        }
        self.take(item, elapsed)
    }

    /// The next item, and the time of the data up to it.
    fn next_item(&mut self) -> anyhow::Result<Option<(SourceItem, RobotDuration)>> {
        if let Some(next) = self.next.take() {
            return Ok(Some(next));
        }
        let item = self.source.next()?;
        let elapsed = self.source.clock().elapsed();
        self.mark_losses(elapsed);
        Ok(item.map(|item| (item, elapsed)))
    }

    fn take(&mut self, item: SourceItem, elapsed: RobotDuration) -> anyhow::Result<()> {
        match &item {
            SourceItem::Timed(Ordered::ClockReset { .. }) => {
                self.pacer.reset();
                let what = "the clock of the data started anew";
                self.mark("clock", what.to_owned());
            }
            SourceItem::Timed(Ordered::Measurement(_))
            | SourceItem::Immediate(_)
            | SourceItem::Unmapped(_)
            | SourceItem::Live { .. }
            | SourceItem::Idle => {
                let gap_s = elapsed.as_secs_f64() - self.newest.as_secs_f64();
                if gap_s > MAX_GAP.as_secs_f64() {
                    self.mark("gap", format!("no data for {gap_s:.0} s"));
                }
            }
        }
        if self.batch.is_empty() {
            self.received_at = clock::now();
        }
        self.batch.push(item);
        self.position = elapsed;
        self.newest = elapsed;
        if self.batch.len() >= self.batch_size {
            self.process_batch()?;
        }
        Ok(())
    }

    fn end(&mut self) -> anyhow::Result<()> {
        self.process_batch()?;
        self.seeking = None;
        self.has_ended = true;
        self.control.set_length(Length {
            duration: self.position,
            is_estimate: false,
        });
        let counts = self.pipeline.localization.registration.counts();
        // Those that still wait are mapped for the standstill.
        if counts.dropped_scans.total() >= counts.scans_in {
            let mut summary = outputs::summary(&self.pipeline);
            summary.recording.clone_from(&self.source_name);
            return Err(nothing_mapped_error(&summary));
        }
        Ok(())
    }

    /// Maps what is due, and says how far that is.
    fn process_batch(&mut self) -> anyhow::Result<()> {
        if self.batch.is_empty() {
            return Ok(());
        }
        let started = clock::now();
        let items = std::mem::replace(&mut self.batch, Vec::with_capacity(MAX_BATCH_ITEMS));
        let count = items.len() as u32;
        let new_streams = self.source.streams_from(self.streams);
        self.streams += new_streams.len();
        if let Some(timeline) = &mut self.pipeline.mapping.timeline {
            timeline.clock = self.source.clock();
        }
        self.pipeline.take(Batch {
            items,
            received_at: self.received_at,
            // The time line says how fast it goes.
            lag: None,
            new_streams,
            position: self.source.position(),
            lost: self.lost,
        })?;
        let now = clock::now();
        let each = (now.since(started) / count).max(Duration::from_nanos(1));
        let fitting = MAX_BATCH_TIME.as_nanos() / each.as_nanos();
        self.batch_size = usize::try_from(fitting)
            .unwrap_or(MAX_BATCH_ITEMS)
            .clamp(1, MAX_BATCH_ITEMS);
        self.items += u64::from(count);
        if self.checkpoints.is_due(self.newest, now.since(started)) {
            self.take_checkpoint();
        }
        self.meter.record(self.position, now);
        self.report_progress();
        Ok(())
    }

    fn report_progress(&self) {
        let progress = ReplayProgress {
            is_opening: false,
            position: self.position,
            seeking: self.seeking,
            has_ended: self.has_ended,
            is_settled: self.paused_snapshot.is_some(),
        };
        self.control.report_progress(progress, self.meter.rate());
    }

    /// Marks what happened behind the newest data.
    fn mark(&self, kind: &'static str, message: String) {
        self.control.mark(TimelineMark {
            at: self.newest,
            kind,
            message,
        });
    }

    /// Marks what could not be read since the last item.
    fn mark_losses(&mut self, at: RobotDuration) {
        let lost = self.source.lost_total();
        let more = lost.saturating_sub(self.lost);
        let notes = self.source.loss_notes();
        let words = notes.get(self.loss_notes..).unwrap_or_default().join("; ");
        self.loss_notes = notes.len();
        if more == 0 {
            return;
        }
        self.lost = lost;
        let message = match (words.is_empty(), more) {
            (false, _) => words,
            // Those behind the first are only counted.
            (true, 1) => "a message could not be read".to_owned(),
            (true, n) => format!("{n} messages could not be read"),
        };
        self.control.mark(TimelineMark {
            at,
            kind: "loss",
            message,
        });
    }
}

#[cfg(test)]
mod tests;
