//! What the large words and the row of the keys say while a key is held: the same.

use super::*;
use crate::panels::driving::labels::stuck;

const GUARDED: SpeedLimits = SpeedLimits {
    forward_mps: 0.0,
    reverse_mps: f32::INFINITY,
    left_radps: f32::INFINITY,
    right_radps: f32::INFINITY,
};

/// Headline, advice and keys.
fn said(rig: &Rig) -> (String, Option<String>, String) {
    let data = rig.data();
    let (_, keys) = rig.row("Keys").unwrap();
    (data.headline, data.advice, keys)
}

fn words([headline, advice, keys]: [&str; 3]) -> (String, Option<String>, String) {
    (
        headline.to_owned(),
        Some(advice.to_owned()),
        keys.to_owned(),
    )
}

#[test]
fn a_key_that_is_pressed_during_a_stop_counts_when_that_is_over() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::Stopping(StopReason::Released);
    rig.teleop.requested.linear_mps = -0.8;
    rig.teleop_client.drive_input.forward = -0.8;
    let slows = "Slows down first, then follows the keys";
    let later = "Active once it has slowed down";
    assert_eq!(said(&rig), words(["Stopping", slows, later]));
    rig.teleop.arming = Arming::Neutral;
    assert_eq!(said(&rig), words(["Stopping", "Keys released", "Ready"]));
}

#[test]
fn a_vehicle_that_the_guard_makes_stand_is_not_said_to_drive() {
    let mut rig = Rig::driving();
    rig.teleop.collision_monitor = CollisionMonitorState::On(GUARDED);
    let drives = "W A S D or arrows drive while held";
    assert_eq!(said(&rig), words(["Driving", drives, "Active"]));
    rig.teleop.applied.linear_mps = 0.0;
    let stands = "Stopped by the collision monitor";
    let held = "Limited by the monitor";
    assert_eq!(said(&rig), words(["Motion blocked", stands, held]));
    assert_eq!(rig.data().tone, Tone::Warning);
    assert_eq!(rig.row("Keys").unwrap().0, Tone::Warning);
    rig.is_boat = true;
    let no_thrust = "No thrust: stopped by the collision monitor";
    assert_eq!(said(&rig), words(["Motion blocked", no_thrust, held]));
    // It has only begun to go.
    rig.teleop.clamp = Some(Clamp::Ramp);
    assert_eq!(said(&rig).0, "Driving");
    // It turns.
    rig.teleop.clamp = Some(Clamp::CollisionMonitor);
    rig.teleop.applied.angular_radps = 0.3;
    assert_eq!(said(&rig).0, "Driving");
}

#[test]
fn during_an_emergency_stop_nothing_looks_as_if_one_might_go() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::EStop;
    rig.teleop.collision_monitor = CollisionMonitorState::On(SpeedLimits {
        forward_mps: f32::INFINITY,
        ..GUARDED
    });
    rig.velocity = [0.0; 2];
    for arming in [Arming::Locked, Arming::Neutral] {
        for is_ready in [true, false] {
            rig.teleop.arming = arming;
            rig.teleop_client.is_ready = is_ready;
            let nothing = (Tone::Warning, "Ignored until the reset".to_owned());
            assert_eq!(rig.row("Keys"), Some(nothing));
        }
    }
    assert_eq!(rig.row("Guard"), Some((Tone::Good, "On".to_owned())));
    rig.teleop.collision_monitor = CollisionMonitorState::UnknownSpace(GUARDED);
    let blind = (Tone::Warning, "Unknown ground".to_owned());
    assert_eq!(rig.row("Guard"), Some(blind));
}

#[test]
fn a_boat_that_was_stopped_lies_still_in_the_same_words_however_it_is_measured() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::EStop;
    for (is_boat, says) in [
        (
            true,
            ["Motors are stopped until the reset. Wind and current may move it"; 2],
        ),
        (
            false,
            [
                "Motors are stopped until the reset.",
                "Commanded to stand, but moving: 0.11 m/s",
            ],
        ),
    ] {
        rig.is_boat = is_boat;
        for (speed_mps, says) in [0.04, 0.11].into_iter().zip(says) {
            rig.velocity = [speed_mps, 0.0];
            assert_eq!(rig.data().advice.as_deref(), Some(says), "{is_boat}");
        }
    }
}

#[test]
fn what_a_key_changes_moves_no_button() {
    let place = |state: TeleopState, is_drifting| {
        let mut rig = Rig::driving();
        rig.teleop.state = state;
        rig.teleop.is_drifting = is_drifting;
        rig.is_boat = true;
        let data = rig.data();
        let mut window = Harness::builder()
            .with_size(vec2(280.0, 800.0))
            .build_ui(move |ui| {
                driving_ui(ui, &data, &mut DrivingEntry::default());
            });
        crate::theme::set(&window.ctx);
        window.run_steps(3);
        ["Release control", "3"].map(|label| window.get_by_label(label).rect())
    };
    let driving = place(TeleopState::Driving, false);
    assert_eq!(place(TeleopState::Held, true), driving, "two lines");
    let stopping = TeleopState::Stopping(StopReason::Released);
    assert_eq!(place(stopping, false), driving);
}

#[test]
fn keys_that_are_held_and_not_sent_are_to_be_let_go_in_every_line() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::Held;
    rig.velocity = [0.0; 2];
    rig.teleop.arming = Arming::Neutral;
    rig.teleop_client.ignored = Some(InputLockReason::Stopped);
    let (_, advice, keys) = said(&rig);
    assert!(advice.unwrap().starts_with("Release all keys"));
    assert_eq!(keys, "Release everything");
}

#[test]
fn a_vehicle_that_is_told_to_go_and_does_not_is_said_to_be_stuck() {
    let mut rig = Rig::driving();
    rig.velocity = [-0.05, 0.0];
    rig.teleop.clamp = Some(Clamp::Ramp);
    let said_after = |rig: &Rig, ms: u64| {
        let mut model = rig.model();
        let (status, _) = model.status().unwrap().clone();
        let (pose, _) = model.vehicle().pose().unwrap();
        inject(&mut model, Topic::Pose, &pose, at(1_000 + ms));
        inject(&mut model, Topic::Status, &status, at(1_000 + ms));
        let data = DrivingData::new(&model, &rig.teleop_client, at(1_100 + ms)).unwrap();
        (data.headline, data.tone, data.advice.unwrap())
    };
    assert_eq!(said_after(&rig, 1_000).0, "Driving");
    let (headline, tone, advice) = said_after(&rig, 3_000);
    assert_eq!((headline.as_str(), tone), ("Not moving", Tone::Warning));
    // As the alert and the event say it.
    assert!(advice.ends_with(stuck(false)[0]), "{advice}");
    rig.is_boat = true;
    assert!(said_after(&rig, 3_000).2.ends_with(stuck(true)[0]));
    rig.velocity = [0.3, 0.0];
    assert_eq!(said_after(&rig, 3_000).0, "Driving");
}
