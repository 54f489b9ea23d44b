use proptest::prelude::*;

use super::*;

/// 0 … 20° in 5 s and back: 5°/s where the rate is even.
fn servo() -> TiltServo {
    TiltServo {
        joint: "joint",
        min_rad: 0.0,
        max_rad: 20.0_f64.to_radians(),
        period_s: 10.0,
        encoder_rate_hz: 50.0,
        encoder_step_rad: 0.1_f64.to_radians(),
    }
}

#[test]
fn it_swings_between_its_angles_with_rounded_ends() {
    let check = |time_s: f64, expected_deg: f64| {
        let angle_deg = servo().angle_rad(time_s).to_degrees();
        assert!(
            (angle_deg - expected_deg).abs() < 1e-9,
            "{time_s} {angle_deg}"
        );
    };
    check(0.0, 0.0);
    // 5°/s² for 1 s, 5°/s for 3 s.
    check(0.5, 0.625);
    check(1.0, 2.5);
    check(2.5, 10.0);
    check(3.5, 15.0);
    check(4.0, 17.5);
    check(5.0, 20.0);
    check(5.5, 19.375);
    check(7.5, 10.0);
    check(10.0, 0.0);
    check(23.5, 15.0);
    check(-0.5, 0.625);
    assert!((servo().even_rate_radps().to_degrees() - 5.0).abs() < 1e-12);
}

#[test]
fn positive_angles_are_nose_down() {
    let ahead = servo().mount_from_sensor(5.0) * Vector3::x();
    assert!((ahead.z + libm::sin(servo().max_rad)).abs() < 1e-15);
    let left = servo().mount_from_sensor(5.0) * Vector3::y();
    assert!((left - Vector3::y()).norm() < 1e-15);
}

#[test]
fn the_encoder_says_where_it_was_in_steps() {
    let read_deg = |time_s, lag_s| servo().read_rad(time_s, lag_s).to_degrees();
    assert!((read_deg(2.513, 0.0) - 10.1).abs() < 1e-9);
    // 5°/s × 0.2 s.
    assert!((read_deg(2.5, 0.2) - 9.0).abs() < 1e-9);
    assert!((read_deg(7.5, 0.2) - 11.0).abs() < 1e-9);
    assert!((read_deg(0.0, 0.5) - 0.6).abs() < 1e-9);
}

proptest! {
    #[test]
    fn it_never_leaves_its_angles_nor_jumps(
        time_s in -100.0..1e5_f64, min_rad in -1.0..0.5_f64, span_rad in 0.01..1.0_f64
    ) {
        let servo = TiltServo { min_rad, max_rad: min_rad + span_rad, ..servo() };
        let angle_rad = servo.angle_rad(time_s);
        prop_assert!((min_rad..=min_rad + span_rad + 1e-12).contains(&angle_rad));
        let step_rad = (servo.angle_rad(time_s + 0.001) - angle_rad).abs();
        prop_assert!(step_rad <= 0.001 * servo.even_rate_radps() + 1e-9);
    }
}
