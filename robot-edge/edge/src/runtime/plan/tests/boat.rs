//! A boat: two sensors, one of which is tilted, and poses from satellites.

use super::*;
use measurement::GeodeticFix;

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
