//! Headline, advice and key state while keys are held.

use super::*;
use crate::panels::driving::labels::stuck;
use crate::teleop_input::DriveKey::{self, A, D, Left, Right, S, Up, W};

/// Held keys at a standing vehicle, with their input: forward and left.
fn holding(keys: &[DriveKey], [forward, left]: [f32; 2]) -> Rig {
    let mut rig = Rig::driving();
    rig.velocity = [0.0; 2];
    rig.teleop_client.keys = keys.to_vec();
    rig.teleop_client.drive_input = DriveInput {
        forward,
        sideways: 0.0,
        left,
    };
    rig
}

#[test]
fn opposing_keys_are_not_shown_as_released() {
    for state in [
        TeleopState::Driving,
        TeleopState::Stopping(StopReason::Released),
        TeleopState::Held,
    ] {
        for keys in [[W, S], [A, D], [S, Up], [Left, Right]] {
            let mut rig = holding(&keys, [0.0; 2]);
            rig.teleop.state = state;
            rig.teleop.arming = Arming::Neutral;
            let advice = "Opposing keys cancel each other out";
            assert_eq!(rig.data().advice.as_deref(), Some(advice), "{state:?}");
            let keys = Some((Tone::Waiting, "Cancel each other out".to_owned()));
            assert_eq!(rig.row("Keys"), keys, "{state:?}");
        }
    }
}

#[test]
fn opposing_keys_hide_no_other_reason() {
    let mut rig = holding(&[W, S], [0.0; 2]);
    rig.teleop.arming = Arming::Neutral;
    rig.teleop.state = TeleopState::Stopping(StopReason::Age);
    assert_eq!(rig.data().advice.as_deref(), Some("Commands too old"));
    rig.teleop.state = TeleopState::Held;
    rig.teleop.collision_monitor = CollisionMonitorState::Stale;
    assert!(rig.data().advice.unwrap().starts_with("The monitor's data"));
    let turning = holding(&[W, S, A], [0.0, 0.4]);
    let drives = "W A S D or arrows drive while held";
    assert_eq!(turning.data().advice.as_deref(), Some(drives));
}

#[test]
fn a_blocked_arc_suggests_driving_or_turning_alone() {
    let alone = "Stopped by the collision monitor: try one direction alone";
    for (requested, is_boat, advice) in [
        ([0.4, 0.4], false, alone),
        ([-0.4, -0.4], true, alone),
        ([0.4, 0.0], false, "Stopped by the collision monitor"),
        (
            [0.0, 0.4],
            true,
            "No thrust: stopped by the collision monitor",
        ),
    ] {
        let mut rig = holding(&[W], requested);
        rig.is_boat = is_boat;
        rig.request(requested);
        rig.teleop.applied.linear_mps = 0.0;
        let data = rig.data();
        assert_eq!(data.headline, "Motion blocked", "{requested:?}");
        assert_eq!(data.advice.as_deref(), Some(advice), "{requested:?}");
    }
}

fn texts(rig: &Rig) -> (String, Option<String>, String) {
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
fn a_key_pressed_while_stopping_counts_afterwards() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::Stopping(StopReason::Released);
    rig.teleop.requested.linear_mps = -0.8;
    rig.teleop_client.drive_input.forward = -0.8;
    let slows = "Slows down first, then follows the keys";
    let later = "Active once it has slowed down";
    assert_eq!(texts(&rig), words(["Stopping", slows, later]));
    rig.teleop.arming = Arming::Neutral;
    assert_eq!(texts(&rig), words(["Stopping", "Keys released", "Ready"]));
}

#[test]
fn a_vehicle_stopped_by_the_monitor_does_not_drive() {
    let mut rig = Rig::driving();
    rig.teleop.collision_monitor = CollisionMonitorState::On(ahead(0.0));
    let drives = "W A S D or arrows drive while held";
    assert_eq!(texts(&rig), words(["Driving", drives, "Active"]));
    rig.teleop.applied.linear_mps = 0.0;
    let stands = "Stopped by the collision monitor";
    let held = "Limited by the monitor";
    assert_eq!(texts(&rig), words(["Motion blocked", stands, held]));
    assert_eq!(rig.data().tone, Tone::Warning);
    assert_eq!(rig.row("Keys").unwrap().0, Tone::Warning);
    rig.is_boat = true;
    let no_thrust = "No thrust: stopped by the collision monitor";
    assert_eq!(texts(&rig), words(["Motion blocked", no_thrust, held]));
    rig.teleop.clamp = Some(Clamp::Ramp);
    assert_eq!(texts(&rig).0, "Driving");
    rig.teleop.clamp = Some(Clamp::CollisionMonitor);
    rig.teleop.applied.angular_radps = 0.3;
    assert_eq!(texts(&rig).0, "Driving");
}

#[test]
fn an_emergency_stop_shows_no_free_direction() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::EStop;
    rig.teleop.collision_monitor = CollisionMonitorState::On(UNLIMITED);
    rig.velocity = [0.0; 2];
    for arming in [Arming::Locked, Arming::Neutral] {
        for is_ready in [true, false] {
            rig.teleop.arming = arming;
            rig.teleop_client.is_ready = is_ready;
            assert_eq!(rig.row("Keys"), Some(warning("Ignored until the reset")));
        }
    }
    assert_eq!(rig.row("Monitor"), Some((Tone::Good, "On".to_owned())));
    rig.teleop.collision_monitor = CollisionMonitorState::UnknownSpace(ahead(0.0));
    assert_eq!(rig.row("Monitor"), Some(warning("Unknown ground")));
}

#[test]
fn a_stopped_boat_has_no_warning_for_slow_motion() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::EStop;
    for (is_boat, advice) in [
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
        for (speed_mps, advice) in [0.04, 0.11].into_iter().zip(advice) {
            rig.velocity = [speed_mps, 0.0];
            assert_eq!(rig.data().advice.as_deref(), Some(advice), "{is_boat}");
        }
    }
}

#[test]
fn changed_advice_moves_no_button() {
    let place = |state: TeleopState, is_drifting| {
        let mut rig = Rig::driving();
        rig.teleop.state = state;
        rig.teleop.is_drifting = is_drifting;
        rig.is_boat = true;
        let window = rig.window([280.0, 800.0]);
        ["Release control", "3"].map(|label| window.get_by_label(label).rect())
    };
    let driving = place(TeleopState::Driving, false);
    assert_eq!(place(TeleopState::Held, true), driving);
    let stopping = TeleopState::Stopping(StopReason::Released);
    assert_eq!(place(stopping, false), driving);
}

#[test]
fn held_keys_that_are_not_sent_are_to_be_released() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::Held;
    rig.velocity = [0.0; 2];
    rig.teleop.arming = Arming::Neutral;
    rig.teleop_client.ignored = Some(InputLockReason::Stopped);
    let (_, advice, keys) = texts(&rig);
    assert!(advice.unwrap().starts_with("Release all keys"));
    assert_eq!(keys, "Release everything");
}

#[test]
fn a_vehicle_that_does_not_move_is_shown_as_stuck() {
    let mut rig = Rig::driving();
    rig.velocity = [-0.05, 0.0];
    rig.teleop.clamp = Some(Clamp::Ramp);
    let shown_after = |rig: &Rig, ms: u64| {
        let mut model = rig.model();
        let (status, _) = model.status().unwrap().clone();
        let (pose, _) = model.vehicle().pose().unwrap();
        inject(&mut model, Topic::Pose, &pose, at(1_000 + ms));
        inject(&mut model, Topic::Status, &status, at(1_000 + ms));
        let data = DrivingData::new(&model, &rig.teleop_client, at(1_100 + ms)).unwrap();
        (data.headline, data.tone, data.advice.unwrap())
    };
    assert_eq!(shown_after(&rig, 1_000).0, "Driving");
    let (headline, tone, advice) = shown_after(&rig, 3_000);
    assert_eq!((headline.as_str(), tone), ("Not moving", Tone::Warning));
    assert!(advice.ends_with(stuck(false)[0]), "{advice}");
    rig.is_boat = true;
    assert!(shown_after(&rig, 3_000).2.ends_with(stuck(true)[0]));
    rig.velocity = [0.3, 0.0];
    assert_eq!(shown_after(&rig, 3_000).0, "Driving");
}
