//! Sensors of a simulated vehicle and their measurements.

use super::{ALWAYS, ODOM, Run, START, TF, Ticks, stream_called};
use std::sync::Arc;

use crate::attitude_sensor::{AttitudeNoise, AttitudeSensor};
use crate::bumper::{Bumper, ContactSensor};
use crate::gps::{FixNoise, GpsReceiver};
use crate::laser::{LaserNoise, RangeSensor};
use crate::tilt_servo::TiltServo;
use crate::ultrasonic::UltrasonicSensor;
use crate::wheel_encoders::{WheelEncoders, WheelTurns};
use measurement::time::RobotTime;
use measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};

/// Names of the wheels in `/joint_states`, left and right.
pub(super) const WHEEL_JOINTS: [&str; 2] = ["left_wheel_joint", "right_wheel_joint"];

/// A sensor with its own rate.
pub(super) enum Sensor {
    /// The true pose, as transform and as odometry.
    Pose,
    Wheels {
        encoders: WheelEncoders,
        turns: Box<WheelTurns>,
        stream: StreamId,
    },
    Tilt {
        servo: TiltServo,
        stream: StreamId,
    },
    Attitude {
        sensor: AttitudeSensor,
        noise: Box<AttitudeNoise>,
        stream: StreamId,
    },
    Position {
        receiver: GpsReceiver,
        noise: Box<FixNoise>,
        stream: StreamId,
    },
    Range {
        sensor: RangeSensor,
        noise: Box<LaserNoise>,
        frame: FrameId,
        stream: StreamId,
    },
    Ultrasonic {
        sensor: UltrasonicSensor,
        frame: FrameId,
        stream: StreamId,
    },
    Contact {
        sensor: ContactSensor,
        bumper: Bumper,
        stream: StreamId,
    },
}

impl Sensor {
    /// The vehicle's sensors, in the order of equal stamps, and their streams.
    pub(super) fn all(run: &Run, seed: u64) -> (Vec<Self>, Vec<Stream>) {
        let vehicle = &run.vehicle;
        let mut streams = Vec::new();
        for (name, type_name) in ALWAYS {
            stream_called(&mut streams, name, type_name);
        }
        let range_sensors: Vec<Self> = vehicle
            .range_sensors()
            .map(|sensor| Self::Range {
                noise: Box::new(LaserNoise::new(seed, sensor.name)),
                frame: FrameId::from(sensor.name),
                stream: stream_called(&mut streams, sensor.stream, sensor.type_name()),
                sensor: sensor.clone(),
            })
            .collect();
        let joint_states = |streams: &mut Vec<Stream>| {
            stream_called(streams, "/joint_states", "sensor_msgs/JointState")
        };
        let mut sensors = vec![Self::Pose];
        if let Some(chassis) = vehicle.carriage.chassis()
            && let Some(encoders) = chassis.encoders
        {
            let turns = WheelTurns::new(chassis, encoders, run.errors.wheels, &run.motion, seed);
            sensors.push(Self::Wheels {
                encoders,
                turns: Box::new(turns),
                stream: joint_states(&mut streams),
            });
        }
        let servos = vehicle
            .range_sensors()
            .filter_map(|sensor| sensor.tilt.clone());
        sensors.extend(servos.map(|servo| Self::Tilt {
            servo,
            stream: joint_states(&mut streams),
        }));
        if let Some(sensor) = vehicle.attitude_sensor {
            sensors.push(Self::Attitude {
                sensor,
                noise: Box::new(AttitudeNoise::new(seed, "ahrs")),
                stream: stream_called(&mut streams, "/imu/data", "sensor_msgs/Imu"),
            });
        }
        if let Some(receiver) = vehicle.gps {
            sensors.push(Self::Position {
                receiver,
                noise: Box::new(FixNoise::new(seed, "gps")),
                stream: stream_called(&mut streams, "/fix", "sensor_msgs/NavSatFix"),
            });
        }
        sensors.extend(range_sensors);
        sensors.extend(
            vehicle
                .ultrasonic_sensors
                .iter()
                .map(|sensor| Self::Ultrasonic {
                    frame: FrameId::from(sensor.name),
                    stream: stream_called(&mut streams, sensor.stream, "sensor_msgs/Range"),
                    sensor: sensor.clone(),
                }),
        );
        sensors.extend(vehicle.contact_sensors.iter().map(|sensor| Self::Contact {
            bumper: Bumper::new(vehicle.body, Arc::clone(&run.scene)),
            stream: stream_called(&mut streams, sensor.stream, "std_msgs/Bool"),
            sensor: sensor.clone(),
        }));
        (sensors, streams)
    }

    /// The instants at which it reads such that the last pose of the run, and of a tilting sensor the last
    /// reading of its joint, follow on the last part of every reading.
    pub(super) fn ticks(&self, run: &Run, last_pose_s: f64) -> Ticks {
        match self {
            Self::Pose => Ticks::until(last_pose_s, run.vehicle.odometry_rate_hz),
            Self::Wheels { encoders, .. } => Ticks::until(last_pose_s, encoders.rate_hz),
            Self::Tilt { servo, .. } => Ticks::until(last_pose_s, servo.encoder_rate_hz),
            Self::Attitude { sensor, .. } => Ticks::until(last_pose_s, sensor.rate_hz),
            Self::Position { receiver, .. } => Ticks::until(last_pose_s, receiver.rate_hz),
            Self::Ultrasonic { sensor, .. } => Ticks::until(last_pose_s, sensor.rate_hz),
            Self::Contact { sensor, .. } => Ticks::until(last_pose_s, sensor.rate_hz),
            Self::Range { sensor, .. } => {
                let last_place_s = sensor.tilt.as_ref().map_or(last_pose_s, |servo| {
                    Ticks::until(last_pose_s, servo.encoder_rate_hz).last_s()
                });
                let end_s = last_place_s - sensor.planar.sweep_duration_s();
                Ticks::until(end_s, sensor.planar.rate_hz)
            }
        }
    }

    /// The servo that it reads or that tilts it.
    pub(super) const fn servo_mut(&mut self) -> Option<&mut TiltServo> {
        match self {
            Self::Tilt { servo, .. } => Some(servo),
            Self::Range { sensor, .. } => sensor.tilt.as_mut(),
            _ => None,
        }
    }

    /// How far past its stamp a reading looks, seconds.
    pub(super) fn lookahead_s(&self) -> f64 {
        match self {
            Self::Pose
            | Self::Wheels { .. }
            | Self::Tilt { .. }
            | Self::Position { .. }
            | Self::Ultrasonic { .. }
            | Self::Contact { .. } => 0.0,
            Self::Attitude { sensor, .. } => sensor.period_s(),
            Self::Range { sensor, .. } => sensor.planar.sweep_duration_s(),
        }
    }

    pub(super) fn read(&mut self, run: &Run, stamp: RobotTime) -> Vec<Measurement> {
        let time_s = stamp.since(START).as_secs_f64();
        let measured = |stream, frame: &FrameId, data| Measurement {
            stamp,
            stream,
            frame: FrameId::clone(frame),
            data,
        };
        let (errors, frames) = (&run.errors, &run.frames);
        let (stream, frame, data) = match self {
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
                return vec![
                    measured(TF, &frames.odom, transform),
                    measured(ODOM, &frames.odom, odometry),
                ];
            }
            Self::Wheels { turns, stream, .. } => {
                let turned_rad = turns.read(&run.motion, time_s);
                let names = WHEEL_JOINTS.map(str::to_owned);
                let joints = names.into_iter().zip(turned_rad).collect();
                (*stream, &frames.base, MeasurementData::Joints(joints))
            }
            Self::Tilt { servo, stream } => {
                let angle_rad = servo.read_rad(time_s, errors.joint_lag_s);
                let joints = vec![(servo.joint.to_owned(), angle_rad)];
                (*stream, &frames.base, MeasurementData::Joints(joints))
            }
            Self::Attitude {
                sensor,
                noise,
                stream,
            } => {
                let sample = sensor.sample(&run.motion, time_s, errors.attitude_noise_rad, noise);
                (*stream, &frames.imu, MeasurementData::Imu(sample))
            }
            Self::Position {
                receiver,
                noise,
                stream,
            } => {
                let fix = receiver.fix(&run.datum, &run.motion, time_s, errors.fix_noise_m, noise);
                (*stream, &frames.gps, MeasurementData::Fix(fix))
            }
            Self::Range {
                sensor,
                noise,
                frame,
                stream,
            } => {
                let world_from_sensor = |after_s: f64| {
                    let time_s = time_s + after_s;
                    run.motion.world_from_base(time_s) * sensor.base_from_sensor(time_s)
                };
                let is_covered = |[from_s, until_s]: [f64; 2]| (from_s..until_s).contains(&time_s);
                let is_covered = sensor.name == run.vehicle.laser.name
                    && errors.laser_covered_s.is_some_and(is_covered);
                let (planar, rings_rad) = (&sensor.planar, &sensor.rings_rad[..]);
                if !rings_rad.is_empty() {
                    let (scene, errors) = (&run.scene, errors.laser);
                    let mut cloud = planar.revolution(
                        rings_rad,
                        scene,
                        errors,
                        noise,
                        time_s,
                        world_from_sensor,
                    );
                    if is_covered {
                        cloud.without_return += cloud.points.len() as u32;
                        cloud.points.clear();
                    }
                    return vec![measured(*stream, &*frame, MeasurementData::Cloud(cloud))];
                }
                let mut scan =
                    planar.sweep(&run.scene, errors.laser, noise, time_s, world_from_sensor);
                sensor.add_own_posts(&mut scan, time_s);
                if is_covered {
                    scan.ranges_m.fill(f32::INFINITY);
                }
                let data = MeasurementData::Scan {
                    scan,
                    own_pose: None,
                };
                (*stream, &*frame, data)
            }
            Self::Ultrasonic {
                sensor,
                frame,
                stream,
            } => {
                let world_from_sensor =
                    run.motion.world_from_base(time_s) * sensor.base_from_sensor;
                let reading = sensor.read(&run.scene, &world_from_sensor, time_s);
                (*stream, &*frame, MeasurementData::Range(reading))
            }
            Self::Contact {
                sensor,
                bumper,
                stream,
            } => {
                let world_from_base = run.motion.world_from_base(time_s);
                let is_pressed = bumper.presses(sensor, &world_from_base, time_s);
                (*stream, &frames.none, MeasurementData::Bool(is_pressed))
            }
        };
        vec![measured(stream, frame, data)]
    }
}
