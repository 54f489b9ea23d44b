use super::*;
use crate::input::SpeedLimits;
use protocol::message::{Arming, Clamp, StopReason};

const OPEN: SpeedLimits = SpeedLimits {
    forward_mps: 1.0,
    reverse_mps: 1.0,
    left_radps: 1.0,
    right_radps: 1.0,
    in_unknown_space: false,
    overspeed: Velocity::ZERO,
};

fn near(is: f64, expected: f64) {
    assert!((is - expected).abs() < 1e-6, "{is} is not {expected}");
}

#[test]
fn old_commands_allow_less_speed() {
    let mut vehicle = Vehicle::driving();
    let fast = Velocity {
        linear_mps: 1.0,
        angular_radps: 0.5,
    };
    vehicle.hold(fast, 100);
    // The token of a command is 20 ms old when the next one comes.
    near(vehicle.report().speed_allowed_mps, 1.0);
    near(vehicle.output().linear_mps, 1.0);
    let delayed = |vehicle: &mut Vehicle, rounds: usize| {
        let mut tokens = vec![vehicle.token; 10];
        for _ in 0..rounds {
            let command = vehicle.command(ALICE, fast);
            tokens.push(vehicle.token);
            let token = tokens.remove(0);
            vehicle.send(DriveCommand { token, ..command });
            vehicle.round();
        }
    };
    delayed(&mut vehicle, 120);
    // Ten rounds on the way and one until the next: 220 ms.
    let report = vehicle.report();
    assert_eq!(report.peak_age, Some(Duration::from_millis(220)));
    near(report.speed_allowed_mps, 0.15 / 0.22);
    near(report.applied.linear_mps, 0.15 / 0.22);
    near(report.applied.angular_radps, 0.5 * 0.15 / 0.22);
    assert_eq!(report.clamp, Some(Clamp::Age));
    assert_eq!(report.requested, fast);
    // A second later, and not before, it is forgotten.
    vehicle.hold(fast, 40);
    near(vehicle.output().linear_mps, 0.15 / 0.22);
    vehicle.hold(fast, 100);
    near(vehicle.output().linear_mps, 1.0);
}

#[test]
fn the_guard_slows_an_arc_without_bending_it() {
    let mut vehicle = Vehicle::driving();
    let arc = Velocity {
        linear_mps: 0.8,
        angular_radps: -0.4,
    };
    vehicle.collision_monitor = CollisionMonitorOutput::Limits(SpeedLimits {
        forward_mps: 0.2,
        ..OPEN
    });
    vehicle.hold(arc, 100);
    near(vehicle.output().linear_mps, 0.2);
    near(vehicle.output().angular_radps, -0.1);
    assert_eq!(vehicle.report().clamp, Some(Clamp::CollisionMonitor));
    vehicle.collision_monitor = CollisionMonitorOutput::Limits(SpeedLimits {
        right_radps: 0.2,
        ..OPEN
    });
    vehicle.hold(arc, 100);
    near(vehicle.output().linear_mps, 0.4);
    near(vehicle.output().angular_radps, -0.2);
}

#[test]
fn the_guard_brakes_without_regard_to_jerk() {
    let mut vehicle = Vehicle::driving();
    vehicle.collision_monitor = CollisionMonitorOutput::Limits(SpeedLimits {
        forward_mps: 0.1,
        ..OPEN
    });
    vehicle.hold(FORWARD, 1);
    near(vehicle.output().linear_mps, 0.28);
    vehicle.hold(FORWARD, 9);
    near(vehicle.output().linear_mps, 0.1);
    vehicle.hold(FORWARD, 9);
    near(vehicle.output().linear_mps, 0.1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
}

#[test]
fn before_a_wall_it_still_backs_off_and_turns() {
    let mut vehicle = Vehicle::driving();
    vehicle.collision_monitor = CollisionMonitorOutput::Limits(SpeedLimits {
        forward_mps: 0.0,
        ..OPEN
    });
    vehicle.hold(FORWARD, 50);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::Driving, Velocity::ZERO)
    );
    vehicle.hold(FORWARD.scaled(-1.0), 60);
    near(vehicle.output().linear_mps, -0.3);
    let turn = Velocity {
        linear_mps: 0.0,
        angular_radps: 0.6,
    };
    vehicle.hold(turn, 60);
    near(vehicle.output().angular_radps, 0.6);
    near(vehicle.output().linear_mps, 0.0);
}

#[test]
fn a_stop_at_a_wall_is_immediate_and_needs_neutral_again() {
    let mut vehicle = Vehicle::driving();
    vehicle.collision_monitor = CollisionMonitorOutput::Limits(SpeedLimits {
        forward_mps: 0.0,
        ..OPEN
    });
    vehicle.hold(FORWARD, 50);
    // Too late to take the stop back, too early to count.
    vehicle.hold(Velocity::ZERO, 3);
    let back = FORWARD.scaled(-1.0);
    vehicle.hold(back, 20);
    assert_eq!(vehicle.state.mode, Mode::Held);
    assert_eq!(vehicle.report().arming, Arming::Locked);
    assert_eq!(vehicle.output(), Velocity::ZERO);
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.hold(back, 60);
    near(vehicle.output().linear_mps, -0.3);
}

#[test]
fn a_stale_monitor_stops_the_vehicle_until_a_new_press() {
    let mut vehicle = Vehicle::driving();
    vehicle.collision_monitor = CollisionMonitorOutput::Stale;
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.stopping(), Some(StopReason::CollisionMonitorStale));
    vehicle.collision_monitor = CollisionMonitorOutput::Off;
    vehicle.hold(FORWARD, 50);
    assert_eq!(vehicle.state.mode, Mode::Held);
}

#[test]
fn a_guard_that_says_nothing_stops_the_vehicle() {
    let mut vehicle = Vehicle::driving();
    for _ in 0..16 {
        vehicle.pass(20);
        vehicle.input(ArbiterInput::Token { nonce: 1 });
        let command = vehicle.command(ALICE, FORWARD);
        vehicle.send(command);
        vehicle.input(ArbiterInput::Tick);
    }
    assert_eq!(vehicle.stopping(), Some(StopReason::CollisionMonitorStale));
    assert_eq!(vehicle.report().collision_monitor, None);
}

#[test]
fn a_press_without_monitor_does_not_count_later() {
    let mut vehicle = Vehicle::held();
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.collision_monitor = CollisionMonitorOutput::Stale;
    vehicle.round();
    vehicle.hold(FORWARD, 2);
    vehicle.collision_monitor = CollisionMonitorOutput::Off;
    vehicle.hold(FORWARD, 20);
    assert_eq!(vehicle.state.mode, Mode::Held);
}

#[test]
fn what_limits_the_speed_is_told() {
    let mut vehicle = Vehicle::driving();
    assert_eq!(vehicle.report().clamp, None);
    let fast = Velocity {
        linear_mps: 0.6,
        angular_radps: 0.0,
    };
    vehicle.hold(fast, 2);
    assert_eq!(vehicle.report().clamp, Some(Clamp::Ramp));
    let spin = Velocity {
        linear_mps: 0.0,
        angular_radps: 5.0,
    };
    vehicle.hold(spin, 100);
    assert_eq!(vehicle.report().clamp, Some(Clamp::Speed));
    near(vehicle.output().angular_radps, 1.0);
    vehicle.silence(600);
    assert_eq!(vehicle.report().clamp, None);
}

#[test]
fn on_its_way_to_a_limit_it_is_held_back_by_its_acceleration() {
    // The first is the greatest speed as the 32 bits of the wire may round it.
    for (asked_mps, at_last) in [(1.000_000_05, None), (1.5, Some(Clamp::Speed))] {
        for way in [1.0, -1.0] {
            let asked = Velocity {
                linear_mps: way * asked_mps,
                angular_radps: 0.0,
            };
            let mut vehicle = Vehicle::driving();
            vehicle.hold(asked, 60);
            assert!(vehicle.output().linear_mps.abs() < 0.95, "{asked:?}");
            assert_eq!(vehicle.report().clamp, Some(Clamp::Ramp), "{asked:?}");
            vehicle.hold(asked, 200);
            near(vehicle.output().linear_mps, way);
            assert_eq!(vehicle.report().clamp, at_last, "{asked:?}");
        }
    }
}

#[test]
fn the_clamp_names_the_monitor_while_it_limits() {
    let mut vehicle = Vehicle::driving();
    vehicle.collision_monitor = CollisionMonitorOutput::Limits(SpeedLimits {
        forward_mps: 0.1,
        ..OPEN
    });
    for (rounds, mps) in [(1, 0.28), (60, 0.1)] {
        vehicle.hold(FORWARD, rounds);
        near(vehicle.output().linear_mps, mps);
        assert_eq!(
            vehicle.report().clamp,
            Some(Clamp::CollisionMonitor),
            "{rounds}"
        );
    }
}

#[test]
fn a_boat_that_is_too_fast_is_shown_the_limit_and_gets_no_thrust() {
    let mut boat = Vehicle::driving();
    let limits = SpeedLimits {
        forward_mps: 0.2,
        overspeed: FORWARD.scaled(1.0 / 3.0),
        ..OPEN
    };
    boat.collision_monitor = CollisionMonitorOutput::Limits(limits);
    boat.hold(FORWARD, 60);
    near(boat.output().linear_mps, 0.0);
    assert_eq!(
        boat.report().collision_monitor,
        Some(CollisionMonitorOutput::Limits(limits))
    );
    // Thrust the other way slows it down.
    boat.hold(FORWARD.scaled(-1.0), 100);
    near(boat.output().linear_mps, -0.3);
}

#[test]
fn a_boat_without_thrust_drifts() {
    let teleop = TeleopConfig {
        is_boat: true,
        ..TeleopConfig::default()
    };
    let mut boat = Vehicle::with(&teleop);
    assert!(!boat.report().is_drifting);
    boat.self_test(true, StoredEStop::None);
    assert!(boat.report().is_drifting);
    boat.lease(ALICE, LeaseVerb::Request);
    boat.hold(Velocity::ZERO, 11);
    assert!(boat.report().is_drifting);
    boat.hold(FORWARD, 1);
    assert!(!boat.report().is_drifting);
    assert!(!Vehicle::idle().report().is_drifting);
}

#[test]
fn measured_speed_is_passed_on_unless_it_is_none() {
    let mut vehicle = Vehicle::idle();
    vehicle.input(ArbiterInput::Measured(FORWARD));
    assert_eq!(vehicle.report().measured, Some(FORWARD));
    vehicle.input(ArbiterInput::Measured(FORWARD.scaled(f64::NAN)));
    assert_eq!(vehicle.report().measured, None);
}
