//! `info`: the facts of a recording, as lines that people and scripts read.

use std::path::Path;

use crate::process::{events, robot_edge, rooms, run, summary_of};
use crate::shared_data::shared_data;

fn info(path: &Path) -> String {
    let page = run(robot_edge("info").arg(path)).succeeds();
    assert_eq!(page.stderr, "");
    page.stdout.replace(path.to_str().unwrap(), "FILE")
}

/// The page holds these lines, in this order; others may stand between them.
#[track_caller]
fn check(path: &Path, lines: &[&str]) {
    let page = info(path);
    let mut rest = page.lines();
    for line in lines {
        assert!(
            rest.any(|found| found.split_whitespace().eq(line.split_whitespace())),
            "{}: no line {line:?} (in this order) in\n{page}",
            path.display()
        );
    }
}

#[test]
fn the_page_of_the_projects_own_clip() {
    assert_eq!(
        info(&rooms()),
        "FILE
  MCAP, 2.8 MB
  1 min 55 s, 2000-01-01 00:00:00 to 00:01:55 UTC (946684800.000 to 946684915.800)
  vehicle: pioneer

  topic       type                   messages  rate
  /tf_static  tf2_msgs/TFMessage            1  -
  /tf         tf2_msgs/TFMessage         5798  50.0 Hz
  /odom       nav_msgs/Odometry          5798  50.0 Hz
  /scan       sensor_msgs/LaserScan      1159  10.0 Hz

range sensors
  /scan: 1159 scans of 683 beams in frame laser
    -119.9° to 119.9° in steps of 0.352°, beams 97.7 µs apart
    ranges 0.02 to 5.6 m; the greatest is 5.5998816 m, 14 times

frames
  /odom: base_link in odom, 5798 poses
  odom
    base_link (5798 transforms in 1 min 55 s)
      laser (static)

faults
  none

can it be mapped?
  yes: transforms lead from laser to odom
  robot-edge replay FILE --export maps
"
    );
}

/// The recording has transforms as well, but the vehicle that it names wants others.
#[test]
fn the_poses_are_those_that_a_replay_takes() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("ramp.mcap");
    let simulate = "simulate ramp --rate max --duration 5 --record";
    summary_of(robot_edge(simulate).arg(&recording));
    check(
        &recording,
        &[
            "vehicle: holos",
            "odom",
            "laser (static)",
            "can it be mapped?",
            "yes: wheels of /joint_states and attitude of /imu/data give poses, as configured for holos",
            "robot-edge replay FILE --export maps",
        ],
    );
    let replayed = events(&summary_of(robot_edge("replay").arg(&recording)));
    let poses = "setup: poses: wheels of /joint_states and attitude of /imu/data, ";
    assert!(
        replayed.iter().any(|event| event.starts_with(poses)),
        "{replayed:?}"
    );
}

#[test]
fn carmen_logs() {
    let Some(folder) = shared_data("carmen") else {
        return;
    };
    let check = |name: &str, lines: &[&str]| check(&folder.join(name), lines);
    let mappable = [
        "yes: every scan brings its pose",
        "robot-edge replay FILE --export maps",
    ];
    let [own_poses, command] = mappable;
    check(
        "intel-corrected.log",
        &[
            "CARMEN log, 1.7 MB",
            "44 min 10 s, stamps 32.907 to 2683.770 s of a clock without a date",
            "ODOM carmen/ODOM 14541 5.40 Hz",
            "FLASER carmen/FLASER 910 0.343 Hz",
            "FLASER: 910 scans of 180 beams in frame laser",
            "-90.0° to 89.0° in steps of 1.000°, beams 0.0 µs apart",
            "ranges 0 to 80 m; the greatest is 81.83 m, 4172 times",
            "stamps that contradicted the order of their lines, changed to fit it: 2516",
            own_poses,
            command,
        ],
    );
    check(
        "aces-corrected.log",
        &[
            "FLASER: 440 scans of 180 beams in frame laser",
            "ranges 0 to 80 m; the greatest is 50 m, 620 times",
            "from 50 m on they repeat: what this laser reports for no return",
            own_poses,
        ],
    );
    check(
        "csail-corrected.log",
        &[
            "times are not known: its clock cannot be used (see faults)",
            "FLASER: 406 scans of 361 beams in frame laser",
            "-90.0° to 90.0° in steps of 0.500°, beams 0.0 µs apart",
            "ranges 0 to 80 m; the greatest is 81.91 m, 3907 times",
            "FLASER: of 406 stamps 404 repeat the one before, 0 go back",
            "FLASER: its clock cannot be used: scans are mapped in the order of the file",
            own_poses,
        ],
    );
    check(
        "belgioioso-corrected.log",
        &[
            "times are not known: its clock cannot be used (see faults)",
            "FLASER: 395 scans of 361 beams in frame laser",
            "ranges 0 to 80 m; the greatest is 81.91 m, 699 times",
            "FLASER: of 395 stamps 394 repeat the one before, 0 go back",
            "FLASER: its clock cannot be used: scans are mapped in the order of the file",
            own_poses,
        ],
    );
    check(
        "infinite-corridor-corrected.log",
        &[
            "times are not known: its clock cannot be used (see faults)",
            "FLASER carmen/FLASER 1941 -",
            "ranges 0 to 80 m; the greatest is 51.16 m, 2 times",
            "from 51.01 m on they repeat: what this laser reports for no return",
            "FLASER: of 1941 stamps 1940 repeat the one before, 0 go back",
            "FLASER: its clock cannot be used: scans are mapped in the order of the file",
            own_poses,
        ],
    );
    check(
        "aces.clf",
        &[
            "22 min 45 s, stamps 70.290 to 1435.810 s of a clock without a date",
            "FLASER: 7374 scans of 180 beams in frame laser",
            "ranges 0 to 80 m; the greatest is 50 m, 11139 times",
            "from 50 m on they repeat: what this laser reports for no return",
            "none",
            own_poses,
        ],
    );
    check(
        "fr-clinic_robotlaser.clf",
        &[
            "1 h 20 min 20 s, 2009-01-22 21:07:58 to 22:28:18 UTC (1232658478.161 to 1232663298.321)",
            "ROBOTLASER1: 6917 scans of 180 to 181 beams in frame laser",
            "ranges 0 to 80 m; the greatest is 81.91 m, 150066 times",
            own_poses,
        ],
    );
    // The reader's 80 m covers what these report for no return.
    for name in [
        "intel-corrected.log",
        "csail-corrected.log",
        "belgioioso-corrected.log",
        "fr-clinic_robotlaser.clf",
    ] {
        assert!(!info(&folder.join(name)).contains("they repeat"), "{name}");
    }
}

#[test]
fn ros_1_bags() {
    let Some(folder) = shared_data("rosbag1") else {
        return;
    };
    let check = |name: &str, lines: &[&str]| check(&folder.join(name), lines);
    let no_poses = "no: there are no poses of the sensor: neither odometry nor a";
    let handheld = [
        "/scan sensor_msgs/LaserScan 360 10.0 Hz",
        "/scan: 360 scans of 681 beams in frame laser",
        "ranges 0.02 to 5.6 m; the greatest is 5.468 m, 2 times",
    ];
    check(
        "urg04lx_handheld.bag",
        &[&["ROS 1 bag, 1.0 MB"], &handheld[..], &["none", no_poses]].concat(),
    );
    let damage = [
        "damaged lines, records or chunks, passed over: 2",
        "byte 792650: an index whose length contradicts its number of entries",
        no_poses,
    ];
    check("damaged_index.bag", &[&handheld[..], &damage].concat());
    check(
        "two_lasers.bag",
        &[
            "/rear_scan: 330 scans of 726 beams in frame rear_scanner",
            "/front_scan: 331 scans of 726 beams in frame front_scanner",
            no_poses,
            "or with --topic laser=/front_scan in the place of --topic laser=/rear_scan",
            "robot-edge replay FILE --topic laser=/rear_scan --set localization.source=static --export maps",
        ],
    );
    check(
        "lms1xx_with_tf.bag",
        &[
            "/rosout rosgraph_msgs/Log 35 not read: no sensor data that is understood",
            "/sick_lms_1xx/scan sensor_msgs/LaserScan 89 49.9 Hz",
            "/cloud sensor_msgs/PointCloud2 89 49.9 Hz",
            "/sick_lms_1xx/scan: 89 scans of 541 beams in frame cloud",
            "ranges 0.05 to 25 m; the greatest is 3.818 m, 1 times",
            "cloud",
            "radar (17 transforms in 1.6 s)",
            no_poses,
        ],
    );
    run(robot_edge("info").arg(folder.join("version_1.2.bag")))
        .refuses(3, &["version 1.2", "rosbag fix"]);
}

#[test]
fn mcap_files() {
    let Some(folder) = shared_data("mcap") else {
        return;
    };
    check(
        &folder.join("turtlebot_tf_odom.mcap"),
        &[
            "MCAP, 505.4 kB",
            "/odom nav_msgs/Odometry 2639 27.3 Hz",
            "map",
            "odom (921 transforms in 96.6 s)",
            "base_link (2639 transforms in 96.7 s)",
            "rplidar_link (static)",
            "no: there is no planar range sensor in it",
        ],
    );
    check(
        &folder.join("intel_corrected.mcap"),
        &[
            "44 min 10 s, 2020-09-13 12:26:40 to 13:10:50 UTC (1600000000.000 to 1600002650.863)",
            "/scan: 910 scans of 180 beams in frame laser",
            "ranges 0.05 to 80 m; the greatest is 81.83 m, 4172 times",
            "yes: transforms lead from laser to odom",
            "robot-edge replay FILE --export maps",
        ],
    );
}
