//! The true motion of a vehicle: its path in the plane, or how it is driven, and the ground or the water that
//! carries it.

mod driven;
mod posture_track;
mod support;

use std::sync::Arc;

pub use driven::{Collisions, DriveModel};

use crate::bumper::Bumper;
use crate::chassis::Chassis;
use crate::dynamics::Drive;
use crate::hull::Hull;
use crate::motion::driven::Driven;
use crate::motion::support::Support;
use crate::path::Path;
use crate::scene::Scene;
use crate::vehicle::Carriage;
use crate::velocity::PlanarVelocity;
use crate::waves::Waves;
use crate::world::World;
use measurement::pose::Pose;

/// Where a world's vehicle truly is at any time.
///
/// Position and yaw are the path's, exactly, until somebody takes the helm; from then on they are what the drive
/// makes of what it is told, every [`POSTURE_STEP_S`], and are interpolated between. Height, pitch and roll of a
/// vehicle on wheels follow from the ground every [`POSTURE_STEP_S`] and are interpolated between: exact on
/// planes, and where a wheel meets a kerb of 4 cm at 0.5 m/s within 0.4 mm and 0.08° during that one step. Those
/// of a boat follow from the waves at that very time. A vehicle without either stays level at z = 0.
///
/// On the path, poses are computed as they are asked for, and those of the last seconds are kept. The first look
/// at a late time takes as long as driving there. Off the path [`Motion::advance_to`] computes them.
#[derive(Clone)]
pub struct Motion {
    path: Arc<Path>,
    support: Support,
    driven: Option<Driven>,
}

/// Time between the instants at which the ground under the wheels is looked at and at which a vehicle does what
/// it is told, seconds.
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
        Self {
            support: chassis.map_or(Support::Level, |chassis| {
                Support::on_ground(chassis, scene, Arc::clone(&path))
            }),
            path,
            driven: None,
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
            driven: None,
        }
    }

    /// Where the vehicle drives in the plane while nobody drives it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The vehicle's pose.
    ///
    /// On the path: before its beginning that at its start, after its end that at its end, where waves go on. Off
    /// the path: of the last [`DriveModel::KEPT_S`] up to [`Motion::advance_to`], before and after the nearest of them.
    pub fn world_from_base(&self, time_s: f64) -> Pose {
        match &self.driven {
            Some(driven) if driven.has_begun(time_s) => {
                let at = driven.planar_pose(time_s);
                self.support.pose(at, time_s, |_| driven.posture(time_s))
            }
            Some(_) | None => {
                let at = self.path.planar_pose(time_s);
                self.support
                    .pose(at, time_s, |track| track.borrow_mut().posture(time_s))
            }
        }
    }

    /// How fast it goes in the plane, for the same times. The path's speeds change at once.
    pub fn velocity(&self, time_s: f64) -> PlanarVelocity {
        match &self.driven {
            Some(driven) if driven.has_begun(time_s) => driven.velocity(time_s),
            Some(_) | None => self.path.velocity(time_s),
        }
    }

    /// Leaves the path at step number `step`, at the pose and the velocity that it has there, for good; does
    /// nothing where it has left it already.
    pub fn take_over(&mut self, step: i64, drive: Drive, bumper: Bumper) {
        if self.driven.is_none() {
            let time_s = step as f64 * POSTURE_STEP_S;
            let at = self.path.planar_pose(time_s);
            let posture = self.support.posture_on_path(time_s);
            let drive_model = DriveModel::new(drive, bumper, self.path.velocity(time_s));
            self.driven = Some(Driven::new(step, at, posture, drive_model));
        }
    }

    /// Drives on to step number `step`; on the path and backwards there is nothing to do.
    pub fn advance_to(&mut self, step: i64) {
        if let Some(driven) = &mut self.driven {
            driven.advance_to(step, &self.support);
        }
    }

    /// Who drives the vehicle; `None` on the path.
    pub fn drive_model(&self) -> Option<&DriveModel> {
        self.driven.as_ref().map(Driven::drive_model)
    }

    /// The same, to tell it something.
    pub fn drive_model_mut(&mut self) -> Option<&mut DriveModel> {
        self.driven.as_mut().map(Driven::drive_model_mut)
    }
}

#[cfg(test)]
mod driven_tests;
#[cfg(test)]
mod tests;
