//! A vehicle that moves although no operator has told it to. The same words always have the same mark: what is another matter
//! has other words.

use protocol::message::{TeleopState, TeleopStatus};

use super::headline::Headline;
use super::words;
use crate::model::DRIFTING_MPS;
use crate::panels::wording::signed;
use crate::theme::Tone;

const BY_ITSELF: &str =
    "Something other than an operator moves it, such as its own program or a simulated tour.";
const ADRIFT: &str = "Something other than an operator moves it: its own program, or a current that is faster than usual. \
                      From here both look the same.";
const AGAINST_ORDERS: &str = "It is told to stand, and moves all the same: it rolls, it is pushed, or its motors do not obey.";

/// What is said of it, where it `moves` so fast, forwards, m/s. `None` where it stands, is driven, or moves as a boat
/// without thrust does: slowly, or after it was driven a moment ago. A boat that somebody stopped moves too, and its
/// satellite receiver says so of one that lies still: neither is a reason to warn.
pub(super) fn untold(teleop: &TeleopStatus, moves: Option<f32>, is_boat: bool) -> Option<Headline> {
    let speed_mps = moves?;
    let speed = signed(f64::from(speed_mps), 2);
    let (tone, words, hint) = match (teleop.state, is_boat || teleop.is_drifting) {
        (TeleopState::Idle, false) => (Tone::Waiting, "Moving by itself".to_owned(), BY_ITSELF),
        // Whether that is a program or a strong current, only the water knows.
        (TeleopState::Idle, true) if speed_mps.abs() > DRIFTING_MPS => {
            (Tone::Warning, "Moving or adrift".to_owned(), ADRIFT)
        }
        (TeleopState::EStop | TeleopState::Fault(_), false) => {
            (Tone::Warning, words::state(teleop.state), AGAINST_ORDERS)
        }
        (TeleopState::SafeBoot | TeleopState::Held, false) => {
            (Tone::Warning, "Moving untold".to_owned(), AGAINST_ORDERS)
        }
        (TeleopState::Driving | TeleopState::Stopping(_), _)
        | (
            TeleopState::SafeBoot
            | TeleopState::Idle
            | TeleopState::Held
            | TeleopState::EStop
            | TeleopState::Fault(_),
            true,
        ) => return None,
    };
    let advice = if teleop.state == TeleopState::Idle {
        format!("Nobody drives it from here: {speed} m/s")
    } else {
        format!("It is told to stand, and moves: {speed} m/s")
    };
    Some(Headline {
        tone,
        words,
        advice: Some(advice),
        hint: Some(hint),
    })
}
