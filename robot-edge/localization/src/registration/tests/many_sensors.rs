//! Several range sensors on one vehicle, and tilting ones.

use super::*;

use crate::tilt::TiltSettings;

/// A laser on stream 1 and a sonar on stream 2, their stamps late by these times.
fn two_sensors(origin: PoseOrigin, offsets_ms: [i64; 2]) -> RegistrationSettings {
    let mut settings = settings(origin);
    let laser = settings.sensors.remove(0);
    for (id, offset_ms) in (0..).zip(offsets_ms) {
        let mut sensor = laser.clone();
        sensor.stream = Some(StreamId(u16::from(id) + 1));
        sensor.beams.id = SensorId(id);
        sensor.beams.time_offset = RobotDuration::from_millis(offset_ms);
        sensor.beams.base_from_sensor = planar(f64::from(id), 0.0, 0.0);
        settings.sensors.push(sensor);
    }
    settings
}

fn scan_of(sensor: u8, secs: f64, dt: f32, ranges_m: &[f32]) -> Measurement {
    Measurement {
        stream: StreamId(u16::from(sensor) + 1),
        ..scan(secs, dt, ranges_m)
    }
}

/// Sensor, stamp in milliseconds, and x of its first beam's end.
fn seen(registered: &[RegistrationOutput]) -> Vec<(u8, i64, f64)> {
    let seen = registered.iter().map(|registered| {
        let scan = registered_scan(registered);
        let millis = scan.stamp.as_nanos() / 1_000_000;
        (scan.sensor.0, millis, ends(registered)[0])
    });
    seen.collect()
}

#[test]
fn two_sensors_interleave_in_the_order_of_their_beams() {
    let input = vec![
        odometry(1.0, 0.0),
        scan_of(1, 1.0, 0.1, &[2.0, 2.0]),
        scan_of(0, 1.02, 0.0, &[2.0]),
        scan_of(0, 1.06, 0.0, &[2.0]),
        odometry(1.2, 2.0),
        scan_of(1, 1.2, 0.0, &[2.0]),
        scan_of(0, 1.2, 0.0, &[2.0]),
        odometry(1.3, 3.0),
    ];
    let (out, counts) = registered(two_sensors(PoseOrigin::Odometry, [0, 0]), input);
    assert_eq!(
        seen(&out),
        [
            (1, 1000, 3.0),
            (0, 1020, 2.2),
            (0, 1060, 2.6),
            (0, 1200, 4.0),
            (1, 1200, 5.0),
        ]
    );
    let of_each: Vec<_> = counts
        .sensors
        .iter()
        .map(|s| (s.sensor.0, s.scans_in, s.scans_registered, s.beams_in))
        .collect();
    assert_eq!(of_each, [(0, 3, 3, 3), (1, 2, 2, 3)]);
    assert_eq!(
        (counts.scans_in, counts.scans_registered, counts.beams_in),
        (5, 5, 6)
    );
}

#[test]
fn scans_that_offsets_put_in_another_order_come_out_in_it() {
    // The sonar's stamp 1.10 s means 1.04 s, before the laser's 1.05 s.
    let input = vec![
        odometry(1.0, 0.0),
        scan_of(0, 1.05, 0.0, &[2.0]),
        odometry(1.09, 0.9),
        scan_of(1, 1.10, 0.0, &[2.0]),
        odometry(1.15, 1.5),
    ];
    let settings = two_sensors(PoseOrigin::Odometry, [0, -60]);
    let (out, counts) = registered(settings.clone(), input.clone());
    assert_eq!(seen(&out), [(1, 1040, 3.4), (0, 1050, 2.5)]);
    assert_eq!(counts.dropped_scans.total(), 0);
    // A silent sonar delays the laser by the difference of their offsets only.
    let mut registration = ScanRegistration::new(settings);
    let mut out = Vec::new();
    registration.push(input[0].clone(), &mut out);
    registration.push(input[1].clone(), &mut out);
    registration.push(odometry(1.109, 1.09), &mut out);
    assert_eq!(out.len(), 0);
    registration.push(odometry(1.11, 1.1), &mut out);
    assert_eq!(seen(&out), [(0, 1050, 2.5)]);
}

#[test]
fn a_still_vehicle_has_its_scans_in_order_too() {
    let input = vec![
        scan_of(0, 1.05, 0.0, &[2.0]),
        scan_of(1, 1.10, 0.0, &[2.0]),
        scan_of(0, 1.15, 0.0, &[2.0]),
    ];
    let (out, _) = registered(two_sensors(PoseOrigin::Static, [0, -60]), input);
    assert_eq!(seen(&out), [(1, 1040, 3.0), (0, 1050, 2.0), (0, 1150, 2.0)]);
}

#[test]
fn too_large_offsets_drop_scans_of_that_sensor() {
    // An hour late: the delay is limited to a second.
    let mut input = vec![odometry(1.0, 0.0)];
    for n in 0..30 {
        let secs = 1.0 + 0.1 * f64::from(n);
        input.push(scan_of(0, secs + 0.01, 0.0, &[2.0]));
        input.push(scan_of(1, secs + 0.02, 0.0, &[2.0]));
        input.push(odometry(secs + 0.1, 0.0));
    }
    let mut settings = two_sensors(PoseOrigin::Odometry, [0, -3_600_000]);
    settings.max_queued = 20;
    let (_, counts) = registered(settings, input);
    let [laser, sonar] = &counts.sensors[..] else {
        panic!("{counts:?}")
    };
    assert_eq!(
        (laser.scans_registered, laser.dropped_scans.total()),
        (30, 0)
    );
    assert_eq!(
        (sonar.scans_registered, sonar.dropped_scans.total()),
        (0, 30)
    );
}

#[test]
fn a_fast_sensor_does_not_push_out_the_scans_of_a_slow_one() {
    let mut input = vec![scan_of(1, 1.0, 0.0, &[2.0])];
    input.extend((0..10).map(|n| scan_of(0, 1.001 + f64::from(n) * 1e-3, 0.0, &[2.0])));
    input.extend([odometry(0.9, 0.0), odometry(1.02, 0.0)]);
    let (out, counts) = registered(two_sensors(PoseOrigin::Odometry, [0, 0]), input);
    assert_eq!(out.len(), 5);
    let dropped = |sensor: usize| reasons(&counts.sensors[sensor].dropped_scans);
    assert_eq!(dropped(0), [(DropReason::QueueFull, 6)]);
    assert_eq!(dropped(1), []);
}

#[test]
fn scans_of_streams_that_no_sensor_has_are_passed_over() {
    let input = vec![scan_of(7, 1.0, 0.0, &[2.0]), scan_of(1, 1.0, 0.0, &[2.0])];
    let (out, counts) = registered(two_sensors(PoseOrigin::Static, [0, 0]), input);
    assert_eq!((out.len(), counts.scans_in), (1, 1));
}

/// A laser 1 m above the vehicle's frame, facing forward, tilted by a joint.
fn tilting(encoder_offset_ms: i64) -> RegistrationSettings {
    let mut settings = settings(PoseOrigin::Odometry);
    let sensor = &mut settings.sensors[0];
    sensor.beams.base_from_sensor = Pose::translation(0.0, 0.0, 1.0);
    sensor.tilt = Some(TiltSettings {
        joint: "laser_tilt_joint".to_owned(),
        stream: Some(StreamId(9)),
        scale: 1.0,
        offset_rad: 0.0,
        time_offset: RobotDuration::from_millis(encoder_offset_ms),
    });
    settings
}

fn joint(secs: f64, angle_rad: f64) -> Measurement {
    let joints = vec![("laser_tilt_joint".to_owned(), angle_rad)];
    Measurement {
        stream: StreamId(9),
        ..measurement(secs, "", MeasurementData::Joints(joints))
    }
}

#[test]
fn tilted_beam_ends_match_geometry() {
    let step_s = 0.1;
    let input = vec![
        odometry(0.9, 10.0),
        joint(1.0, 0.0),
        scan(1.0, step_s, &[2.0, 2.0, 2.0]),
        // The same joint on another stream is ignored.
        Measurement {
            stream: StreamId(8),
            ..joint(1.1, -1.0)
        },
        joint(1.2, 0.6),
        odometry(1.3, 10.0),
        joint(1.3, 0.6),
    ];
    let (out, counts) = registered(tilting(0), input);
    let beams = &registered_scan(&out[0]).beams;
    for (beam, angle_rad) in beams.iter().zip([0.0, 0.3, 0.6]) {
        // Nose down: the beam's end is lower and nearer.
        let expected = Point3::new(
            10.0 + 2.0 * libm::cos(angle_rad),
            0.0,
            1.0 - 2.0 * libm::sin(angle_rad),
        );
        let error_m = (beam.end_in_odom - expected).norm();
        assert!(error_m < 1e-8, "{angle_rad} rad: {}", beam.end_in_odom);
    }
    assert_eq!((beams.len(), counts.dropped_scans.total()), (3, 0));
}

#[test]
fn a_tilt_is_waited_for_and_its_gaps_are_not_bridged() {
    let mut registration = ScanRegistration::new(tilting(0));
    let mut out = push_all(
        &mut registration,
        vec![
            odometry(0.9, 0.0),
            joint(1.0, 0.0),
            scan(1.05, 0.0, &[2.0]),
            odometry(1.1, 0.0),
        ],
    );
    assert_eq!(out.len(), 0, "the pose is there, the angle is not");
    registration.push(joint(1.1, 0.1), &mut out);
    assert_eq!(out.len(), 1);
    out.extend(push_all(
        &mut registration,
        vec![
            scan(1.5, 0.0, &[2.0]),
            odometry(1.55, 0.0),
            joint(1.7, 0.1),
            joint(1.8, f64::NAN),
        ],
    ));
    registration.finish(&mut out);
    let counts = registration.counts();
    assert_eq!(reasons(&counts.dropped_scans), [(DropReason::PoseGap, 1)]);
    assert_eq!(reasons(&counts.dropped_poses), [(DropReason::BadPose, 1)]);
}

/// A servo at 1 rad/s with a late encoder, over ground 1 m below the laser.
fn nodding(encoder_late_s: f64) -> Vec<Measurement> {
    let angle_rad = |secs: f64| 0.2 + (secs - 1.0);
    let mut input = Vec::new();
    for tick in 0..=50 {
        let secs = 1.0 + 0.01 * f64::from(tick);
        input.push(odometry(secs, 0.0));
        input.push(joint(secs + encoder_late_s, angle_rad(secs)));
        if tick % 4 == 2 && tick < 44 {
            let ground = (0..4)
                .map(|beam| (1.0 / libm::sin(angle_rad(secs + 1e-3 * f64::from(beam)))) as f32);
            input.push(scan(secs, 1e-3, &ground.collect::<Vec<_>>()));
        }
    }
    input.sort_by_key(|measurement| measurement.stamp);
    input
}

#[test]
fn an_encoders_lag_and_its_offset_cancel() {
    let heights = |settings: RegistrationSettings, input| {
        let (out, counts) = registered(settings, input);
        let beams: Vec<f64> = out
            .iter()
            .flat_map(|registered| registered_scan(registered).beams.clone())
            .map(|beam| beam.end_in_odom.z)
            .collect();
        (beams, counts.scans_registered)
    };
    let (true_m, all) = heights(tilting(0), nodding(0.0));
    assert_eq!((true_m.len(), all), (44, 11));
    assert!(true_m.iter().all(|z_m| z_m.abs() < 1e-6), "{true_m:?}");
    let (corrected_m, all) = heights(tilting(-30), nodding(0.03));
    assert_eq!(all, 11);
    assert!(corrected_m.iter().all(|z_m| z_m.abs() < 1e-6));
    // Without the offset the laser seems to point 0.03 rad too high.
    let (lagging_m, _) = heights(tilting(0), nodding(0.03));
    assert!(
        lagging_m.iter().all(|z_m| (0.03..0.2).contains(z_m)),
        "{lagging_m:?}"
    );
}

fn ranges_m_of(registered: &RegistrationOutput) -> Vec<f32> {
    let beams = &registered_scan(registered).beams;
    beams.iter().map(|beam| beam.range_m).collect()
}

#[test]
fn canopy_above_vehicle_is_kept_and_own_deck_dropped() {
    let mut settings = tilting(0);
    settings.body = BodyBox {
        length_m: 1.5,
        width_m: 0.8,
        offset_m: 0.0,
        lowest_m: 0.0,
        highest_m: 0.7,
    };
    settings.sensors[0].beams.base_from_sensor = Pose::translation(0.0, 0.0, 0.65);
    let hits_at = |tilt_rad: f64, ranges_m: &[f32]| {
        let input = vec![
            odometry(0.9, 0.0),
            joint(0.9, tilt_rad),
            scan(1.0, 0.0, ranges_m),
            odometry(1.1, 0.0),
            joint(1.1, tilt_rad),
        ];
        let (out, counts) = registered(settings.clone(), input);
        (
            ranges_m_of(&out[0]),
            counts.dropped_beams.get(DropReason::OwnBody),
        )
    };
    let straight_up = -std::f64::consts::FRAC_PI_2;
    // 5 cm of body above the lens and 5 cm of margin; the canopy is at 1.25 m.
    assert_eq!(hits_at(straight_up, &[0.11, 0.6]), (vec![0.11, 0.6], 0));
    // Straight down: the body, 5 cm of margin below it; then the ground below a bridge.
    assert_eq!(hits_at(-straight_up, &[0.3, 0.69, 0.71]), (vec![0.71], 2));
    // Level: the footprint decides.
    assert_eq!(hits_at(0.0, &[0.5, 0.74, 0.76]), (vec![0.76], 2));
}

/// The base frame is at the rear axle: the front is 1.3 m ahead of it, the rear 0.2 m behind.
#[test]
fn hits_on_a_front_that_overhangs_are_the_vehicles_own() {
    for (yaw_rad, ranges_m, kept) in [
        (0.0, [0.5, 1.29, 1.31], 1.31),
        (std::f64::consts::PI, [0.15, 0.19, 0.21], 0.21),
    ] {
        let mut settings = settings(PoseOrigin::Odometry);
        settings.body = BodyBox {
            length_m: 1.5,
            width_m: 0.8,
            offset_m: 0.55,
            lowest_m: 0.0,
            highest_m: 0.7,
        };
        settings.sensors[0].beams.base_from_sensor = planar(0.0, 0.0, yaw_rad);
        let input = vec![
            odometry(0.9, 0.0),
            scan(1.0, 0.0, &ranges_m),
            odometry(1.1, 0.0),
        ];
        let (out, counts) = registered(settings, input);
        assert_eq!(ranges_m_of(&out[0]), [kept]);
        assert_eq!(counts.dropped_beams.get(DropReason::OwnBody), 2);
    }
}

#[test]
fn fixes_and_attitude_place_beams_and_the_datum_is_kept() {
    use crate::gnss_positioning::GnssSettings;
    use measurement::GeodeticFix;

    let mut gps = settings(PoseOrigin::Odometry);
    gps.origin = PoseOrigin::Gps(GnssSettings {
        fix_time_offset: RobotDuration::ZERO,
        antenna_in_base: nalgebra::Vector3::zeros(),
        attitude: SMOOTHED,
        outlier_limit: gps.limits.jump,
        max_gap: RobotDuration::from_millis(500),
    });
    let mut input = Vec::new();
    for tick in 0..=100 {
        let secs = 1.0 + 0.01 * f64::from(tick);
        let sample = imu_at(UnitQuaternion::identity());
        input.push(measurement(secs, "imu", MeasurementData::Imu(sample)));
        if tick % 20 == 0 {
            // A degree of longitude is 111,319.49 m on the equator: 1 m/s to the east.
            let fix = GeodeticFix {
                latitude_deg: 0.0,
                longitude_deg: 7.0 + (secs - 1.0) / 111_319.490_793,
                altitude_m: 0.0,
                status: 2,
                sigma_m: None,
            };
            input.push(measurement(secs, "gps", MeasurementData::Fix(fix)));
        }
        if tick % 20 == 11 {
            input.push(scan(secs, 0.0, &[2.0]));
        }
    }
    let mut registration = ScanRegistration::new(gps);
    let mut out = push_all(&mut registration, input);
    registration.finish(&mut out);
    let xs: Vec<f64> = out.iter().map(|registered| ends(registered)[0]).collect();
    // The laser is 1 m ahead; scans at 0.11 s, 0.31 s, …
    for (scan, x) in xs.iter().enumerate() {
        let expected = 3.11 + 0.2 * scan as f64;
        assert!((x - expected).abs() < 1e-5, "{x} {expected}");
    }
    assert_eq!(xs.len(), 5);
    assert!((registration.datum().unwrap().longitude_deg - 7.0).abs() < 1e-12);
    registration.reset_clock(&mut out);
    assert!(registration.datum().is_some(), "Earth stays");
}
