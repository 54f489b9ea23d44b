//! Keys that are down when the lease ends, or is granted anew: what is said of them is true.

use super::*;

/// What was noted since the last call.
fn notes(rig: &mut Rig) -> Vec<Note> {
    let notes = rig.helm.take_notes().into_iter();
    notes.map(|(_, note)| note).collect()
}

/// A key drives that was pressed after the grant.
fn driving() -> Rig {
    let mut rig = Rig::held();
    rig.turn(&[W]);
    rig.run(100);
    assert!(rig.moves());
    notes(&mut rig);
    rig
}

#[test]
fn of_a_lease_that_ends_with_a_key_down_the_end_alone_is_said() {
    type End = fn(&mut Rig);
    let ends: [(End, Note); 3] = [
        (|rig| rig.ask(LeaseRequest::Release), Note::LeaseGivenBack),
        (
            |rig| rig.status(|status| status.lease.holder = None),
            Note::LeaseLost,
        ),
        (
            |rig| rig.status(|status| status.lease.epoch = 5),
            Note::LeaseLost,
        ),
    ];
    for (end, note) in ends {
        let mut rig = driving();
        end(&mut rig);
        rig.run(100);
        assert_eq!(notes(&mut rig), [note]);
        assert!(!rig.moves());
    }
}

#[test]
fn a_key_that_is_down_when_the_first_grant_comes_was_down_before() {
    for waits in [false, true] {
        let mut rig = Rig::new();
        rig.ask(LeaseRequest::Request);
        rig.run(20);
        if waits {
            rig.answer(Answer::Waiting);
            rig.run(20);
        }
        notes(&mut rig);
        // It comes before the queue that this is in has been dealt with.
        rig.helm.apply(W);
        if waits {
            rig.status(|status| status.lease.epoch = 5);
        } else {
            rig.answer(Answer::Granted(5));
        }
        let lost = Note::Lost(Loss::Lease);
        assert!(notes(&mut rig).contains(&lost), "{waits}");
    }
}

#[test]
fn a_key_that_drove_by_another_grant_was_not_down_before_anybody_drove() {
    let mut rig = driving();
    rig.ask(LeaseRequest::Request);
    rig.run(20);
    rig.answer(Answer::Granted(5));
    let granted = Note::Answered(Asked::Lease(LeaseRequest::Request), Answer::Granted(5));
    let lost = Note::Lost(Loss::Renewed);
    assert_eq!(notes(&mut rig), [granted, lost, Note::LeaseGained(5)]);
    rig.run(500);
    assert_eq!(rig.helm.sight(at(rig.ms)).ignored, Some(Loss::Renewed));
}
