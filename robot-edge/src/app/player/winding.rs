//! Where the recording and its maps stand, and how they get elsewhere.

use super::super::checkpoints::Kept;
use super::super::is_set;
use super::super::source::Source as _;
use super::Player;
use crate::clock::Monotonic;
use crate::robot_time::RobotDuration;

impl Player<'_> {
    /// Winds to `to`: it remains to map up to there.
    pub(super) fn wind(&mut self, to: RobotDuration) -> anyhow::Result<()> {
        let nearest = self.checkpoints.up_to(to).map(|kept| kept.at);
        if nearest.is_some_and(|at| to < self.position || at > self.newest) {
            self.go_back(to)?;
        } else if to < self.position {
            self.begin_anew()?;
        }
        // Behind the end there is nothing to be read.
        self.seeking = (!self.has_ended).then_some(to);
        self.meter.reset();
        self.tell();
        Ok(())
    }

    /// Goes on from the beginning.
    pub(super) fn begin_anew(&mut self) -> anyhow::Result<()> {
        self.source.begin_anew()?;
        self.sides.begin_anew(self.config, self.placer.clone())?;
        self.control.begin_anew();
        self.stand_at(RobotDuration::ZERO, 0);
        Ok(())
    }

    /// Goes on from the last copy of the maps up to `to`, be it behind or ahead.
    fn go_back(&mut self, to: RobotDuration) -> anyhow::Result<()> {
        let Some(kept) = self.checkpoints.up_to(to) else {
            return Ok(());
        };
        self.source.begin_anew()?;
        // To read is many times faster than to map.
        for _item in 0..kept.items {
            if is_set(self.interrupt) || self.source.next()?.is_none() {
                break;
            }
        }
        self.sides.go_back(&kept.sides)?;
        self.control.go_back(&kept.trail);
        let (at, items) = (kept.at, kept.items);
        self.stand_at(at, items);
        Ok(())
    }

    /// The source has yielded so many items, and the maps hold them.
    fn stand_at(&mut self, at: RobotDuration, items: u64) {
        self.batch.clear();
        self.next = None;
        // The maps that it belongs to are gone.
        self.standstill = None;
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
    pub(super) fn keep_checkpoint(&mut self) {
        let started = Monotonic::now();
        let kept = Kept {
            at: self.newest,
            items: self.items,
            trail: self.control.trail_so_far(),
            sides: self.sides.checkpoint(),
        };
        self.checkpoints.keep(kept, started.elapsed());
    }
}
