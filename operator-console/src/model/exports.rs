//! What exports want of the robot, beyond what is shown.

use std::collections::BTreeSet;

use protocol::layer::LayerId;

use super::{ConsoleModel, TrajectoryProgress, VoxelsProgress};

impl ConsoleModel {
    /// Follows these layers too, whatever is shown: an export wants them.
    pub fn want_for_export(&mut self, layers: BTreeSet<LayerId>) {
        self.exported = layers;
        self.update_wanted_layers();
    }

    /// Fetches the octree's files as they are now, for an export.
    pub fn want_voxels(&mut self) {
        self.voxels.want();
    }

    /// Gives back the memory of the octree's files.
    pub fn drop_voxels(&mut self) {
        self.voxels.drop_all();
    }

    /// How far the octree's files are.
    pub fn voxels(&self) -> VoxelsProgress {
        self.voxels.progress()
    }

    /// Fetches the whole way as it is now, for an export.
    pub fn want_trajectory(&mut self) {
        self.trajectory.want();
    }

    /// Gives back the memory of the fetched way.
    pub fn drop_trajectory(&mut self) {
        self.trajectory.drop_all();
    }

    /// How far fetching the whole way is.
    pub fn trajectory(&self) -> TrajectoryProgress {
        self.trajectory.progress()
    }
}
