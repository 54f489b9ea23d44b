use super::*;
use crate::lease::GrantReason;
use protocol::keys::OperatorTopic;
use protocol::message::{Answer, LeaseEnd, Refusal, StopReason};

#[test]
fn nothing_is_granted_before_the_self_test() {
    let mut vehicle = Vehicle::at_boot();
    assert_eq!(
        vehicle.lease(ALICE, LeaseVerb::Request),
        Answer::Refused(Refusal::NotReady)
    );
}

#[test]
fn old_requests_and_onlookers_are_refused() {
    let mut vehicle = Vehicle::idle();
    let token = vehicle.token;
    vehicle.pass(401);
    let verb = LeaseVerb::Request;
    vehicle.input(ArbiterInput::Lease {
        caller: caller(ALICE),
        token,
        verb,
    });
    assert_eq!(vehicle.answer(), Some(Answer::Refused(Refusal::TooOld)));
    let onlooker = Caller {
        role: Role::Observer,
        ..caller(ALICE)
    };
    vehicle.round();
    let token = vehicle.token;
    vehicle.input(ArbiterInput::Lease {
        caller: onlooker,
        token,
        verb,
    });
    assert_eq!(vehicle.answer(), Some(Answer::Refused(Refusal::Role)));
    assert_eq!(vehicle.state.mode, Mode::Idle);
    let refusal = Refusal::Role;
    assert!(vehicle.events.contains(&ArbiterEvent::Refused {
        request_kind: OperatorTopic::Lease,
        caller: onlooker,
        refusal
    }));
}

#[test]
fn a_hand_over_happens_after_the_vehicle_has_stopped() {
    let mut vehicle = Vehicle::driving();
    assert_eq!(vehicle.lease(BOB, LeaseVerb::Request), Answer::Waiting);
    assert!(
        vehicle
            .events
            .contains(&ArbiterEvent::LeaseRequested { by: BOB })
    );
    assert_eq!(
        vehicle.lease(CAROL, LeaseVerb::Request),
        Answer::Refused(Refusal::Busy)
    );
    assert_eq!(
        vehicle.lease(ALICE, LeaseVerb::HandOver { to: CAROL }),
        Answer::Refused(Refusal::NotWaiting)
    );
    assert_eq!(
        vehicle.lease(BOB, LeaseVerb::HandOver { to: BOB }),
        Answer::Refused(Refusal::NotHolder)
    );
    assert_eq!(vehicle.holder(), Some(ALICE));

    assert_eq!(
        vehicle.lease(ALICE, LeaseVerb::HandOver { to: BOB }),
        Answer::Done
    );
    assert_eq!(
        vehicle.stopping(),
        Some(StopReason::LeaseEnded(LeaseEnd::HandedOver))
    );
    assert_eq!(vehicle.holder(), None);
    vehicle.hold(FORWARD, 14);
    assert_eq!(
        (vehicle.holder(), vehicle.refused(Refusal::NotHolder)),
        (None, 15)
    );
    vehicle.round();
    assert_eq!(
        (vehicle.holder(), vehicle.output()),
        (Some(BOB), Velocity::ZERO)
    );
    assert_eq!(vehicle.state.mode, Mode::Held);
    let how = GrantReason::HandOver;
    assert!(vehicle.events.contains(&ArbiterEvent::LeaseGranted {
        to: BOB,
        epoch: 2,
        how
    }));
}

#[test]
fn a_supervisor_takes_over_through_zero() {
    let mut vehicle = Vehicle::driving();
    assert_eq!(
        vehicle.lease(BOB, LeaseVerb::TakeOver),
        Answer::Refused(Refusal::Role)
    );
    assert_eq!(vehicle.state.mode, Mode::Driving);
    assert_eq!(vehicle.lease(CAROL, LeaseVerb::TakeOver), Answer::Waiting);
    assert_eq!(
        vehicle.stopping(),
        Some(StopReason::LeaseEnded(LeaseEnd::TakenOver))
    );
    vehicle.silence(280);
    assert_eq!(vehicle.holder(), None);
    vehicle.round();
    assert_eq!(
        (vehicle.holder(), vehicle.state.mode),
        (Some(CAROL), Mode::Held)
    );
    assert_eq!(vehicle.report().counters.involuntary_stops, 1);
}

#[test]
fn a_supervisor_takes_over_a_standing_vehicle_at_once() {
    let mut vehicle = Vehicle::held();
    vehicle.hold(Velocity::ZERO, 20);
    assert_eq!(
        vehicle.lease(CAROL, LeaseVerb::TakeOver),
        Answer::Granted(2)
    );
    let ended = ArbiterEvent::LeaseEnded {
        operator: ALICE,
        why: LeaseEnd::TakenOver,
    };
    assert!(vehicle.events.contains(&ended));
    // Alice's neutral was hers alone.
    let command = DriveCommand {
        operator: CAROL,
        ..vehicle.command(CAROL, FORWARD)
    };
    vehicle.send(command);
    assert_eq!(vehicle.state.mode, Mode::Held);
}

#[test]
fn giving_the_lease_back_while_driving_stops_first() {
    let mut vehicle = Vehicle::driving();
    assert_eq!(vehicle.lease(ALICE, LeaseVerb::Release), Answer::Done);
    assert_eq!(
        vehicle.stopping(),
        Some(StopReason::LeaseEnded(LeaseEnd::Released))
    );
    vehicle.silence(300);
    assert_eq!(
        (vehicle.state.mode, vehicle.output()),
        (Mode::Idle, Velocity::ZERO)
    );
}

#[test]
fn who_waits_gets_what_is_given_back() {
    let mut vehicle = Vehicle::held();
    assert_eq!(vehicle.lease(BOB, LeaseVerb::Request), Answer::Waiting);
    vehicle.lease(ALICE, LeaseVerb::Release);
    assert_eq!(
        (vehicle.holder(), vehicle.state.mode),
        (Some(BOB), Mode::Held)
    );
}

#[test]
fn who_waits_may_wait_no_longer() {
    let mut vehicle = Vehicle::held();
    assert_eq!(vehicle.lease(BOB, LeaseVerb::Request), Answer::Waiting);
    assert_eq!(vehicle.lease(BOB, LeaseVerb::Release), Answer::Done);
    assert_eq!(vehicle.report().lease.waiting, None);
    assert_eq!(
        vehicle.lease(BOB, LeaseVerb::Release),
        Answer::Refused(Refusal::NotHolder),
        "there is nothing more to leave"
    );
    assert_eq!(vehicle.holder(), Some(ALICE));
    vehicle.lease(ALICE, LeaseVerb::Release);
    assert_eq!((vehicle.holder(), vehicle.state.mode), (None, Mode::Idle));
}

#[test]
fn who_is_next_may_leave_it_to_who_waits() {
    for bob_waits in [false, true] {
        let mut vehicle = Vehicle::driving();
        if bob_waits {
            assert_eq!(vehicle.lease(BOB, LeaseVerb::Request), Answer::Waiting);
        }
        assert_eq!(vehicle.lease(CAROL, LeaseVerb::TakeOver), Answer::Waiting);
        assert_eq!(vehicle.lease(CAROL, LeaseVerb::Release), Answer::Done);
        vehicle.silence(300);
        let after = if bob_waits {
            (Some(BOB), Mode::Held)
        } else {
            (None, Mode::Idle)
        };
        assert_eq!((vehicle.holder(), vehicle.state.mode), after);
        assert_eq!(vehicle.output(), Velocity::ZERO);
    }
}

#[test]
fn a_request_is_forgotten_after_ten_seconds() {
    let mut vehicle = Vehicle::held();
    vehicle.lease(BOB, LeaseVerb::Request);
    vehicle.hold(Velocity::ZERO, 501);
    assert_eq!(vehicle.report().lease.waiting, None);
    vehicle.lease(ALICE, LeaseVerb::Release);
    assert_eq!((vehicle.holder(), vehicle.state.mode), (None, Mode::Idle));
}

#[test]
fn a_lease_that_nobody_renews_expires() {
    let mut vehicle = Vehicle::held();
    vehicle.silence(2000);
    assert_eq!(vehicle.holder(), Some(ALICE));
    vehicle.round();
    assert_eq!((vehicle.holder(), vehicle.state.mode), (None, Mode::Idle));
}

#[test]
fn a_lease_that_expires_while_driving_ends_idle_through_a_stop() {
    let mut vehicle = Vehicle::driving();
    // The loop stood still: one tick sees all limits passed at once.
    vehicle.pass(2001);
    vehicle.input(ArbiterInput::Tick);
    assert_eq!(vehicle.output(), Velocity::ZERO, "the ramp is long over");
    assert_eq!(vehicle.state.mode, Mode::Idle);
    assert!(vehicle.events.contains(&ArbiterEvent::LeaseEnded {
        operator: ALICE,
        why: LeaseEnd::Expired
    }));
}

#[test]
fn a_console_that_was_restarted_begins_anew() {
    let mut vehicle = Vehicle::driving();
    let old = vehicle.command(ALICE, FORWARD);
    assert_eq!(vehicle.lease(ALICE, LeaseVerb::Request), Answer::Waiting);
    assert_eq!(
        vehicle.stopping(),
        Some(StopReason::LeaseEnded(LeaseEnd::Renewed))
    );
    vehicle.silence(300);
    assert_eq!(
        (vehicle.holder(), vehicle.state.lease.epoch),
        (Some(ALICE), 2)
    );
    let token = vehicle.token;
    vehicle.send(DriveCommand { token, ..old });
    assert_eq!(vehicle.refused(Refusal::OtherEpoch), 1);
    // Its numbers start anew.
    vehicle.seq = 0;
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.hold(FORWARD, 1);
    assert_eq!(vehicle.state.mode, Mode::Driving);
}

#[test]
fn who_is_no_longer_an_operator_loses_the_lease() {
    let mut vehicle = Vehicle::driving();
    vehicle.input(ArbiterInput::Revoked(BOB));
    assert_eq!(vehicle.state.mode, Mode::Driving);
    vehicle.input(ArbiterInput::Revoked(ALICE));
    assert_eq!(
        vehicle.stopping(),
        Some(StopReason::LeaseEnded(LeaseEnd::Revoked))
    );
    vehicle.silence(300);
    assert_eq!(vehicle.state.mode, Mode::Idle);
}

#[test]
fn who_is_revoked_before_the_vehicle_stands_is_not_granted_it() {
    let mut vehicle = Vehicle::driving();
    vehicle.lease(BOB, LeaseVerb::Request);
    vehicle.lease(ALICE, LeaseVerb::Release);
    vehicle.input(ArbiterInput::Revoked(BOB));
    vehicle.silence(300);
    assert_eq!((vehicle.holder(), vehicle.state.mode), (None, Mode::Idle));
}
