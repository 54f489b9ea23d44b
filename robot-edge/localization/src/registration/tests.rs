mod arcs_and_contacts;
mod clouds;
mod many_sensors;
mod matched_clouds;
mod matched_scans;

use super::*;
use mapping::registered_scan::{BeamOutcome, ScanKind, SensorId};
use measurement::StreamId;
use measurement::pose::{Pose, planar};
use nalgebra::{Point3, UnitQuaternion};

use crate::attitude::AttitudeSettings;
use crate::beam_projection::{BodyBox, SensorSettings, ZeroRange};
use crate::dead_reckoning::{DeadReckoningSettings, WheelSettings};
use crate::test_data::{ATTITUDE, LIMITS, at, imu_at};

fn settings(origin: PoseOrigin) -> RegistrationSettings {
    RegistrationSettings {
        origin,
        base_frame: "base_link".into(),
        limits: LIMITS,
        pose_history: RobotDuration::from_millis(10_000),
        max_pose_wait: RobotDuration::from_millis(100),
        max_queued: 4,
        pose_streams: PoseStreams::default(),
        sensors: vec![RangeSensorSettings {
            stream: None,
            beams: SensorSettings {
                id: SensorId(0),
                kind: ScanKind::Beams,
                range_min_m: None,
                range_max_m: None,
                zero_range: ZeroRange::Invalid,
                time_offset: RobotDuration::ZERO,
                thin_m: 0.0,
                base_from_sensor: planar(1.0, 0.0, 0.0),
            },
            mount: MountOrigin::Configured,
            tilt: None,
        }],
        body: BodyBox {
            length_m: 0.4,
            width_m: 0.4,
            offset_m: 0.0,
            lowest_m: 0.0,
            highest_m: 0.5,
        },
        continuation: None,
    }
}

fn tf() -> PoseOrigin {
    PoseOrigin::Tf {
        fixed_frame: "odom".into(),
    }
}

/// A scan of beams straight ahead, `dt` apart.
fn scan(secs: f64, dt: f32, ranges_m: &[f32]) -> Measurement {
    let scan = Scan {
        time_increment_s: dt,
        range_min_m: 0.1,
        range_max_m: 20.0,
        ranges_m: ranges_m.to_vec(),
        ..Scan::default()
    };
    measurement(
        secs,
        "laser",
        MeasurementData::Scan {
            scan,
            own_pose: None,
        },
    )
}

fn pose(secs: f64, x: f64) -> Measurement {
    let data = MeasurementData::Transform {
        child: "base_link".into(),
        parent_from_child: planar(x, 0.0, 0.0),
        is_static: false,
    };
    measurement(secs, "odom", data)
}

fn measurement(secs: f64, frame: &str, data: MeasurementData) -> Measurement {
    Measurement {
        stamp: at(secs),
        stream: StreamId(0),
        frame: frame.into(),
        data,
    }
}

fn registered(
    settings: RegistrationSettings,
    input: Vec<Measurement>,
) -> (Vec<RegistrationOutput>, RegistrationCounts) {
    let mut registration = ScanRegistration::new(settings);
    let mut out = push_all(&mut registration, input);
    registration.finish(&mut out);
    (out, registration.counts())
}

/// x of the ends of every registered scan's beams.
fn run(
    settings: RegistrationSettings,
    input: Vec<Measurement>,
) -> (Vec<Vec<f64>>, RegistrationCounts) {
    let (mut out, counts) = registered(settings, input);
    out.retain(|registered| matches!(registered, RegistrationOutput::Scan(_)));
    (out.iter().map(ends).collect(), counts)
}

fn registered_scan(registered: &RegistrationOutput) -> &RegisteredScan {
    match registered {
        RegistrationOutput::Scan(scan) => scan,
        other => panic!("{other:?}"),
    }
}

fn ends(registered: &RegistrationOutput) -> Vec<f64> {
    registered_scan(registered)
        .beams
        .iter()
        .map(|beam| (beam.end_in_odom.x * 1e6).round() / 1e6)
        .collect()
}

fn reasons(drops: &DropCounts) -> Vec<(DropReason, u64)> {
    drops.iter().collect()
}

#[test]
fn each_beam_gets_the_pose_of_its_own_time() {
    let input = vec![
        pose(1.0, 0.0),
        scan(1.0, 0.1, &[2.0, 2.0, 2.0]),
        pose(1.4, 4.0),
    ];
    let (registered, counts) = run(settings(tf()), input);
    // 1 m/0.1 s, the laser 1 m ahead of the vehicle.
    assert_eq!(registered, [[3.0, 4.0, 5.0]]);
    assert_eq!(
        (counts.scans_in, counts.scans_registered, counts.beams_in),
        (1, 1, 3)
    );
}

#[test]
fn a_scan_waits_for_the_pose_after_its_last_beam() {
    let mut registration = ScanRegistration::new(settings(tf()));
    let mut out = Vec::new();
    registration.push(pose(1.0, 0.0), &mut out);
    registration.push(scan(1.0, 0.1, &[2.0, 2.0]), &mut out);
    registration.push(pose(1.05, 0.5), &mut out);
    assert_eq!(out.len(), 0, "its last beam is at 1.1 s");
    registration.push(pose(1.1, 0.5), &mut out);
    assert_eq!(
        out.len(),
        0,
        "another pose at 1.1 s may still come, and would win"
    );
    registration.push(pose(1.1, 1.0), &mut out);
    registration.push(pose(1.15, 1.9), &mut out);
    assert_eq!(ends(&out[0]), [3.0, 4.0]);
}

#[test]
fn a_pause_in_the_data_does_not_cost_the_scan_before_it() {
    let input = vec![
        pose(1.0, 3.0),
        scan(1.0, 0.0, &[2.0]),
        pose(31.0, 4.0),
        scan(31.0, 0.0, &[2.0]),
    ];
    assert_eq!(run(settings(tf()), input).0, [[6.0], [7.0]]);
}

#[test]
fn after_the_wait_a_scan_is_extrapolated_or_dropped() {
    let other = |secs| measurement(secs, "imu", MeasurementData::Joints(vec![]));
    let near = vec![
        pose(1.0, 0.0),
        pose(1.1, 1.0),
        scan(1.15, 0.0, &[2.0]),
        other(1.251),
    ];
    assert_eq!(run(settings(tf()), near).0, [[4.5]]);
    let far = vec![
        pose(1.0, 0.0),
        pose(1.1, 1.0),
        scan(1.21, 0.0, &[2.0]),
        other(1.4),
    ];
    let (registered, counts) = run(settings(tf()), far);
    assert_eq!(
        (registered.len(), reasons(&counts.dropped_scans)),
        (0, vec![(DropReason::AfterLastPose, 1)])
    );
}

#[test]
fn every_lost_scan_has_its_reason() {
    let bad = Measurement {
        stamp: at(1.0),
        ..scan(1.0, -1.0, &[1.0, 1.0])
    };
    let (_, counts) = run(
        settings(tf()),
        vec![
            scan(0.5, 0.0, &[1.0]),
            pose(1.0, 0.0),
            bad,
            scan(1.2, 0.0, &[1.0]),
            pose(1.6, 0.0),
            scan(5.0, 0.0, &[1.0]),
        ],
    );
    assert_eq!(
        reasons(&counts.dropped_scans),
        [
            (DropReason::BadScan, 1),
            (DropReason::BeforeFirstPose, 1),
            (DropReason::PoseGap, 1),
            (DropReason::AfterLastPose, 1),
        ]
    );
    let (_, counts) = run(
        settings(tf()),
        (0..6)
            .map(|i| scan(f64::from(i) * 0.01, 0.0, &[1.0]))
            .collect(),
    );
    assert_eq!(
        reasons(&counts.dropped_scans),
        [(DropReason::NoPose, 4), (DropReason::QueueFull, 2)]
    );
    assert_eq!(counts.scans_in, counts.dropped_scans.total());
}

#[test]
fn invalid_beams_and_own_body_hits_are_counted() {
    let mut still = settings(PoseOrigin::Static);
    still.sensors[0].beams.base_from_sensor = planar(-0.15, 0.0, 0.0);
    let ranges = [f32::NAN, 0.0, 0.2, 0.34, 0.36, 5.0, f32::INFINITY];
    let (registered, counts) = run(still, vec![scan(1.0, 0.0, &ranges)]);
    assert_eq!(registered, [[0.21, 4.85, 19.85]]);
    assert_eq!(counts.beams_in, 7);
    assert_eq!(
        reasons(&counts.dropped_beams),
        [(DropReason::InvalidRange, 2), (DropReason::OwnBody, 2)]
    );
}

#[test]
fn a_log_places_its_beams_with_the_lasers_pose_not_the_robots() {
    let own = OwnPose {
        odom_from_sensor: planar(10.0, 5.0, std::f64::consts::FRAC_PI_2),
        odom_from_base: planar(10.0, 4.0, 0.0),
    };
    let mut carmen = scan(1.0, 0.0, &[2.0]);
    if let MeasurementData::Scan { own_pose, .. } = &mut carmen.data {
        *own_pose = Some(own);
    }
    let mut registration = ScanRegistration::new(settings(PoseOrigin::Log));
    let mut out = Vec::new();
    registration.push(carmen, &mut out);
    let out = registered_scan(&out[0]);
    assert!((out.beams[0].end_in_odom - Point3::new(10.0, 7.0, 0.0)).norm() < 1e-9);
    assert_eq!(out.odom_from_base, own.odom_from_base);
    assert_eq!(out.beams[0].outcome, BeamOutcome::Hit);
}

#[test]
fn a_time_offset_moves_the_scan_along_the_track() {
    let mut late = settings(PoseOrigin::Odometry);
    late.sensors[0].beams.time_offset = RobotDuration::from_millis(-100);
    let input = vec![
        odometry(1.0, 0.0),
        scan(1.2, 0.0, &[2.0]),
        odometry(1.4, 4.0),
    ];
    assert_eq!(run(late, input).0, [[4.0]]);
}

#[test]
fn a_static_transform_of_another_clock_hurries_nothing() {
    let mount = |secs| {
        let data = MeasurementData::Transform {
            child: "laser".into(),
            parent_from_child: planar(0.5, 0.0, 0.0),
            is_static: true,
        };
        measurement(secs, "base_link", data)
    };
    let mut settings = settings(tf());
    settings.sensors[0].mount = MountOrigin::Tree;
    // The mounting arrives late, stamped by the wall clock: the scan waits for it and for its pose.
    let input = vec![
        pose(1.0, 0.0),
        scan(1.0, 0.1, &[2.0, 2.0]),
        mount(1e9),
        pose(1.4, 4.0),
    ];
    assert_eq!(run(settings, input).0, [[2.5, 3.5]]);
}

#[test]
fn clock_reset_forgets_old_poses() {
    let mut registration = ScanRegistration::new(settings(tf()));
    let mut out = Vec::new();
    registration.push(pose(100.0, 50.0), &mut out);
    registration.push(scan(100.0, 0.0, &[2.0]), &mut out);
    registration.reset_clock(&mut out);
    assert_eq!(out.len(), 1);
    registration.push(scan(1.0, 0.0, &[2.0]), &mut out);
    registration.push(pose(1.0, 7.0), &mut out);
    registration.push(pose(1.1, 7.0), &mut out);
    assert_eq!(ends(&out[1]), [10.0]);
}

/// The x of a scan's only beam, or the distance of a jump.
#[derive(Debug, PartialEq)]
enum Out {
    Scan(f64),
    Jump(f64),
}

fn outs(registered: &[RegistrationOutput]) -> Vec<Out> {
    let out = |registered: &RegistrationOutput| match registered {
        RegistrationOutput::Scan(_) => Out::Scan(ends(registered)[0]),
        RegistrationOutput::Jump(jump) => Out::Jump((jump.distance_m * 1e6).round() / 1e6),
        other => panic!("{other:?}"),
    };
    registered.iter().map(out).collect()
}

fn push_all(
    registration: &mut ScanRegistration,
    input: Vec<Measurement>,
) -> Vec<RegistrationOutput> {
    let mut out = Vec::new();
    for measurement in input {
        registration.push(measurement, &mut out);
    }
    out
}

fn odometry(secs: f64, x: f64) -> Measurement {
    let data = MeasurementData::Odometry {
        child: "base_link".into(),
        odom_from_base: planar(x, 0.0, 0.0),
    };
    measurement(secs, "odom", data)
}

#[test]
fn odometry_jump_is_between_the_scans_around_it() {
    for (origin, pose) in [
        (tf(), pose as fn(f64, f64) -> Measurement),
        (PoseOrigin::Odometry, odometry),
    ] {
        let mut registration = ScanRegistration::new(settings(origin));
        let mut out = push_all(
            &mut registration,
            vec![
                pose(1.0, 0.0),
                scan(1.05, 0.0, &[2.0]),
                pose(1.1, 0.1),
                // Its first beam is before the jump, its last after it.
                scan(1.1, 0.05, &[2.0, 2.0]),
                scan(1.15, 0.0, &[2.0]),
                // 5 m, while 20 m/s for 0.1 s plus 1 m are allowed.
                pose(1.2, 5.1),
                scan(1.25, 0.0, &[2.0]),
                pose(1.3, 5.2),
                scan(1.35, 0.0, &[2.0]),
                pose(1.4, 5.3),
            ],
        );
        registration.finish(&mut out);
        let expected = [
            Out::Scan(3.05),
            Out::Jump(5.0),
            Out::Scan(8.15),
            Out::Scan(8.25),
        ];
        assert_eq!(outs(&out), expected);
        let RegistrationOutput::Jump(jump) = out[1] else {
            panic!("{out:?}")
        };
        assert_eq!(jump.stamp, at(1.2));
        assert_eq!(
            reasons(&registration.counts().dropped_scans),
            [(DropReason::PoseJump, 2)]
        );
    }
}

#[test]
fn jump_without_later_scan_is_emitted_at_the_end() {
    let mut registration = ScanRegistration::new(settings(tf()));
    let mut out = push_all(
        &mut registration,
        vec![pose(1.0, 0.0), pose(1.1, 9.0), pose(1.2, 0.0)],
    );
    assert_eq!(outs(&out), []);
    registration.finish(&mut out);
    assert_eq!(outs(&out), [Out::Jump(9.0), Out::Jump(9.0)]);
}

#[test]
fn jumps_of_frames_that_do_not_carry_the_vehicle_are_none() {
    let other = |secs, x_m: f64| {
        let data = MeasurementData::Transform {
            child: "person".into(),
            parent_from_child: planar(x_m, 0.0, 0.0),
            is_static: false,
        };
        measurement(secs, "odom", data)
    };
    let mut registration = ScanRegistration::new(settings(tf()));
    let mut out = push_all(
        &mut registration,
        vec![
            pose(1.0, 0.0),
            other(1.0, 0.0),
            other(1.1, 50.0),
            scan(1.2, 0.0, &[2.0]),
            pose(1.2, 0.0),
        ],
    );
    registration.finish(&mut out);
    assert_eq!(outs(&out), [Out::Scan(3.0)]);
}

#[test]
fn log_with_jumps_loses_no_scan() {
    let own = |secs, x_m| {
        let mut carmen = scan(secs, 0.0, &[2.0]);
        if let MeasurementData::Scan { own_pose, .. } = &mut carmen.data {
            *own_pose = Some(OwnPose {
                odom_from_sensor: planar(x_m, 0.0, 0.0),
                odom_from_base: planar(x_m, 0.0, 0.0),
            });
        }
        carmen
    };
    let mut registration = ScanRegistration::new(settings(PoseOrigin::Log));
    let mut out = push_all(&mut registration, vec![own(1.0, 0.0), own(1.1, 6.0)]);
    assert_eq!(outs(&out), [Out::Scan(2.0), Out::Jump(6.0), Out::Scan(8.0)]);
    let keyframes = push_all(&mut registration, vec![own(1.1, 7.5), own(1.1, 9.0)]);
    assert_eq!(outs(&keyframes), [Out::Scan(9.5), Out::Scan(11.0)]);
    registration.reset_clock(&mut out);
    out.extend(push_all(&mut registration, vec![own(1.0, 0.0)]));
    assert_eq!(outs(&out)[3..], [Out::Scan(2.0)]);
}

#[test]
fn clock_reset_is_no_jump() {
    let mut registration = ScanRegistration::new(settings(PoseOrigin::Odometry));
    let mut out = push_all(
        &mut registration,
        vec![
            odometry(9.0, 0.0),
            scan(9.0, 0.0, &[2.0]),
            odometry(9.1, 0.0),
        ],
    );
    registration.reset_clock(&mut out);
    out.extend(push_all(
        &mut registration,
        vec![
            odometry(1.0, 50.0),
            scan(1.0, 0.0, &[2.0]),
            odometry(1.1, 50.0),
        ],
    ));
    assert_eq!(outs(&out), [Out::Scan(3.0), Out::Scan(53.0)]);
}

#[test]
fn many_jumps_between_two_scans_take_bounded_memory() {
    let poses = (0..1000).map(|n| pose(1.0 + f64::from(n) * 1e-3, f64::from(n % 2) * 9.0));
    let mut registration = ScanRegistration::new(settings(tf()));
    let mut out = push_all(&mut registration, poses.collect());
    registration.finish(&mut out);
    assert_eq!(out.len(), 64);
    let RegistrationOutput::Jump(newest) = out[63] else {
        panic!("{out:?}")
    };
    assert_eq!(newest.stamp, at(1.999));
}

#[test]
fn a_scan_that_is_older_than_the_one_before_is_late() {
    let input = vec![
        odometry(1.0, 0.0),
        odometry(1.2, 0.0),
        scan(1.1, 0.0, &[2.0]),
        scan(1.05, 0.0, &[2.0]),
        scan(1.1, 0.0, &[2.0]),
        scan(1.15, 0.0, &[2.0]),
    ];
    for origin in [PoseOrigin::Odometry, PoseOrigin::Static] {
        let (registered, counts) = run(settings(origin), input.clone());
        assert_eq!(registered.len(), 3);
        assert_eq!(reasons(&counts.dropped_scans), [(DropReason::Late, 1)]);
    }
}

#[test]
fn scans_without_valid_beams_are_registered_empty() {
    let input = vec![
        scan(1.0, 0.0, &[f32::NAN; 5]),
        scan(1.1, 0.0, &[0.0, f32::NEG_INFINITY]),
    ];
    let (registered, counts) = run(settings(PoseOrigin::Static), input);
    assert_eq!(registered, [[0.0; 0]; 2]);
    assert_eq!((counts.scans_registered, counts.beams_in), (2, 7));
    assert_eq!(
        reasons(&counts.dropped_beams),
        [(DropReason::InvalidRange, 7)]
    );
}

#[test]
fn the_number_and_the_step_of_beams_may_change_in_mid_stream() {
    let fan = |secs, step: f32, beams: usize| {
        let mut fan = scan(secs, 0.0, &vec![2.0; beams]);
        if let MeasurementData::Scan { scan, .. } = &mut fan.data {
            scan.angle_increment_rad = step;
        }
        fan
    };
    let half_turn = std::f32::consts::PI;
    let input = vec![
        fan(1.0, half_turn, 2),
        fan(1.1, half_turn, 1),
        fan(1.2, half_turn, 3),
        fan(1.3, 0.5 * half_turn, 3),
        fan(1.4, half_turn, 2),
    ];
    let (registered, counts) = run(settings(PoseOrigin::Static), input);
    // From a laser 1 m ahead of the origin.
    assert_eq!(
        registered,
        [
            vec![3.0, -1.0],
            vec![3.0],
            vec![3.0, -1.0, 3.0],
            vec![3.0, 1.0, -1.0],
            vec![3.0, -1.0],
        ]
    );
    assert_eq!(counts.dropped_scans.total(), 0);
}

const SMOOTHED: AttitudeSettings = AttitudeSettings {
    smoothing: RobotDuration::from_millis(100),
    ..ATTITUDE
};

fn wheels(wheels_offset_ms: i64) -> PoseOrigin {
    PoseOrigin::Wheels(DeadReckoningSettings {
        wheels: WheelSettings {
            left_joint: "left".to_owned(),
            right_joint: "right".to_owned(),
            radius_m: 0.5,
            max_speed_mps: 9.0,
        },
        wheels_time_offset: RobotDuration::from_millis(wheels_offset_ms),
        attitude: SMOOTHED,
        max_gap: RobotDuration::from_millis(500),
    })
}

/// 2 m/s ahead for 3 s: attitudes at 100 Hz, wheels at 20 Hz with late stamps, scans at 10 Hz.
fn drive(wheels_late_s: f64) -> Vec<Measurement> {
    let mut input = Vec::new();
    for tick in 0..=300 {
        let secs = f64::from(tick) * 0.01;
        let sample = imu_at(UnitQuaternion::identity());
        input.push(measurement(secs, "imu", MeasurementData::Imu(sample)));
        if tick % 5 == 0 {
            let angles = ["left", "right"].map(|name| (name.to_owned(), 4.0 * secs));
            let data = MeasurementData::Joints(angles.to_vec());
            input.push(measurement(secs + wheels_late_s, "", data));
        }
        if tick % 10 == 3 {
            input.push(scan(secs, 0.005, &[2.0; 10]));
        }
    }
    input.sort_by_key(|measurement| measurement.stamp);
    input
}

#[test]
fn wheels_and_attitude_place_beams() {
    let (registered, counts) = run(settings(wheels(0)), drive(0.0));
    assert_eq!((registered.len(), counts.scans_in), (30, 30));
    assert_eq!(counts.dropped_poses, DropCounts::default());
    for (scan, ends) in registered.iter().enumerate() {
        for (beam, end) in ends.iter().enumerate() {
            let secs = 0.03 + 0.1 * scan as f64 + 0.005 * beam as f64;
            assert!((end - (3.0 + 2.0 * secs)).abs() < 2e-6, "{end} at {secs} s");
        }
    }
    let (late, counts) = run(settings(wheels(-200)), drive(0.2));
    assert_eq!((&late, counts.scans_registered), (&registered, 30));
    let (uncorrected, _) = run(settings(wheels(0)), drive(0.2));
    // The first two scans are before its first pose.
    assert_eq!(uncorrected.len(), 28);
    assert!((uncorrected[8][0] - (registered[10][0] - 0.4)).abs() < 2e-6);
}

#[test]
fn a_loop_begins_at_the_origin_again() {
    let mut registration = ScanRegistration::new(settings(wheels(0)));
    let mut out = push_all(&mut registration, drive(0.0));
    registration.reset_clock(&mut out);
    let first: Vec<_> = out.iter().map(ends).collect();
    let mut out = push_all(&mut registration, drive(0.0));
    registration.finish(&mut out);
    assert_eq!(out.iter().map(ends).collect::<Vec<_>>(), first);
    assert_eq!(registration.counts().scans_registered, 60);
    assert_eq!(registration.counts().dropped_poses, DropCounts::default());
}

#[test]
fn attitudes_that_are_not_numbers_cost_no_scan() {
    let mut input = drive(0.0);
    for (n, measurement) in input.iter_mut().enumerate() {
        if let MeasurementData::Imu(sample) = &mut measurement.data
            && n % 3 == 0
        {
            sample.orientation_xyzw = Some([f64::NAN; 4]);
        }
    }
    let bad = input.iter().filter(|measurement| {
        matches!(&measurement.data, MeasurementData::Imu(sample)
            if sample.orientation_xyzw.is_some_and(|xyzw| xyzw[0].is_nan()))
    });
    let bad = bad.count() as u64;
    assert!(bad > 90);
    let (registered, counts) = run(settings(wheels(0)), input);
    assert_eq!(reasons(&counts.dropped_poses), [(DropReason::BadPose, bad)]);
    assert_eq!(registered.len(), 30);
}

#[test]
fn without_wheels_no_scan_has_a_pose() {
    let mut input = drive(0.0);
    input.retain(|measurement| !matches!(measurement.data, MeasurementData::Joints(_)));
    let mut settings = settings(wheels(0));
    settings.max_queued = 100;
    let (registered, counts) = run(settings, input);
    assert_eq!(registered.len(), 0);
    assert_eq!(reasons(&counts.dropped_scans), [(DropReason::NoPose, 30)]);
}
