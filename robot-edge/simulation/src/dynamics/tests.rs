#![expect(clippy::float_cmp, reason = "these values are exact")]

use proptest::prelude::*;

use super::*;
use crate::vehicle::SimulatedVehicle;

const STEP_S: f64 = 0.005;

/// What somebody may tell a vehicle, far more than it can do, for some steps.
fn commands() -> impl Strategy<Value = Vec<(CommandedVelocity, usize)>> {
    let command =
        (-9.0..9.0, -9.0..9.0, 1..400_usize).prop_map(|(linear_mps, angular_radps, steps)| {
            let command = CommandedVelocity {
                linear_mps,
                angular_radps,
            };
            (command, steps)
        });
    prop::collection::vec(command, 1..12)
}

proptest! {
    #[test]
    fn whatever_it_is_told_it_does_what_it_can(commands in commands()) {
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
