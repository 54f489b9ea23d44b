//! The true motion of a vehicle: its path in the plane, and the ground under its wheels.

mod posture_track;

use std::cell::RefCell;
use std::sync::Arc;

use crate::pose::Pose;
use crate::simulation::chassis::Chassis;
use crate::simulation::motion::posture_track::PostureTrack;
use crate::simulation::path::Path;
use crate::simulation::scene::Scene;
use crate::simulation::world::World;

/// Where a world's vehicle truly is at any time.
///
/// Position and yaw are the path's, exactly. Height, pitch and roll of a vehicle that has a chassis follow
/// from the ground every [`POSTURE_STEP_S`] and are interpolated between: exact on planes, and where a wheel
/// meets a kerb of 4 cm at 0.5 m/s within 0.4 mm and 0.08° during that one step. A vehicle without a chassis
/// stays level at z = 0.
///
/// Poses are computed as they are asked for, and those of the last seconds are kept. The first look at a
/// late time takes as long as driving there.
#[derive(Clone)]
pub struct Motion {
    path: Arc<Path>,
    postures: Option<RefCell<PostureTrack>>,
}

/// Time between the instants at which the ground under the wheels is looked at, seconds.
pub const POSTURE_STEP_S: f64 = 0.005;

impl Motion {
    /// The motion of the world's vehicle along the world's path.
    pub fn new(world: &World) -> Self {
        let chassis = world.simulated_vehicle().chassis;
        Self::along(Arc::clone(world.path()), Arc::clone(world.scene()), chassis)
    }

    /// The motion along `path`, over what is in `scene` where there is a chassis.
    pub fn along(path: Arc<Path>, scene: Arc<Scene>, chassis: Option<Chassis>) -> Self {
        let track = |chassis| PostureTrack::new(chassis, scene, Arc::clone(&path));
        Self {
            postures: chassis.map(track).map(RefCell::new),
            path,
        }
    }

    /// Where the vehicle drives in the plane.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The vehicle's pose; before the beginning of the path that at its start, after the end that at its end.
    pub fn world_from_base(&self, time_s: f64) -> Pose {
        match &self.postures {
            None => self.path.world_from_base(time_s),
            Some(postures) => {
                let posture = postures.borrow_mut().posture(time_s);
                posture.world_from_base(self.path.planar_pose(time_s))
            }
        }
    }
}

#[cfg(test)]
mod tests;
