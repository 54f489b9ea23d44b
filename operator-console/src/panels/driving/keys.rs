//! What becomes of the keys of who drives from here.

use protocol::message::{Arming, TeleopState, TeleopStatus};

use super::guard::is_stopped_by_monitor;
use super::input_hints::opposing_keys;
use super::labels;
use crate::teleop_client::TeleopClientState;
use crate::theme::Tone;

/// Whether the vehicle does what they say, or when it will.
pub(super) fn keys(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
) -> (Tone, &'static str) {
    match teleop.state {
        // That all were let go is true then too, and sounds as if a press would count.
        TeleopState::EStop => (Tone::Warning, "Ignored until the reset"),
        TeleopState::Fault(_) => (Tone::Warning, "Ignored while in fault"),
        TeleopState::SafeBoot => (Tone::Waiting, "Ignored before the self-test"),
        TeleopState::Stopping(_) if teleop.arming == Arming::Pressed => {
            (Tone::Waiting, "Active once it has slowed down")
        }
        TeleopState::Driving
            if teleop.arming == Arming::Pressed && is_stopped_by_monitor(teleop) =>
        {
            (Tone::Warning, "Limited by the monitor")
        }
        TeleopState::Idle | TeleopState::Held | TeleopState::Driving | TeleopState::Stopping(_) => {
            arming_text(teleop.arming, teleop_client)
        }
    }
}

/// Of a vehicle that heeds them.
fn arming_text(arming: Arming, teleop_client: &TeleopClientState) -> (Tone, &'static str) {
    // The vehicle would obey, and hears nothing: the keyboard is another window's, or a field's.
    let is_elsewhere = !teleop_client.is_ready && teleop_client.ignored.is_none();
    let arming_label = labels::arming(arming);
    match arming {
        Arming::Locked | Arming::Neutral if is_elsewhere => {
            (Tone::Warning, "No focus: click into the map")
        }
        Arming::Locked => (Tone::Warning, arming_label),
        // What is held down here is not sent: the vehicle does not know of it.
        Arming::Neutral if teleop_client.ignored.is_some() => {
            (Tone::Warning, labels::arming(Arming::Locked))
        }
        // To the vehicle they were let go, and what stands for that sounds as if none were held.
        Arming::Neutral if opposing_keys(teleop_client).is_some() => {
            (Tone::Waiting, "Cancel each other out")
        }
        Arming::Neutral => (Tone::Waiting, arming_label),
        Arming::Pressed => (Tone::Good, arming_label),
    }
}
