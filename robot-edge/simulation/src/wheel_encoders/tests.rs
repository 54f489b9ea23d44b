use std::f64::consts::{FRAC_PI_2, TAU};

use super::*;
use crate::fixtures::{holos, motion, path, slope};
use crate::solid::Solid;

const PULSE_M: f64 = TAU * 0.125 / 2000.0;

fn drive(waypoints: &[[f64; 3]], solids: &[Solid]) -> Motion {
    motion("holos", path(waypoints), solids)
}

/// Way of both sides over the whole motion, as a program reads it from the encoders, metres.
fn read_m(motion: &Motion, errors: WheelErrors, seed: u64) -> [f64; 2] {
    let encoders = holos().encoders.unwrap();
    let mut turns = WheelTurns::new(holos(), encoders, errors, motion, seed);
    let mut read_rad = [0.0; 2];
    let readings = libm::ceil(motion.path().duration_s() * encoders.rate_hz) as u32;
    for reading in 0..=readings {
        read_rad = turns.read(motion, f64::from(reading) / encoders.rate_hz);
    }
    read_rad.map(|rad| rad * 0.125)
}

fn scaled(scale_error: f64) -> WheelErrors {
    WheelErrors {
        scale_error,
        slip: 0.0,
    }
}

#[track_caller]
fn check_to_a_pulse(read_m: [f64; 2], expected_m: [f64; 2]) {
    for (read, expected) in read_m.iter().zip(expected_m) {
        assert!(
            (read - expected).abs() < PULSE_M,
            "{read_m:?}, {expected_m:?}"
        );
    }
}

#[test]
fn the_documents_encoder_errors_give_the_documents_distances() {
    let short = drive(&[[4.2, 0.0, 0.0]], &[]);
    check_to_a_pulse(read_m(&short, scaled(0.0), 0), [4.2; 2]);
    check_to_a_pulse(read_m(&short, scaled(0.048), 0), [4.4016; 2]);
    let long = drive(&[[20.0, 0.0, 0.0]], &[]);
    check_to_a_pulse(read_m(&long, scaled(0.0705), 0), [21.41; 2]);
}

#[test]
fn readings_are_whole_pulses() {
    let motion = drive(&[[1.0, 0.0, 0.0]], &[]);
    let encoders = holos().encoders.unwrap();
    let mut turns = WheelTurns::new(holos(), encoders, WheelErrors::default(), &motion, 0);
    let turned_rad = turns.read(&motion, 1.2345)[0];
    let pulses = turned_rad / TAU * 2000.0;
    assert!(
        (pulses - libm::round(0.617_25 / PULSE_M)).abs() < 1e-6,
        "{pulses}"
    );
}

#[test]
fn sides_go_their_own_ways_in_turns() {
    // 0.3 m to either side: a quarter turn on the spot, and one about a centre 1 m to the left.
    let on_the_spot = drive(&[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], &[]);
    let turn_m = 0.3 * FRAC_PI_2;
    check_to_a_pulse(
        read_m(&on_the_spot, scaled(0.0), 0),
        [2.0 - turn_m, 2.0 + turn_m],
    );
    let arc = drive(&[[2.0, 0.0, 1.0], [2.0, 2.0, 0.0]], &[]);
    check_to_a_pulse(
        read_m(&arc, scaled(0.0), 0),
        [2.0 + 0.7 * FRAC_PI_2, 2.0 + 1.3 * FRAC_PI_2],
    );
}

#[test]
fn on_a_slope_wheels_turn_by_its_length() {
    let motion = drive(&[[5.0, 0.0, 0.0]], &[slope(-10.0)]);
    let length_m = 5.0 / libm::cos(10.0_f64.to_radians());
    check_to_a_pulse(read_m(&motion, scaled(0.0), 0), [length_m; 2]);
}

#[test]
fn slip_grows_with_the_root_of_the_way_and_belongs_to_a_side() {
    let motion = drive(&[[4.0, 0.0, 0.0]], &[]);
    let slip = WheelErrors {
        scale_error: 0.0,
        slip: 0.02,
    };
    let runs: Vec<[f64; 2]> = (0..400)
        .map(|seed| read_m(&motion, slip, seed).map(|m| m - 4.0))
        .collect();
    let n = runs.len() as f64;
    let (left_m2, right_m2, both_m2) = runs.iter().fold((0.0, 0.0, 0.0), |sums, [l, r]| {
        (sums.0 + l * l / n, sums.1 + r * r / n, sums.2 + l * r / n)
    });
    // 0.02 · √4 = 0.04 m; the bounds are 4 standard errors.
    for m2 in [left_m2, right_m2] {
        assert!((libm::sqrt(m2) - 0.04).abs() < 0.0057, "{m2}");
    }
    assert!(both_m2.abs() < 4.0 * 0.0016 / libm::sqrt(n), "{both_m2}");
    let bits = |seed| read_m(&motion, slip, seed).map(f64::to_bits);
    assert_eq!(bits(3), bits(3));
    assert_ne!(bits(3), bits(4));
}
