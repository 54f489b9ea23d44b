#![expect(clippy::float_cmp, reason = "numbers must arrive bit for bit")]

use super::*;
use measurement::pose::yaw_rad;

fn parse_line(line: &str) -> Result<(RobotTime, MeasurementData), LineError> {
    let (name, fields) = line.split_once(' ').unwrap();
    parse(layout_of(name).unwrap().0, fields, 50.0)
}

fn scan_of(line: &str) -> (Scan, Option<OwnPose>) {
    let MeasurementData::Scan { scan, own_pose } = parse_line(line).unwrap().1 else {
        panic!("not a scan: {line}");
    };
    (scan, own_pose)
}

#[test]
fn laser_line_has_separate_laser_and_vehicle_poses() {
    let line = "FLASER 4 6.66 7.16 50 81.83 1.25 2 0.5 1 2 -0.5 21.0199 pippo 22.5";
    let (scan, own_pose) = scan_of(line);
    assert_eq!(scan.ranges_m, [6.66, 7.16, 50.0, 81.83]);
    assert_eq!((scan.range_min_m, scan.range_max_m), (0.0, 50.0));
    assert_eq!(scan.angle_min_rad, -FRAC_PI_2 as f32);
    assert_eq!(scan.angle_increment_rad, (PI / 4.0) as f32);
    let own_pose = own_pose.unwrap();
    assert_eq!(own_pose.odom_from_sensor.translation.x, 1.25);
    assert!((yaw_rad(&own_pose.odom_from_sensor) - 0.5).abs() < 1e-12);
    assert_eq!(own_pose.odom_from_base.translation.x, 1.0);
    assert!((yaw_rad(&own_pose.odom_from_base) + 0.5).abs() < 1e-12);
    assert_eq!(
        parse_line(line).unwrap().0,
        RobotTime::from_secs_f64(21.0199).unwrap()
    );
}

#[test]
fn odd_beam_counts_hold_both_ends_of_the_half_circle() {
    let (scan, _) = scan_of("RLASER 5 1 1 1 1 1 0 0 0 0 0 0 1 host 1");
    assert_eq!(scan.angle_increment_rad, (PI / 4.0) as f32);
    let (scan, _) = scan_of("FLASER 1 3.5 0 0 0 0 0 0 1 host 1");
    assert!(scan.angle_increment_rad.is_finite());
}

#[test]
fn configured_laser_lines_name_their_angles_and_limit() {
    let robot = "ROBOTLASER1 0 -1.566433 3.141593 0.017453 81.9 0.01 0 3 14.15 6.73 49.63 \
                 2 0 1 0.1 0.2 0.3 0.4 0.5 0.6 0 0 0 0 0 1232658641.50129 zoidberg2 163.28";
    let (scan, own_pose) = scan_of(robot);
    assert_eq!(scan.angle_min_rad, -1.566433);
    assert_eq!(scan.angle_increment_rad, 0.017453);
    assert_eq!(scan.range_max_m, 80.0);
    assert_eq!(scan.ranges_m, [14.15, 6.73, 49.63]);
    assert_eq!(own_pose.unwrap().odom_from_base.translation.x, 0.4);
    assert_eq!(
        (parse_line(robot).unwrap().0.as_nanos() + 500) / 1000,
        1_232_658_641_501_290
    );

    let raw = "RAWLASER2 1 -2 4 0.006 5.6 0.01 0 2 1 2 0 17.5 host 1";
    let (scan, own_pose) = scan_of(raw);
    assert_eq!((scan.range_max_m, own_pose), (5.6, None));
    assert_eq!(layout_of("RAWLASER2").unwrap().1, "rear_laser");
}

#[test]
fn odometry_line_is_a_pose_in_odom() {
    let (stamp, data) = parse_line("ODOM 1 2 -1.5 0.1 0.2 0.3 70.25 nohost 0").unwrap();
    let MeasurementData::Odometry {
        child,
        odom_from_base,
    } = data
    else {
        panic!("not odometry");
    };
    assert_eq!(&*child, "base_link");
    assert_eq!(odom_from_base.translation.y, 2.0);
    assert!((yaw_rad(&odom_from_base) + 1.5).abs() < 1e-12);
    assert_eq!(stamp.as_nanos(), 70_250_000_000);
}

#[test]
fn lines_that_do_not_hold_together_say_why() {
    let check = |line: &str, expected: &str, reason: DropReason| {
        let error = parse_line(line).unwrap_err();
        assert_eq!(error.to_string(), expected, "{line}");
        assert_eq!(error.reason(), reason, "{line}");
    };
    check("FLASER 3 1 2", "ends before a range", DropReason::Damaged);
    check(
        "FLASER 18446744073709551615 1 2",
        "ends before a range",
        DropReason::Damaged,
    );
    check(
        "FLASER 1 1.5x 0 0 0 0 0 0 1 host 1",
        "a range is not a number: \"1.5x\"",
        DropReason::Damaged,
    );
    check(
        "FLASER 1 1 2 0 0 0 0 0 0 1 host 1",
        "logger stamp is not a number: \"host\"",
        DropReason::Damaged,
    );
    check(
        "ODOM 0 0 0 0 0 0 1 host 1 2",
        "goes on after its last field with \"2\"",
        DropReason::Damaged,
    );
    check(
        "FLASER 0 0 0 0 0 0 0 1 host 1",
        "a scan without beams",
        DropReason::BadScan,
    );
    check(
        "ODOM nan 0 0 0 0 0 1 host 1",
        "a pose is not finite",
        DropReason::BadPose,
    );
    check(
        "ODOM 0 0 0 0 0 0 1e300 host 1",
        &format!("the stamp is {} s", 1e300),
        DropReason::BadStamp,
    );
}

#[test]
fn message_names_are_told_from_garbage() {
    for name in ["SYNC", "SM_UPDATE", "LASER3", "NEFF"] {
        assert!(is_message_name(name), "{name}");
    }
    for name in ["", "3LASER", "flaser", "FLA\u{fffd}SER", &"A".repeat(41)] {
        assert!(!is_message_name(name), "{name}");
    }
}
