//! Where the recording and its maps stand, and how they get elsewhere.

use super::super::checkpoints::ReplayCheckpoint;
use super::super::is_set;
use super::super::source::Source as _;
use super::Player;
use crate::clock;
use measurement::time::RobotDuration;

impl Player<'_> {
    /// Winds to `to`: it remains to map up to there.
    pub(super) fn seek(&mut self, to: RobotDuration) -> anyhow::Result<()> {
        let nearest = self.checkpoints.latest_until(to).map(|kept| kept.at);
        if nearest.is_some_and(|at| to < self.position || at > self.newest) {
            self.restore(to)?;
        } else if to < self.position {
            self.restart()?;
        }
        // Behind the end there is nothing to be read.
        self.seeking = (!self.has_ended).then_some(to);
        self.meter.reset();
        self.report_progress();
        Ok(())
    }

    /// Goes on from the beginning.
    pub(super) fn restart(&mut self) -> anyhow::Result<()> {
        self.source.restart()?;
        self.pipeline
            .restart(self.config, self.registration.clone())?;
        self.control.restart();
        self.reset_to(RobotDuration::ZERO, 0);
        Ok(())
    }

    /// Goes on from the last copy of the maps up to `to`, be it behind or ahead.
    fn restore(&mut self, to: RobotDuration) -> anyhow::Result<()> {
        let Some(kept) = self.checkpoints.latest_until(to) else {
            return Ok(());
        };
        self.source.restart()?;
        // To read is many times faster than to map.
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

    /// The source has yielded so many items, and the maps hold them.
    fn reset_to(&mut self, at: RobotDuration, items: u64) {
        self.batch.clear();
        self.next = None;
        // The maps that it belongs to are gone.
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

    /// Keeps a copy of the maps.
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
