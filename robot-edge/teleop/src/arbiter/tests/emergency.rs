use super::*;
use protocol::keys::OperatorTopic;
use protocol::message::{Answer, FaultReason, Refusal};

const FIRST: EStopId = EStopId(1);

fn stored(vehicle: &mut Vehicle) {
    vehicle.input(ArbiterInput::EStopStored(FIRST));
    vehicle.round();
}

#[test]
fn any_operator_stops_the_vehicle_at_once() {
    let mut vehicle = Vehicle::driving();
    vehicle.input(ArbiterInput::EStop(caller(BOB)));
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::EStop, Velocity::ZERO)
    );
    assert!(vehicle.actions.contains(&Action::StoreEStop(FIRST)));
    assert_eq!(vehicle.answer(), None, "not before it is stored");
    vehicle.hold(FORWARD, 10);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::EStop, Velocity::ZERO)
    );

    vehicle.input(ArbiterInput::EStopStored(FIRST));
    assert!(vehicle.actions.contains(&Action::AcknowledgeEStop(FIRST)));
    vehicle.input(ArbiterInput::EStop(caller(BOB)));
    assert_eq!(vehicle.answer(), Some(Answer::EStopped(FIRST.0)));
    vehicle.input(ArbiterInput::EStopStored(FIRST));
    assert_eq!(vehicle.actions, []);
}

#[test]
fn a_command_stops_it_whatever_else_is_wrong_with_it() {
    let mut vehicle = Vehicle::driving();
    let command = DriveCommand {
        epoch: 77,
        seq: 0,
        token: AgeToken {
            boot_id: 0,
            n: 0,
            nonce: 0,
        },
        requested: FORWARD,
        estop: true,
        ..vehicle.command(BOB, FORWARD)
    };
    vehicle.input(ArbiterInput::Command {
        role: Role::Observer,
        command,
    });
    assert_eq!(vehicle.state.mode, Mode::Driving);
    vehicle.send(command);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::EStop, Velocity::ZERO)
    );
}

#[test]
fn onlookers_do_not_stop_it() {
    let mut vehicle = Vehicle::driving();
    let onlooker = Caller {
        role: Role::Observer,
        ..caller(BOB)
    };
    vehicle.input(ArbiterInput::EStop(onlooker));
    assert_eq!(vehicle.state.mode, Mode::Driving);
    assert_eq!(vehicle.answer(), Some(Answer::Refused(Refusal::Role)));
    assert!(vehicle.events.contains(&ArbiterEvent::Refused {
        request_kind: OperatorTopic::EStop,
        caller: onlooker,
        refusal: Refusal::Role,
    }));
}

#[test]
fn it_is_given_to_be_stored_until_it_is() {
    let mut vehicle = Vehicle::idle();
    vehicle.input(ArbiterInput::LocalEStop);
    assert!(vehicle.actions.contains(&Action::StoreEStop(FIRST)));
    let mut retries = 0;
    for _ in 0..150 {
        vehicle.round();
        retries += usize::from(vehicle.actions.contains(&Action::StoreEStop(FIRST)));
    }
    assert_eq!(retries, 3);
    stored(&mut vehicle);
    for _ in 0..150 {
        vehicle.round();
        assert_eq!(vehicle.actions, []);
    }
}

#[test]
fn a_reset_must_be_right_in_everything() {
    let mut vehicle = Vehicle::driving();
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::NoEStop)
    );
    vehicle.input(ArbiterInput::EStop(caller(BOB)));
    let before = vehicle.token;
    vehicle.round();
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::EStopNotStored)
    );
    vehicle.input(ArbiterInput::EStopStored(FIRST));
    assert_eq!(
        vehicle.reset(BOB, FIRST),
        Answer::Refused(Refusal::NotHolder)
    );
    assert!(matches!(
        vehicle.events.last(),
        Some(ArbiterEvent::Refused {
            request_kind: OperatorTopic::Reset,
            refusal: Refusal::NotHolder,
            ..
        })
    ));
    assert_eq!(
        vehicle.reset(CAROL, EStopId(0)),
        Answer::Refused(Refusal::OtherEStop)
    );
    let young = std::mem::replace(&mut vehicle.token, before);
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::EStopSince)
    );
    vehicle.token = young;
    vehicle.input(ArbiterInput::EStop(caller(BOB)));
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::EStopSince),
        "Bob asked again"
    );
    vehicle.pass(401);
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::TooOld)
    );
    assert_eq!(vehicle.state.mode, Mode::EStop);

    vehicle.round();
    assert_eq!(vehicle.reset(CAROL, FIRST), Answer::Done);
    assert_eq!((vehicle.state.mode, vehicle.holder()), (Mode::Idle, None));
    assert!(vehicle.actions.contains(&Action::ClearEStop(FIRST)));
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::NoEStop)
    );
}

#[test]
fn after_a_reset_the_holder_asks_lets_go_and_presses() {
    let mut vehicle = Vehicle::driving();
    vehicle.input(ArbiterInput::EStop(caller(ALICE)));
    stored(&mut vehicle);
    vehicle.hold(FORWARD, 5);
    assert_eq!(vehicle.reset(ALICE, FIRST), Answer::Done);
    vehicle.hold(FORWARD, 5);
    assert_eq!(vehicle.state.mode, Mode::Idle);
    assert_eq!(vehicle.lease(ALICE, LeaseVerb::Request), Answer::Granted(2));
    vehicle.hold(FORWARD, 20);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::Held, Velocity::ZERO)
    );
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
    vehicle.input(ArbiterInput::LocalEStop);
    assert_eq!(
        vehicle.report().estop.unwrap().id,
        EStopId(2),
        "another one"
    );
}

#[test]
fn an_operator_alone_can_reset_what_was_found_at_the_start() {
    let found = EStopId(41);
    let mut vehicle = Vehicle::at_boot();
    vehicle.self_test(true, StoredEStop::Latched(found));
    assert_eq!(vehicle.state.mode, Mode::EStop);
    assert!(!vehicle.actions.contains(&Action::StoreEStop(found)));
    vehicle.round();
    assert_eq!(
        vehicle.reset(ALICE, found),
        Answer::Refused(Refusal::NotHolder)
    );
    assert_eq!(vehicle.lease(ALICE, LeaseVerb::Request), Answer::Granted(1));
    assert_eq!(vehicle.state.mode, Mode::EStop);
    assert_eq!(vehicle.reset(ALICE, found), Answer::Done);
    vehicle.input(ArbiterInput::LocalEStop);
    assert_eq!(vehicle.report().estop.unwrap().id, EStopId(42));
}

#[test]
fn what_cannot_be_read_at_the_start_counts_as_a_stop() {
    let mut vehicle = Vehicle::at_boot();
    vehicle.self_test(true, StoredEStop::Unreadable);
    assert_eq!(vehicle.state.mode, Mode::EStop);
    assert!(vehicle.actions.contains(&Action::StoreEStop(FIRST)));
}

#[test]
fn a_stop_during_the_self_test_is_in_force_after_it() {
    let mut vehicle = Vehicle::at_boot();
    vehicle.input(ArbiterInput::EStop(caller(BOB)));
    assert_eq!(vehicle.state.mode, Mode::SafeBoot);
    stored(&mut vehicle);
    assert_eq!(
        vehicle.reset(CAROL, FIRST),
        Answer::Refused(Refusal::NotReady)
    );
    vehicle.self_test(true, StoredEStop::None);
    assert_eq!(vehicle.state.mode, Mode::EStop);
}

#[test]
fn a_take_over_under_way_ends_with_the_supervisor_able_to_reset() {
    let mut vehicle = Vehicle::driving();
    vehicle.lease(CAROL, LeaseVerb::TakeOver);
    vehicle.input(ArbiterInput::EStop(caller(ALICE)));
    assert_eq!(
        (vehicle.state.mode, vehicle.holder()),
        (Mode::EStop, Some(CAROL))
    );
}

#[test]
fn a_fault_is_ended_at_the_vehicle_alone_and_by_a_self_test() {
    let mut vehicle = Vehicle::driving();
    vehicle.input(ArbiterInput::ActuatorFault);
    let fault = Mode::Fault(FaultReason::Actuator);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (fault, Velocity::ZERO)
    );
    assert_eq!(vehicle.holder(), None);
    assert_eq!(
        vehicle.lease(CAROL, LeaseVerb::TakeOver),
        Answer::Refused(Refusal::NotReady)
    );
    vehicle.self_test(true, StoredEStop::None);
    assert_eq!(vehicle.state.mode, fault);
    vehicle.input(ArbiterInput::EStop(caller(BOB)));
    stored(&mut vehicle);
    assert_eq!(vehicle.state.mode, fault);
    vehicle.input(ArbiterInput::LocalReset);
    assert_eq!(vehicle.state.mode, Mode::SafeBoot);
    vehicle.self_test(true, StoredEStop::None);
    assert_eq!(
        vehicle.state.mode,
        Mode::EStop,
        "the fault did not end the stop"
    );
    vehicle.input(ArbiterInput::LocalReset);
    assert_eq!(vehicle.state.mode, Mode::Idle);
}

#[test]
fn a_self_test_that_fails_is_a_fault_at_any_time() {
    for mut vehicle in [Vehicle::at_boot(), Vehicle::idle(), Vehicle::driving()] {
        vehicle.self_test(false, StoredEStop::None);
        assert_eq!(vehicle.state.mode, Mode::Fault(FaultReason::SelfTest));
        assert_eq!(vehicle.output(), Velocity::ZERO);
    }
}
