//! A replay that can be paused, sought and paced.
//!
//! Unlike [`super::source_reader`], it reads on the thread that maps, so that a pause takes effect at once and a seek
//! can restart the maps.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::mapping_stage::TimelineRecorder;
use super::maps::PausedSnapshot;
use super::pipeline::{Pipeline, PipelineCheckpoint, join_mapping_pool};
use super::run::{Run, nothing_mapped_error};
use super::source::{ReplaySource, Source as _, SourceItem};
use super::source_reader::Batch;
use super::{is_set, outputs};
use crate::config::Config;
use crate::pacer::{MAX_GAP, Pacer, Rate};
use crate::replay_control::{
    Length, RateMeter, ReplayCommands, ReplayControl, ReplayProgress, ReplayTrail, TimelineMark,
};
use localization::registration::RegistrationSettings;
use measurement::time::{Monotonic, RobotDuration};
use network::clock;
use recording::time_sequencer::Ordered;

const MAX_BATCH_ITEMS: usize = 64;
/// Maximum time to map a batch: commands wait for its end.
const MAX_BATCH_TIME: Duration = Duration::from_millis(20);
const PAUSED_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Replays `source` as `control` commands, until interrupted.
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
    pipeline: Pipeline,
    source_name: String,
    config: &'a Config,
    registration: &'a RegistrationSettings,
    control: &'a ReplayControl,
    interrupt: &'a AtomicBool,
    batch: Vec<SourceItem>,
    batch_size: usize,
    /// When the first item of the batch was due.
    received_at: Monotonic,
    /// Number of streams that the pipeline knows.
    streams: usize,
    /// Number of items that are mapped.
    items: u64,
    checkpoints: Checkpoints,
    /// Messages that the source has lost in this loop.
    lost: u64,
    /// Number of loss notes that are on the timeline.
    loss_notes: usize,
    /// Already read, and after `position`.
    next: Option<(SourceItem, RobotDuration)>,
    /// Time of the data up to which the recording is mapped.
    position: RobotDuration,
    /// Time of the newest data; `position` may be in a gap after it.
    newest: RobotDuration,
    seeking: Option<RobotDuration>,
    has_ended: bool,
    paused_snapshot: Option<PausedSnapshot>,
    pacer: Pacer,
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
        // When the replay resumes, the next item is due at once.
        self.pacer.reset();
        self.report_progress();
        let interrupt = self.interrupt;
        self.control
            .sleep_until(clock::now() + PAUSED_POLL_INTERVAL, commands, || {
                is_set(interrupt)
            });
        Ok(())
    }

    /// Takes one item if it is due.
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
                // Items that are due do not wait for the next one.
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
                let what = "the clock of the data was reset";
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
        // Scans that still wait for a pose are mapped in the paused snapshot.
        if counts.dropped_scans.total() >= counts.scans_in {
            let mut summary = outputs::summary(&self.pipeline);
            summary.recording.clone_from(&self.source_name);
            return Err(nothing_mapped_error(&summary));
        }
        Ok(())
    }

    /// Maps the batch and reports the progress.
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
            // The timeline shows the speed.
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

    /// Adds a mark at the newest data.
    fn mark(&self, kind: &'static str, message: String) {
        self.control.mark(TimelineMark {
            at: self.newest,
            kind,
            message,
        });
    }

    /// Adds a mark for the losses since the last item.
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
            // Later losses have no note.
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

impl Player<'_> {
    /// Goes to `to`; mapping up to there may remain to be done.
    pub(super) fn seek(&mut self, to: RobotDuration) -> anyhow::Result<()> {
        let nearest = self.checkpoints.latest_until(to).map(|kept| kept.at);
        if nearest.is_some_and(|at| to < self.position || at > self.newest) {
            self.restore(to)?;
        } else if to < self.position {
            self.restart()?;
        }
        // After the end there is nothing to read.
        self.seeking = (!self.has_ended).then_some(to);
        self.meter.reset();
        self.report_progress();
        Ok(())
    }

    pub(super) fn restart(&mut self) -> anyhow::Result<()> {
        self.source.restart()?;
        self.pipeline
            .restart(self.config, self.registration.clone())?;
        self.control.restart();
        self.reset_to(RobotDuration::ZERO, 0);
        Ok(())
    }

    /// Restores the last checkpoint up to `to`, earlier or later than the current position.
    fn restore(&mut self, to: RobotDuration) -> anyhow::Result<()> {
        let Some(kept) = self.checkpoints.latest_until(to) else {
            return Ok(());
        };
        self.source.restart()?;
        // Reading is many times faster than mapping.
        for _item in 0..kept.items {
            if is_set(self.interrupt) || self.source.next()?.is_none() {
                break;
            }
        }
        self.pipeline.restore(&kept.pipeline)?;
        self.control.restore(&kept.trail);
        let (at, items) = (kept.at, kept.items);
        self.reset_to(at, items);
        Ok(())
    }

    /// The source has yielded `items` items, and the maps contain them.
    fn reset_to(&mut self, at: RobotDuration, items: u64) {
        self.batch.clear();
        self.next = None;
        // It belongs to the maps before the seek.
        self.paused_snapshot = None;
        self.items = items;
        self.streams = 0;
        self.lost = self.source.lost_total();
        self.loss_notes = self.source.loss_notes().len();
        self.position = at;
        self.newest = at;
        self.seeking = None;
        self.has_ended = false;
        self.pacer.reset();
        self.meter.reset();
    }

    pub(super) fn take_checkpoint(&mut self) {
        let started = clock::now();
        let kept = ReplayCheckpoint {
            at: self.newest,
            items: self.items,
            trail: self.control.trail_snapshot(),
            pipeline: self.pipeline.checkpoint(),
        };
        self.checkpoints.keep(kept, clock::elapsed(started));
    }
}

/// Mapping time between two checkpoints, at least.
const MIN_INTERVAL: Duration = Duration::from_millis(1500);
/// Checkpoints cost at most this part of the time.
const MAX_COST_DIVISOR: u32 = 20;
/// Limits of the number of checkpoints and of their memory, bytes.
pub(super) const MAX_CHECKPOINTS: usize = 24;
const MAX_BYTES: usize = 512_000_000;

pub(super) struct ReplayCheckpoint {
    /// Time of the data since the first scan.
    pub(super) at: RobotDuration,
    /// Number of items of the source.
    pub(super) items: u64,
    pub(super) trail: ReplayTrail,
    pub(super) pipeline: PipelineCheckpoint,
}

/// The checkpoints of a recording, in its order.
pub(super) struct Checkpoints {
    pub(super) kept: Vec<ReplayCheckpoint>,
    /// Mapping time between two checkpoints.
    pub(super) interval: Duration,
    /// Mapping time since the last checkpoint.
    since_last: Duration,
}

impl Checkpoints {
    pub(super) const fn new() -> Self {
        Self {
            kept: Vec::new(),
            interval: MIN_INTERVAL,
            since_last: Duration::ZERO,
        }
    }

    /// Adds the mapping time up to `at`, and returns whether a checkpoint is due.
    pub(super) fn is_due(&mut self, at: RobotDuration, took: Duration) -> bool {
        if self.kept.last().is_some_and(|last| at <= last.at) {
            return false;
        }
        self.since_last += took;
        self.since_last >= self.interval
    }

    /// Adds a checkpoint after all others; `took` is the time of making it.
    pub(super) fn keep(&mut self, kept: ReplayCheckpoint, took: Duration) {
        self.kept.push(kept);
        self.since_last = Duration::ZERO;
        self.interval = self.interval.max(MAX_COST_DIVISOR * took);
        while self.kept.len() > MAX_CHECKPOINTS
            || (self.bytes() > MAX_BYTES && !self.kept.is_empty())
        {
            self.thin();
        }
    }

    pub(super) fn latest_until(&self, to: RobotDuration) -> Option<&ReplayCheckpoint> {
        let behind = self.kept.partition_point(|kept| kept.at <= to);
        self.kept.get(behind.checked_sub(1)?)
    }

    fn bytes(&self) -> usize {
        self.kept.iter().map(|kept| kept.pipeline.bytes()).sum()
    }

    /// Removes every second checkpoint, the first one first, so that a single one that is too large is removed.
    fn thin(&mut self) {
        let mut index = 0;
        self.kept.retain(|_| {
            index += 1;
            index % 2 == 0
        });
        self.interval *= 2;
    }
}

#[cfg(test)]
mod tests;
