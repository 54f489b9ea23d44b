//! Why a lease was lost.

use protocol::message::{Event, Severity};

use super::*;

/// What is said of a lease that was lost, where these events were heard: kinds and words, the oldest first.
fn told(events: &[(&str, &str)]) -> Option<String> {
    let mut rig = Rig::new();
    rig.teleop_client.notice = Some(TeleopNotification::LeaseLost);
    let mut model = rig.model();
    for (kind, message) in events {
        let event = Event {
            kind: (*kind).to_owned(),
            severity: Severity::Info,
            message: (*message).to_owned(),
        };
        inject(&mut model, Topic::Event, &event, at(1_000));
    }
    DrivingData::new(&model, &rig.teleop_client, rig.now)
        .unwrap()
        .notice
}

#[test]
fn a_lease_that_is_lost_says_why_where_the_robot_has_told() {
    const GRANTED: (&str, &str) = ("lease_granted", "anna drives: asked and the lease was free");
    const REVOKED: (&str, &str) = (
        "lease_ended",
        "anna no longer drives: the leave to drive was taken away",
    );
    let idle = ("teleop_state", "nobody drives");
    let of_others = ("lease_ended", "annabel no longer drives: no command came");
    let why = "Lease lost: the leave to drive was taken away";
    for (events, says) in [
        (vec![GRANTED, REVOKED, idle, of_others], why),
        // The end that was heard is an earlier one's.
        (vec![REVOKED, GRANTED], "Lease lost"),
        (vec![of_others], "Lease lost"),
    ] {
        assert_eq!(told(&events).as_deref(), Some(says), "{events:?}");
    }
}
