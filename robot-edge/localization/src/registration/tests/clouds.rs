//! Clouds: each point has the pose of its own time, and the index of its beam.

use measurement::cloud::{Cloud, CloudPoint};

use super::*;

/// Points of two rings in three columns, clockwise, 10 ms from column to column; the first column is 10 ms before the stamp.
fn revolution() -> Cloud {
    let point = |ring: u16, column: u16| {
        let azimuth_rad = 0.1 - 0.1 * f32::from(column);
        CloudPoint {
            position_m: [
                10.0 * libm::cosf(azimuth_rad),
                10.0 * libm::sinf(azimuth_rad),
                f32::from(ring),
            ],
            after_s: 0.01 * (f32::from(column) - 1.0),
            intensity: 0.0,
            ring: Some(ring),
        }
    };
    let columns = (0..3).flat_map(|column| (0..2).map(move |ring| point(ring, column)));
    Cloud {
        points: columns.collect(),
        without_return: 2,
    }
}

/// Of a vehicle that drives ahead with 10 m/s.
fn registered(
    cloud: &Cloud,
    settings: RegistrationSettings,
) -> (Vec<RegisteredScan>, RegistrationCounts) {
    let mut registration = ScanRegistration::new(settings);
    let mut out = Vec::new();
    for tenths in 0..20 {
        let secs = 0.1 * f64::from(tenths);
        let pose = MeasurementData::Odometry {
            child: "base_link".into(),
            odom_from_base: planar(10.0 * secs, 0.0, 0.0),
        };
        registration.push(measurement(secs, pose), &mut out);
        if tenths == 10 {
            let cloud = MeasurementData::Cloud(cloud.clone());
            registration.push(measurement(1.05, cloud), &mut out);
        }
    }
    registration.finish(&mut out);
    let scans = out.into_iter().filter_map(|output| match output {
        RegistrationOutput::Scan(scan) => Some(scan),
        _ => None,
    });
    (scans.collect(), registration.counts())
}

fn measurement(secs: f64, data: MeasurementData) -> Measurement {
    Measurement {
        stamp: at(secs),
        stream: StreamId(0),
        frame: "".into(),
        data,
    }
}

fn lidar() -> RegistrationSettings {
    let mut settings = settings(PoseOrigin::Odometry);
    settings.sensors[0].beams.kind = ScanKind::Cloud;
    settings
}

#[test]
fn each_point_is_placed_by_the_pose_of_its_time() {
    let (scans, counts) = registered(&revolution(), lidar());
    let [scan] = &scans[..] else {
        panic!("{scans:?}")
    };
    assert_eq!((scan.kind, scan.stamp), (ScanKind::Cloud, at(1.04)));
    let columns = (std::f64::consts::TAU / scan.beam_step_rad).round() as u32;
    assert!(
        (scan.beam_step_rad - 0.1).abs() < 0.001,
        "{}",
        scan.beam_step_rad
    );
    let first = scan.beams[0].index;
    let expected = [0, 1, 2, columns + 2, columns + 3, columns + 4];
    for (beam, (at, index)) in scan.beams.iter().zip(expected.iter().enumerate()) {
        assert_eq!(beam.index - first, *index);
        let (ring, column) = ((at / 3) as f64, (at % 3) as f64);
        // The mounting is 1 m ahead of the base.
        let origin = Point3::new(10.4 + 0.1 * column + 1.0, 0.0, 0.0);
        let azimuth_rad = 0.1 - 0.1 * column;
        let along = nalgebra::Vector3::new(
            10.0 * libm::cos(azimuth_rad),
            10.0 * libm::sin(azimuth_rad),
            ring,
        );
        assert!((beam.origin_in_odom - origin).norm() < 1e-5, "{beam:?}");
        assert!(
            (beam.end_in_odom - (origin + along)).norm() < 1e-5,
            "{beam:?}"
        );
    }
    assert_eq!((counts.scans_registered, counts.beams_in), (1, 8));
    assert_eq!(counts.dropped_beams.get(DropReason::InvalidRange), 2);
}

#[test]
fn points_are_dropped_by_range_body_and_thinning() {
    let beams = |change: &dyn Fn(&mut RegistrationSettings)| {
        let mut settings = lidar();
        change(&mut settings);
        let (scans, counts) = registered(&revolution(), settings);
        let outcomes = scans[0]
            .beams
            .iter()
            .map(|beam| (beam.outcome, beam.range_m));
        (outcomes.collect::<Vec<_>>(), counts.dropped_beams)
    };
    // The upper ring is 10.05 m away.
    let (outcomes, _) = beams(&|settings| settings.sensors[0].beams.range_max_m = Some(10.02));
    assert_eq!(outcomes[3..], [(BeamOutcome::Miss, 10.02); 3]);
    assert_eq!(outcomes[0].0, BeamOutcome::Hit);
    let (outcomes, dropped) =
        beams(&|settings| settings.sensors[0].beams.range_min_m = Some(10.02));
    assert_eq!(
        (outcomes.len(), dropped.get(DropReason::InvalidRange)),
        (3, 5)
    );
    let (outcomes, dropped) = beams(&|settings| settings.sensors[0].beams.thin_m = 5.0);
    assert_eq!(
        (
            outcomes.len() as u64 + dropped.get(DropReason::Thinned),
            outcomes.len() < 4
        ),
        (6, true)
    );
    let long = |settings: &mut RegistrationSettings| settings.body.length_m = 30.0;
    let (outcomes, dropped) = beams(&long);
    // A box 0.4 m wide and 0.5 m high: the middle column of the lower ring.
    assert_eq!((outcomes.len(), dropped.get(DropReason::OwnBody)), (5, 1));
}

#[test]
fn a_cloud_without_rings_or_with_senseless_times() {
    let mut cloud = revolution();
    cloud.points.iter_mut().for_each(|point| point.ring = None);
    let (scans, _) = registered(&cloud, lidar());
    assert!(scans[0].beam_step_rad <= 0.0);
    let are_apart = scans[0]
        .beams
        .windows(2)
        .all(|pair| pair[1].index - pair[0].index > 2);
    assert!(are_apart, "no neighbours");
    for after_s in [f32::NAN, f32::INFINITY, -31.0, 1e9] {
        let mut cloud = revolution();
        cloud.points[3].after_s = after_s;
        let (scans, counts) = registered(&cloud, lidar());
        assert_eq!(
            (scans.len(), counts.dropped_scans.get(DropReason::BadScan)),
            (0, 1),
            "{after_s}"
        );
    }
    let (_, counts) = registered(&Cloud::default(), lidar());
    assert_eq!(counts.dropped_scans.get(DropReason::BadScan), 1);
}
