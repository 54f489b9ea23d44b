//! A recording that is paused, wound and paced while it is mapped.
//!
//! As [`super::feed`], but on one thread with the maps, so that a pause stops them at once, and so that winding back
//! can begin them anew.

mod winding;

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::checkpoints::Checkpoints;
use super::feed::Batch;
use super::is_set;
use super::mapping_side::Marking;
use super::outputs;
use super::run::{Run, nothing_mapped};
use super::sides::{Sides, pool_around_this_thread};
use super::source::{Item, Replayed, Source as _};
use crate::clock::Monotonic;
use crate::config::Config;
use crate::localization::placer::PlacerSettings;
use crate::pacer::{LONGEST_GAP, Pacer, Rate};
use crate::pipeline::Standstill;
use crate::recording::stamp_order::Ordered;
use crate::replay_control::{Length, Mark, Progress, RateMeter, ReplayControl, Wishes};
use crate::robot_time::RobotDuration;

/// Items in a batch, at most.
const BATCH: usize = 64;
/// Mapping a batch should take no longer: a wish waits for its end.
const BATCH_TIME: Duration = Duration::from_millis(20);
/// Whoever stands still looks up this often.
const REST: Duration = Duration::from_millis(100);

/// Replays `source` as `control` wants it, until interrupted.
///
/// # Errors
/// Where reading or publishing stopped, or nothing of the recording could be mapped.
pub(super) fn play(
    run: &Run<'_>,
    source: Replayed,
    control: &ReplayControl,
    interrupt: &AtomicBool,
) -> anyhow::Result<()> {
    let mut player = Player::new(run, source, control, interrupt)?;
    let _pool = pool_around_this_thread(run.config.mapping.threads);
    while !is_set(interrupt) {
        player.step()?;
    }
    Ok(())
}

struct Player<'a> {
    source: Replayed,
    sides: Sides,
    source_name: String,
    config: &'a Config,
    placer: &'a PlacerSettings,
    control: &'a ReplayControl,
    interrupt: &'a AtomicBool,
    batch: Vec<Item>,
    /// Items after which a batch is mapped.
    batch_size: usize,
    /// When the first of the batch was due.
    came: Monotonic,
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
    next: Option<(Item, RobotDuration)>,
    /// Up to here the recording is mapped.
    position: RobotDuration,
    /// Where the newest data is; behind it, a position may lie in a gap.
    newest: RobotDuration,
    seeking: Option<RobotDuration>,
    has_ended: bool,
    /// What was published so that the map is that of the position.
    standstill: Option<Standstill>,
    pacer: Pacer,
    /// The rate of `pacer`.
    paced: Rate,
    meter: RateMeter,
}

impl<'a> Player<'a> {
    fn new(
        run: &'a Run<'_>,
        source: Replayed,
        control: &'a ReplayControl,
        interrupt: &'a AtomicBool,
    ) -> anyhow::Result<Self> {
        let mut sides = run.start()?;
        sides.mapping.marking = Some(Marking {
            control: control.clone(),
            clock: source.clock(),
        });
        Ok(Self {
            source,
            sides,
            source_name: run.source.clone(),
            config: run.config,
            placer: &run.placer,
            control,
            interrupt,
            batch: Vec::with_capacity(BATCH),
            batch_size: BATCH,
            came: Monotonic::now(),
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
            standstill: None,
            pacer: Pacer::new(run.rate),
            paced: run.rate,
            meter: RateMeter::default(),
        })
    }

    fn step(&mut self) -> anyhow::Result<()> {
        let wishes = self.control.take_wishes();
        if let Some(to) = wishes.seek {
            self.wind(to)?;
        }
        if self.seeking.is_some() {
            return self.advance(wishes);
        }
        if self.has_ended && wishes.is_looping && !wishes.is_paused {
            self.begin_anew()?;
        }
        if self.has_ended || wishes.is_paused {
            self.rest(wishes)
        } else {
            self.advance(wishes)
        }
    }

    fn rest(&mut self, wishes: Wishes) -> anyhow::Result<()> {
        self.hand_over()?;
        let standstill = match self.standstill.take() {
            Some(standstill) => standstill,
            None => self.sides.stand_still(self.source.lost_total())?,
        };
        self.sides.mapping.serve_voxels(&standstill);
        self.standstill = Some(standstill);
        self.meter.reset();
        // When it goes on, what comes next is due at once.
        self.pacer.reset();
        self.tell();
        let interrupt = self.interrupt;
        self.control
            .sleep_until(Monotonic::now() + REST, wishes, || is_set(interrupt));
        Ok(())
    }

    /// Takes one item, if its time has come.
    fn advance(&mut self, wishes: Wishes) -> anyhow::Result<()> {
        if let Some(standstill) = self.standstill.take() {
            self.sides.mapping.go_on(standstill)?;
        }
        let Some((item, elapsed)) = self.next_item()? else {
            return self.end();
        };
        if let Some(to) = self.seeking {
            if elapsed > to {
                self.next = Some((item, elapsed));
                self.hand_over()?;
                self.position = to;
                self.seeking = None;
                self.meter.reset();
                self.pacer.reset();
                self.tell();
                return Ok(());
            }
        } else if let Item::Due(Ordered::Measurement(measurement)) = &item {
            if self.paced != wishes.rate {
                self.pacer = Pacer::new(wishes.rate);
                self.paced = wishes.rate;
            }
            let now = Monotonic::now();
            let wait = self.pacer.wait(measurement.stamp, now);
            if !wait.is_zero() {
                // What is due already must not wait for what is not.
                self.hand_over()?;
                let interrupt = self.interrupt;
                let is_due = self
                    .control
                    .sleep_until(now + wait, wishes, || is_set(interrupt));
                if !is_due {
                    self.next = Some((item, elapsed));
                    return Ok(());
                }
            }
        }
        self.take(item, elapsed)
    }

    /// The next item, and the time of the data up to it.
    fn next_item(&mut self) -> anyhow::Result<Option<(Item, RobotDuration)>> {
        if let Some(next) = self.next.take() {
            return Ok(Some(next));
        }
        let item = self.source.next()?;
        let elapsed = self.source.clock().elapsed();
        self.mark_losses(elapsed);
        Ok(item.map(|item| (item, elapsed)))
    }

    fn take(&mut self, item: Item, elapsed: RobotDuration) -> anyhow::Result<()> {
        match &item {
            Item::Due(Ordered::ClockReset { .. }) => {
                self.pacer.reset();
                let what = "the clock of the data started anew";
                self.mark("clock", what.to_owned());
            }
            Item::Due(Ordered::Measurement(_))
            | Item::AtOnce(_)
            | Item::Aside(_)
            | Item::Came { .. }
            | Item::Pause => {
                let gap_s = elapsed.as_secs_f64() - self.newest.as_secs_f64();
                if gap_s > LONGEST_GAP.as_secs_f64() {
                    self.mark("gap", format!("no data for {gap_s:.0} s"));
                }
            }
        }
        if self.batch.is_empty() {
            self.came = Monotonic::now();
        }
        self.batch.push(item);
        self.position = elapsed;
        self.newest = elapsed;
        if self.batch.len() >= self.batch_size {
            self.hand_over()?;
        }
        Ok(())
    }

    fn end(&mut self) -> anyhow::Result<()> {
        self.hand_over()?;
        self.seeking = None;
        self.has_ended = true;
        self.control.tell_length(Length {
            duration: self.position,
            is_estimate: false,
        });
        let counts = self.sides.placing.placer.counts();
        // Those that still wait are mapped for the standstill.
        if counts.dropped_scans.total() >= counts.scans_in {
            let mut summary = outputs::summary(&self.sides);
            summary.recording.clone_from(&self.source_name);
            return Err(nothing_mapped(&summary));
        }
        Ok(())
    }

    /// Maps what is due, and says how far that is.
    fn hand_over(&mut self) -> anyhow::Result<()> {
        if self.batch.is_empty() {
            return Ok(());
        }
        let started = Monotonic::now();
        let items = std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH));
        let count = items.len() as u32;
        let new_streams = self.source.streams_from(self.streams);
        self.streams += new_streams.len();
        if let Some(marking) = &mut self.sides.mapping.marking {
            marking.clock = self.source.clock();
        }
        self.sides.take(Batch {
            items,
            came: self.came,
            // The time line says how fast it goes.
            late: None,
            new_streams,
            position: self.source.position(),
            lost: self.lost,
        })?;
        let now = Monotonic::now();
        let each = (now.since(started) / count).max(Duration::from_nanos(1));
        let fitting = BATCH_TIME.as_nanos() / each.as_nanos();
        self.batch_size = usize::try_from(fitting).unwrap_or(BATCH).clamp(1, BATCH);
        self.items += u64::from(count);
        if self.checkpoints.is_due(self.newest, now.since(started)) {
            self.keep_checkpoint();
        }
        self.meter.see(self.position, now);
        self.tell();
        Ok(())
    }

    fn tell(&self) {
        let progress = Progress {
            is_opening: false,
            position: self.position,
            seeking: self.seeking,
            has_ended: self.has_ended,
            is_settled: self.standstill.is_some(),
        };
        self.control.tell(progress, self.meter.rate());
    }

    /// Marks what happened behind the newest data.
    fn mark(&self, kind: &'static str, message: String) {
        self.control.mark(Mark {
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
        self.control.mark(Mark {
            at,
            kind: "loss",
            message,
        });
    }
}

#[cfg(test)]
mod tests;
