//! Poses from clouds, on a simulated drive up a hill.

use simulation::{SimulatedSource, SimulationOptions, World};

use super::*;
use crate::scan_localization::{MotionPrior, ScanLocalizationSettings};
use crate::scan_matching::slam_settings::SlamSettings;

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
