//! Hands that get nowhere by what they ask for at once.

use super::*;
use crate::teleop_input::DriveKey::{self, A, D, Down, Left, Right, S, Up, W};

const FREE: f32 = f32::INFINITY;

/// Keys that are held at a vehicle that stands, and what they ask for: forwards and to the left.
fn holding(keys: &[DriveKey], [forward, left]: [f32; 2]) -> Rig {
    let mut rig = Rig::driving();
    rig.velocity = [0.0; 2];
    rig.teleop_client.keys = keys.to_vec();
    rig.teleop_client.drive_input = DriveInput { forward, left };
    rig
}

#[test]
fn keys_that_take_each_other_back_are_not_said_to_be_let_go() {
    let nothing = Some((Tone::Waiting, "Cancel each other out".to_owned()));
    for state in [
        TeleopState::Driving,
        TeleopState::Stopping(StopReason::Released),
        TeleopState::Held,
    ] {
        for (keys, says) in [
            (&[W, S][..], "W and S at once cancel out"),
            (&[A, D], "A and D at once cancel out"),
            (&[S, Up], "Up and S at once cancel out"),
            (&[Left, Right], "Left and Right at once cancel out"),
        ] {
            let mut rig = holding(keys, [0.0; 2]);
            rig.teleop.state = state;
            rig.teleop.arming = Arming::Neutral;
            assert_eq!(rig.data().advice.as_deref(), Some(says), "{state:?}");
            assert_eq!(rig.row("Keys"), nothing, "{state:?}");
        }
    }
}

#[test]
fn keys_that_take_each_other_back_hide_no_other_reason() {
    let mut rig = holding(&[W, S], [0.0; 2]);
    rig.teleop.arming = Arming::Neutral;
    rig.teleop.state = TeleopState::Stopping(StopReason::Age);
    assert_eq!(rig.data().advice.as_deref(), Some("Commands too old"));
    rig.teleop.state = TeleopState::Held;
    rig.teleop.collision_monitor = CollisionMonitorState::Stale;
    assert!(rig.data().advice.unwrap().starts_with("The guard's data"));
    // The turn is asked for all the same.
    let turning = holding(&[W, S, A], [0.0, 0.4]);
    let drives = "W A S D or arrows drive while held";
    assert_eq!(turning.data().advice.as_deref(), Some(drives));
}

/// Anna holds these keys, or a stick where there are none, and the guard makes the vehicle stand: it allows so much
/// forwards and back, m/s, and to the left and right, rad/s.
fn held(keys: &[DriveKey], drive_input: [f32; 2], limits: [f32; 4]) -> Rig {
    let mut rig = holding(keys, drive_input);
    let [forward_mps, reverse_mps, left_radps, right_radps] = limits;
    rig.teleop.collision_monitor = CollisionMonitorState::On(SpeedLimits {
        forward_mps,
        reverse_mps,
        left_radps,
        right_radps,
    });
    [
        rig.teleop.requested.linear_mps,
        rig.teleop.requested.angular_radps,
    ] = drive_input;
    rig.teleop.applied.linear_mps = 0.0;
    rig
}

#[test]
fn a_vehicle_that_is_held_and_could_turn_says_what_to_let_go_of() {
    let ahead = [0.0, FREE, FREE, 0.0];
    let behind = [FREE, 0.0, FREE, 0.2];
    let stands = "Stopped by the collision monitor";
    for (keys, drive_input, limits, says) in [
        (
            &[W, A][..],
            [0.4, 0.4],
            ahead,
            "Release W to turn on the spot",
        ),
        (
            &[W, Up, A],
            [0.4, 0.4],
            ahead,
            "Release W and Up to turn on the spot",
        ),
        (
            &[Right, Down],
            [-0.4, -0.4],
            behind,
            "Release Down to turn on the spot",
        ),
        (&[], [0.4, 0.4], ahead, "Request the turn alone"),
        // The turn is held as well, or only while it is asked for together with the way.
        (
            &[W, D],
            [0.4, -0.4],
            ahead,
            "Release W, or of D: one alone may be free",
        ),
        (
            &[],
            [0.4, -0.4],
            ahead,
            "Request motion or turn alone: one may be free",
        ),
        // Nothing is to turn.
        (&[W], [0.4, 0.0], ahead, stands),
        // It is not the way that holds it.
        (&[W, A], [0.4, 0.4], behind, stands),
    ] {
        let rig = held(keys, drive_input, limits);
        let data = rig.data();
        assert_eq!(data.headline, "Motion blocked", "{keys:?}");
        assert_eq!(data.advice.as_deref(), Some(says), "{keys:?} {limits:?}");
    }
    let mut let_go = held(&[A], [0.4, 0.4], ahead);
    let_go.teleop_client.drive_input.forward = 0.0;
    assert_eq!(
        let_go.data().advice.as_deref(),
        Some(stands),
        "of W, by now"
    );
    let mut boat = held(&[W, A], [0.4, 0.4], ahead);
    boat.is_boat = true;
    assert_eq!(boat.data().advice.as_deref(), Some("Release W to turn"));
}
