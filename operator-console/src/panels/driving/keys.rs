//! What becomes of the keys of who drives from here.

use protocol::message::{Arming, TeleopState, TeleopStatus};

use super::guard::makes_stand;
use super::hands::opposed;
use super::words;
use crate::helm::HelmSight;
use crate::theme::Tone;

/// Whether the vehicle does what they say, or when it will.
pub(super) fn keys(teleop: &TeleopStatus, helm: &HelmSight) -> (Tone, &'static str) {
    match teleop.state {
        // That all were let go is true then too, and sounds as if a press would count.
        TeleopState::EStop => (Tone::Warning, "Do nothing until the reset"),
        TeleopState::Fault(_) => (Tone::Warning, "Do nothing while it is at fault"),
        TeleopState::SafeBoot => (Tone::Waiting, "Do nothing before its self-test"),
        TeleopState::Stopping(_) if teleop.arming == Arming::Pressed => {
            (Tone::Waiting, "Obeyed once it has slowed down")
        }
        TeleopState::Driving if teleop.arming == Arming::Pressed && makes_stand(teleop) => {
            (Tone::Warning, "Held back by the guard")
        }
        TeleopState::Idle | TeleopState::Held | TeleopState::Driving | TeleopState::Stopping(_) => {
            heeded(teleop.arming, helm)
        }
    }
}

/// Of a vehicle that heeds them.
fn heeded(arming: Arming, helm: &HelmSight) -> (Tone, &'static str) {
    // The vehicle would obey, and hears nothing: the keyboard is another window's, or a field's.
    let is_elsewhere = !helm.is_ready && helm.ignored.is_none();
    let told = words::arming(arming);
    match arming {
        Arming::Locked | Arming::Neutral if is_elsewhere => {
            (Tone::Warning, "Go elsewhere: click into the map")
        }
        Arming::Locked => (Tone::Warning, told),
        // What is held down here is not sent: the vehicle does not know of it.
        Arming::Neutral if helm.ignored.is_some() => (Tone::Warning, words::arming(Arming::Locked)),
        // To the vehicle they were let go, and what stands for that sounds as if none were held.
        Arming::Neutral if opposed(helm).is_some() => (Tone::Waiting, "Ask for nothing together"),
        Arming::Neutral => (Tone::Waiting, told),
        Arming::Pressed => (Tone::Good, told),
    }
}
