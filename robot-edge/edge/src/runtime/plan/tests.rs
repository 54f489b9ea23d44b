use super::*;
use crate::cli::VehicleOptions;
use crate::config::{Override, load};
use crate::survey::tests::{Recorded, Topic};
use localization::dead_reckoning::WheelSettings;
use measurement::pose::planar;
use measurement::scan::Scan;
use measurement::time::RobotDuration;
use measurement::{GeodeticFix, ImuSample, MeasurementData, StreamId};

fn survey(topics: &[Topic]) -> Survey {
    Recorded::new(topics, "odom", 10).survey("drive.mcap")
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

/// Labels, and whether the recording can be mapped with that choice.
#[track_caller]
fn choices(topics: &[Topic], settings: &[&str], question: &str) -> Vec<(String, bool)> {
    let settings = SENSORS.iter().chain(settings);
    let overrides: Vec<Override> = settings.map(|set| set.parse().unwrap()).collect();
    let planned = |added: &[Override]| {
        let config = load("generic2d", &[&overrides, added].concat()).unwrap();
        plan(&survey(topics), &config)
    };
    let error = planned(&[]).unwrap_err();
    let needed = error.downcast_ref::<ChoiceNeeded>().unwrap();
    assert_eq!(needed.question, question);
    let choices = needed.choices.iter().map(|choice| {
        let setup = VehicleOptions::default().with(choice);
        let added = [setup.settings, setup.topics].concat();
        (choice.label.clone(), planned(&added).is_ok())
    });
    choices.collect()
}

#[test]
fn every_choice_can_be_mapped() {
    let both = |labels: [&str; 2]| labels.map(|label| (label.to_owned(), true));
    let lasers = [scan_on("/front"), scan_on("/rear"), odometry()];
    assert_eq!(
        choices(&lasers, &[], "Which topic is the laser?"),
        both(["/front", "/rear"])
    );
    assert_eq!(
        choices(
            &lasers,
            &["sensors.laser.topic=/scan"],
            "Which topic is the laser?"
        ),
        both(["/front", "/rear"])
    );
    let wheel_topics = [scan(), wheels("/front"), wheels("/rear"), ahrs("/imu")];
    assert_eq!(
        choices(
            &wheel_topics,
            &[WHEELS],
            "Several topics carry angles of both wheels. Which one?"
        ),
        both(["/front", "/rear"])
    );
    let question =
        "Nothing in it says where the laser was: there are neither transforms nor odometry.";
    let stood_still = choices(&[scan()], &[], question);
    assert_eq!(stood_still, [("The vehicle stood still".to_owned(), true)]);
    let question = "The settings want poses of source \"wheels\", but there are neither angles of wheels nor \
                    attitudes; there is odometry (/odom in odom).";
    let others = choices(&[scan(), odometry()], &[WHEELS], question);
    assert_eq!(others, [("Use what there is".to_owned(), true)]);
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

fn scan_on(topic: &'static str) -> Topic {
    let (_, type_name, data) = scan();
    (topic, type_name, data)
}

fn fixes(topic: &'static str, status: i8) -> Topic {
    let fix = GeodeticFix {
        latitude_deg: 38.5,
        longitude_deg: -9.2,
        altitude_m: 50.0,
        status,
        sigma_m: None,
    };
    (topic, "sensor_msgs/NavSatFix", MeasurementData::Fix(fix))
}

fn of_boat(topics: &[Topic], settings: &[&str]) -> Result<Plan, String> {
    let overrides: Vec<Override> = settings.iter().map(|set| set.parse().unwrap()).collect();
    let config = load("riverwatch", &overrides).unwrap();
    plan(&survey(topics), &config).map_err(|error| error.to_string())
}

#[test]
fn a_boat_is_mapped_with_all_its_sensors() {
    let topics = [
        fixes("/fix", 2),
        scan_on("/sonar"),
        ahrs("/imu/data"),
        joints("/joint_states", &["laser_tilt_joint"]),
        scan_on("/scan"),
    ];
    let plan = of_boat(&topics, &[]).unwrap();
    assert_eq!(
        plan.sensors,
        [("laser", "/scan"), ("sonar", "/sonar")]
            .map(|(name, topic)| (name.to_owned(), topic.to_owned()))
    );
    assert_eq!(
        plan.streams,
        ["/scan", "/sonar", "/fix", "/imu/data", "/joint_states"]
    );
    assert_eq!(
        plan.notes,
        [
            "poses: satellite fixes of /fix and attitude of /imu/data, with the configured mounting of the laser \
             and the sonar",
            "laser: tilted as /joint_states says of joint laser_tilt_joint",
        ]
    );
    let planned = &plan.localization_plan.sensors;
    let routes: Vec<_> = planned.iter().map(|s| (s.stream, s.tilt_stream)).collect();
    assert_eq!(
        routes,
        [
            (Some(StreamId(4)), Some(StreamId(3))),
            (Some(StreamId(1)), None)
        ]
    );
    assert_eq!(plan.localization_plan.pose_streams.fixes, Some(StreamId(0)));
    // Where the sonar was not recorded, the rest is mapped, and it is said.
    let mut without: Vec<_> = topics.to_vec();
    without.remove(1);
    let plan = of_boat(&without, &[]).unwrap();
    assert_eq!(plan.sensors.len(), 1);
    assert!(plan.notes[0].starts_with("sonar: "), "{:?}", plan.notes);
}

#[test]
fn auto_uses_fixes_last() {
    let topics = [
        scan_on("/scan"),
        fixes("/fix", 0),
        ahrs("/imu/data"),
        odometry(),
    ];
    let tilt_elsewhere = "sensors.laser.tilt.joint=nod";
    let auto = ["localization.source=auto"];
    let error = of_boat(&topics, &[auto[0], tilt_elsewhere]).unwrap_err();
    assert_eq!(
        error,
        "drive.mcap: nothing says how far laser was tilted: no topic has the joint \"nod\", which \
         sensors.laser.tilt.joint names: there are no joint angles (sensor_msgs/JointState)"
    );
    let mut topics = topics.to_vec();
    topics.push(joints("/a/joint_states", &["laser_tilt_joint"]));
    let plan = of_boat(&topics, &auto).unwrap();
    assert_eq!(plan.localization_plan.origin, PoseOrigin::Odometry);
    topics.remove(3);
    let plan = of_boat(&topics, &auto).unwrap();
    assert!(matches!(plan.localization_plan.origin, PoseOrigin::Gps(_)));
    topics.push(joints("/b/joint_states", &["laser_tilt_joint"]));
    let error = of_boat(&topics, &auto).unwrap_err();
    assert!(
        error.ends_with(
            "several topics carry angles of \"laser_tilt_joint\": /a/joint_states, /b/joint_states. Choose \
             one, for example --set sensors.laser.tilt.topic=/a/joint_states"
        ),
        "{error}"
    );
    let chosen = of_boat(
        &topics,
        &[auto[0], "sensors.laser.tilt.topic=/b/joint_states"],
    )
    .unwrap();
    assert!(chosen.streams.contains(&"/b/joint_states".to_owned()));
}

#[test]
fn a_receiver_without_fixes_gives_no_poses() {
    let topics = [scan_on("/scan"), fixes("/fix", -1), ahrs("/imu/data")];
    assert_eq!(
        of_boat(&topics, &[]).unwrap_err(),
        "drive.mcap: the receiver of /fix never had a fix, so nothing says where the vehicle was"
    );
    let error = of_boat(&topics[..2], &[]).unwrap_err();
    assert!(
        error.contains("\"gps\" wants it: there are no attitudes (sensor_msgs/Imu);"),
        "{error}"
    );
}

fn transform(parent: &str, child: &str, is_static: bool) -> Topic {
    let data = MeasurementData::Transform {
        child: child.into(),
        parent_from_child: planar(0.0, 0.0, 0.0),
        is_static,
    };
    assert_eq!(parent, "odom", "the frame of all messages here");
    ("/tf", "tf2_msgs/TFMessage", data)
}

#[test]
fn transforms_place_a_tilting_laser_only_if_they_move_it() {
    // All messages here are of frame odom, which moves with nothing: base_link is the vehicle in it.
    let topics = [
        scan_on("/scan"),
        transform("odom", "base_link", false),
        joints("/joint_states", &["laser_tilt_joint"]),
    ];
    let plan = of_boat(&topics, &["localization.source=tf"]).unwrap();
    let sensor = plan.localization_plan.sensors[0];
    assert_eq!(sensor.mount, MountOrigin::Configured);
    assert_eq!(sensor.tilt_stream, Some(StreamId(2)));
}

/// Of one laser, by its pitch; 7.5° is that of the document's robot.
#[test]
fn the_scans_of_a_tilted_laser_are_matched_in_space_and_need_odometry() {
    let topics = [scan(), odometry(), ahrs("/imu")];
    for (pitch_deg, source, is_tilted) in [
        (1.0, "scan+wheels", Ok(false)),
        (1.0, "scan+imu", Ok(false)),
        (7.5, "scan+wheels", Ok(true)),
        (7.5, "scan+imu", Err(())),
        (7.5, "scan", Err(())),
    ] {
        let settings = [
            format!("sensors.laser.mount.pitch_deg={pitch_deg}"),
            format!("localization.source={source}"),
        ];
        let settings = settings.each_ref().map(String::as_str);
        let plan = planned(&topics, &settings);
        match (plan, is_tilted) {
            (Ok(plan), Ok(is_tilted)) => {
                let PoseOrigin::Scans { scans, .. } = plan.localization_plan.origin else {
                    panic!("{source}");
                };
                assert_eq!(scans.is_tilted, is_tilted, "{pitch_deg} {source}");
            }
            (Err(error), Err(())) => assert!(
                error.contains("the laser \"laser\" is tilted") && error.contains("scan+wheels"),
                "{error}"
            ),
            (plan, _) => panic!("{pitch_deg} {source}: {plan:?}"),
        }
    }
}
