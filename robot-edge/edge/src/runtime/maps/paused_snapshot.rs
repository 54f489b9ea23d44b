//! The maps as published while a replay is paused.

use std::sync::Arc;

use protocol::message::Shores;

use super::Maps;
use crate::publishing::publisher::{PublishError, ReplacedTiles};
use crate::runtime::searched_map::SearchedMap;
use localization::OnJump;
use localization::registration::RegistrationOutput;
use mapping::octree::Octree;
use mapping::registered_scan::RegisteredScan;
use measurement::time::RobotTime;

/// The maps as published while a replay is paused.
///
/// A scan waits for the next pose, and changed cells wait for the next publication. A paused replay shows both at once,
/// and the data that follows must not depend on it. Therefore a copy of the maps is finished and published, and the
/// replaced tiles are restored when the replay resumes.
#[derive(Debug)]
pub struct PausedSnapshot {
    published: ReplacedTiles,
    /// Scans that the maps themselves do not contain yet, and the pose jumps between them.
    waiting: Vec<RegistrationOutput>,
    last_scan: Option<RobotTime>,
    /// Shores and docking sites if they changed, and the stamp of the last scan.
    pub shores: Option<(RobotTime, Shores)>,
}

impl PausedSnapshot {
    /// The scans that are only in the snapshot.
    pub(in crate::runtime) fn waiting_scans(&self) -> impl Iterator<Item = &RegisteredScan> {
        self.waiting
            .iter()
            .filter_map(|registered| match registered {
                RegistrationOutput::Scan(scan) => Some(scan),
                RegistrationOutput::Jump(_)
                | RegistrationOutput::Corrected(_)
                | RegistrationOutput::Confidence(_) => None,
            })
    }

    pub const fn last_scan(&self) -> Option<RobotTime> {
        self.last_scan
    }
}

impl Maps {
    /// Publishes the maps as if the data ended here, with the same cells as [`Maps::finish`]. `waiting` is what the
    /// registration would yield at the end of the data.
    ///
    /// The copy of the maps exists only during this call.
    pub fn publish_paused(
        &mut self,
        waiting: Vec<RegistrationOutput>,
    ) -> Result<PausedSnapshot, PublishError> {
        // The map of the run goes to nobody in the copy too.
        let searched = self
            .searched
            .as_ref()
            .map(|_| SearchedMap::new(Arc::default(), None, &self.mapper, self.tile_store_mb));
        let mut ended = Self {
            mapper: self.mapper.clone(),
            publisher: self.publisher.with_undo(),
            tile_store_mb: self.tile_store_mb,
            publish_period: self.publish_period,
            on_jump: self.on_jump,
            events: Vec::new(),
            progress: self.progress.clone(),
            correction: None,
            corrected: None,
            searched: searched.transpose()?,
        };
        for registered in &waiting {
            match registered {
                RegistrationOutput::Scan(scan) => {
                    ended.integrate(&self.placed(scan));
                    ended.publish_if_due()?;
                }
                RegistrationOutput::Jump(jump) => ended.on_pose_jump(jump),
                // What is shown is what is known now.
                RegistrationOutput::Corrected(_) | RegistrationOutput::Confidence(_) => {}
            }
        }
        ended.finish()?;
        let shores = ended.take_shores();
        self.publisher.add_changed(ended.publisher.take_changed());
        Ok(PausedSnapshot {
            waiting,
            last_scan: ended.last_scan(),
            published: ended.publisher.into_replaced(),
            shores,
        })
    }

    /// The octree at the time of the snapshot, if there is one. It is a copy.
    pub fn octree_of(&self, paused_snapshot: &PausedSnapshot) -> Option<Octree> {
        let mut ended = self.mapper.voxels()?.clone();
        for registered in &paused_snapshot.waiting {
            match (registered, self.on_jump) {
                (RegistrationOutput::Scan(scan), _) => {
                    ended.integrate(&self.placed(scan));
                }
                (RegistrationOutput::Jump(_), OnJump::Reset) => ended.reset(),
                (RegistrationOutput::Jump(_), OnJump::Keep)
                | (RegistrationOutput::Corrected(_) | RegistrationOutput::Confidence(_), _) => {}
            }
        }
        Some(ended.octree().clone())
    }

    /// Restores the tiles that the snapshot replaced, before the data goes on.
    ///
    /// The result is exact unless the tile store was full (`streaming.tile_store_mb`): evicted tiles stay evicted.
    pub fn resume(&mut self, paused_snapshot: PausedSnapshot) -> Result<(), PublishError> {
        self.publisher.restore_replaced(paused_snapshot.published)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::voxels::voxel_digest;
    use crate::runtime::maps::tests::{BEFORE_M, WAITING_M, maps, scan, take};
    use localization::pose_buffer::PoseJump;
    use mapping::grid::VoxelIndex;
    use mapping::octree::VoxelState;
    use nalgebra::Point3;

    fn state(octree: &Octree, [x, y]: [f64; 2]) -> VoxelState {
        let point = Point3::new(x, y, 0.05);
        octree.state(VoxelIndex::containing(point, octree.cell_m()))
    }

    /// The voxels that the two scans hit, in the octree of a paused snapshot; it equals the octree of maps that end there.
    fn shown(on_jump: OnJump, waiting: &[RegistrationOutput]) -> (VoxelState, VoxelState) {
        let before = scan(0, BEFORE_M);
        let (mut standing, mut ended) = (maps(on_jump), maps(on_jump));
        for maps in [&mut standing, &mut ended] {
            take(maps, &before);
        }
        for registered in waiting {
            take(&mut ended, registered);
        }
        ended.finish().unwrap();
        let paused_snapshot = standing.publish_paused(waiting.to_vec()).unwrap();
        let octree = standing.octree_of(&paused_snapshot).unwrap();
        let of_ended = ended.mapper().voxels().unwrap().octree();
        assert_eq!(voxel_digest(&octree), voxel_digest(of_ended), "{on_jump:?}");
        (state(&octree, BEFORE_M), state(&octree, WAITING_M))
    }

    #[test]
    fn a_waiting_jump_erases_the_octree_like_the_other_maps() {
        use VoxelState::{Occupied, Unknown};
        let jump = RegistrationOutput::Jump(PoseJump {
            stamp: RobotTime::from_nanos(100),
            distance_m: 5.0,
        });
        let waiting = scan(200, WAITING_M);
        let in_front = [jump.clone(), waiting.clone()];
        let behind = [waiting, jump];
        for (on_jump, waiting, known) in [
            (OnJump::Keep, &in_front, (Occupied, Occupied)),
            (OnJump::Keep, &behind, (Occupied, Occupied)),
            (OnJump::Reset, &in_front, (Unknown, Occupied)),
            (OnJump::Reset, &behind, (Unknown, Unknown)),
        ] {
            assert_eq!(shown(on_jump, waiting), known, "{on_jump:?} {waiting:?}");
        }
    }
}
