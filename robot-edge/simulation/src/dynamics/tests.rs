#![expect(clippy::float_cmp, reason = "these values are exact")]

use proptest::prelude::*;

use super::{Drive, *};
use crate::vehicle::SimulatedVehicle;

const STEP_S: f64 = 0.005;

/// Commands far beyond the vehicle's limits, each for some steps.
fn commands() -> impl Strategy<Value = Vec<(CommandedVelocity, usize)>> {
    let command =
        (-9.0..9.0, -9.0..9.0, 1..400_usize).prop_map(|(linear_mps, angular_radps, steps)| {
            let command = CommandedVelocity {
                linear_mps,
                lateral_mps: 0.0,
                angular_radps,
            };
            (command, steps)
        });
    prop::collection::vec(command, 1..12)
}

proptest! {
    #[test]
    fn no_command_exceeds_the_limits(commands in commands()) {
        for name in SimulatedVehicle::NAMES {
            let drive = SimulatedVehicle::preset(name).unwrap().drive;
            let mut momentum = Momentum::default();
            for (command, steps) in &commands {
                for _ in 0..*steps {
                    let next = drive.after(momentum, *command, STEP_S);
                    check(&drive, momentum.velocity, next.velocity);
                    momentum = next;
                }
            }
        }
    }
}

fn check(drive: &Drive, from: PlanarVelocity, to: PlanarVelocity) {
    match drive {
        Drive::Wheels(WheelDrive { linear, angular }) => {
            let pairs = [
                (linear, from.forward_mps, to.forward_mps),
                (angular, from.turn_rate_radps, to.turn_rate_radps),
            ];
            for (axis, from, to) in pairs {
                assert!(to.abs() <= axis.max_speed, "{to:?}");
                // A gap smaller than friction's is closed at once.
                let most = (axis.max_acceleration * STEP_S).max(1e-4);
                assert!((to - from).abs() <= most + 1e-12, "{from:?}, {to:?}");
            }
            assert_eq!(to.left_mps, 0.0);
        }
        Drive::Thrusters(boat) => {
            // Turning back out of a bend, leeway becomes headway for a moment.
            assert!(to.forward_mps.abs() <= 1.05 * boat.max_speed_mps, "{to:?}");
            assert!(to.left_mps.abs() < 1.0, "{to:?}");
            assert!(
                to.turn_rate_radps.abs() <= 1.05 * boat.max_turn_rate_radps,
                "{to:?}"
            );
        }
    }
}

fn riverwatch() -> TwinThrusters {
    match SimulatedVehicle::preset("riverwatch").unwrap().drive {
        Drive::Thrusters(thrusters) => thrusters,
        Drive::Wheels(_) => panic!("a boat on wheels"),
    }
}

fn command(linear_mps: f64, angular_radps: f64) -> CommandedVelocity {
    CommandedVelocity {
        linear_mps,
        lateral_mps: 0.0,
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
fn it_reaches_the_commanded_speed_and_no_more() {
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

const AXIS: Axis = Axis {
    max_speed: 1.2,
    max_acceleration: 2.0,
    lag_s: 0.1,
};

/// Speeds at multiples of 5 ms.
fn run(from: f64, target: f64, steps: usize) -> Vec<f64> {
    let next = |speed: &f64| Some(AXIS.after(*speed, target, 0.005));
    std::iter::successors(Some(from), next)
        .take(steps)
        .collect()
}

#[test]
fn small_changes_lag_and_large_ones_keep_the_acceleration() {
    // 0.1 m/s over 0.1 s is half of the acceleration: after one time constant 63 % are done.
    let small = run(0.0, 0.1, 21);
    assert!(
        (small[20] - 0.1 * (1.0 - libm::exp(-1.0))).abs() < 1e-12,
        "{small:?}"
    );
    // From 1 m/s the brakes hold 2 m/s² until 0.2 m/s, which the lag takes from there.
    let stop = run(1.0, 0.0, 400);
    assert!((stop[60] - 0.4).abs() < 1e-12, "{}", stop[60]);
    assert!(
        stop.windows(2)
            .all(|pair| pair[0] - pair[1] <= 0.01 + 1e-12)
    );
    assert!(
        stop.windows(2)
            .all(|pair| pair[1] <= pair[0] && pair[1] >= 0.0)
    );
    assert_eq!(stop[399], 0.0);
}
