//! What is published while a replay stands still, and the maps that begin anew when it is wound back.
//!
//! A scan waits for the pose behind it, and cells wait to be published. Whoever looks at a paused recording wants both
//! at once, yet neither may change what comes when it goes on: so a copy of the maps is brought to its end and
//! published, and what that changed is taken back.

use protocol::message::Shores;

use super::{Maps, MapsReport, ScanObserver};
use crate::config::Config;
use crate::streaming::publisher::{PublishError, ReplacedTiles};
use localization::config::OnJump;
use localization::registration::RegistrationOutput;
use mapping::Mapper;
use mapping::octree::Octree;
use measurement::time::RobotTime;

/// What was published for a standstill.
#[derive(Debug)]
pub struct PausedSnapshot {
    published: ReplacedTiles,
    /// Scans that the maps themselves do not hold yet, and the jumps before and behind them.
    waiting: Vec<RegistrationOutput>,
    last_scan: Option<RobotTime>,
    /// Shores and docking sites if they are other than those taken before, and the stamp of the last scan.
    pub shores: Option<(RobotTime, Shores)>,
}

impl PausedSnapshot {
    /// Stamp of the newest scan that is shown.
    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.last_scan
    }
}

impl Maps {
    /// Publishes the maps as if the data ended here: to the cell what [`Maps::finish`] would leave behind it.
    ///
    /// It takes a copy of the maps, for as long as this lasts. `waiting` is what the end of the data would have placed;
    /// `observer` hears of those scans.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn publish_paused(
        &mut self,
        waiting: Vec<RegistrationOutput>,
        mut observer: impl ScanObserver,
    ) -> Result<PausedSnapshot, PublishError> {
        let mut ended = Self {
            mapper: self.mapper.clone(),
            publisher: self.publisher.with_undo(),
            publish_period: self.publish_period,
            published_at: self.published_at,
            scans_unpublished: self.scans_unpublished,
            report: MapsReport::default(),
            on_jump: self.on_jump,
            map_events: Vec::new(),
            evictions_reported_at: self.evictions_reported_at,
            shore_updates_taken: self.shore_updates_taken,
            last_scan: self.last_scan,
            datum: self.datum,
        };
        waiting
            .iter()
            .try_for_each(|placed| ended.take(placed, &mut observer))?;
        ended.finish()?;
        let shores = ended.take_shores();
        self.publisher.add_changed(ended.publisher.take_changed());
        Ok(PausedSnapshot {
            waiting,
            last_scan: ended.last_scan,
            published: ended.publisher.into_replaced(),
            shores,
        })
    }

    /// The octree that belongs to what is published, where there is one. It takes a copy of the maps.
    pub fn octree_of(&self, paused_snapshot: &PausedSnapshot) -> Option<Octree> {
        let mut ended = self.mapper.voxels()?.clone();
        for placed in &paused_snapshot.waiting {
            match (placed, self.on_jump) {
                (RegistrationOutput::Scan(scan), _) => {
                    ended.integrate(scan);
                }
                (RegistrationOutput::Jump(_), OnJump::Reset) => ended.reset(),
                (RegistrationOutput::Jump(_), OnJump::Keep) => {}
            }
        }
        Some(ended.octree().clone())
    }

    /// Takes back what was published for a standstill: the data goes on.
    ///
    /// Exact as long as the tile store has room (`streaming.tile_store_mb`); what was evicted for the standstill stays so.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn resume(&mut self, paused_snapshot: PausedSnapshot) -> Result<(), PublishError> {
        self.publisher.restore_replaced(paused_snapshot.published)
    }

    /// Empty maps again, for data that begins anew. Layers keep their place in the tile store, in a new epoch.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn restart(&mut self, config: &Config) -> Result<(), PublishError> {
        self.mapper = Mapper::new(
            &config.mapping,
            config.vehicle.shape(),
            &config.range_models(),
        );
        self.publisher.restart(&self.mapper)?;
        self.published_at = None;
        self.scans_unpublished = 0;
        self.report = MapsReport::default();
        self.map_events.clear();
        self.evictions_reported_at = None;
        self.shore_updates_taken = 0;
        self.last_scan = None;
        self.datum = None;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
