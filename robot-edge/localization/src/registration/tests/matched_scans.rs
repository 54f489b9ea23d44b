use nalgebra::{Isometry2, Vector3};

use super::*;
use crate::scan_localization::{
    MapFromOdom, MotionPrior, ReceiverSettings, ScanLocalizationSettings,
};
use crate::scan_matching::slam_settings::SlamSettings;
use crate::scan_matching::test_world::{AROUND_RING, Drive, ring, way};
use crate::test_data::{about, imu_at};
use measurement::GeodeticFix;
use measurement::pose::planar;
use protocol::geodesy::LocalTangentPlane;

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

const DATUM: GeodeticPoint = GeodeticPoint {
    latitude_deg: 38.7,
    longitude_deg: -9.1,
    altitude_m: 50.0,
};

/// Metres ahead and to the left.
const ANTENNA_M: [f64; 3] = [-0.4, 0.2, 1.0];

/// East and north of the datum, which is where the antenna begins.
fn earth_from_world(way: &[Isometry2<f64>]) -> Isometry2<f64> {
    let turned = Isometry2::rotation(1.2);
    let first = turned * way[0] * Point2::new(ANTENNA_M[0], ANTENNA_M[1]);
    Isometry2::from_parts((-first.coords).into(), turned.rotation)
}

/// Once around the ring and on; what `prior` says of the motion is in the measurements.
fn drive(prior: PoseOrigin, motion: MotionPrior) -> (Vec<Isometry2<f64>>, Vec<RegistrationOutput>) {
    let (way, _, out) = drive_with(prior, motion, None);
    (way, out)
}

fn drive_with(
    prior: PoseOrigin,
    motion: MotionPrior,
    receiver: Option<ReceiverSettings>,
) -> (
    Vec<Isometry2<f64>>,
    ScanRegistration,
    Vec<RegistrationOutput>,
) {
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
            is_tilted: false,
            prior: motion,
            has_gravity: false,
            has_height: false,
            receiver,
            slam: SlamSettings::default(),
        }),
    });
    settings.sensors[0].beams.base_from_sensor = Pose::identity();
    let mut registration = ScanRegistration::new(settings);
    let mut out = Vec::new();
    let (plane, earth_from_world) = (LocalTangentPlane::new(DATUM), earth_from_world(&way));
    for ((stamp, scan, odom_from_base), pose) in drive.scans().into_iter().zip(&way) {
        let antenna = earth_from_world * pose * Point2::new(ANTENNA_M[0], ANTENNA_M[1]);
        let place = plane.geodetic_from_enu([antenna.x, antenna.y, 0.0]);
        let fix = GeodeticFix {
            latitude_deg: place.latitude_deg,
            longitude_deg: place.longitude_deg,
            altitude_m: place.altitude_m,
            status: 2,
            sigma_m: Some(0.05),
        };
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
            MeasurementData::Fix(fix),
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
    (way, registration, out)
}

#[test]
fn fixes_turn_a_map_of_scans_to_east_and_north_and_say_where_on_earth_it_is() {
    let receiver = ReceiverSettings {
        time_offset: RobotDuration::ZERO,
        antenna_in_base: ANTENNA_M.into(),
    };
    let (_, without, _) = drive_with(PoseOrigin::Odometry, MotionPrior::Full, None);
    assert_eq!(without.datum(), None);
    let (way, registration, out) =
        drive_with(PoseOrigin::Odometry, MotionPrior::Full, Some(receiver));
    let datum = registration.datum().unwrap();
    assert!((datum.latitude_deg - DATUM.latitude_deg).abs() < 1e-9);
    assert!((datum.longitude_deg - DATUM.longitude_deg).abs() < 1e-9);
    let earth_from_world = earth_from_world(&way);
    let map_from_odom = registration.map_from_odom();
    let scans = out.iter().filter_map(|output| match output {
        RegistrationOutput::Scan(scan) => Some(scan),
        _ => None,
    });
    for (scan, pose) in scans.zip(&way) {
        let found = map_from_odom.at((0, scan.stamp)).unwrap() * scan.odom_from_base;
        let error = in_space(&(earth_from_world * pose)).inv_mul(&found);
        let error_m = error.translation.vector.norm();
        assert!(error_m < 0.15, "{error_m} m at {}", scan.stamp);
    }
    let saved = registration.saved_map().unwrap();
    let (keyframes, parts) = saved.to_parts();
    let again = crate::scan_localization::SavedMap::from_parts(keyframes, parts, saved.datum());
    assert_eq!(again.unwrap().datum(), Some(datum));
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
            is_tilted: false,
            prior: MotionPrior::None,
            has_gravity: false,
            has_height: false,
            receiver: None,
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
