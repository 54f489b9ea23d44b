//! A vehicle that moves although no operator has told it to. The same words always have the same mark: what is another matter
//! has other words.

use protocol::message::{TeleopState, TeleopStatus};

use super::headline::Headline;
use super::labels;
use crate::model::DRIFTING_MPS;
use crate::panels::formatting::signed;
use crate::theme::Tone;

const WITHOUT_OPERATOR: &str =
    "Something other than an operator moves it, such as its own program or a simulated tour.";
const ADRIFT: &str = "Something other than an operator moves it: its own program, or a current that is faster than usual. \
                      From here both look the same.";
const AGAINST_COMMAND: &str =
    "It is commanded to stand, but moves: it rolls, it is pushed, or its motors do not respond.";

/// What is said of it, where it `moves` so fast, forwards, m/s. `None` where it stands, is driven, or moves as a boat
/// without thrust does: slowly, or after it was driven a moment ago. A boat that somebody stopped moves too, and its
/// satellite receiver says so of one that lies still: neither is a reason to warn.
pub(super) fn unexpected_motion(
    teleop: &TeleopStatus,
    moves: Option<f32>,
    is_boat: bool,
) -> Option<Headline> {
    let speed_mps = moves?;
    let speed = signed(f64::from(speed_mps), 2);
    let (tone, words, hint) = match (teleop.state, is_boat || teleop.is_drifting) {
        (TeleopState::Idle, false) => (
            Tone::Waiting,
            "Moving by itself".to_owned(),
            WITHOUT_OPERATOR,
        ),
        // Whether that is a program or a strong current, only the water knows.
        (TeleopState::Idle, true) if speed_mps.abs() > DRIFTING_MPS => {
            (Tone::Warning, "Moving or adrift".to_owned(), ADRIFT)
        }
        (TeleopState::EStop | TeleopState::Fault(_), false) => {
            (Tone::Warning, labels::state(teleop.state), AGAINST_COMMAND)
        }
        (TeleopState::SafeBoot | TeleopState::Held, false) => (
            Tone::Warning,
            "Moving without command".to_owned(),
            AGAINST_COMMAND,
        ),
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
        format!("Commanded to stand, but moving: {speed} m/s")
    };
    Some(Headline {
        tone,
        words,
        advice: Some(advice),
        hint: Some(hint),
    })
}
