use nalgebra::Point3;

use super::*;
use crate::localization::beam_range::ZeroRange;
use crate::mapping::posed_scan::BeamOutcome;
use crate::measurement::StreamId;
use crate::pose::planar;

fn at(secs: f64) -> RobotTime {
    RobotTime::from_secs_f64(secs).unwrap()
}

fn settings(origin: PoseOrigin) -> PlacerSettings {
    PlacerSettings {
        origin,
        base_frame: "base_link".into(),
        reach: Reach {
            max_gap: RobotDuration::from_millis(500),
            max_extrapolation: RobotDuration::from_millis(100),
        },
        keep: RobotDuration::from_millis(10_000),
        wait: RobotDuration::from_millis(100),
        max_waiting: 4,
        sensor: SensorSettings {
            range_min_m: None,
            range_max_m: None,
            zero: ZeroRange::Invalid,
            time_offset: RobotDuration::ZERO,
            base_from_sensor: planar(1.0, 0.0, 0.0),
        },
        footprint: Footprint {
            length_m: 0.4,
            width_m: 0.4,
        },
    }
}

fn tf() -> PoseOrigin {
    PoseOrigin::Tf {
        fixed_frame: "odom".into(),
        mount: MountOrigin::Configured,
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

/// x of the ends of every placed scan's beams.
fn run(settings: PlacerSettings, input: Vec<Measurement>) -> (Vec<Vec<f64>>, PlacerCounts) {
    let mut placer = BeamPlacer::new(settings);
    let mut out = Vec::new();
    for measurement in input {
        placer.push(measurement, &mut out);
    }
    placer.finish(&mut out);
    (out.iter().map(ends).collect(), placer.counts())
}

fn ends(scan: &PosedScan) -> Vec<f64> {
    scan.beams
        .iter()
        .map(|beam| (beam.end_in_odom.x * 1e6).round() / 1e6)
        .collect()
}

fn dropped(counts: &PlacerCounts) -> Vec<(DropReason, u64)> {
    counts.dropped_scans.iter().collect()
}

#[test]
fn each_beam_gets_the_pose_of_its_own_time() {
    let input = vec![
        pose(1.0, 0.0),
        scan(1.0, 0.1, &[2.0, 2.0, 2.0]),
        pose(1.4, 4.0),
    ];
    let (placed, counts) = run(settings(tf()), input);
    // 1 m/0.1 s, the laser 1 m ahead of the vehicle.
    assert_eq!(placed, [[3.0, 4.0, 5.0]]);
    assert_eq!(
        (counts.scans_in, counts.scans_placed, counts.beams_in),
        (1, 1, 3)
    );
}

#[test]
fn a_scan_waits_for_the_pose_after_its_last_beam() {
    let mut placer = BeamPlacer::new(settings(tf()));
    let mut out = Vec::new();
    placer.push(pose(1.0, 0.0), &mut out);
    placer.push(scan(1.0, 0.1, &[2.0, 2.0]), &mut out);
    placer.push(pose(1.05, 0.5), &mut out);
    assert_eq!(out.len(), 0, "its last beam is at 1.1 s");
    placer.push(pose(1.1, 0.5), &mut out);
    assert_eq!(
        out.len(),
        0,
        "another pose at 1.1 s may still come, and would win"
    );
    placer.push(pose(1.1, 1.0), &mut out);
    placer.push(pose(1.15, 9.0), &mut out);
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
fn when_stamps_have_passed_it_by_100_ms_it_is_extrapolated_or_dropped() {
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
    let (placed, counts) = run(settings(tf()), far);
    assert_eq!(
        (placed.len(), dropped(&counts)),
        (0, vec![(DropReason::PoseTooOld, 1)])
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
        dropped(&counts),
        [
            (DropReason::BadScan, 1),
            (DropReason::BeforeFirstPose, 1),
            (DropReason::PoseGap, 1),
            (DropReason::PoseTooOld, 1),
        ]
    );
    let (_, counts) = run(
        settings(tf()),
        (0..6)
            .map(|i| scan(f64::from(i) * 0.01, 0.0, &[1.0]))
            .collect(),
    );
    assert_eq!(
        dropped(&counts),
        [(DropReason::NoPose, 4), (DropReason::QueueFull, 2)]
    );
    assert_eq!(counts.scans_in, counts.dropped_scans.total());
}

#[test]
fn invalid_beams_and_the_vehicle_itself_are_left_out_and_counted() {
    let mut still = settings(PoseOrigin::Static);
    still.sensor.base_from_sensor = planar(-0.15, 0.0, 0.0);
    let ranges = [f32::NAN, 0.0, 0.2, 0.34, 0.36, 5.0, f32::INFINITY];
    let (placed, counts) = run(still, vec![scan(1.0, 0.0, &ranges)]);
    assert_eq!(placed, [[0.21, 4.85, 19.85]]);
    assert_eq!(counts.beams_in, 7);
    let dropped: Vec<_> = counts.dropped_beams.iter().collect();
    assert_eq!(
        dropped,
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
    let mut placer = BeamPlacer::new(settings(PoseOrigin::Log));
    let mut out = Vec::new();
    placer.push(carmen, &mut out);
    assert!((out[0].beams[0].end_in_odom - Point3::new(10.0, 7.0, 0.0)).norm() < 1e-9);
    assert_eq!(out[0].odom_from_base, own.odom_from_base);
    assert_eq!(out[0].beams[0].outcome, BeamOutcome::Hit);
}

#[test]
fn a_time_offset_moves_the_scan_along_the_track() {
    let mut late = settings(PoseOrigin::Odometry);
    late.sensor.time_offset = RobotDuration::from_millis(-100);
    let odometry = |secs, x| {
        let data = MeasurementData::Odometry {
            child: "base_footprint".into(),
            odom_from_base: planar(x, 0.0, 0.0),
        };
        measurement(secs, "world", data)
    };
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
    settings.origin = PoseOrigin::Tf {
        fixed_frame: "odom".into(),
        mount: MountOrigin::Tree,
    };
    // The mounting comes late, stamped by the wall clock: the scan waits for it and for its pose.
    let input = vec![
        pose(1.0, 0.0),
        scan(1.0, 0.1, &[2.0, 2.0]),
        mount(1e9),
        pose(1.4, 4.0),
    ];
    assert_eq!(run(settings, input).0, [[2.5, 3.5]]);
}

#[test]
fn a_clock_that_starts_anew_forgets_old_poses() {
    let mut placer = BeamPlacer::new(settings(tf()));
    let mut out = Vec::new();
    placer.push(pose(100.0, 50.0), &mut out);
    placer.push(scan(100.0, 0.0, &[2.0]), &mut out);
    placer.reset_clock(&mut out);
    assert_eq!(out.len(), 1);
    placer.push(scan(1.0, 0.0, &[2.0]), &mut out);
    placer.push(pose(1.0, 7.0), &mut out);
    placer.push(pose(1.1, 7.0), &mut out);
    assert_eq!(ends(&out[1]), [10.0]);
}
