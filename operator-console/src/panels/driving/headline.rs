//! How the vehicle is, in a word or two, and what follows from that.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Arming, CollisionMonitorState, StopReason, TeleopState, TeleopStatus};

use super::guard::is_stopped_by_monitor;
use super::input_hints::{opposing_keys, turn_only_hint};
use super::labels;
use super::unexpected_motion::unexpected_motion;
use crate::model::ConsoleModel;
use crate::panels::formatting::{age, capitalised};
use crate::teleop_client::{Lease, TeleopClientState};
use crate::theme::Tone;

const DRIVES: &str = "W A S D or arrows drive while held";
const COASTS: &str = "No thrust: it coasts, and wind and current move it";
const NOT_HELD: &str = "No thrust: wind and current may move it";
const SLOWS: &str = "Slows down first, then follows the keys";
const STANDS: &str = "Stopped by the collision monitor";
const NO_THRUST: &str = "No thrust: stopped by the collision monitor";
const STOPPED: &str = "Motors are stopped until the reset.";
const STOPPED_AFLOAT: &str = "Motors are stopped until the reset. Wind and current may move it";
const STUCK: &str = "Commanded but not moving: stuck, or its motors do not respond";
const AGROUND: &str = "Commanded but not moving: aground, held, or its motors do not respond";
/// What a key changes from one to the other: all have the room of the longest, so that nothing below moves meanwhile.
/// What names keys is shorter.
pub(super) const KEY_ADVICE: [&str; 11] = [
    DRIVES,
    COASTS,
    NOT_HELD,
    SLOWS,
    STANDS,
    NO_THRUST,
    STOPPED,
    STOPPED_AFLOAT,
    labels::stop(StopReason::Released),
    STUCK,
    AGROUND,
];

/// What is known of the vehicle's body.
#[derive(Clone, Copy, Debug)]
pub(super) struct VehicleState {
    /// It moves so fast, forwards, m/s.
    moves: Option<f32>,
    /// It floats.
    is_boat: bool,
    conduct: Motion,
}

/// What it makes of what its motors are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Motion {
    /// It is told to go, and has not for seconds.
    Stuck,
    /// It was told to stand a moment ago, and has not had the time that it takes.
    Brakes,
    /// It stays where it is.
    Still,
    /// It goes, or drifts.
    Moves,
}

impl VehicleState {
    pub(super) fn of(model: &ConsoleModel, now: Monotonic) -> Self {
        Self {
            moves: model.moves(),
            is_boat: model.is_boat(),
            conduct: if model.is_stuck() {
                Motion::Stuck
            } else if model.brakes(now) {
                Motion::Brakes
            } else if model.is_still() {
                Motion::Still
            } else {
                Motion::Moves
            },
        }
    }

    fn brakes(self) -> bool {
        self.conduct == Motion::Brakes
    }

    fn is_still(self) -> bool {
        self.conduct == Motion::Still
    }
}

/// How the vehicle is, in words.
pub(super) struct Headline {
    pub(super) tone: Tone,
    pub(super) words: String,
    pub(super) advice: Option<String>,
    pub(super) hint: Option<&'static str>,
}

impl Headline {
    const fn new(tone: Tone, words: String, advice: Option<String>) -> Self {
        Self {
            tone,
            words,
            advice,
            hint: None,
        }
    }
}

/// A link that is lost is no pause: nobody here knows what the vehicle does.
pub(super) fn link_lost(silence: Duration, teleop_client: &TeleopClientState) -> Headline {
    let advice = match teleop_client.lease {
        Lease::Held(_) => {
            "It stops by itself without commands, and its lease soon expires. When it is connected again, release \
             all keys, and press Request control."
        }
        Lease::None | Lease::Waiting { .. } => "State unknown (no data).",
    };
    let words = format!("Link lost for {}", age(silence));
    Headline::new(Tone::Warning, words, Some(advice.to_owned()))
}

/// It runs anew, and has not said yet how it is.
pub(super) fn status_pending() -> Headline {
    let advice = "It has restarted. State unknown (no data yet).";
    let words = "Waiting for status".to_owned();
    Headline::new(Tone::Waiting, words, Some(advice.to_owned()))
}

/// Where it was and how fast it went are the last that there is.
pub(super) fn data_ended() -> Headline {
    let advice = "Robot session ended";
    let words = "Its data has ended".to_owned();
    Headline::new(Tone::Waiting, words, Some(advice.to_owned()))
}

/// It had said so, and was closed, as it seems.
pub(super) fn data_ended_silent(silence: Duration) -> Headline {
    let advice = format!(
        "No data for {}: robot-edge has closed, or the link is lost. State unknown (no data)",
        age(silence)
    );
    Headline {
        advice: Some(advice),
        ..data_ended()
    }
}

/// Of a vehicle that is heard.
pub(super) fn live(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    body: VehicleState,
) -> Headline {
    let unexpected_motion = unexpected_motion(teleop, body.moves, body.is_boat);
    if let Some(unexpected_motion) = unexpected_motion.filter(|_| !body.brakes()) {
        return unexpected_motion;
    }
    if teleop.state == TeleopState::Driving && body.conduct == Motion::Stuck {
        let why = if body.is_boat { AGROUND } else { STUCK };
        return Headline::new(Tone::Warning, "Not moving".to_owned(), Some(why.to_owned()));
    }
    let headline = match teleop.state {
        TeleopState::Stopping(_) => "Stopping".to_owned(),
        TeleopState::Idle | TeleopState::Held if body.brakes() => "Stopping".to_owned(),
        TeleopState::Fault(_) => "Fault".to_owned(),
        // It has no brakes: that it does not drift now is no promise.
        TeleopState::Idle | TeleopState::Held if teleop.is_drifting && body.is_still() => {
            "Standing, not held".to_owned()
        }
        TeleopState::Idle | TeleopState::Held if teleop.is_drifting => "Drifting".to_owned(),
        TeleopState::Idle => "Standing".to_owned(),
        TeleopState::Driving if is_stopped_by_monitor(teleop) => "Motion blocked".to_owned(),
        TeleopState::SafeBoot | TeleopState::Held | TeleopState::Driving | TeleopState::EStop => {
            labels::state(teleop.state)
        }
    };
    let tone = match teleop.state {
        TeleopState::Driving if !is_stopped_by_monitor(teleop) => Tone::Good,
        TeleopState::Idle | TeleopState::Held if !teleop.is_drifting => Tone::Waiting,
        TeleopState::Stopping(StopReason::Released) | TeleopState::SafeBoot => Tone::Waiting,
        TeleopState::Idle
        | TeleopState::Held
        | TeleopState::Driving
        | TeleopState::Stopping(_)
        | TeleopState::EStop
        | TeleopState::Fault(_) => Tone::Warning,
    };
    Headline::new(tone, headline, advice(teleop, teleop_client, body))
}

fn advice(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    body: VehicleState,
) -> Option<String> {
    let is_mine = teleop_client.lease.held().is_some();
    let opposing_keys = opposing_keys(teleop_client).filter(|_| is_mine && follows_keys(teleop));
    if opposing_keys.is_some() {
        return opposing_keys;
    }
    let words = match (teleop.state, teleop_client.ignored) {
        // It is taken back early only: later it ends first, and goes on by itself with what is held down then.
        (TeleopState::Stopping(_), _) if teleop.arming == Arming::Pressed => SLOWS,
        (TeleopState::Stopping(why), _) => return Some(capitalised(labels::stop(why))),
        (TeleopState::Fault(_), _) => {
            let fault = labels::state(teleop.state);
            return Some(format!("{fault}. Reset it at the vehicle."));
        }
        (TeleopState::EStop, _) if body.is_boat => STOPPED_AFLOAT,
        (TeleopState::EStop, _) => STOPPED,
        (_, Some(why)) if is_mine => {
            let why = labels::ignored(why, teleop.last_stop);
            return Some(format!("Release all keys: {why}"));
        }
        // Whatever is pressed: without this it would be for the operator to guess.
        (TeleopState::Held, None)
            if is_mine
                && matches!(
                    teleop.collision_monitor,
                    CollisionMonitorState::Stale | CollisionMonitorState::Silent
                ) =>
        {
            "The monitor's data is late, so nothing moves: the robot's sensors or its computer are slow. When it comes, \
             press again"
        }
        (TeleopState::Held, None)
            if is_mine
                && !teleop_client.drive_input.is_neutral()
                && teleop.arming == Arming::Locked =>
        {
            "Release all keys, then press again"
        }
        (TeleopState::Held | TeleopState::Driving, _) if is_mine && !teleop_client.is_ready => {
            "Keyboard focus is elsewhere. Click into the map to drive"
        }
        (TeleopState::Driving, _) if is_stopped_by_monitor(teleop) => {
            let alone = turn_only_hint(teleop, teleop_client, body.is_boat).filter(|_| is_mine);
            let stands = if body.is_boat { NO_THRUST } else { STANDS };
            return alone.or_else(|| Some(stands.to_owned()));
        }
        (TeleopState::Idle | TeleopState::Held, _) if teleop.is_drifting && body.is_still() => {
            NOT_HELD
        }
        (TeleopState::Idle | TeleopState::Held, _) if teleop.is_drifting => COASTS,
        (TeleopState::Held | TeleopState::Driving, _) if is_mine => DRIVES,
        (
            TeleopState::SafeBoot | TeleopState::Idle | TeleopState::Held | TeleopState::Driving,
            _,
        ) => return None,
    };
    Some(words.to_owned())
}

/// Whether what a driven vehicle does now is what the keys ask for, be that nothing.
const fn follows_keys(teleop: &TeleopStatus) -> bool {
    match teleop.state {
        TeleopState::Driving | TeleopState::Stopping(StopReason::Released) => true,
        // Whatever is pressed, it stands while the guard's data is late.
        TeleopState::Held => !matches!(
            teleop.collision_monitor,
            CollisionMonitorState::Stale | CollisionMonitorState::Silent
        ),
        TeleopState::SafeBoot
        | TeleopState::Idle
        | TeleopState::Stopping(
            StopReason::Age
            | StopReason::NotFinite
            | StopReason::CollisionMonitorStale
            | StopReason::LeaseEnded(_),
        )
        | TeleopState::EStop
        | TeleopState::Fault(_) => false,
    }
}
