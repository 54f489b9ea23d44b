//! How the vehicle is, in a word or two, and what follows from that.

use std::time::Duration;

use protocol::message::{Arming, Guard, StopReason, TeleopState, TeleopStatus};
use robot_edge::clock::Monotonic;

use super::guard::makes_stand;
use super::hands::{opposed, turn_alone};
use super::untold::untold;
use super::words;
use crate::helm::{HelmSight, Lease};
use crate::model::ConsoleModel;
use crate::panels::wording::{age, capitalised};
use crate::theme::Tone;

const DRIVES: &str = "W A S D or arrows drive while held";
const COASTS: &str = "No thrust: it coasts, and wind and current move it";
const UNHELD: &str = "No thrust: wind and current may move it";
const SLOWS: &str = "Slows down first, then goes as the keys say";
const STANDS: &str = "Stands: the collision guard holds it back";
const NO_THRUST: &str = "No thrust: the collision guard holds it back";
const STOPPED: &str = "Its motors stand until it is reset.";
const STOPPED_AFLOAT: &str = "Its motors stand until it is reset. Wind and current may move it";
const STUCK: &str = "Told to go, and does not move: stuck, or its motors do not obey";
const AGROUND: &str = "Told to go, and does not move: aground, held, or its motors do not obey";
/// What a key changes from one to the other: all have the room of the longest, so that nothing below moves meanwhile.
/// What names keys is shorter.
pub(super) const BY_KEYS: [&str; 11] = [
    DRIVES,
    COASTS,
    UNHELD,
    SLOWS,
    STANDS,
    NO_THRUST,
    STOPPED,
    STOPPED_AFLOAT,
    words::stop(StopReason::Released),
    STUCK,
    AGROUND,
];

/// What is known of the vehicle's body.
#[derive(Clone, Copy, Debug)]
pub(super) struct Body {
    /// It moves so fast, forwards, m/s.
    moves: Option<f32>,
    /// It floats.
    is_boat: bool,
    conduct: Conduct,
}

/// What it makes of what its motors are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Conduct {
    /// It is told to go, and has not for seconds.
    Stuck,
    /// It was told to stand a moment ago, and has not had the time that it takes.
    Brakes,
    /// It stays where it is.
    Still,
    /// It goes, or drifts.
    Moves,
}

impl Body {
    pub(super) fn of(model: &ConsoleModel, now: Monotonic) -> Self {
        Self {
            moves: model.moves(),
            is_boat: model.is_boat(),
            conduct: if model.is_stuck() {
                Conduct::Stuck
            } else if model.brakes(now) {
                Conduct::Brakes
            } else if model.is_still() {
                Conduct::Still
            } else {
                Conduct::Moves
            },
        }
    }

    fn brakes(self) -> bool {
        self.conduct == Conduct::Brakes
    }

    fn is_still(self) -> bool {
        self.conduct == Conduct::Still
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
pub(super) fn lost(silence: Duration, helm: &HelmSight) -> Headline {
    let advice = match helm.lease {
        Lease::Held(_) => {
            "It stops by itself when commands stay away, and soon gives up the lease. When it is heard again, let go \
             of all keys, and press Drive where nobody drives."
        }
        Lease::None | Lease::Waiting { .. } => "What it does now is not known here.",
    };
    let words = format!("Link lost for {}", age(silence));
    Headline::new(Tone::Warning, words, Some(advice.to_owned()))
}

/// It runs anew, and has not said yet how it is.
pub(super) fn awaited() -> Headline {
    let advice = "It has restarted. What it does now is not known here yet.";
    let words = "Waiting for its state".to_owned();
    Headline::new(Tone::Waiting, words, Some(advice.to_owned()))
}

/// Where it was and how fast it went are the last that there is.
pub(super) fn ended() -> Headline {
    let advice = "Nothing new will come of this robot";
    let words = "Its data has ended".to_owned();
    Headline::new(Tone::Waiting, words, Some(advice.to_owned()))
}

/// It had said so, and was closed, as it seems.
pub(super) fn gone(silence: Duration) -> Headline {
    let advice = format!(
        "Nothing heard for {}: robot-edge has closed, or the link is lost. What it does now is not known here",
        age(silence)
    );
    Headline {
        advice: Some(advice),
        ..ended()
    }
}

/// Of a vehicle that is heard.
pub(super) fn heard(teleop: &TeleopStatus, helm: &HelmSight, body: Body) -> Headline {
    let untold = untold(teleop, body.moves, body.is_boat);
    if let Some(untold) = untold.filter(|_| !body.brakes()) {
        return untold;
    }
    if teleop.state == TeleopState::Driving && body.conduct == Conduct::Stuck {
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
        TeleopState::Driving if makes_stand(teleop) => "Held back".to_owned(),
        TeleopState::SafeBoot | TeleopState::Held | TeleopState::Driving | TeleopState::EStop => {
            words::state(teleop.state)
        }
    };
    let tone = match teleop.state {
        TeleopState::Driving if !makes_stand(teleop) => Tone::Good,
        TeleopState::Idle | TeleopState::Held if !teleop.is_drifting => Tone::Waiting,
        TeleopState::Stopping(StopReason::Released) | TeleopState::SafeBoot => Tone::Waiting,
        TeleopState::Idle
        | TeleopState::Held
        | TeleopState::Driving
        | TeleopState::Stopping(_)
        | TeleopState::EStop
        | TeleopState::Fault(_) => Tone::Warning,
    };
    Headline::new(tone, headline, advice(teleop, helm, body))
}

fn advice(teleop: &TeleopStatus, helm: &HelmSight, body: Body) -> Option<String> {
    let is_mine = helm.lease.held().is_some();
    let opposed = opposed(helm).filter(|_| is_mine && follows_keys(teleop));
    if opposed.is_some() {
        return opposed;
    }
    let words = match (teleop.state, helm.ignored) {
        // It is taken back early only: later it ends first, and goes on by itself with what is held down then.
        (TeleopState::Stopping(_), _) if teleop.arming == Arming::Pressed => SLOWS,
        (TeleopState::Stopping(why), _) => return Some(capitalised(words::stop(why))),
        (TeleopState::Fault(_), _) => {
            let fault = words::state(teleop.state);
            return Some(format!("{fault}. Reset it at the vehicle."));
        }
        (TeleopState::EStop, _) if body.is_boat => STOPPED_AFLOAT,
        (TeleopState::EStop, _) => STOPPED,
        (_, Some(why)) if is_mine => {
            let why = words::ignored(why, teleop.last_stop);
            return Some(format!("Let go of all keys: {why}"));
        }
        // Whatever is pressed: without this it would be for the operator to guess.
        (TeleopState::Held, None)
            if is_mine && matches!(teleop.guard, Guard::Stale | Guard::Silent) =>
        {
            "The guard's data is late, so nothing moves: the robot's sensors or its machine are slow. When it comes, \
             press anew"
        }
        (TeleopState::Held, None)
            if is_mine && !helm.wish.is_neutral() && teleop.arming == Arming::Locked =>
        {
            "Let go of all keys, then press anew"
        }
        (TeleopState::Held | TeleopState::Driving, _) if is_mine && !helm.is_ready => {
            "The keys go to a text or to another window. Click into the map to drive"
        }
        (TeleopState::Driving, _) if makes_stand(teleop) => {
            let alone = turn_alone(teleop, helm, body.is_boat).filter(|_| is_mine);
            let stands = if body.is_boat { NO_THRUST } else { STANDS };
            return alone.or_else(|| Some(stands.to_owned()));
        }
        (TeleopState::Idle | TeleopState::Held, _) if teleop.is_drifting && body.is_still() => {
            UNHELD
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
        TeleopState::Held => !matches!(teleop.guard, Guard::Stale | Guard::Silent),
        TeleopState::SafeBoot
        | TeleopState::Idle
        | TeleopState::Stopping(
            StopReason::Age
            | StopReason::NotFinite
            | StopReason::GuardStale
            | StopReason::LeaseEnded(_),
        )
        | TeleopState::EStop
        | TeleopState::Fault(_) => false,
    }
}
