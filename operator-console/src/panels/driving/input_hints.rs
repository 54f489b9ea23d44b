//! Hands that get nowhere by what they ask for at once, and what to do about it.

use protocol::message::{CollisionMonitorState, TeleopStatus, Velocity};

use super::guard::{allowed, is_stopped_by_monitor};
use crate::model::{MIN_SHOWN_MPS, MIN_SHOWN_RADPS};
use crate::teleop_client::TeleopClientState;
use crate::teleop_input::DriveKey;

const FORWARD: [DriveKey; 2] = [DriveKey::W, DriveKey::Up];
const BACK: [DriveKey; 2] = [DriveKey::S, DriveKey::Down];
const LEFT: [DriveKey; 2] = [DriveKey::A, DriveKey::Left];
const RIGHT: [DriveKey; 2] = [DriveKey::D, DriveKey::Right];

/// That keys are held which take each other back, and nothing else: to the vehicle all are let go.
pub(super) fn opposing_keys(teleop_client: &TeleopClientState) -> Option<String> {
    if !teleop_client.drive_input.is_neutral() {
        return None;
    }
    let first = |keys: [DriveKey; 2]| {
        keys.into_iter()
            .find(|key| teleop_client.keys.contains(key))
    };
    let [one, other] = [[FORWARD, BACK], [LEFT, RIGHT]]
        .into_iter()
        .find_map(|[one, other]| Some([first(one)?, first(other)?]))?;
    Some(format!(
        "{} and {} at once cancel out",
        name(one),
        name(other)
    ))
}

/// How a vehicle comes to turn that the guard makes stand because it is asked to go as well: it holds back both alike,
/// so that the arc keeps its shape. `None` where it lets it go that way.
pub(super) fn turn_only_hint(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    is_boat: bool,
) -> Option<String> {
    let Velocity {
        linear_mps,
        angular_radps,
    } = teleop.requested;
    let is_asked = linear_mps.abs() >= MIN_SHOWN_MPS && angular_radps.abs() >= MIN_SHOWN_RADPS;
    // The hands may have changed since the robot told.
    let is_so_now = teleop_client.drive_input.forward * linear_mps > 0.0
        && teleop_client.drive_input.left * angular_radps > 0.0;
    let sees = matches!(
        teleop.collision_monitor,
        CollisionMonitorState::On(_) | CollisionMonitorState::UnknownSpace(_)
    );
    let [going, turning] = allowed(teleop.collision_monitor, teleop.requested);
    // What is asked for at once it holds back alike: whether the turn alone is free it has not said then.
    let is_held_by_way = sees && going < MIN_SHOWN_MPS;
    let is_turn_free = turning >= MIN_SHOWN_RADPS;
    if !(is_stopped_by_monitor(teleop) && is_asked && is_so_now && is_held_by_way) {
        return None;
    }
    if teleop_client.keys.is_empty() {
        return Some(if is_turn_free {
            "Request the turn alone".to_owned()
        } else {
            "Request motion or turn alone: one may be free".to_owned()
        });
    }
    // A boat drifts meanwhile.
    let turn = if is_boat { "turn" } else { "turn on the spot" };
    let keys = held(teleop_client, [FORWARD, BACK]);
    Some(if is_turn_free {
        format!("Release {keys} to {turn}")
    } else {
        let turns = held(teleop_client, [LEFT, RIGHT]);
        format!("Release {keys}, or of {turns}: one alone may be free")
    })
}

/// Those of the keys that are held.
fn held(teleop_client: &TeleopClientState, keys: [[DriveKey; 2]; 2]) -> String {
    let keys = keys.into_iter().flatten();
    let names: Vec<_> = keys
        .filter(|key| teleop_client.keys.contains(key))
        .map(name)
        .collect();
    names.join(" and ")
}

/// As the table of keys names it.
const fn name(key: DriveKey) -> &'static str {
    match key {
        DriveKey::W => "W",
        DriveKey::A => "A",
        DriveKey::S => "S",
        DriveKey::D => "D",
        DriveKey::Up => "Up",
        DriveKey::Left => "Left",
        DriveKey::Down => "Down",
        DriveKey::Right => "Right",
    }
}
