//! The true motion of a vehicle: its path in the plane, and the ground or the water that carries it.

mod posture_track;

use std::cell::RefCell;
use std::sync::Arc;

use crate::pose::Pose;
use crate::simulation::chassis::Chassis;
use crate::simulation::hull::Hull;
use crate::simulation::motion::posture_track::PostureTrack;
use crate::simulation::path::Path;
use crate::simulation::scene::Scene;
use crate::simulation::vehicle::Carriage;
use crate::simulation::waves::Waves;
use crate::simulation::world::World;

/// Where a world's vehicle truly is at any time.
///
/// Position and yaw are the path's, exactly. Height, pitch and roll of a vehicle on wheels follow from the
/// ground every [`POSTURE_STEP_S`] and are interpolated between: exact on planes, and where a wheel meets a
/// kerb of 4 cm at 0.5 m/s within 0.4 mm and 0.08° during that one step. Those of a boat follow from the waves
/// at that very time. A vehicle without either stays level at z = 0.
///
/// Poses are computed as they are asked for, and those of the last seconds are kept. The first look at a
/// late time takes as long as driving there.
#[derive(Clone)]
pub struct Motion {
    path: Arc<Path>,
    support: Support,
}

/// What holds the vehicle up.
#[derive(Clone)]
enum Support {
    Level,
    Ground(RefCell<PostureTrack>),
    Water {
        hull: Hull,
        waves: Arc<Waves>,
        water_level_m: f64,
    },
}

/// Time between the instants at which the ground under the wheels is looked at, seconds.
pub const POSTURE_STEP_S: f64 = 0.005;

impl Motion {
    /// The motion of the world's vehicle along the world's path.
    pub fn new(world: &World) -> Self {
        let path = Arc::clone(world.path());
        match world.simulated_vehicle().carriage {
            Carriage::Level => Self::along(path, Arc::clone(world.scene()), None),
            Carriage::Wheels(chassis) => {
                Self::along(path, Arc::clone(world.scene()), Some(chassis))
            }
            Carriage::Hull(hull) => Self::afloat(
                path,
                hull,
                Arc::clone(world.waves()),
                world.water_m().unwrap_or(0.0),
            ),
        }
    }

    /// The motion along `path`, over what is in `scene` where there is a chassis.
    pub fn along(path: Arc<Path>, scene: Arc<Scene>, chassis: Option<Chassis>) -> Self {
        let track = |chassis| PostureTrack::new(chassis, scene, Arc::clone(&path));
        let ground = |chassis| Support::Ground(RefCell::new(track(chassis)));
        Self {
            support: chassis.map_or(Support::Level, ground),
            path,
        }
    }

    /// The motion of a boat along `path`, on waves about `water_level_m`.
    pub fn afloat(path: Arc<Path>, hull: Hull, waves: Arc<Waves>, water_level_m: f64) -> Self {
        Self {
            path,
            support: Support::Water {
                hull,
                waves,
                water_level_m,
            },
        }
    }

    /// Where the vehicle drives in the plane.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The vehicle's pose; before the beginning of the path that at its start, after the end that at its end,
    /// where waves go on.
    pub fn world_from_base(&self, time_s: f64) -> Pose {
        let posture = match &self.support {
            Support::Level => return self.path.world_from_base(time_s),
            Support::Ground(postures) => postures.borrow_mut().posture(time_s),
            Support::Water {
                hull,
                waves,
                water_level_m,
            } => hull.afloat(self.path.planar_pose(time_s), waves, *water_level_m, time_s),
        };
        posture.world_from_base(self.path.planar_pose(time_s))
    }
}

#[cfg(test)]
mod tests;
