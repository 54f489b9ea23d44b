use std::path::Path;

use super::*;
use crate::config::{Override, load};
use localization::dead_reckoning::WheelSettings;
use measurement::drops::DropCounts;
use measurement::pose::planar;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{ImuSample, Measurement, MeasurementData, Stream, StreamId};
use recording::{Position, RecordingError, RecordingReader, StreamSummary};

mod boat;

/// One stream of a recording.
type Topic = (&'static str, &'static str, MeasurementData);

/// A recording with ten messages on each of its topics.
struct Recording {
    topics: Vec<Topic>,
    streams: Vec<StreamSummary>,
    yielded: usize,
    losses: DropCounts,
}

impl RecordingReader for Recording {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        let index = self.yielded % self.topics.len();
        let tick = i64::try_from(self.yielded / self.topics.len()).unwrap();
        self.yielded += 1;
        let stamp = RobotTime::from_nanos(tick * 100_000_000);
        Ok((tick < 10).then(|| Measurement {
            stamp,
            stream: StreamId(index as u16),
            frame: "odom".into(),
            data: self.topics[index].2.clone(),
        }))
    }

    fn streams(&self) -> &[StreamSummary] {
        &self.streams
    }

    fn losses(&self) -> &DropCounts {
        &self.losses
    }

    fn loss_notes(&self) -> &[String] {
        &[]
    }

    fn position(&self) -> Position {
        Position {
            bytes_read: 0,
            bytes_total: 1,
        }
    }
}

fn survey(topics: &[Topic]) -> Survey {
    let stream = |(name, type_name, _): &Topic| StreamSummary {
        stream: Stream {
            name: (*name).to_owned(),
            type_name: (*type_name).to_owned(),
        },
        understood: true,
        messages: 10,
        first: None,
        last: None,
    };
    let mut recording = Recording {
        topics: topics.to_vec(),
        streams: topics.iter().map(stream).collect(),
        yielded: 0,
        losses: DropCounts::default(),
    };
    Survey::of_reader(Path::new("drive.mcap"), Format::Mcap, &mut recording).unwrap()
}

fn scan() -> Topic {
    let data = MeasurementData::Scan {
        scan: Scan {
            ranges_m: vec![1.0],
            range_max_m: 20.0,
            ..Scan::default()
        },
        own_pose: None,
    };
    ("/scan", "sensor_msgs/LaserScan", data)
}

fn joints(topic: &'static str, names: &[&str]) -> Topic {
    let angles = names.iter().map(|name| ((*name).to_owned(), 0.0));
    let data = MeasurementData::Joints(angles.collect());
    (topic, "sensor_msgs/JointState", data)
}

fn wheels(topic: &'static str) -> Topic {
    joints(topic, &["left_wheel_joint", "right_wheel_joint", "arm"])
}

fn imu(topic: &'static str, orientation_xyzw: Option<[f64; 4]>) -> Topic {
    let sample = ImuSample {
        orientation_xyzw,
        angular_velocity_radps: [0.0; 3],
        linear_acceleration_mps2: [0.0; 3],
    };
    (topic, "sensor_msgs/Imu", MeasurementData::Imu(sample))
}

fn ahrs(topic: &'static str) -> Topic {
    imu(topic, Some([0.0, 0.0, 0.0, 1.0]))
}

fn odometry() -> Topic {
    let data = MeasurementData::Odometry {
        child: "base_link".into(),
        odom_from_base: planar(0.0, 0.0, 0.0),
    };
    ("/odom", "nav_msgs/Odometry", data)
}

const SENSORS: [&str; 2] = [
    "sensors.wheels={kind = 'wheel_encoders', wheel_radius_m = 0.2, time_offset_s = -0.2}",
    "sensors.ahrs={kind = 'imu'}",
];

fn planned(topics: &[Topic], settings: &[&str]) -> Result<Plan, String> {
    let settings = SENSORS.iter().chain(settings);
    let overrides: Vec<Override> = settings.map(|set| set.parse().unwrap()).collect();
    let config = load("generic2d", &overrides).unwrap();
    plan(&survey(topics), &config).map_err(|error| error.to_string())
}

const WHEELS: &str = "localization.source=wheels";

#[test]
fn poses_come_from_the_only_wheels_and_attitude() {
    // Encoders of an arm and an IMU without attitude are no candidates.
    let topics = [
        scan(),
        joints("/arm", &["arm"]),
        wheels("/joint_states"),
        imu("/imu/raw", None),
        ahrs("/imu/data"),
        odometry(),
    ];
    let plan = planned(&topics, &[WHEELS]).unwrap();
    let PoseOrigin::Wheels(settings) = &plan.localization_plan.origin else {
        panic!("{plan:?}");
    };
    assert_eq!(
        settings.wheels,
        WheelSettings {
            left_joint: "left_wheel_joint".to_owned(),
            right_joint: "right_wheel_joint".to_owned(),
            radius_m: 0.2,
            max_speed_mps: 3.0,
        }
    );
    assert_eq!(
        settings.wheels_time_offset,
        RobotDuration::from_millis(-200)
    );
    assert_eq!(settings.attitude.smoothing, RobotDuration::from_millis(100));
    assert_eq!(plan.streams, ["/scan", "/joint_states", "/imu/data"]);
    assert_eq!(
        plan.notes,
        [
            "poses: wheels of /joint_states and attitude of /imu/data, with the configured mounting of the \
          laser"
        ]
    );
}

#[test]
fn auto_uses_wheels_only_without_better_poses() {
    let mut topics = vec![scan(), wheels("/joint_states"), ahrs("/imu/data")];
    let is_wheels = |plan: &Plan| matches!(plan.localization_plan.origin, PoseOrigin::Wheels(_));
    assert!(is_wheels(&planned(&topics, &[]).unwrap()));
    let in_odom = planned(&topics, &["localization.fixed_frame=odom"]);
    assert!(is_wheels(&in_odom.unwrap()));
    let in_map = planned(&topics, &["localization.fixed_frame=map"]).unwrap_err();
    assert!(
        in_map.contains("no frame \"map\" in which the laser moves"),
        "{in_map}"
    );
    topics.push(odometry());
    assert_eq!(
        planned(&topics, &[]).unwrap().localization_plan.origin,
        PoseOrigin::Odometry
    );
    // Wheels that the vehicle does not have are not guessed.
    let config = load("generic2d", &[]).unwrap();
    let unknown = plan(&survey(&topics[..3]), &config).unwrap_err();
    assert_eq!(
        unknown.to_string(),
        "drive.mcap: nothing in it says where the laser was: there are neither transforms nor odometry. \
         There are joint angles (/joint_states) and attitudes (/imu/data): poses can be reckoned from them if \
         the vehicle's configuration has a sensor of kind \"wheel_encoders\" and one of kind \"imu\". If the \
         vehicle stood still, map it with --set localization.source=static"
    );
}

#[test]
fn the_topic_chooses_one_of_several() {
    let topics = [
        scan(),
        wheels("/front"),
        wheels("/rear"),
        ahrs("/imu/a"),
        ahrs("/imu/b"),
    ];
    assert_eq!(
        planned(&topics, &[WHEELS]).unwrap_err(),
        "drive.mcap: several topics carry angles of both wheels: /front, /rear. Choose one, for example \
         --topic wheels=/front"
    );
    let rear = "sensors.wheels.topic=/rear";
    assert_eq!(
        planned(&topics, &[WHEELS, rear]).unwrap_err(),
        "drive.mcap: several topics carry orientations: /imu/a, /imu/b. Choose one, for example --topic \
         ahrs=/imu/a"
    );
    let both = planned(&topics, &[WHEELS, rear, "sensors.ahrs.topic=/imu/b"]).unwrap();
    assert_eq!(both.streams, ["/scan", "/rear", "/imu/b"]);
    assert_eq!(
        planned(&topics, &[WHEELS, "sensors.wheels.topic=/side"]).unwrap_err(),
        "drive.mcap: no angles of both wheels on \"/side\", which `--topic wheels=` or the configuration \
         names; it has /front, /rear"
    );
}

#[test]
fn errors_name_what_is_missing() {
    let error = |topics: &[Topic]| planned(topics, &[WHEELS]).unwrap_err();
    assert_eq!(
        error(&[scan(), ahrs("/imu/data"), odometry()]),
        "drive.mcap: nothing in it says where the laser was, as localization.source = \"wheels\" wants it: \
         there are no angles of wheels (sensor_msgs/JointState); there is odometry (/odom in odom). --set \
         localization.source=auto takes what there is"
    );
    assert!(
        error(&[scan(), wheels("/joint_states")])
            .contains("there are no attitudes (sensor_msgs/Imu);")
    );
    assert!(error(&[scan()]).contains("there are neither angles of wheels nor attitudes;"));
    let other_names = [
        scan(),
        joints("/joint_states", &["wheel_r", "wheel_l"]),
        ahrs("/imu/data"),
    ];
    assert_eq!(
        error(&other_names),
        "drive.mcap: no topic has both joints \"left_wheel_joint\" and \"right_wheel_joint\", which \
         sensors.wheels.left_joint and right_joint name: /joint_states has wheel_l, wheel_r"
    );
    assert_eq!(
        error(&[scan(), wheels("/joint_states"), imu("/imu/raw", None)]),
        "drive.mcap: /imu/raw gives turn rates and accelerations but no orientation, from which poses are \
         reckoned"
    );
}
