//! A drive whose recording has wheel angles and attitudes, and no poses.

use std::fs;
use std::path::Path;

use measurement::pose::Pose;
use measurement::{ImuSample, Measurement, MeasurementData, Stream};
use nalgebra::{Point3, Vector3};
use recording::writer::McapWriter;
use recording::{Selection, open};

use crate::process::{Ended, events, read_json, robot_edge, rooms, run};

const RADIUS_M: f64 = 0.125;

/// Wheel angles and attitude of a vehicle that drives from pose to pose.
#[derive(Default)]
struct Wheels {
    distance_m: f64,
    last: Option<Pose>,
}

impl Wheels {
    fn measure(&mut self, odom_from_base: Pose) -> [MeasurementData; 2] {
        if let Some(last) = self.last.replace(odom_from_base) {
            let step = odom_from_base.translation.vector - last.translation.vector;
            self.distance_m += step.dot(&(last.rotation * Vector3::x())).signum() * step.norm();
        }
        let angle_rad = self.distance_m / RADIUS_M;
        let wheels = ["left_wheel_joint", "right_wheel_joint"];
        let joints = wheels.map(|name| (name.to_owned(), angle_rad));
        let [x, y, z, w] = odom_from_base.rotation.coords.into();
        let attitude = ImuSample {
            orientation_xyzw: Some([x, y, z, w]),
            angular_velocity_radps: [0.0; 3],
            linear_acceleration_mps2: [0.0; 3],
        };
        [
            MeasurementData::Joints(joints.to_vec()),
            MeasurementData::Imu(attitude),
        ]
    }
}

/// `rooms`, as a vehicle would have recorded it that only has wheels and an attitude sensor.
fn without_poses(path: &Path) {
    let mut reader = open(&rooms(), Selection::All).unwrap();
    let mut writer = McapWriter::create(path, None).unwrap();
    let stream = |name: &str, type_name: &str| Stream {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
    };
    let scans = stream("/scan", "sensor_msgs/LaserScan");
    let of_wheels = [
        stream("/joint_states", "sensor_msgs/JointState"),
        stream("/imu/data", "sensor_msgs/Imu"),
    ];
    let mut wheels = Wheels::default();
    while let Some(measurement) = reader.next_measurement().unwrap() {
        match measurement.data {
            MeasurementData::Scan { .. } => writer.write(&scans, &measurement).unwrap(),
            MeasurementData::Odometry { odom_from_base, .. } => {
                for (stream, data) in of_wheels.iter().zip(wheels.measure(odom_from_base)) {
                    let said = Measurement {
                        frame: "imu_link".into(),
                        data,
                        ..measurement
                    };
                    writer.write(stream, &said).unwrap();
                }
            }
            MeasurementData::Transform { .. }
            | MeasurementData::Imu(_)
            | MeasurementData::Joints(_)
            | MeasurementData::Fix(_)
            | MeasurementData::Twist(_)
            | MeasurementData::Range(_)
            | MeasurementData::Bool(_)
            | MeasurementData::Cloud(_) => {}
        }
    }
    writer.finish().unwrap();
}

const DURATION_S: &str = "30";

fn replay(recording: &Path, settings: &[&str], into: &Path) -> Ended {
    let mut command = robot_edge("replay --quiet --vehicle pioneer");
    command.arg(recording).args(["--duration", DURATION_S]);
    for setting in settings {
        command.args(["--set", setting]);
    }
    command
        .arg("--export")
        .arg(into)
        .arg("--summary")
        .arg(into.with_extension("json"));
    run(&mut command)
}

fn trajectory(folder: &Path) -> Vec<(f64, Point3<f64>)> {
    let text = fs::read_to_string(folder.join("trajectory.tum")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let pose = |line: &str| {
        let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        (numbers[0], Point3::new(numbers[1], numbers[2], numbers[3]))
    };
    lines.map(pose).collect()
}

#[test]
fn wheels_and_attitude_lead_where_the_poses_do() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("wheels.mcap");
    without_poses(&recording);
    let maps = |name: &str| folder.path().join(name);

    let sensors = [
        "sensors.wheels.kind=wheel_encoders",
        "sensors.ahrs.kind=imu",
    ];
    replay(&rooms(), &[], &maps("poses")).succeeds();
    replay(&recording, &sensors, &maps("wheels")).succeeds();
    let summary = read_json(&maps("wheels.json"));
    let said = events(&summary).join("\n");
    assert!(
        said.contains("poses: wheels of /joint_states and attitude of /imu/data"),
        "{said}"
    );
    let (poses, wheels) = (trajectory(&maps("poses")), trajectory(&maps("wheels")));
    assert!(wheels.len() > 250);
    assert_eq!(poses.len(), wheels.len());
    // Wheels begin at the origin, turned as the attitude says.
    let origin = poses[0].1 - wheels[0].1;
    for ((stamp, pose), (_, reckoned)) in poses.iter().zip(&wheels) {
        let error_m = (reckoned + origin - pose).norm();
        assert!(error_m < 0.02, "{error_m} m off at {stamp}");
    }
    let distance_m: f64 = wheels
        .windows(2)
        .map(|two| (two[1].1 - two[0].1).norm())
        .sum();
    assert!(distance_m > 5.0, "{distance_m}");

    // Without the sensors in the configuration nothing is guessed.
    replay(&recording, &[], &maps("none")).refuses(
        2,
        &[
            "joint angles (/joint_states) and attitudes (/imu/data)",
            "a sensor of kind \"wheel_encoders\" and one of kind \"imu\"",
        ],
    );
    let one = ["localization.source=wheels", "sensors.ahrs.kind=imu"];
    replay(&recording, &one, &maps("one")).refuses(
        2,
        &[
            "`localization.source`: \"wheels\" is not allowed",
            "(there are 0)",
        ],
    );
}
