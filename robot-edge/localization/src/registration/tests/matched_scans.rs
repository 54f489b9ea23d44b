use nalgebra::{Isometry2, Vector3};

use super::*;
use crate::scan_localization::{MapFromOdom, MotionPrior, ScanLocalizationSettings};
use crate::scan_matching::slam_settings::SlamSettings;
use crate::scan_matching::test_world::{AROUND_RING, Drive, ring, way};
use crate::test_data::{about, imu_at};
use measurement::pose::planar;

fn in_space(pose: &Isometry2<f64>) -> Pose {
    planar(
        pose.translation.x,
        pose.translation.y,
        pose.rotation.angle(),
    )
}

fn measurement(stamp: RobotTime, data: MeasurementData) -> Measurement {
    Measurement {
        stamp,
        stream: StreamId(0),
        frame: "laser".into(),
        data,
    }
}

/// Once around the ring and on; what `prior` says of the motion is in the measurements.
fn drive(prior: PoseOrigin, motion: MotionPrior) -> (Vec<Isometry2<f64>>, Vec<RegistrationOutput>) {
    let (world, way) = (ring(), way(&AROUND_RING));
    let drive = Drive {
        world: &world,
        way: &way,
        has_odometry: true,
        slip: 0.1,
        drift_rad_per_m: 0.003,
        seed: 3,
    };
    let mut settings = settings(PoseOrigin::Scans {
        prior: Box::new(prior),
        scans: Box::new(ScanLocalizationSettings {
            sensor: SensorId(0),
            prior: motion,
            slam: SlamSettings::default(),
        }),
    });
    settings.sensors[0].beams.base_from_sensor = Pose::identity();
    let mut registration = ScanRegistration::new(settings);
    let mut out = Vec::new();
    for (stamp, scan, odom_from_base) in drive.scans() {
        let odom_from_base = in_space(&odom_from_base);
        let turned = imu_at(about(
            Vector3::z(),
            measurement::pose::yaw_rad(&odom_from_base),
        ));
        let odometry = MeasurementData::Odometry {
            child: "base_link".into(),
            odom_from_base,
        };
        for data in [
            odometry,
            MeasurementData::Imu(turned),
            MeasurementData::Scan {
                scan,
                own_pose: None,
            },
        ] {
            registration.push(measurement(stamp, data), &mut out);
        }
    }
    registration.finish(&mut out);
    let report = registration.scan_localization().unwrap();
    assert_eq!((report.lost, report.odometry_only), (0, 0), "{report:?}");
    (way, out)
}

#[test]
fn odometry_that_slips_is_corrected_by_scans_and_odom_does_not_jump() {
    for (prior, motion) in [
        (PoseOrigin::Odometry, MotionPrior::Full),
        (PoseOrigin::Attitude(ATTITUDE), MotionPrior::Heading),
        (PoseOrigin::Static, MotionPrior::None),
    ] {
        let (way, out) = drive(prior, motion);
        let mut map_from_odom = MapFromOdom::default();
        let mut poses = Vec::new();
        for output in &out {
            match output {
                RegistrationOutput::Scan(scan) => poses.push((scan.stamp, scan.odom_from_base)),
                RegistrationOutput::Corrected(way) => map_from_odom = (**way).clone(),
                RegistrationOutput::Jump(_) | RegistrationOutput::Confidence(_) => {
                    panic!("{motion:?}: {output:?}")
                }
            }
        }
        assert_eq!(poses.len(), way.len(), "{motion:?}");
        for (pair, true_pair) in poses.windows(2).zip(way.windows(2)) {
            let step = pair[0].1.inv_mul(&pair[1].1);
            let true_step = in_space(&true_pair[0].inv_mul(&true_pair[1]));
            let jump_m = (step.translation.vector - true_step.translation.vector).norm();
            assert!(jump_m < 0.1, "{motion:?}: {jump_m} m at {}", pair[1].0);
        }
        let start = way[0].inverse();
        for ((stamp, odom_from_base), truth) in poses.iter().zip(&way) {
            let error = in_space(&(start * truth))
                .inv_mul(&(map_from_odom.at((0, *stamp)).unwrap() * odom_from_base));
            let error_m = error.translation.vector.norm();
            assert!(error_m < 0.1, "{motion:?}: {error_m} m at {stamp}");
        }
    }
}

#[test]
fn a_laser_that_hangs_upside_down_is_mirrored() {
    let scan = Scan {
        angle_min_rad: -1.0,
        angle_increment_rad: 0.5,
        ..Scan::default()
    };
    let upside_down = Pose::from_parts(
        nalgebra::Translation3::new(1.0, 2.0, 3.0),
        about(Vector3::z(), 0.5) * about(Vector3::x(), std::f64::consts::PI),
    );
    let (seen, base_from_sensor) = crate::scan_localization::seen_from_above(&scan, &upside_down);
    assert_eq!((seen.angle_min_rad, seen.angle_increment_rad), (1.0, -0.5));
    assert!((base_from_sensor.rotation.angle() - 0.5).abs() < 1e-12);
    assert_eq!(base_from_sensor.translation.vector.as_slice(), [1.0, 2.0]);
}

#[test]
fn after_a_clock_reset_a_run_of_its_own_begins_and_the_old_places_are_not_in_its_map() {
    let mut registration = ScanRegistration::new(settings(PoseOrigin::Scans {
        prior: Box::new(PoseOrigin::Static),
        scans: Box::new(ScanLocalizationSettings {
            sensor: SensorId(0),
            prior: MotionPrior::None,
            slam: SlamSettings::default(),
        }),
    }));
    let mut out = Vec::new();
    registration.push(scan(5.0, 0.0, &[2.0; 9]), &mut out);
    registration.push(scan(5.2, 0.0, &[2.0; 9]), &mut out);
    registration.reset_clock(&mut out);
    let Some(RegistrationOutput::Corrected(begun)) = out.last() else {
        panic!("{out:?}");
    };
    assert!(begun.begins_map && begun.session() == 1, "{begun:?}");
    assert_eq!(begun.at((0, at(5.0))), None);
    assert_eq!(begun.at((1, at(1.0))), Some(Pose::identity()));
}
