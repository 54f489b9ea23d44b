//! Which physical key does what.

use winit::keyboard::{KeyCode, PhysicalKey};

use crate::teleop_input::{DriveKey, SpeedStep};

/// What a key does at the helm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TeleopKey {
    /// It drives while it is held.
    Drive(DriveKey),
    /// It says how fast the others do.
    Step(SpeedStep),
    /// It stops for good.
    EStop,
}

const DRIVE: [(KeyCode, DriveKey); 8] = [
    (KeyCode::KeyW, DriveKey::W),
    (KeyCode::KeyA, DriveKey::A),
    (KeyCode::KeyS, DriveKey::S),
    (KeyCode::KeyD, DriveKey::D),
    (KeyCode::ArrowUp, DriveKey::Up),
    (KeyCode::ArrowLeft, DriveKey::Left),
    (KeyCode::ArrowDown, DriveKey::Down),
    (KeyCode::ArrowRight, DriveKey::Right),
];

/// Step 1 first.
const STEPS: [[KeyCode; 2]; SpeedStep::COUNT as usize] = [
    [KeyCode::Digit1, KeyCode::Numpad1],
    [KeyCode::Digit2, KeyCode::Numpad2],
    [KeyCode::Digit3, KeyCode::Numpad3],
    [KeyCode::Digit4, KeyCode::Numpad4],
    [KeyCode::Digit5, KeyCode::Numpad5],
];

/// What the key at this place of the keyboard does, whatever is printed on it.
pub(super) fn teleop_key(key: PhysicalKey) -> Option<TeleopKey> {
    let PhysicalKey::Code(code) = key else {
        return None;
    };
    if code == KeyCode::Space {
        return Some(TeleopKey::EStop);
    }
    let drive = DRIVE.into_iter().find(|(at, _)| *at == code);
    let mut steps = STEPS.iter().zip(SpeedStep::all());
    let step = steps.find(|(at, _)| at.contains(&code));
    drive
        .map(|(_, key)| TeleopKey::Drive(key))
        .or_else(|| step.map(|(_, step)| TeleopKey::Step(step)))
}

#[cfg(test)]
mod tests {
    use winit::keyboard::NativeKeyCode;

    use super::*;

    #[test]
    fn every_key_that_drives_is_somewhere_once() {
        let keys: Vec<_> = DRIVE.iter().map(|(_, key)| *key).collect();
        assert_eq!(keys, DriveKey::ALL);
        let of = |code| teleop_key(PhysicalKey::Code(code));
        assert_eq!(of(KeyCode::Space), Some(TeleopKey::EStop));
        for key in [KeyCode::Digit4, KeyCode::Numpad4] {
            assert_eq!(of(key), SpeedStep::new(4).map(TeleopKey::Step));
        }
        assert_eq!(of(KeyCode::KeyF), None, "it is the map's");
        let unknown = PhysicalKey::Unidentified(NativeKeyCode::Xkb(38));
        assert_eq!(teleop_key(unknown), None);
    }
}
