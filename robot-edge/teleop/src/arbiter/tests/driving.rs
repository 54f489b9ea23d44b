use super::*;
use protocol::message::{Arming, Refusal, StopReason};

#[test]
fn a_press_after_neutral_drives() {
    let mut vehicle = Vehicle::held();
    assert_eq!(vehicle.state.mode, Mode::Held);
    vehicle.hold(Velocity::ZERO, 11);
    assert_eq!(vehicle.state.mode, Mode::Held);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
    assert!(vehicle.output().linear_mps > 0.0);
}

#[test]
fn a_key_that_was_down_before_the_grant_moves_nothing() {
    let mut vehicle = Vehicle::held();
    vehicle.hold(FORWARD, 100);
    assert_eq!(vehicle.state.mode, Mode::Held);
    assert_eq!(vehicle.report().arming, Arming::Locked);
    assert_eq!(vehicle.output(), Velocity::ZERO);
}

#[test]
fn less_than_200_ms_of_neutral_do_not_count() {
    let mut vehicle = Vehicle::held();
    // The first at 0 ms, the last at 180 ms, the press at 199 ms.
    vehicle.hold(Velocity::ZERO, 9);
    vehicle.pass(19);
    vehicle.hold(FORWARD, 5);
    assert_eq!(vehicle.state.mode, Mode::Held);
}

#[test]
fn neutral_with_a_gap_of_the_age_limit_does_not_count() {
    let mut vehicle = Vehicle::held();
    vehicle.hold(Velocity::ZERO, 1);
    vehicle.silence(440);
    vehicle.hold(FORWARD, 5);
    assert_eq!(vehicle.state.mode, Mode::Held);
}

#[test]
fn letting_go_stops_by_the_ramp_and_keeps_the_lease() {
    let mut vehicle = Vehicle::driving();
    vehicle.hold(Velocity::ZERO, 1);
    assert_eq!(vehicle.stopping(), Some(StopReason::Released));
    // 0.3 m/s at 1 m/s² are 15 rounds, of which one has passed.
    for round in 1..15 {
        let expected = 0.3 - 0.02 * f64::from(round);
        assert!((vehicle.output().linear_mps - expected).abs() < 1e-9);
        vehicle.hold(Velocity::ZERO, 1);
    }
    assert_eq!(vehicle.output(), Velocity::ZERO);
    assert_eq!(vehicle.state.mode, Mode::Held);
    assert_eq!(vehicle.report().counters.involuntary_stops, 0);
}

#[test]
fn pressing_again_at_once_drives_on() {
    let mut vehicle = Vehicle::driving();
    vehicle.hold(Velocity::ZERO, 2);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
}

#[test]
fn pressing_again_later_waits_for_standstill() {
    let mut vehicle = Vehicle::driving();
    vehicle.hold(Velocity::ZERO, 12);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.stopping(), Some(StopReason::Released));
    assert_eq!(vehicle.report().arming, Arming::Pressed);
    vehicle.hold(FORWARD, 2);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::Held, Velocity::ZERO)
    );
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
}

#[test]
fn the_output_falls_when_the_last_command_is_too_old() {
    let mut vehicle = Vehicle::driving();
    // The last token was issued two rounds ago: the console had the one of the round before its command.
    let issued = vehicle.now;
    let command = vehicle.command(ALICE, FORWARD);
    vehicle.send(command);
    while vehicle.state.mode == Mode::Driving {
        vehicle.round();
        // It may slow down before, because commands that grow old allow less speed.
        assert!(vehicle.now.since(issued) <= Duration::from_millis(420));
    }
    assert_eq!(vehicle.stopping(), Some(StopReason::Age));
    assert_eq!(vehicle.now.since(issued), Duration::from_millis(420));
    let stopped = vehicle.now;
    while vehicle.output() != Velocity::ZERO {
        vehicle.round();
    }
    assert_eq!(vehicle.now.since(stopped), Duration::from_millis(280));
    assert_eq!(vehicle.state.mode, Mode::Held);
    assert_eq!(vehicle.report().counters.involuntary_stops, 1);
}

#[test]
fn commands_that_are_young_again_within_200_ms_take_the_stop_back() {
    let mut vehicle = Vehicle::driving();
    vehicle.silence(420);
    assert_eq!(vehicle.stopping(), Some(StopReason::Age));
    vehicle.silence(160);
    assert!(vehicle.output().linear_mps > 0.0);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
}

#[test]
fn commands_that_are_young_again_later_do_not() {
    let mut vehicle = Vehicle::driving();
    vehicle.silence(420 + 220);
    assert!(vehicle.output().linear_mps > 0.0);
    vehicle.hold(FORWARD, 100);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::Held, Velocity::ZERO)
    );
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
}

#[test]
fn a_stall_s_commands_move_nothing_when_they_arrive() {
    let mut vehicle = Vehicle::driving();
    let stalled: Vec<_> = (0..150)
        .map(|_| {
            let command = vehicle.command(ALICE, FORWARD);
            vehicle.round();
            command
        })
        .collect();
    assert_eq!(vehicle.state.mode, Mode::Idle, "the lease has expired");
    for command in stalled {
        vehicle.send(command);
        vehicle.input(ArbiterInput::Tick);
        assert_eq!(vehicle.output(), Velocity::ZERO);
    }
    // Tokens of more than 2 s ago are not even known, and those of the last 0.4 s are young, but nobody's.
    let refusals = [Refusal::UnknownToken, Refusal::TooOld, Refusal::NotHolder];
    let refused = refusals.map(|refusal| vehicle.refused(refusal));
    assert_eq!(refused.iter().sum::<u64>(), 150);
    assert_eq!(refused[2], 20);
}

#[test]
fn what_is_no_number_stops_the_vehicle() {
    for nonsense in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut vehicle = Vehicle::driving();
        let requested = Velocity {
            angular_radps: nonsense,
            ..FORWARD
        };
        let command = vehicle.command(ALICE, requested);
        vehicle.send(command);
        assert_eq!(vehicle.stopping(), Some(StopReason::NotFinite));
        vehicle.hold(FORWARD, 100);
        assert_eq!(vehicle.state.mode, Mode::Held);
        assert_eq!(vehicle.refused(Refusal::NotFinite), 1);
    }
}

#[test]
fn commands_are_checked_in_the_order_of_their_cost() {
    let mut vehicle = Vehicle::driving();
    let right = vehicle.command(ALICE, FORWARD);
    let precheck = |role, command: DriveCommand| {
        vehicle
            .state
            .precheck(&vehicle.rules, vehicle.now, role, &command)
    };
    let token = |n| AgeToken { n, ..right.token };
    let wrong = DriveCommand {
        operator: BOB,
        epoch: 9,
        seq: 0,
        token: AgeToken {
            boot_id: 1,
            n: u64::MAX,
            nonce: 0,
        },
        ..right
    };
    let operator = Role::Operator;
    assert_eq!(precheck(operator, right), Ok(Duration::ZERO));
    assert_eq!(precheck(Role::Observer, wrong), Err(Refusal::Role));
    assert_eq!(precheck(operator, wrong), Err(Refusal::OtherBoot));
    let wrong = DriveCommand {
        token: token(0),
        ..wrong
    };
    assert_eq!(precheck(operator, wrong), Err(Refusal::TooOld));
    let wrong = DriveCommand {
        token: right.token,
        ..wrong
    };
    assert_eq!(precheck(operator, wrong), Err(Refusal::NotHolder));
    let wrong = DriveCommand {
        operator: ALICE,
        ..wrong
    };
    assert_eq!(precheck(operator, wrong), Err(Refusal::OtherEpoch));
    let wrong = DriveCommand { epoch: 1, ..wrong };
    assert_eq!(precheck(operator, wrong), Err(Refusal::OldSequence));
    let same = DriveCommand {
        seq: right.seq - 1,
        ..right
    };
    assert_eq!(precheck(operator, same), Err(Refusal::OldSequence));
}

#[test]
fn what_was_refused_outside_is_counted() {
    let mut vehicle = Vehicle::idle();
    vehicle.input(ArbiterInput::Rejected(Refusal::Signature));
    assert_eq!(vehicle.refused(Refusal::Signature), 1);
}

#[test]
fn time_does_not_go_back() {
    let mut vehicle = Vehicle::driving();
    let command = vehicle.command(ALICE, FORWARD);
    vehicle.silence(420);
    let now = std::mem::replace(&mut vehicle.now, Monotonic::from_nanos(0));
    vehicle.send(command);
    assert_eq!(vehicle.refused(Refusal::TooOld), 1);
    assert_eq!(vehicle.state.now, now);
}

#[test]
fn a_stop_that_is_over_within_one_step_says_why_it_was() {
    let mut vehicle = Vehicle::driving();
    vehicle.events.clear();
    // The process stood still for longer than the lease holds.
    vehicle.pass(5000);
    vehicle.input(ArbiterInput::Tick);
    assert_eq!(vehicle.state.mode, Mode::Idle);
    let modes: Vec<_> = vehicle
        .events
        .iter()
        .filter_map(|event| {
            let ArbiterEvent::ModeChanged { from, to } = event else {
                return None;
            };
            Some((*from, *to))
        })
        .collect();
    let stopping = Mode::Stopping {
        reason: StopReason::Age,
        since: vehicle.now,
    };
    assert_eq!(modes, [(Mode::Driving, stopping), (stopping, Mode::Idle)]);
}
