//! Vehicles that were told to stand a moment ago, and such as have taken their leave.

use super::*;
use crate::test_support::pose_at_rest;

/// Anna has driven until the guard stopped it, and lets go of the key; it still moves at this time, ms.
fn lets_go(model: &mut ConsoleModel, ms: u64) {
    let pose = Pose {
        speed_mps: 0.4,
        ..pose_at_rest()
    };
    let mut teleop = idle_teleop_status();
    teleop.state = TeleopState::Held;
    let status = Status {
        teleop: Some(teleop),
        ..Status::default()
    };
    inject(model, Topic::Pose, &pose, at(ms));
    inject(model, Topic::Status, &status, at(ms));
}

#[test]
fn a_vehicle_that_has_just_been_stopped_is_stopping_and_does_not_move_untold() {
    let mut model = Rig::driving().model();
    let headline = |model: &ConsoleModel, ms| {
        let data = DrivingData::new(model, &idle_teleop_client(), at(ms)).unwrap();
        (data.headline, data.tone)
    };
    lets_go(&mut model, 1_200);
    let stopping = ("Stopping".to_owned(), Tone::Waiting);
    assert_eq!(headline(&model, 1_300), stopping);
    // It has had its time.
    lets_go(&mut model, 2_300);
    let unexpected_motion = ("Moving without command".to_owned(), Tone::Warning);
    assert_eq!(headline(&model, 2_300), unexpected_motion);
}

#[test]
fn a_vehicle_that_has_taken_its_leave_has_ended_and_lost_no_link() {
    let mut model = Rig::new().model();
    let status = Status {
        has_ended: true,
        teleop: Some(idle_teleop_status()),
        ..Status::default()
    };
    inject(&mut model, Topic::Status, &status, at(1_200));
    let data = DrivingData::new(&model, &idle_teleop_client(), at(9_000)).unwrap();
    let headline = (data.headline.as_str(), data.tone);
    assert_eq!(headline, ("Its data has ended", Tone::Waiting));
    let advice = data.advice.unwrap();
    assert!(
        advice.contains("for 8.0 s: robot-edge has closed"),
        "{advice}"
    );
}
