use std::f64::consts::TAU;

use super::*;
use crate::test_data::{ATTITUDE, about, at, imu_at};

const DATUM: GeodeticPoint = GeodeticPoint {
    latitude_deg: 38.51,
    longitude_deg: -9.17,
    altitude_m: 53.0,
};

fn settings() -> GnssSettings {
    GnssSettings {
        fix_time_offset: RobotDuration::ZERO,
        antenna_in_base: Vector3::zeros(),
        attitude: ATTITUDE,
        outlier_limit: JumpLimit {
            slack_m: 1.0,
            speed_mps: 9.0,
        },
        max_gap: RobotDuration::from_millis(500),
    }
}

fn fix_at(place: &Point3<f64>) -> GeodeticFix {
    let place = LocalTangentPlane::new(DATUM).geodetic_from_enu((*place).into());
    GeodeticFix {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        altitude_m: place.altitude_m,
        status: 0,
        sigma_m: None,
    }
}

/// Poses for a base that moves as `base`, with an antenna as in `settings`: fixes at 5 Hz,
/// attitudes at 100 Hz, for 10 s.
fn positioned(
    settings: GnssSettings,
    base: impl Fn(f64) -> (Point3<f64>, UnitQuaternion<f64>),
) -> Vec<StampedPose> {
    let lever = settings.antenna_in_base;
    let mut positioning = GnssPositioning::new(settings);
    let mut out = Vec::new();
    for tick in 0..=1000 {
        let secs = f64::from(tick) * 0.01;
        let (place, attitude) = base(secs);
        if tick % 20 == 0 {
            let fix = fix_at(&(place + attitude * lever));
            positioning.push_fix(at(secs), &fix, &mut out);
        }
        positioning.push_attitude(at(secs), &imu_at(attitude), &mut out);
    }
    positioning.finish(&mut out);
    assert_eq!(*positioning.drops(), DropCounts::default());
    assert!(out.is_sorted_by(|a, b| a.0 < b.0));
    out
}

#[test]
fn a_circle_on_earth_is_a_circle_of_the_same_radius() {
    let radius_m = 25.0;
    let poses = positioned(settings(), |secs| {
        let angle_rad = TAU * secs / 100.0;
        let place = Point3::new(
            radius_m * libm::sin(angle_rad),
            radius_m * (1.0 - libm::cos(angle_rad)),
            0.0,
        );
        (place, about(Vector3::z(), angle_rad))
    });
    assert_eq!(poses.len(), 1001);
    let centre = Point3::new(0.0, radius_m, 0.0);
    for (stamp, pose) in &poses {
        let from_centre = Point3::from(pose.translation.vector) - centre;
        assert!((from_centre.norm() - radius_m).abs() < 1e-3, "{stamp:?}");
        assert!(from_centre.z.abs() < 1e-6);
        // Ahead is along the circle: yaw 0 is east, positive to the left.
        let ahead = pose.rotation * Vector3::x();
        assert!(ahead.dot(&from_centre).abs() < 1e-2 * radius_m);
    }
    let (_, last) = poses.last().unwrap();
    assert!((last.translation.x - radius_m * libm::sin(TAU / 10.0)).abs() < 1e-6);
}

#[test]
fn the_first_fix_is_the_origin_and_a_metre_is_a_metre() {
    let poses = positioned(settings(), |secs| {
        let place = Point3::new(0.1 * secs, 0.2 * secs, -0.01 * secs);
        (place, UnitQuaternion::identity())
    });
    let at_end = poses.last().unwrap().1.translation.vector;
    assert!(poses[0].1.translation.vector.norm() < 1e-6);
    assert!(
        (at_end - Vector3::new(1.0, 2.0, -0.1)).norm() < 1e-6,
        "{at_end}"
    );
}

#[test]
fn the_lever_arm_is_taken_off_where_the_vehicle_is_turned_to() {
    // It rolls and turns in place; only the antenna on its mast moves.
    let lever = Vector3::new(-0.5, 0.2, 1.5);
    let mast = GnssSettings {
        antenna_in_base: lever,
        ..settings()
    };
    let swaying = |secs: f64| {
        let roll_rad = 0.1 * libm::sin(TAU * 0.25 * secs);
        let attitude = about(Vector3::z(), 0.1 * secs) * about(Vector3::x(), roll_rad);
        (Point3::origin(), attitude)
    };
    let poses = positioned(mast, swaying);
    // The first antenna position is the origin.
    for (stamp, pose) in &poses {
        let base = pose.translation.vector + lever;
        // Between fixes the antenna's path is a chord.
        assert!(base.norm() < 3e-3, "{stamp:?}: {base}");
    }
    for (_, pose) in poses.iter().step_by(20) {
        assert!((pose.translation.vector + lever).norm() < 1e-6);
    }
    let without = positioned(settings(), |secs| {
        let (place, attitude) = swaying(secs);
        (place + attitude * lever, attitude)
    });
    let strays_m = without
        .iter()
        .map(|(_, pose)| pose.translation.vector.norm());
    assert!(strays_m.fold(0.0, f64::max) > 0.3);
}

#[test]
fn fixes_that_are_none_are_counted_by_reason() {
    let mut positioning = GnssPositioning::new(settings());
    let mut out = Vec::new();
    let good = fix_at(&Point3::origin());
    let push = |positioning: &mut GnssPositioning, secs: f64, fix: GeodeticFix| {
        positioning.push_fix(at(secs), &fix, &mut Vec::new());
    };
    let mut bad = [good; 5];
    bad[0].status = -1;
    bad[1].latitude_deg = f64::NAN;
    bad[2].latitude_deg = 90.1;
    bad[3].longitude_deg = f64::INFINITY;
    bad[4].altitude_m = f64::NAN;
    for (tenths, fix) in (0..).zip(bad) {
        push(&mut positioning, 0.1 * f64::from(tenths), fix);
        assert_eq!(positioning.datum(), None);
    }
    push(&mut positioning, 1.0, good);
    let datum = positioning.datum().unwrap();
    assert!((datum.latitude_deg - DATUM.latitude_deg).abs() < 1e-9);
    push(&mut positioning, 1.2, fix_at(&Point3::new(40.0, 0.0, 0.0)));
    push(&mut positioning, 1.2, good);
    push(&mut positioning, 1.4, fix_at(&Point3::new(0.1, 0.0, 0.0)));
    positioning.push_attitude(at(1.0), &imu_at(UnitQuaternion::identity()), &mut out);
    positioning.push_attitude(at(1.4), &imu_at(UnitQuaternion::identity()), &mut out);
    positioning.finish(&mut out);
    let xs: Vec<f64> = out.iter().map(|(_, pose)| pose.translation.x).collect();
    assert_eq!(xs.len(), 2);
    assert!(xs[0].abs() < 1e-6 && (xs[1] - 0.1).abs() < 1e-6, "{xs:?}");
    assert_eq!(
        positioning.drops().iter().collect::<Vec<_>>(),
        [
            (DropReason::Late, 1),
            (DropReason::NoFix, 1),
            (DropReason::BadFix, 4),
            (DropReason::GnssOutlier, 1),
        ]
    );
}

#[test]
fn persistent_outliers_are_accepted() {
    let mut filter = FixFilter::new(settings().outlier_limit);
    let place = |tenths: i32, x_m: f64| (at(0.1 * f64::from(tenths)), Point3::new(x_m, 0.0, 0.0));
    assert_eq!(filter.check(&place(0, 0.0)), Ok(()));
    let judged: Vec<_> = (1..=13).map(|n| filter.check(&place(n, 100.0))).collect();
    let leaps = judged.iter().filter(|judged| judged.is_err()).count();
    assert_eq!(leaps, 10, "for a second");
    assert!(judged[10..].iter().all(Result::is_ok));
    // Inconsistent outliers are never accepted.
    let echoes = (14..40).map(|n| filter.check(&place(n, 100.0 + 30.0 * f64::from(n % 3 + 1))));
    assert!(
        echoes
            .into_iter()
            .all(|judged| judged == Err(DropReason::GnssOutlier))
    );
    assert_eq!(filter.check(&place(40, 101.0)), Ok(()));
}

#[test]
fn poses_wait_for_the_fix_behind_them() {
    let mut settings = settings();
    settings.fix_time_offset = RobotDuration::from_millis(-100);
    settings.attitude.smoothing = RobotDuration::from_millis(100);
    assert_eq!(settings.lag(), RobotDuration::from_millis(600));
}

#[test]
fn clock_reset_keeps_the_datum() {
    let mut positioning = GnssPositioning::new(settings());
    let mut out = Vec::new();
    let level = imu_at(UnitQuaternion::identity());
    positioning.push_fix(at(9.0), &fix_at(&Point3::origin()), &mut out);
    positioning.reset();
    positioning.push_fix(at(1.0), &fix_at(&Point3::new(50.0, 0.0, 0.0)), &mut out);
    positioning.push_attitude(at(1.0), &level, &mut out);
    assert_eq!(out.len(), 1);
    assert!((out[0].1.translation.x - 50.0).abs() < 1e-6);
}
