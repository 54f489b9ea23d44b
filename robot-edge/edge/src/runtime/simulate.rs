//! `simulate`: a simulated world as the source.

use std::io::Write;
use std::sync::atomic::AtomicBool;

use super::driving::{DrivePlan, MotorsPlan};
use super::localization_plan::{
    LocalizationPlan, PlannedSensor, match_scans, poses_from_attitude, poses_from_fixes,
    poses_from_wheels, range_sensors, registration_settings,
};
use super::network_plan::NetworkPlan;
use super::outputs::SETUP;
use super::ros_endpoint::ros_endpoint;
use super::run::Run;
use super::source::{Source, SourceItem, SourceLosses};
use super::tilt_control::TiltControl;
use crate::cli::Simulate;
use crate::config::advice::advise;
use crate::config::{self, Config, FixesAndAttitude, WheelsAndAttitude, the_imu};
use crate::driving::motors::SimulatedMotors;
use crate::exit::{Exit, UsageError};
use crate::ros2::RosTarget;
use crate::summary::Event;
use crate::survey::range_sensors::assign_streams;
use drivers::joint_goal::JointGoal;
use localization::PoseSource;
use localization::registration::{MountOrigin, PoseOrigin, PoseStreams};
use mapping::registered_scan::ScanKind;
use measurement::{Stream, StreamId};
use recording::time_sequencer::Ordered;
use recording::{Position, RecordingError};
use simulation::{CommandedVelocity, SimulatedSource, SimulationOptions, World};
use teleop::Velocity;

pub(super) fn simulate(
    command: &Simulate,
    quiet: bool,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let options = &command.mapping;
    let world = World::load(&command.world)?;
    let vehicle = options
        .setup
        .vehicle
        .as_deref()
        .unwrap_or_else(|| world.vehicle());
    let config = config::load(vehicle, &options.setup.overrides())?;
    let network = NetworkPlan::new(&options.network, options.robot.as_ref(), &config)?;
    let can_be_driven = command.rate.is_real_time() || command.drive_at_any_rate;
    let motors = (network.is_some() && can_be_driven).then(SimulatedMotors::default);
    if motors.is_none() && command.driving.drive_log.is_some() {
        return Err(UsageError(
            "--drive-log: a simulated vehicle is driven at --rate 1, over a network".to_owned(),
        )
        .into());
    }
    let keeps_serving = network.as_ref().is_some_and(NetworkPlan::keeps_serving);
    let source = SimulatedSource::new(
        &world,
        SimulationOptions {
            seed: command.seed,
            duration_s: command.duration_s,
            ..SimulationOptions::default()
        },
    )
    .map_err(|err| UsageError(err.to_string()))?;
    let source = if motors.is_some() && keeps_serving {
        source.until_stopped()
    } else {
        source
    };
    let mut notes = vec![format!(
        "{vehicle}, in world {} with seed {}",
        world.name(),
        command.seed
    )];
    let overrides = options.setup.overrides();
    notes.extend(advise(vehicle, &overrides, &config, true));
    if config.motors.has_motors() {
        notes.push("[motors] is left alone: only `run` drives real motors".to_owned());
    }
    if command.ros.endpoint.is_none() && !config.ros2_output.is_empty() {
        notes.push("[ros2_output] is left alone: --ros says where to publish".to_owned());
    }
    if command.ros.endpoint.is_none() && config.planner.is_some() {
        notes.push("[planner] is left alone: --ros says where it is".to_owned());
    }
    let mut tilt = TiltControl::new(&config);
    if tilt.is_some() && !command.rate.is_real_time() {
        tilt = None;
        notes.push("`tilt.search` is left alone: when it turns the laser depends on how fast maps are made, so it does at --rate 1 only".to_owned());
    }
    let tilt_goal = tilt.as_ref().map(|tilt| tilt.goal().clone());
    let run = Run {
        source: command.world.clone(),
        title: world.name().to_owned(),
        registration: registration_settings(
            &config,
            &simulated_localization_plan(&config, source.streams())?,
        ),
        config: &config,
        rate: command.rate,
        is_live: false,
        network,
        drive: motors.clone().map_or_else(DrivePlan::none, |motors| {
            let drive = DrivePlan::new(MotorsPlan::Simulated(motors), &command.driving);
            match &command.ros.endpoint {
                Some(_) => drive.with_planner(&config),
                None => drive,
            }
        }),
        record: options.record.clone(),
        foxglove: options.foxglove_address()?,
        export: options.export.clone(),
        map: &options.map,
        summary: options.summary.clone(),
        quiet,
        earliest: None,
        events: notes
            .into_iter()
            .map(|message| Event {
                stamp_s: None,
                kind: SETUP.to_owned(),
                message,
            })
            .collect(),
        devices: None,
        tilt,
        ros: match &command.ros.endpoint {
            Some(_) => Some(RosTarget::Endpoint(ros_endpoint(&command.ros, &config)?)),
            None => None,
        },
    };
    run.execute(
        &mut SimulatedRun {
            source,
            motors,
            tilt_goal,
        },
        interrupt,
        out,
    )
}

/// The registration of a simulated vehicle with these streams.
pub fn simulated_localization_plan(
    config: &Config,
    streams: &[Stream],
) -> Result<LocalizationPlan, UsageError> {
    let prior = pose_origin(config, streams)?;
    let ids_of = |type_name: &str| -> Vec<StreamId> {
        let ids = (0..=u16::MAX).map(StreamId).zip(streams);
        ids.filter(|(_, stream)| stream.type_name == type_name)
            .map(|(id, _)| id)
            .collect()
    };
    let scans = ids_of("sensor_msgs/LaserScan");
    let sensors = range_sensors(config)?;
    // If no stream is known yet, a single sensor accepts all scans.
    let takes_all = scans.is_empty() && sensors.len() == 1;
    let assigned = if takes_all {
        vec![None]
    } else {
        assign_streams(&sensors, streams.iter(), &scans)
            .map_err(|error| UsageError(format!("the simulated vehicle: {error}")))?
    };
    // There is no transform of a tilting sensor: its joint gives the angle.
    let joints = ids_of("sensor_msgs/JointState").first().copied();
    let planned = sensors.iter().zip(assigned).filter_map(|(sensor, stream)| {
        let tilt_stream = joints.filter(|_| sensor.config.tilt.is_some());
        // Of the sensors with a frame of their own.
        let is_in_tree = matches!(prior, PoseOrigin::Tf { .. })
            && tilt_stream.is_none()
            && matches!(sensor.config.scan_kind, ScanKind::Beams | ScanKind::Cloud);
        (takes_all || stream.is_some()).then_some(PlannedSensor {
            id: sensor.id,
            stream,
            mount: if is_in_tree {
                MountOrigin::Tree
            } else {
                MountOrigin::Configured
            },
            tilt_stream,
            range_max_m: None,
        })
    });
    let sensors: Vec<_> = planned.collect();
    let origin = match match_scans(config, &sensors, &prior)? {
        Some(scans) => PoseOrigin::Scans {
            prior: Box::new(prior),
            scans: Box::new(scans),
        },
        None => prior,
    };
    Ok(LocalizationPlan {
        origin,
        pose_streams: PoseStreams::default(),
        sensors,
    })
}

/// A simulated vehicle provides every source of poses, except poses in its scans.
fn pose_origin(config: &Config, streams: &[Stream]) -> Result<PoseOrigin, UsageError> {
    let fixed_frame = config.localization.fixed_frame.as_deref().unwrap_or("odom");
    match config.localization.source {
        PoseSource::Auto | PoseSource::Tf => Ok(PoseOrigin::Tf {
            fixed_frame: fixed_frame.into(),
        }),
        PoseSource::Odometry => Ok(PoseOrigin::Odometry),
        PoseSource::ScanWheels => Ok(from_wheels(config, streams).unwrap_or(PoseOrigin::Odometry)),
        PoseSource::Static | PoseSource::Scan => Ok(PoseOrigin::Static),
        PoseSource::Wheels => from_wheels(config, streams),
        PoseSource::Gps | PoseSource::ScanGps => from_fixes(config, streams),
        PoseSource::ScanImu => match the_imu(&config.sensors) {
            Some((_, imu)) if has(streams, "sensor_msgs/Imu") => {
                Ok(poses_from_attitude(config, imu))
            }
            Some(_) | None => Err(UsageError(
                "localization.source = \"scan+imu\": this simulated vehicle has no attitude sensor; use \"scan\""
                    .to_owned(),
            )),
        },
        PoseSource::Log => Err(UsageError(
            "localization.source = \"log\" is for CARMEN logs: a simulated scan carries no pose of its \
             own; use \"auto\""
                .to_owned(),
        )),
    }
}

fn has(streams: &[Stream], type_name: &str) -> bool {
    streams.iter().any(|stream| stream.type_name == type_name)
}

fn from_fixes(config: &Config, streams: &[Stream]) -> Result<PoseOrigin, UsageError> {
    match FixesAndAttitude::of(&config.sensors) {
        Ok(sensors)
            if has(streams, "sensor_msgs/NavSatFix") && has(streams, "sensor_msgs/Imu") =>
        {
            Ok(poses_from_fixes(config, &sensors))
        }
        Ok(_) | Err(_) => Err(UsageError(
            "localization.source = \"gps\": this simulated vehicle has no satellite receiver or no attitude \
             sensor; use \"auto\""
                .to_owned(),
        )),
    }
}

fn from_wheels(config: &Config, streams: &[Stream]) -> Result<PoseOrigin, UsageError> {
    match WheelsAndAttitude::of(&config.sensors) {
        Ok(sensors)
            if has(streams, "sensor_msgs/JointState") && has(streams, "sensor_msgs/Imu") =>
        {
            Ok(poses_from_wheels(config, &sensors))
        }
        Ok(_) | Err(_) => Err(UsageError(
            "localization.source = \"wheels\": this simulated vehicle has no wheel encoders or no attitude \
             sensor; use \"auto\""
                .to_owned(),
        )),
    }
}

/// A simulated run, and the motors of its vehicle if it can be driven.
struct SimulatedRun {
    source: SimulatedSource,
    motors: Option<SimulatedMotors>,
    tilt_goal: Option<JointGoal>,
}

impl SimulatedRun {
    /// Applies the motor command from the time up to which nothing has been measured yet.
    fn drive(&mut self) {
        let Some(motors) = &self.motors else { return };
        let at = self.source.frontier();
        let true_velocity = self.source.velocity(at);
        let command = motors.exchange(Velocity {
            linear_mps: true_velocity.forward_mps,
            lateral_mps: true_velocity.left_mps,
            angular_radps: true_velocity.turn_rate_radps,
        });
        let Velocity {
            linear_mps,
            lateral_mps,
            angular_radps,
        } = command.velocity;
        let velocity = CommandedVelocity {
            linear_mps,
            lateral_mps,
            angular_radps,
        };
        let stopped = if command.is_engaged && !self.source.is_driven() {
            self.source.take_over(at).map(drop)
        } else {
            Ok(())
        };
        // The time is the measured frontier, so it is never in the future.
        if let Err(error) = stopped.and_then(|()| self.source.drive(at, velocity).map(drop)) {
            tracing::warn!(%error, "the simulated vehicle was not driven");
        }
    }
}

impl Source for SimulatedRun {
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        self.drive();
        if let Some(goal) = &self.tilt_goal
            && let Some(angle_rad) = goal.angle_rad()
        {
            self.source.turn(goal.joint(), angle_rad);
        }
        Ok(self.source.next_measurement().map(|measurement| {
            if measurement.is_static_transform() {
                SourceItem::Immediate(measurement)
            } else {
                SourceItem::Timed(Ordered::Measurement(measurement))
            }
        }))
    }

    fn streams_from(&self, from: usize) -> Vec<Stream> {
        self.source.streams().iter().skip(from).cloned().collect()
    }

    fn position(&self) -> Option<Position> {
        None
    }

    fn lost_total(&self) -> u64 {
        0
    }

    fn lost(&self) -> SourceLosses {
        SourceLosses::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Override, load};

    fn origin(settings: &[&str], types: &[&str]) -> Result<PoseOrigin, String> {
        let overrides: Vec<Override> = settings.iter().map(|set| set.parse().unwrap()).collect();
        let stream = |type_name: &&str| Stream {
            name: String::new(),
            type_name: (*type_name).to_owned(),
        };
        let streams: Vec<_> = types.iter().map(stream).collect();
        pose_origin(&load("generic2d", &overrides).unwrap(), &streams)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn a_simulated_run_uses_the_configured_pose_source() {
        let tf = PoseOrigin::Tf {
            fixed_frame: "odom".into(),
        };
        assert_eq!(origin(&[], &[]), Ok(tf.clone()));
        assert_eq!(origin(&["localization.source=tf"], &[]), Ok(tf));
        let odometry = origin(&["localization.source=odometry"], &[]);
        assert_eq!(odometry, Ok(PoseOrigin::Odometry));
        let still = origin(&["localization.source=static"], &[]);
        assert_eq!(still, Ok(PoseOrigin::Static));
        let log = origin(&["localization.source=log"], &[]).unwrap_err();
        assert!(log.contains("is for CARMEN logs"), "{log}");

        let wheels = [
            "localization.source=wheels",
            "sensors.wheels={kind = 'wheel_encoders', wheel_radius_m = 0.2}",
            "sensors.ahrs={kind = 'imu'}",
        ];
        let both = ["sensor_msgs/JointState", "sensor_msgs/Imu"];
        let Ok(PoseOrigin::Wheels(settings)) = origin(&wheels, &both) else {
            panic!("{:?}", origin(&wheels, &both));
        };
        assert!((settings.wheels.radius_m - 0.2).abs() < f64::EPSILON);
        let none = origin(&wheels, &both[..1]).unwrap_err();
        assert!(
            none.contains("this simulated vehicle has no wheel encoders"),
            "{none}"
        );
    }

    #[test]
    fn a_boats_sensors_are_assigned_and_its_joint_tilts_one() {
        let stream = |(name, type_name): (&str, &str)| Stream {
            name: name.to_owned(),
            type_name: format!("sensor_msgs/{type_name}"),
        };
        let streams = [
            ("/imu/data", "Imu"),
            ("/sonar", "LaserScan"),
            ("/scan", "LaserScan"),
            ("/joint_states", "JointState"),
            ("/fix", "NavSatFix"),
        ]
        .map(stream);
        let config = load("riverwatch", &[]).unwrap();
        let localization_plan = simulated_localization_plan(&config, &streams).unwrap();
        assert!(matches!(localization_plan.origin, PoseOrigin::Gps(_)));
        let seen = localization_plan
            .sensors
            .iter()
            .map(|sensor| (sensor.id.0, sensor.stream, sensor.tilt_stream));
        assert_eq!(
            seen.collect::<Vec<_>>(),
            [
                (0, Some(StreamId(2)), Some(StreamId(3))),
                (1, Some(StreamId(1)), None)
            ]
        );
        let settings = registration_settings(&config, &localization_plan);
        assert_eq!(settings.sensors[0].mount, MountOrigin::Configured);
        assert!((settings.body.lowest_m + 0.6).abs() < 1e-9);
        assert!((settings.body.highest_m - 2.0).abs() < 1e-9);
        let with_tf = load("riverwatch", &["localization.source=tf".parse().unwrap()]).unwrap();
        let localization_plan = simulated_localization_plan(&with_tf, &streams).unwrap();
        let mounts = localization_plan.sensors.iter().map(|sensor| sensor.mount);
        assert_eq!(
            mounts.collect::<Vec<_>>(),
            [MountOrigin::Configured, MountOrigin::Tree]
        );
    }

    #[test]
    fn a_lidar_is_assigned_its_clouds_and_mounted_where_the_transform_says() {
        let streams = ["sensor_msgs/PointCloud2", "tf2_msgs/TFMessage"].map(|type_name| Stream {
            name: "/s".to_owned(),
            type_name: type_name.to_owned(),
        });
        let config = load("lidar64", &[]).unwrap();
        let localization_plan = simulated_localization_plan(&config, &streams).unwrap();
        assert!(matches!(localization_plan.origin, PoseOrigin::Tf { .. }));
        let sensors = localization_plan.sensors.iter();
        let planned: Vec<_> = sensors.map(|sensor| (sensor.id.0, sensor.mount)).collect();
        assert_eq!(planned, [(0, MountOrigin::Tree)]);
    }
}
