//! The saved map that the vehicle is searched for in, and beside it the map of the run.

use std::sync::Arc;

use anyhow::anyhow;
use protocol::tile::BootId;

use super::map_correction::MakingMaps;
use super::maps::Maps;
use crate::publishing::publisher::{PublishError, Publisher, PublisherState};
use localization::scan_localization::MapFromOdom;
use mapping::Mapper;
use measurement::time::RobotTime;

/// Until the vehicle is found, consoles get the saved map, and the collision monitor that of the run.
pub(super) struct SearchedMap {
    /// Where `odom` of its runs lies in the saved map.
    map_from_odom: Arc<MapFromOdom>,
    /// The map of the run, which nobody gets: of all its changes only the newest cells are kept.
    pub(super) of_run: Publisher,
    /// The saved map until it was taken.
    making: Option<MakingMaps>,
}

#[derive(Clone, Debug)]
pub(super) struct SearchedMapCheckpoint {
    pub(super) map_from_odom: Arc<MapFromOdom>,
    of_run: PublisherState,
}

impl SearchedMapCheckpoint {
    /// Memory of the tiles.
    pub(super) fn bytes(&self) -> usize {
        self.of_run.bytes()
    }
}

impl SearchedMap {
    /// `mapper` maps the run, whose tiles take at most `tile_store_mb` megabytes.
    pub(super) fn new(
        map_from_odom: Arc<MapFromOdom>,
        making: Option<MakingMaps>,
        mapper: &Mapper,
        tile_store_mb: u32,
    ) -> Result<Self, PublishError> {
        Ok(Self {
            map_from_odom,
            of_run: Publisher::new(BootId([0; 16]), tile_store_mb, mapper, false)?,
            making,
        })
    }

    pub(super) fn publish_run(
        &mut self,
        mapper: &mut Mapper,
        stamp: RobotTime,
    ) -> Result<(), PublishError> {
        self.of_run.publish(mapper, stamp)?;
        // They would be kept for consoles.
        drop(self.of_run.take_changed());
        Ok(())
    }

    /// The saved map or what failed, once, when it is made.
    pub(super) fn take_made(&mut self) -> Option<anyhow::Result<Maps>> {
        let thread = self.making.take_if(|thread| thread.is_finished())?;
        let made = thread.join();
        Some(made.unwrap_or_else(|_panic| Err(anyhow!("its thread failed"))))
    }

    pub(super) fn checkpoint(&self) -> SearchedMapCheckpoint {
        SearchedMapCheckpoint {
            map_from_odom: Arc::clone(&self.map_from_odom),
            of_run: self.of_run.state(),
        }
    }

    pub(super) fn restore(&mut self, to: &SearchedMapCheckpoint) -> Result<(), PublishError> {
        self.of_run.restore(&to.of_run)
    }
}
