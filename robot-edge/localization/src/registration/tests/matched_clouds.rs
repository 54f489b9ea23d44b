//! Poses from clouds, on a simulated drive up a hill.

use nalgebra::Vector3;
use simulation::{SimulatedSource, SimulationOptions, World};

use super::*;
use crate::scan_localization::{MotionPrior, ScanLocalizationSettings};
use crate::scan_matching::slam_settings::SlamSettings;
use crate::test_data::about;
use crate::tilt::TiltSettings;

/// The vehicle begins before the hill and is on top of it after 10 s.
fn hill() -> SimulatedSource {
    let text = include_str!("hill.toml")
        .replace(
            "x_m = 0.0\ny_m = -9.1\nyaw_deg = 0.0",
            "x_m = 11.3\ny_m = 9.1\nyaw_deg = 180.0",
        )
        .replacen("{ x_m = 14.1, y_m = -9.1 },", "", 1)
        .replacen("{ x_m = 14.1, y_m = 9.1 },", "", 1);
    let world = World::parse("hill.toml", &text).unwrap();
    let options = SimulationOptions {
        duration_s: Some(10.3),
        ..SimulationOptions::default()
    };
    SimulatedSource::new(&world, options).unwrap()
}

#[test]
fn a_lidar_follows_a_hill_alone_and_with_planar_odometry_that_slips() {
    for (prior, motion) in [
        (PoseOrigin::Static, MotionPrior::None),
        (PoseOrigin::Odometry, MotionPrior::Full),
    ] {
        let mut settings = settings(PoseOrigin::Scans {
            prior: Box::new(prior),
            scans: Box::new(ScanLocalizationSettings {
                sensor: SensorId(0),
                is_tilted: false,
                prior: motion,
                has_gravity: false,
                has_height: false,
                receiver: None,
                slam: SlamSettings::default(),
            }),
        });
        settings.sensors[0].beams.kind = ScanKind::Cloud;
        settings.sensors[0].beams.base_from_sensor = Pose::translation(0.0, 0.0, 0.8);
        let mut registration = ScanRegistration::new(settings);
        let (mut truths, mut out) = (Vec::new(), Vec::new());
        let mut source = hill();
        while let Some(mut measurement) = source.next_measurement() {
            match &mut measurement.data {
                MeasurementData::Odometry { odom_from_base, .. } => {
                    truths.push((measurement.stamp, *odom_from_base));
                    let way_m = 1.1 * (11.3 - odom_from_base.translation.x);
                    *odom_from_base = planar(way_m, 0.0, 0.001 * truths.len() as f64 * 0.1);
                }
                MeasurementData::Cloud(_) => {}
                _ => continue,
            }
            registration.push(measurement, &mut out);
        }
        registration.finish(&mut out);
        let poses = out.iter().filter_map(|output| match output {
            RegistrationOutput::Scan(scan) => Some((scan.stamp, scan.odom_from_base)),
            _ => None,
        });
        let truth_at = |stamp| truths.iter().find(|(at, _)| *at >= stamp).unwrap().1;
        let poses: Vec<_> = poses.collect();
        assert!(poses.len() > 95, "{motion:?}: {}", poses.len());
        for (stamp, pose) in &poses {
            let truth = truth_at(poses[0].0).inv_mul(&truth_at(*stamp));
            let found = poses[0].1.inv_mul(pose);
            let error_m = found.translation.vector - truth.translation.vector;
            let turned_rad = found.rotation.angle_to(&truth.rotation);
            assert!(
                error_m.norm() < 0.1 && error_m.z.abs() < 0.03,
                "{motion:?}: {error_m} at {stamp}"
            );
            // In the revolution in which a wheel comes onto the ramp.
            assert!(turned_rad < 0.015, "{motion:?}: {turned_rad} at {stamp}");
        }
        let (_, last) = poses.last().unwrap();
        assert!(
            (last.translation.z - 0.85).abs() < 0.03,
            "{motion:?}: {last}"
        );
    }
}

/// 40 s along the hill with a laser that a servo tilts, odometry that slips by 10 % and a heading that drifts by 5° a minute.
#[test]
fn a_laser_that_tilts_holds_a_heading_that_drifts() {
    let text = include_str!("hill.toml").replacen("lidar64", "introbot", 1);
    let world = World::parse("hill.toml", &text).unwrap();
    let options = SimulationOptions {
        duration_s: Some(40.0),
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(&world, options).unwrap();
    let mut settings = settings(PoseOrigin::Scans {
        prior: Box::new(PoseOrigin::Odometry),
        scans: Box::new(ScanLocalizationSettings {
            sensor: SensorId(0),
            is_tilted: true,
            prior: MotionPrior::Full,
            has_gravity: true,
            has_height: false,
            receiver: None,
            slam: SlamSettings::default(),
        }),
    });
    settings.max_queued = 256;
    settings.sensors[0].beams.base_from_sensor = Pose::translation(0.65, 0.0, 0.65);
    settings.sensors[0].tilt = Some(TiltSettings {
        joint: "laser_tilt_joint".to_owned(),
        stream: None,
        scale: 1.0,
        offset_rad: 0.0,
        time_offset: RobotDuration::ZERO,
    });
    let mut registration = ScanRegistration::new(settings);
    let (mut truths, mut out) = (Vec::<(RobotTime, Pose)>::new(), Vec::new());
    let mut odometry = Pose::identity();
    while let Some(mut measurement) = source.next_measurement() {
        match &mut measurement.data {
            MeasurementData::Odometry { odom_from_base, .. } => {
                let truth = *odom_from_base;
                let before = truths.last().map_or(truth, |(_, before)| *before);
                let way_m = 1.1 * before.inv_mul(&truth).translation.vector;
                let drift_rad = (5.0 / 60.0 * 0.01 * truths.len() as f64).to_radians();
                let rotation = about(Vector3::z(), drift_rad) * truth.rotation;
                let place = odometry.translation.vector + rotation * way_m;
                odometry = Pose::from_parts(place.into(), rotation);
                truths.push((measurement.stamp, truth));
                *odom_from_base = odometry;
            }
            MeasurementData::Scan { .. } | MeasurementData::Joints(_) => {}
            _ => continue,
        }
        registration.push(measurement, &mut out);
    }
    registration.finish(&mut out);
    let counts = registration.counts();
    assert_eq!(counts.scans_registered, counts.scans_in, "{counts:?}");
    let scans = out.iter().filter_map(|output| match output {
        RegistrationOutput::Scan(scan) => Some(scan),
        _ => None,
    });
    let last = scans.max_by_key(|scan| scan.stamp).unwrap();
    let truth = truths.iter().find(|(at, _)| *at >= last.stamp).unwrap().1;
    let off_rad = |pose: &Pose| measurement::pose::yaw_rad(&truth.inv_mul(pose)).abs();
    let begin = truths[0].1;
    let (odometry_rad, found_rad) = (off_rad(&odometry), off_rad(&last.odom_from_base));
    assert!(odometry_rad > 0.05, "{odometry_rad}");
    assert!(found_rad < 0.3 * odometry_rad, "{found_rad} {odometry_rad}");
    let way_m = last.odom_from_base.translation.vector - truth.translation.vector;
    assert!(way_m.z.abs() < 0.1, "{way_m} {begin}");
    let report = registration.scan_localization().unwrap();
    // Stripes of 0.28 s, most of which say with those before where the vehicle is.
    assert!(report.full > 100 && report.odometry_only < 43, "{report:?}");
}
