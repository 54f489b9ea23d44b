//! What a simulated vehicle reads at one instant, as measurements.

use std::sync::Arc;

use super::START;
use super::options::Errors;
use crate::measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};
use crate::pose::Pose;
use crate::robot_time::RobotTime;
use crate::simulation::attitude_sensor::{AttitudeNoise, AttitudeSensor};
use crate::simulation::laser::LaserNoise;
use crate::simulation::motion::Motion;
use crate::simulation::scene::Scene;
use crate::simulation::vehicle::SimulatedVehicle;
use crate::simulation::wheel_encoders::{WheelEncoders, WheelTurns};
use crate::simulation::world::World;

/// Names of the wheels in `/joint_states`, left and right.
pub const WHEEL_JOINTS: [&str; 2] = ["left_wheel_joint", "right_wheel_joint"];

/// What all sensors of a run share.
pub(super) struct Run {
    scene: Arc<Scene>,
    motion: Motion,
    vehicle: SimulatedVehicle,
    errors: Errors,
    frames: Frames,
}

struct Frames {
    odom: FrameId,
    base: FrameId,
    laser: FrameId,
    imu: FrameId,
}

/// What reads at its own rate, with what it needs to do so.
pub(super) enum Sensor {
    /// The true pose, as transform and as odometry.
    Pose,
    Wheels {
        encoders: WheelEncoders,
        turns: Box<WheelTurns>,
        stream: StreamId,
    },
    Attitude {
        sensor: AttitudeSensor,
        noise: Box<AttitudeNoise>,
        stream: StreamId,
    },
    Laser {
        noise: Box<LaserNoise>,
    },
}

/// Streams that every run has, in the order of their [`StreamId`]s.
const ALWAYS: [(&str, &str); 4] = [
    ("/tf_static", "tf2_msgs/TFMessage"),
    ("/tf", "tf2_msgs/TFMessage"),
    ("/odom", "nav_msgs/Odometry"),
    ("/scan", "sensor_msgs/LaserScan"),
];
pub(super) const TF_STATIC: StreamId = StreamId(0);
pub(super) const TF: StreamId = StreamId(1);
pub(super) const ODOM: StreamId = StreamId(2);
pub(super) const SCAN: StreamId = StreamId(3);

impl Run {
    pub(super) fn new(world: &World, errors: Errors) -> Self {
        Self {
            scene: Arc::clone(world.scene()),
            motion: Motion::new(world),
            vehicle: world.simulated_vehicle().clone(),
            errors,
            frames: Frames {
                odom: FrameId::from("odom"),
                base: FrameId::from("base_link"),
                laser: FrameId::from("laser"),
                imu: FrameId::from("imu_link"),
            },
        }
    }

    pub(super) fn motion(&self) -> &Motion {
        &self.motion
    }

    pub(super) fn vehicle(&self) -> &SimulatedVehicle {
        &self.vehicle
    }

    /// Where the sensors with a frame of their own are mounted.
    pub(super) fn mounts(&self, stamp: RobotTime) -> Vec<Measurement> {
        let laser = (&self.frames.laser, self.vehicle.laser.base_from_laser);
        let has_imu = self.vehicle.attitude_sensor.is_some();
        let imu = has_imu.then(|| (&self.frames.imu, Pose::identity()));
        let mount = |(child, parent_from_child): (&FrameId, Pose)| Measurement {
            stamp,
            stream: TF_STATIC,
            frame: FrameId::clone(&self.frames.base),
            data: MeasurementData::Transform {
                child: FrameId::clone(child),
                parent_from_child,
                is_static: true,
            },
        };
        std::iter::once(laser).chain(imu).map(mount).collect()
    }
}

impl Sensor {
    /// What the vehicle has, in the order in which equal stamps come, and the streams that it gives.
    pub(super) fn all(run: &Run, seed: u64) -> (Vec<Self>, Vec<Stream>) {
        let mut streams: Vec<Stream> = ALWAYS.map(stream).to_vec();
        let mut added = |name, type_name| {
            streams.push(stream((name, type_name)));
            StreamId(streams.len() as u16 - 1)
        };
        let mut sensors = vec![Self::Pose];
        if let Some(chassis) = run.vehicle.chassis
            && let Some(encoders) = chassis.encoders
        {
            let turns = WheelTurns::new(chassis, encoders, run.errors.wheels, &run.motion, seed);
            sensors.push(Self::Wheels {
                encoders,
                turns: Box::new(turns),
                stream: added("/joint_states", "sensor_msgs/JointState"),
            });
        }
        if let Some(sensor) = run.vehicle.attitude_sensor {
            sensors.push(Self::Attitude {
                sensor,
                noise: Box::new(AttitudeNoise::new(seed, "ahrs")),
                stream: added("/imu/data", "sensor_msgs/Imu"),
            });
        }
        sensors.push(Self::Laser {
            noise: Box::new(LaserNoise::new(seed, "laser")),
        });
        (sensors, streams)
    }

    /// Readings a second.
    pub(super) fn rate_hz(&self, run: &Run) -> f64 {
        match self {
            Self::Pose => run.vehicle.odometry_rate_hz,
            Self::Wheels { encoders, .. } => encoders.rate_hz,
            Self::Attitude { sensor, .. } => sensor.rate_hz,
            Self::Laser { .. } => run.vehicle.laser.rate_hz,
        }
    }

    /// How long after its stamp the last part of a reading is read, seconds.
    pub(super) fn reading_duration_s(&self, run: &Run) -> f64 {
        match self {
            Self::Pose | Self::Wheels { .. } | Self::Attitude { .. } => 0.0,
            Self::Laser { .. } => run.vehicle.laser.sweep_duration_s(),
        }
    }

    /// One reading; stamps never go back.
    pub(super) fn read(&mut self, run: &Run, stamp: RobotTime) -> Vec<Measurement> {
        let time_s = stamp.since(START).as_secs_f64();
        let measured = |stream, frame: &FrameId, data| Measurement {
            stamp,
            stream,
            frame: FrameId::clone(frame),
            data,
        };
        let frames = &run.frames;
        match self {
            Self::Pose => {
                let odom_from_base = run.motion.world_from_base(time_s);
                let transform = MeasurementData::Transform {
                    child: FrameId::clone(&frames.base),
                    parent_from_child: odom_from_base,
                    is_static: false,
                };
                let odometry = MeasurementData::Odometry {
                    child: FrameId::clone(&frames.base),
                    odom_from_base,
                };
                vec![
                    measured(TF, &frames.odom, transform),
                    measured(ODOM, &frames.odom, odometry),
                ]
            }
            Self::Wheels { turns, stream, .. } => {
                let turned_rad = turns.read(&run.motion, time_s);
                let names = WHEEL_JOINTS.map(str::to_owned);
                let joints = names.into_iter().zip(turned_rad).collect();
                vec![measured(
                    *stream,
                    &frames.base,
                    MeasurementData::Joints(joints),
                )]
            }
            Self::Attitude {
                sensor,
                noise,
                stream,
            } => {
                let noise_rad = run.errors.attitude_noise_rad;
                let sample = sensor.sample(&run.motion, time_s, noise_rad, noise);
                vec![measured(*stream, &frames.imu, MeasurementData::Imu(sample))]
            }
            Self::Laser { noise } => {
                let scan = run.vehicle.laser.sweep(
                    &run.scene,
                    run.errors.laser,
                    noise,
                    time_s,
                    |after_s: f64| run.motion.world_from_base(time_s + after_s),
                );
                let data = MeasurementData::Scan {
                    scan,
                    own_pose: None,
                };
                vec![measured(SCAN, &frames.laser, data)]
            }
        }
    }
}

fn stream((name, type_name): (&str, &str)) -> Stream {
    Stream {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
    }
}
