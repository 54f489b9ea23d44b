//! The maps as they were, to go back to.

use protocol::message::Shores;

use super::{Maps, MapsReport};
use crate::streaming::publisher::{PublishError, PublisherState};
use localization::geodesy::GeodeticPoint;
use mapping::Mapper;
use mapping::cost_map::CostMap;
use mapping::occupancy_grid::OccupancyGrid;
use mapping::terrain::Terrain;
use measurement::time::RobotTime;

/// All that [`Maps`] know at one time of the data.
#[derive(Clone, Debug)]
pub struct MapsCheckpoint {
    mapper: Mapper,
    publisher: PublisherState,
    published_at: Option<RobotTime>,
    scans_unpublished: u32,
    report: MapsReport,
    evictions_reported_at: Option<RobotTime>,
    shore_updates_taken: u32,
    last_scan: Option<RobotTime>,
    datum: Option<GeodeticPoint>,
}

impl MapsCheckpoint {
    /// Memory that it takes, bytes: the maps and the tiles, which are nearly all of it.
    pub fn bytes(&self) -> usize {
        let occupancy = self.mapper.occupancy().map_or(0, OccupancyGrid::bytes);
        let terrain = self.mapper.terrain().map_or(0, Terrain::bytes);
        let voxels = self.mapper.voxels().map_or(0, |voxels| {
            let octree = voxels.octree();
            octree.bytes() + octree.scratch_bytes() + voxels.cost().map_or(0, CostMap::bytes)
        });
        occupancy + terrain + voxels + self.publisher.bytes()
    }
}

impl Maps {
    /// A copy of all that is known now.
    pub fn checkpoint(&self) -> MapsCheckpoint {
        MapsCheckpoint {
            mapper: self.mapper.clone(),
            publisher: self.publisher.state(),
            published_at: self.published_at,
            scans_unpublished: self.scans_unpublished,
            report: self.report.clone(),
            evictions_reported_at: self.evictions_reported_at,
            shore_updates_taken: self.shore_updates_taken,
            last_scan: self.last_scan,
            datum: self.datum,
        }
    }

    /// Goes on from where the checkpoint was taken. What was published since is void, in a new epoch of each layer.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub fn restore(&mut self, checkpoint: &MapsCheckpoint) -> Result<(), PublishError> {
        self.publisher.restore(&checkpoint.publisher)?;
        self.mapper = checkpoint.mapper.clone();
        self.published_at = checkpoint.published_at;
        self.scans_unpublished = checkpoint.scans_unpublished;
        self.report = checkpoint.report.clone();
        self.map_events.clear();
        self.evictions_reported_at = checkpoint.evictions_reported_at;
        self.shore_updates_taken = checkpoint.shore_updates_taken;
        self.last_scan = checkpoint.last_scan;
        self.datum = checkpoint.datum;
        Ok(())
    }

    /// Shores and docking sites where any were looked for, whether they were taken or not, and the stamp of the last scan.
    pub fn current_shores(&self) -> Option<(RobotTime, Shores)> {
        let is_known = self.mapper.voxels()?.shore()?.updates() > 0;
        Some((self.last_scan.filter(|_| is_known)?, self.shores()?))
    }
}
