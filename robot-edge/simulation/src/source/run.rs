//! What all sensors of a run share.

use std::sync::Arc;

use super::options::Errors;
use super::streams::TF_STATIC;
use crate::gps::Datum;
use crate::motion::Motion;
use crate::scene::Scene;
use crate::vehicle::SimulatedVehicle;
use crate::world::World;
use measurement::pose::Pose;
use measurement::time::RobotTime;
use measurement::{FrameId, Measurement, MeasurementData};

/// A vehicle in its world.
pub(super) struct Run {
    pub(super) scene: Arc<Scene>,
    pub(super) motion: Motion,
    pub(super) vehicle: SimulatedVehicle,
    pub(super) datum: Datum,
    pub(super) errors: Errors,
    pub(super) frames: Frames,
}

/// Frames other than those of range sensors, which are called as the sensors are.
pub(super) struct Frames {
    pub(super) odom: FrameId,
    pub(super) base: FrameId,
    pub(super) imu: FrameId,
    pub(super) gps: FrameId,
}

impl Run {
    pub(super) fn new(world: &World, errors: Errors) -> Self {
        Self {
            scene: Arc::clone(world.scene()),
            motion: Motion::new(world),
            vehicle: world.simulated_vehicle().clone(),
            datum: Datum::LAKE,
            errors,
            frames: Frames {
                odom: FrameId::from("odom"),
                base: FrameId::from("base_link"),
                imu: FrameId::from("imu_link"),
                gps: FrameId::from("gps_link"),
            },
        }
    }

    /// Where the sensors with a frame of their own are mounted, but those that tilt: as on a real vehicle, where
    /// these are follows from their joints.
    pub(super) fn mounts(&self, stamp: RobotTime) -> Vec<Measurement> {
        let fixed = self.vehicle.range_sensors().filter(|s| s.tilt.is_none());
        let range_sensors = fixed.map(|s| (FrameId::from(s.name), s.base_from_mount));
        let imu = self
            .vehicle
            .attitude_sensor
            .map(|_at_base| Pose::identity());
        let gps = self
            .vehicle
            .gps
            .map(|receiver| receiver.base_from_antenna());
        let others = [(&self.frames.imu, imu), (&self.frames.gps, gps)]
            .into_iter()
            .filter_map(|(frame, mount)| Some((FrameId::clone(frame), mount?)));
        let mount = |(child, parent_from_child): (FrameId, Pose)| Measurement {
            stamp,
            stream: TF_STATIC,
            frame: FrameId::clone(&self.frames.base),
            data: MeasurementData::Transform {
                child,
                parent_from_child,
                is_static: true,
            },
        };
        range_sensors.chain(others).map(mount).collect()
    }
}
