//! Goals: what starts one, what ends one, and that nothing of a planner counts otherwise.

use super::*;
use protocol::message::{GoalEnd, MapPose};

const GOAL: MapPose = MapPose {
    x_mm: 4000,
    y_mm: -500,
    yaw_mrad: 0,
};
const OTHER: MapPose = MapPose { x_mm: 1, ..GOAL };
const NAN: Velocity = Velocity::new(f64::NAN, 0.0);

impl Vehicle {
    /// Alice may drive, or name a goal.
    fn ready() -> Self {
        let mut vehicle = Self::held();
        vehicle.rules = vehicle.rules.with_planner(Duration::from_millis(200));
        vehicle.hold(Velocity::ZERO, 11);
        vehicle
    }

    /// A planner drives it at the speed of [`FORWARD`].
    fn planned() -> Self {
        let mut vehicle = Self::ready();
        vehicle.go(Some(GOAL), Some(FORWARD), 60);
        assert_eq!(vehicle.report().goal, Some(GOAL));
        assert_eq!(vehicle.output(), FORWARD);
        vehicle
    }

    fn name(&mut self, goal: Option<MapPose>) {
        let command = DriveCommand {
            goal,
            ..self.command(ALICE, Velocity::ZERO)
        };
        self.send(command);
    }

    fn plan(&mut self, velocity: Velocity) {
        let arrived = self.now;
        self.input(ArbiterInput::Planned { velocity, arrived });
    }

    /// So many rounds in which Alice's console names `goal` and the planner sends `velocity`.
    fn go(&mut self, goal: Option<MapPose>, velocity: Option<Velocity>, rounds: usize) {
        for _ in 0..rounds {
            self.name(goal);
            if let Some(velocity) = velocity {
                self.plan(velocity);
            }
            self.round();
        }
    }

    fn goal_ends(&self) -> Vec<GoalEnd> {
        let ends = self.events.iter().filter_map(|event| {
            if let ArbiterEvent::GoalEnded(why) = event {
                Some(*why)
            } else {
                None
            }
        });
        ends.collect()
    }
}

/// What ends a goal; how, in which state, and how many involuntary stops that is.
type Case = (&'static str, fn(&mut Vehicle), GoalEnd, TeleopState, u64);

const CASES: [Case; 14] = [
    (
        "no goal",
        |v| v.go(None, Some(FORWARD), 1),
        GoalEnd::Cancelled,
        RELEASED,
        0,
    ),
    (
        "keys",
        |v| v.hold(Velocity::new(0.0, 0.5), 1),
        GoalEnd::TakenOver,
        Driving,
        0,
    ),
    (
        "a gap",
        |v| v.go(Some(GOAL), None, 11),
        GoalEnd::PlannerSilent,
        Stopping(StopReason::PlannerSilent),
        1,
    ),
    (
        "a gap that no round saw",
        |v| {
            v.pass(185);
            v.go(Some(GOAL), Some(FORWARD), 1);
        },
        GoalEnd::PlannerSilent,
        Stopping(StopReason::PlannerSilent),
        1,
    ),
    (
        "not a number",
        |v| v.plan(NAN),
        GoalEnd::NotFinite,
        Stopping(StopReason::NotFinite),
        1,
    ),
    (
        "infinite",
        |v| {
            v.plan(Velocity {
                lateral_mps: f64::NEG_INFINITY,
                ..FORWARD
            });
        },
        GoalEnd::NotFinite,
        Stopping(StopReason::NotFinite),
        1,
    ),
    (
        "a flood",
        |v| v.input(ArbiterInput::PlannerFloods),
        GoalEnd::PlannerFloods,
        Stopping(StopReason::PlannerFloods),
        1,
    ),
    (
        "old tokens",
        |v| {
            for _ in 0..21 {
                v.plan(FORWARD);
                v.round();
            }
        },
        GoalEnd::Age,
        TOO_OLD,
        1,
    ),
    (
        "the lease",
        |v| assert_eq!(v.lease(ALICE, LeaseVerb::Release), Done),
        GoalEnd::LeaseEnded,
        ended(LeaseEnd::Released),
        0,
    ),
    (
        "a take-over",
        |v| {
            v.input(ArbiterInput::Lease {
                caller: caller(CAROL),
                token: v.token,
                verb: LeaseVerb::TakeOver,
            });
        },
        GoalEnd::LeaseEnded,
        ended(LeaseEnd::TakenOver),
        1,
    ),
    (
        "an emergency stop",
        |v| v.input(ArbiterInput::LocalEStop),
        GoalEnd::EStop,
        EStop,
        0,
    ),
    (
        "a fault",
        |v| v.input(ArbiterInput::ActuatorFault),
        GoalEnd::Motors,
        Fault(FaultReason::Actuator),
        0,
    ),
    (
        "held motors",
        |v| v.input(ArbiterInput::MotorsHeld),
        GoalEnd::Motors,
        Stopping(StopReason::MotorsHeld),
        1,
    ),
    (
        "a blind monitor",
        |v| {
            v.collision_monitor = CollisionMonitorOutput::Stale;
            v.go(Some(GOAL), Some(FORWARD), 1);
        },
        GoalEnd::CollisionMonitorStale,
        STALE,
        1,
    ),
];

#[test]
fn each_end_is_final_and_has_its_reason() {
    for (what, end, why, state, involuntary) in CASES {
        let mut vehicle = Vehicle::planned();
        end(&mut vehicle);
        let report = vehicle.report();
        assert_eq!(report.mode.teleop_state(), state, "{what}");
        assert_eq!(
            (report.goal, report.last_goal_end),
            (None, Some(why)),
            "{what}"
        );
        assert_eq!(vehicle.goal_ends(), [why], "{what}");
        assert_eq!(report.counters.involuntary_stops, involuntary, "{what}");
        // The planner goes on, and the console still names the goal.
        vehicle.collision_monitor = CollisionMonitorOutput::Off;
        for _ in 0..100 {
            let was = vehicle.output().linear_mps;
            vehicle.go(Some(GOAL), Some(FORWARD), 1);
            assert!(vehicle.output().linear_mps <= was, "{what}");
        }
        assert_eq!(vehicle.output(), Velocity::ZERO, "{what}");
        assert_eq!(vehicle.report().goal, None, "{what}");
    }
}

#[test]
fn a_goal_starts_as_a_press_does() {
    // Named from the start, without neutral commands.
    let mut vehicle = Vehicle::held();
    vehicle.rules = vehicle.rules.with_planner(Duration::from_millis(200));
    vehicle.go(Some(GOAL), Some(FORWARD), 100);
    assert_eq!(vehicle.report().goal, None);
    vehicle.go(None, Some(FORWARD), 11);
    assert_eq!(vehicle.output(), Velocity::ZERO, "no goal");
    vehicle.go(Some(GOAL), Some(FORWARD), 10);
    assert!(vehicle.output().linear_mps > 0.0);
    assert!(vehicle.events.contains(&ArbiterEvent::GoalStarted(GOAL)));

    // Without a planner.
    let mut vehicle = Vehicle::held();
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.go(Some(GOAL), Some(FORWARD), 10);
    assert_eq!(vehicle.report().goal, None);

    // From keys: the vehicle stops, and the goal must be named anew.
    let mut vehicle = Vehicle::ready();
    vehicle.hold(FORWARD, 60);
    vehicle.go(Some(GOAL), Some(FORWARD), 60);
    assert_eq!(
        (vehicle.state.mode, vehicle.report().goal),
        (Mode::Held, None)
    );
    // While it brakes: the goal waits for standstill.
    let mut vehicle = Vehicle::ready();
    vehicle.hold(FORWARD, 60);
    vehicle.go(None, None, 11);
    assert_eq!(vehicle.state.mode.teleop_state(), RELEASED);
    vehicle.go(Some(GOAL), Some(FORWARD), 2);
    assert_eq!(vehicle.state.mode.teleop_state(), RELEASED);
    vehicle.go(Some(GOAL), Some(FORWARD), 20);
    assert_eq!(vehicle.report().goal, Some(GOAL));
}

#[test]
fn nothing_moves_before_the_first_velocity_and_planning_has_an_end() {
    let mut vehicle = Vehicle::ready();
    // What arrived before the goal is about another one.
    let before = vehicle.now;
    vehicle.pass(1);
    vehicle.name(Some(GOAL));
    vehicle.input(ArbiterInput::Planned {
        velocity: FORWARD,
        arrived: before,
    });
    vehicle.go(Some(GOAL), None, 450);
    assert_eq!(
        (vehicle.report().goal, vehicle.output()),
        (Some(GOAL), Velocity::ZERO)
    );
    vehicle.go(Some(GOAL), None, 51);
    assert_eq!(vehicle.goal_ends(), [GoalEnd::PlannerSilent]);
    assert_eq!(vehicle.report().counters.involuntary_stops, 0, "it stood");
    // A planner that has arrived sends zero and falls silent.
    let mut vehicle = Vehicle::planned();
    vehicle.go(Some(GOAL), Some(Velocity::ZERO), 1);
    vehicle.go(Some(GOAL), None, 10);
    assert_eq!(vehicle.goal_ends(), [GoalEnd::PlannerSilent]);
    assert_eq!(
        vehicle.report().counters.involuntary_stops,
        0,
        "it was to stand"
    );
}

#[test]
fn another_goal_replaces_the_first_and_keys_go_on_after_it() {
    let mut vehicle = Vehicle::planned();
    vehicle.go(Some(OTHER), Some(FORWARD), 5);
    assert_eq!(
        (vehicle.report().goal, vehicle.output()),
        (Some(OTHER), FORWARD)
    );
    // A planner that says nothing about the new one is still watched.
    vehicle.go(Some(OTHER), None, 9);
    assert_eq!(vehicle.output(), FORWARD);
    vehicle.go(Some(OTHER), None, 1);
    assert_eq!(vehicle.goal_ends(), [GoalEnd::PlannerSilent]);

    let mut vehicle = Vehicle::planned();
    vehicle.hold(FORWARD, 20);
    vehicle.input(ArbiterInput::PlannerFloods);
    vehicle.plan(NAN);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::Driving, FORWARD)
    );
}

#[test]
fn limits_hold_as_for_an_operator() {
    let mut vehicle = Vehicle::ready();
    let limits = SpeedLimits {
        forward_mps: 0.1,
        reverse_mps: 0.0,
        left_mps: 0.0,
        right_mps: 0.0,
        left_radps: 1.0,
        right_radps: 1.0,
        in_unknown_space: false,
        overspeed: Velocity::ZERO,
    };
    vehicle.limit(limits);
    vehicle.go(Some(GOAL), Some(Velocity::new(1e300, 0.0)), 60);
    assert!(vehicle.output().linear_mps <= 0.1 + 1e-9);
    assert_eq!(vehicle.report().clamp, Some(Clamp::CollisionMonitor));
    // An old command, or one of another grant, names nothing.
    let mut vehicle = Vehicle::ready();
    let stale = DriveCommand {
        goal: Some(GOAL),
        epoch: 0,
        ..vehicle.command(ALICE, Velocity::ZERO)
    };
    vehicle.send(stale);
    let replayed = DriveCommand {
        goal: Some(GOAL),
        seq: 1,
        ..vehicle.command(ALICE, Velocity::ZERO)
    };
    vehicle.send(replayed);
    assert_eq!(vehicle.report().goal, None);
    assert_eq!(vehicle.refused(Refusal::OtherEpoch), 1);
    assert_eq!(vehicle.refused(Refusal::OldSequence), 1);
}
