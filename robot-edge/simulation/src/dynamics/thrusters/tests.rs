#![expect(clippy::float_cmp, reason = "these values are exact")]

use super::*;
use crate::dynamics::Drive;
use crate::vehicle::SimulatedVehicle;

const STEP_S: f64 = 0.005;

fn riverwatch() -> TwinThrusters {
    match SimulatedVehicle::preset("riverwatch").unwrap().drive {
        Drive::Thrusters(thrusters) => thrusters,
        Drive::Wheels(_) => panic!("a boat on wheels"),
    }
}

fn command(linear_mps: f64, angular_radps: f64) -> CommandedVelocity {
    CommandedVelocity {
        linear_mps,
        angular_radps,
    }
}

fn after(momentum: Momentum, command: CommandedVelocity, duration_s: f64) -> Momentum {
    let boat = riverwatch();
    (0..(duration_s / STEP_S) as u32).fold(momentum, |momentum, _| {
        boat.after(momentum, command, STEP_S)
    })
}

#[test]
fn it_comes_to_the_speed_that_it_is_told_and_no_further() {
    for speed_mps in [0.3, 1.5, 3.0, 9.0] {
        let run = after(Momentum::default(), command(speed_mps, 0.0), 60.0);
        let expected_mps = f64::min(speed_mps, 3.0);
        assert!(
            (run.velocity.forward_mps - expected_mps).abs() < 1e-3,
            "{run:?}"
        );
        assert_eq!(run.velocity.turn_rate_radps, 0.0);
    }
    // Half of the thrust is there astern: 1.99 m/s where the drag is half of that at 3 m/s.
    let astern = after(Momentum::default(), command(-3.0, 0.0), 60.0)
        .velocity
        .forward_mps;
    let drag = riverwatch().surge_drag;
    assert!(
        (drag.at(astern) + 0.5 * drag.at(3.0)).abs() < 1e-3,
        "{astern}"
    );
}

#[test]
fn it_turns_on_the_spot_and_underway() {
    let spot = after(Momentum::default(), command(0.0, 0.2), 60.0).velocity;
    assert!((spot.turn_rate_radps - 0.2).abs() < 1e-3, "{spot:?}");
    assert!(spot.forward_mps.abs() < 1e-3, "{spot:?}");
    // At full thrust the outer thruster has nothing to add: the inner one gives way.
    let bend = after(Momentum::default(), command(3.0, -0.2), 60.0).velocity;
    assert!((bend.turn_rate_radps + 0.2).abs() < 1e-3, "{bend:?}");
    assert!((2.5..2.99).contains(&bend.forward_mps), "{bend:?}");
    // To the outside, which in a bend to the right is the left.
    assert!((0.2..0.6).contains(&bend.left_mps), "{bend:?}");
}

#[test]
fn without_thrust_it_drifts_as_far_as_drag_lets_it() {
    let boat = riverwatch();
    let mut momentum = Momentum {
        velocity: PlanarVelocity {
            forward_mps: 3.0,
            ..PlanarVelocity::default()
        },
        ..Momentum::default()
    };
    let (mut way_m, mut passed_s, mut at_1_s) = (0.0, 0.0, 0.0);
    while momentum.velocity.forward_mps > 0.0 {
        way_m += momentum.velocity.forward_mps * STEP_S;
        passed_s += STEP_S;
        momentum = boat.after(momentum, CommandedVelocity::ZERO, STEP_S);
        if at_1_s == 0.0 && passed_s >= 1.0 {
            at_1_s = momentum.velocity.forward_mps;
        }
        assert!(passed_s < 120.0, "{momentum:?}");
    }
    // ∫ v / (b₁ v + b₂ v²) dv from 0 to 3 m/s.
    let Drag {
        linear_per_s,
        quadratic,
    } = boat.surge_drag;
    let exact_m = libm::log(1.0 + quadratic * 3.0 / linear_per_s) / quadratic;
    assert!((way_m - exact_m).abs() < 0.02, "{way_m} m, {exact_m} m");
    assert!(exact_m > 4.0, "{exact_m}");
    assert!((1.0..1.5).contains(&at_1_s), "{at_1_s} m/s after 1 s");
}
