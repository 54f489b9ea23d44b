use super::*;
use measurement::time::RobotDuration;
use nalgebra::{Translation3, UnitQuaternion};
use proptest::prelude::*;

fn rotation(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad)
}

fn pitched(x_m: f64, pitch_deg: f64) -> Pose {
    Pose::from_parts(
        Translation3::new(x_m, 0.0, 0.0),
        rotation(0.0, pitch_deg.to_radians(), 0.0),
    )
}

/// Drives with the given pitch per scan, 8 mm and 40 ms apart; returns the scans with a reset.
fn changes(pitches_deg: &[f64], speed_mps: f64) -> Vec<usize> {
    changes_by(GroundReset::Wheelbase, pitches_deg, speed_mps)
}

fn changes_by(reset: GroundReset, pitches_deg: &[f64], speed_mps: f64) -> Vec<usize> {
    let config = GroundConfig {
        reset,
        ..GroundConfig::default()
    };
    let mut tracker = GroundTracker::new(&config, 0.55);
    let mut changed = Vec::new();
    let mut stamp = RobotTime::from_nanos(0);
    for (scan, &pitch_deg) in pitches_deg.iter().enumerate() {
        stamp = stamp + RobotDuration::from_millis(40);
        let x_m = 0.04 * speed_mps * scan as f64;
        if tracker.update(stamp, &pitched(x_m, pitch_deg)).1.is_some() {
            changed.push(scan);
        }
    }
    changed
}

/// `level` scans at 0°, then `steps` to `pitch_deg`, then `rest` scans there.
fn climb(level: usize, steps: usize, pitch_deg: f64, rest: usize) -> Vec<f64> {
    let rise = (1..=steps).map(|step| pitch_deg * step as f64 / steps as f64);
    std::iter::repeat_n(0.0, level)
        .chain(rise)
        .chain(std::iter::repeat_n(pitch_deg, rest))
        .collect()
}

#[test]
fn a_ramp_changes_the_ground_once_after_a_wheelbase() {
    // 8 mm per scan: a wheelbase of 0.55 m is 69 scans.
    assert_eq!(changes(&climb(50, 10, 4.0, 200), 0.2), [50 + 9 + 69]);
}

#[test]
fn by_scans_the_first_steady_one_changes_it_also_beyond_a_bump() {
    let by_scan = |pitches_deg: &[f64]| changes_by(GroundReset::Scan, pitches_deg, 0.2);
    // 0.4° per scan up to scan 59; scan 60 is the first with the pitch of the one before.
    assert_eq!(by_scan(&climb(50, 10, 4.0, 200)), [60]);
    // One more scan on top of a bump, and two changes.
    let mut bump = climb(50, 10, 4.0, 1);
    bump.extend(climb(0, 10, -4.0, 5).iter().map(|pitch| pitch + 4.0));
    assert_eq!(by_scan(&bump), [60, 71]);
}

#[test]
fn a_slow_way_onto_a_ramp_changes_it_once_and_not_on_the_way() {
    // 0.058° per scan, as front wheels that roll onto a ramp of 4° at 0.2 m/s: always below η.
    let changed = changes(&climb(200, 69, 4.0, 200), 0.2);
    assert_eq!(changed.len(), 1, "{changed:?}");
    assert!((269 + 60..=269 + 69).contains(&changed[0]), "{changed:?}");
}

#[test]
fn neither_a_bump_nor_standing_on_one_changes_it() {
    let mut bump = climb(50, 10, -4.5, 60);
    bump.extend(climb(0, 10, 4.5, 0).iter().map(|pitch| pitch - 4.5));
    bump.extend([0.0; 200]);
    assert_eq!(changes(&bump, 0.2), [0usize; 0]);
    // The literal rule fires here one scan after the climb.
    assert_eq!(changes(&climb(50, 10, -4.5, 1000), 0.0), [0usize; 0]);
    // Slow drift that never exceeds ε.
    assert_eq!(changes(&climb(0, 1000, 0.49, 500), 0.2), [0usize; 0]);
}

#[test]
fn plane_averages_attitudes_after_a_reset() {
    let mut tracker = GroundTracker::new(&GroundConfig::default(), 0.55);
    let mut far_m = Vec::new();
    for scan in 0..60 {
        // Off by 0.2° at first, then alternately by as much to either side of the truth.
        let pitch_deg = if scan % 2 == 0 { 0.2 } else { -0.2 };
        let stamp = RobotTime::from_nanos(40_000_000 * scan);
        let (plane, _) = tracker.update(stamp, &pitched(0.0, pitch_deg));
        far_m.push(plane.height_m(&Point3::new(40.0, 0.0, 0.0)));
    }
    assert!((far_m[0] - 0.14).abs() < 1e-3, "{}", far_m[0]);
    assert!(far_m[59].abs() < 1e-6, "{}", far_m[59]);
}

#[test]
fn heights_and_the_event_refer_to_the_new_plane() {
    let mut tracker = GroundTracker::new(&GroundConfig::default(), 0.55);
    let ahead_on_ramp = |x_m: f64| Point3::new(x_m, 0.0, -x_m * libm::tan(4f64.to_radians()));
    let mut seen = Vec::new();
    for scan in 0..200 {
        let stamp = RobotTime::from_nanos(40_000_000 * scan);
        let x_m = 0.01 * scan as f64;
        let on_ramp = scan >= 100;
        let mut pose = pitched(x_m, if on_ramp { 4.0 } else { 0.0 });
        pose.translation.z = if on_ramp { ahead_on_ramp(x_m).z } else { 0.0 };
        let (plane, change) = tracker.update(stamp, &pose);
        seen.push(plane.height_m(&ahead_on_ramp(8.0)));
        if let Some(change) = change {
            assert!(
                change.to_string().contains("pitch went from 0.0° to 4.0°"),
                "{change}"
            );
            assert!((0.55..0.57).contains(&change.steady_m), "{change:?}");
        }
    }
    assert!((seen[0] + 0.559).abs() < 1e-3, "{}", seen[0]);
    assert!(seen[199].abs() < 1e-9, "{}", seen[199]);
}

/// A degree of pitch: \[LOD\] turns its reference about the ground below the lens, not about the lens.
#[test]
fn one_increment_is_short_already() {
    let (h, tilt) = (1.08, 7.5f64.to_radians());
    let reference = |tilt: f64| h / libm::sin(tilt);
    let nose_up = 1f64.to_radians();
    let along = h / libm::tan(tilt);
    let (ahead, up) = (along * libm::cos(nose_up), along * libm::sin(nose_up));
    let short = libm::hypot(ahead * h / (h - up), h);
    let exact = reference(tilt - nose_up);
    assert!((exact - 9.54).abs() < 0.01, "{exact}");
    assert!(
        (0.015..0.03).contains(&(exact - short)),
        "{}",
        exact - short
    );
}

proptest! {
    /// [LOD §4.2, §4.6] for any height, tilt and beam, the exact range to the ground and anything on it.
    #[test]
    fn heights_match_equations_1_and_2(
        h in 0.3..3.0f64, tilt_deg in 2.0..30.0f64, sigma_deg in 30.0..150.0f64, share in 0.2..1.3f64,
    ) {
        let (tilt, sigma) = (tilt_deg.to_radians(), sigma_deg.to_radians());
        // Equations (1) and (2) of docs/methods.md.
        let d = h / libm::cos(std::f64::consts::FRAC_PI_2 - tilt);
        let r_ref = d / libm::sin(sigma);
        let rho = libm::acos(h / r_ref);
        let r_real = share * r_ref;
        let height = libm::cos(rho) * (r_ref - r_real);

        // σ counts from the right, 90° is ahead: the beam's angle in REP-103 is σ − 90°.
        let base_from_laser =
            Pose::from_parts(Translation3::new(0.0, 0.0, h), rotation(0.0, tilt, 0.0));
        let angle = sigma - std::f64::consts::FRAC_PI_2;
        let hit = base_from_laser * Point3::new(r_real * libm::cos(angle), r_real * libm::sin(angle), 0.0);
        let plane = GroundPlane::under(&Pose::identity());
        prop_assert!((plane.height_m(&hit) - height).abs() < 1e-9);
        // [LOD] uses σ for the azimuth; this is exact in a tilted plane.
        let azimuth = libm::atan2(hit.y, hit.x);
        let exact = libm::atan2(-libm::cos(sigma), libm::sin(sigma) * libm::cos(tilt));
        prop_assert!((azimuth - exact).abs() < 1e-9);
    }

    /// [LOD] turns each point of its reference plane by the change since the last scan and projects it
    /// back onto the ground. After a wobble it does not return to the start; the absolute attitude does.
    #[test]
    fn increments_drift_and_absolute_attitude_does_not(
        amplitude_deg in 2.0..4.0f64, sigma_deg in 60.0..120.0f64,
    ) {
        let (h, tilt, sigma) = (1.08, 7.5f64.to_radians(), sigma_deg.to_radians());
        let first = (h / libm::cos(std::f64::consts::FRAC_PI_2 - tilt)) / libm::sin(sigma);
        let along = (first * first - h * h).sqrt();
        // x to the right and y ahead, as in [LOD]; a point of the reference plane on the ground.
        let mut point = nalgebra::Vector3::new(along * libm::cos(sigma), along * libm::sin(sigma), 0.0);
        let attitude = |scan: u32| {
            let phase = f64::from(scan) / 50.0 * std::f64::consts::TAU;
            let wobble = amplitude_deg.to_radians();
            (wobble * libm::sin(phase), wobble * (1.0 - libm::cos(phase)))
        };
        for scan in 1..=500 {
            let ((pitch_0, roll_0), (pitch_1, roll_1)) = (attitude(scan - 1), attitude(scan));
            let turn = UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), -(pitch_1 - pitch_0))
                * UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), roll_1 - roll_0);
            let turned = turn * point;
            // The line from the lens at (0, 0, h) through the turned point meets the ground here.
            point = turned * (h / (h - turned.z));
            point.z = 0.0;
        }
        let drift_m = ((point.norm_squared() + h * h).sqrt() - first).abs();
        // Absolute attitude: the pose after the wobble is the pose before it.
        let (pitch, roll) = attitude(500);
        let pose = Pose::from_parts(Translation3::identity(), rotation(roll, pitch, 0.0));
        let laser = Pose::from_parts(Translation3::new(0.0, 0.0, h), rotation(0.0, tilt, 0.0));
        let angle = sigma - std::f64::consts::FRAC_PI_2;
        let ground = pose * laser * Point3::new(first * libm::cos(angle), first * libm::sin(angle), 0.0);
        let ours_m = GroundPlane::under(&Pose::identity()).height_m(&ground);
        prop_assert!(ours_m.abs() < 1e-9, "{ours_m}");
        prop_assert!(drift_m > 5e-3, "{drift_m}");
    }
}
