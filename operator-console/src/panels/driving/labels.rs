//! Texts of the driving panel: states, reasons, headline and advice.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{
    Answer, Arming, Clamp, CollisionMonitorState, FaultReason, LeaseEnd, LeaseRequest, Refusal,
    Setting, StopReason, TeleopState, TeleopStatus,
};

use super::limits::is_stopped_by_monitor;
use crate::identity::OBSERVER_HINT;
use crate::model::{ConsoleModel, DRIFTING_MPS, LinkState, direction_signs};
use crate::panels::formatting::{age, capitalised, signed};
use crate::teleop_client::{NotSentReason, RequestKind, TeleopClientState, TeleopNotification};
use crate::teleop_input::{DriveKey, InputLockReason};
use crate::theme::Tone;

const AGROUND: &str = "Commanded but not moving: aground, held, or its motors do not respond";
/// The longest advice that a key press can cause: the panel reserves its height.
pub(super) const LONGEST_KEY_ADVICE: &str = AGROUND;
const WITHOUT_COMMAND: &str = "Moves without command";
const ON_ROUTE: &str =
    "A simulated vehicle follows the route of its world until an operator drives or stops it.";
const WITHOUT_OPERATOR: &str =
    "Something other than an operator moves it: its own program, a slope or a push.";
const ADRIFT: &str = "Something other than an operator moves it: its own program, or a current that is faster than usual. \
                      From here both look the same.";
const AGAINST_COMMAND: &str =
    "It is commanded to stand, but moves: it rolls, it is pushed, or its motors do not respond.";

pub(crate) fn state(state: TeleopState) -> String {
    match state {
        TeleopState::SafeBoot => "Self-test".to_owned(),
        TeleopState::Idle => "Nobody drives".to_owned(),
        TeleopState::Held => "Standing".to_owned(),
        TeleopState::Driving => "Driving".to_owned(),
        TeleopState::Stopping(why) => format!("Stopping: {}", stop(why)),
        TeleopState::EStop => "Emergency stop".to_owned(),
        TeleopState::Fault(why) => format!("Fault: {}", fault(why)),
    }
}

pub(crate) const fn stop(why: StopReason) -> &'static str {
    match why {
        StopReason::Released => "keys released",
        StopReason::Age => "commands too old",
        StopReason::NotFinite => "invalid velocity command",
        StopReason::CollisionMonitorStale => "the monitor's data came too late",
        StopReason::MotorsHeld => "the motors obeyed no velocity",
        StopReason::PlannerSilent => "the planner fell silent",
        StopReason::PlannerFloods => "the planner sent too many velocities",
        StopReason::LeaseEnded(LeaseEnd::Released) => "the lease was released",
        StopReason::LeaseEnded(LeaseEnd::Expired) => "the console timed out",
        StopReason::LeaseEnded(LeaseEnd::Renewed) => "the lease was requested again",
        StopReason::LeaseEnded(LeaseEnd::HandedOver) => "handed over",
        StopReason::LeaseEnded(LeaseEnd::TakenOver) => "taken over",
        StopReason::LeaseEnded(LeaseEnd::Revoked) => "operator access revoked",
        StopReason::LeaseEnded(LeaseEnd::Reset) => "an emergency stop was reset",
        StopReason::LeaseEnded(LeaseEnd::Fault) => "the vehicle is at fault",
    }
}

const fn fault(why: FaultReason) -> &'static str {
    match why {
        FaultReason::SelfTest => "the self-test failed",
        FaultReason::Actuator => "the motors do not respond",
    }
}

/// Possible reasons of a vehicle that does not move as commanded: present and past.
pub(crate) const fn stuck(is_boat: bool) -> [&'static str; 2] {
    if is_boat {
        [
            "aground, held, or its motors do not respond",
            "aground, held, or its motors did not respond",
        ]
    } else {
        [
            "stuck, or its motors do not respond",
            "stuck, or its motors did not respond",
        ]
    }
}

pub(crate) const fn clamp(clamp: Clamp) -> &'static str {
    match clamp {
        Clamp::Speed => "the vehicle's greatest speed",
        Clamp::Ramp => "its acceleration",
        Clamp::Age => "the age of commands",
        Clamp::CollisionMonitor => "the collision monitor",
        Clamp::Stop => "its state",
        Clamp::Locomotion => "its wheels, which must stand to be set for it",
    }
}

fn ignored(why: InputLockReason, last_stop: Option<StopReason>) -> String {
    match last_stop {
        Some(reason) if why == InputLockReason::Stopped && reason != StopReason::Released => {
            format!("{}, {}", loss(why), stop(reason))
        }
        _ => loss(why).to_owned(),
    }
}

const fn loss(loss: InputLockReason) -> &'static str {
    match loss {
        InputLockReason::Focus => "the window lost focus",
        InputLockReason::WindowHidden => "the window was hidden",
        InputLockReason::Typing => "text was typed",
        InputLockReason::Gamepad => "the gamepad was disconnected",
        InputLockReason::Link => "the link was lost",
        InputLockReason::Robot => "the robot was restarted",
        InputLockReason::Lease => "they were pressed before you had control",
        InputLockReason::LeaseRenewed => "the lease was requested again",
        InputLockReason::EStop => "emergency stop",
        InputLockReason::Stopped => "the robot stopped by itself",
        InputLockReason::LoopStalled => "this program was suspended",
    }
}

pub(super) const fn arming(arming: Arming) -> &'static str {
    match arming {
        Arming::Locked => "Release everything",
        Arming::Neutral => "Ready",
        Arming::Pressed => "Active",
    }
}

pub(super) fn refusal(why: Refusal) -> String {
    match why {
        // The robot does not say more to unknown operators.
        Refusal::Signature | Refusal::UnknownOperator => {
            "your name and key are not on this vehicle's list of operators".to_owned()
        }
        Refusal::TooOld => {
            "the link is too slow: it reached the robot later than commands may".to_owned()
        }
        _ => why.to_string(),
    }
}

fn request_refusal(what: &RequestKind, why: Refusal) -> String {
    let is_take_over = matches!(what, RequestKind::Lease(LeaseRequest::TakeOver));
    if is_take_over && why == Refusal::Role {
        return "only supervisors take over".to_owned();
    }
    refusal(why)
}

/// Text of a notification, and whether it reports a failure.
pub(crate) fn note(note: &TeleopNotification) -> (String, bool) {
    match note {
        TeleopNotification::Answered(what, Answer::Refused(why)) => {
            let why = request_refusal(what, *why);
            (format!("{} refused: {why}", request_text(what)), true)
        }
        TeleopNotification::Answered(what, answer) => (
            format!("{}: {}", request_text(what), answer_text(*answer)),
            false,
        ),
        TeleopNotification::RequestTimedOut(what) => {
            (format!("{}: no answer", request_text(what)), true)
        }
        TeleopNotification::NotSent(what, why) => {
            let why = match why {
                NotSentReason::NoToken => "the robot sends no tokens",
                NotSentReason::TooMany => "too many pending",
            };
            (format!("{} not sent: {why}", request_text(what)), true)
        }
        TeleopNotification::LeaseGained(epoch) => (format!("lease held, grant {epoch}"), false),
        TeleopNotification::LeaseLost => ("lease lost".to_owned(), false),
        TeleopNotification::LeaseReleased => ("lease released".to_owned(), false),
        TeleopNotification::LeaseEndedByReset => (
            "the reset ended driving: press Request control again".to_owned(),
            false,
        ),
        TeleopNotification::EStopPressed => ("emergency stop pressed".to_owned(), false),
        TeleopNotification::EStopAcknowledged(number) => {
            (format!("emergency stop {number} acknowledged"), false)
        }
        TeleopNotification::EStopRefused(why) => {
            (format!("emergency stop refused: {}", refusal(*why)), true)
        }
        TeleopNotification::EStopNotInForce => (
            "the emergency stop is not active: it was refused, or reset since".to_owned(),
            true,
        ),
        TeleopNotification::NotDrivable => (
            "nothing to stop: this robot is not driven over the network".to_owned(),
            true,
        ),
        TeleopNotification::ObserverOnly => (OBSERVER_HINT.to_owned(), true),
        TeleopNotification::GoalEnded(None) => ("goal ended".to_owned(), false),
        TeleopNotification::GoalEnded(Some(why)) => (format!("goal ended: {why}"), false),
        TeleopNotification::GoalNotStarted => {
            ("the robot does not drive to the goal".to_owned(), true)
        }
        TeleopNotification::InputLocked(why) => (format!("keys ignored: {}", loss(*why)), false),
    }
}

fn request_text(request_text: &RequestKind) -> String {
    match request_text {
        RequestKind::Lease(LeaseRequest::Request) => "lease request".to_owned(),
        RequestKind::Lease(LeaseRequest::Release) => "lease release".to_owned(),
        RequestKind::Lease(LeaseRequest::TakeOver) => "lease take-over".to_owned(),
        RequestKind::Lease(LeaseRequest::HandOver(to)) => format!("lease consent {to}"),
        RequestKind::Lease(LeaseRequest::Refuse(whom)) => format!("lease refuse {whom}"),
        RequestKind::Reset(number) => format!("reset of emergency stop {number}"),
        RequestKind::Set(Setting::BudgetKbps(kbps)) => format!("budget {kbps}"),
        RequestKind::Set(Setting::CollisionMonitor(is_on)) => {
            format!("guard {}", on_or_off(*is_on))
        }
        RequestKind::Set(Setting::Recording(is_on)) => format!("recording {}", on_or_off(*is_on)),
        RequestKind::Set(Setting::SaveMap(name)) => format!("save-map {name}"),
        RequestKind::Set(Setting::Locate(_)) => "set-pose".to_owned(),
    }
}

fn answer_text(answer: Answer) -> String {
    match answer {
        Answer::Done => "done".to_owned(),
        Answer::Granted(epoch) => format!("granted, grant {epoch}"),
        Answer::Waiting => "waiting".to_owned(),
        Answer::EStopped(number) => format!("stopped, number {number}"),
        Answer::Refused(why) => format!("refused: {}", refusal(why)),
    }
}

const fn on_or_off(is_on: bool) -> &'static str {
    if is_on { "on" } else { "off" }
}

pub(super) struct Headline {
    pub(super) tone: Tone,
    pub(super) words: String,
    pub(super) advice: Option<String>,
    pub(super) hint: Option<&'static str>,
    /// Instead of "Nobody drives".
    pub(super) without_driver: Option<String>,
}

impl Headline {
    fn new(tone: Tone, words: &str, advice: impl Into<String>) -> Self {
        Self {
            tone,
            words: words.to_owned(),
            advice: Some(advice.into()),
            hint: None,
            without_driver: None,
        }
    }

    fn of_unknown_state(tone: Tone, words: &str, advice: impl Into<String>) -> Self {
        Self {
            without_driver: Some("State unknown".to_owned()),
            ..Self::new(tone, words, advice)
        }
    }
}

/// `silence`: time since the last pose, status or message, if it is too long.
pub(super) fn headline(
    model: &ConsoleModel,
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    silence: Option<Duration>,
    now: Monotonic,
) -> Headline {
    const ENDED: &str = "Its data has ended";
    let is_live = model.connection().state(now) == LinkState::Live;
    match silence {
        Some(_) if is_live && model.awaits_status() => Headline::of_unknown_state(
            Tone::Waiting,
            "Waiting for status",
            "It has restarted. State unknown (no data yet).",
        ),
        Some(silence) if model.is_silence_expected() => {
            let advice = format!(
                "No data for {}: robot-edge has closed, or the link is lost. State unknown (no data)",
                age(silence)
            );
            Headline::of_unknown_state(Tone::Waiting, ENDED, advice)
        }
        Some(silence) => {
            let advice = if teleop_client.lease.held().is_some() {
                "It stops by itself without commands, and its lease soon expires. When it is connected again, \
                 release all keys, and press Request control."
            } else {
                "State unknown (no data)."
            };
            let words = format!("Link lost for {}", age(silence));
            Headline::of_unknown_state(Tone::Warning, &words, advice)
        }
        None if model.reports_ended() && teleop.state == TeleopState::Idle => {
            Headline::new(Tone::Waiting, ENDED, "Robot session ended")
        }
        None => live(model, teleop, teleop_client, now),
    }
}

fn live(
    model: &ConsoleModel,
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    now: Monotonic,
) -> Headline {
    let (is_boat, is_stuck) = (model.is_boat(), model.is_stuck());
    // Commanded to stop a moment ago, within its braking time.
    let brakes = !is_stuck && model.brakes(now);
    let is_still = !is_stuck && !brakes && model.is_still();
    if !brakes && let Some(headline) = unexpected_motion(model, teleop) {
        return headline;
    }
    if let (Some(hold), TeleopState::Idle | TeleopState::Held) = (teleop.motor_hold, teleop.state) {
        return Headline::new(
            Tone::Warning,
            "Cannot be driven",
            capitalised(&hold.to_string()),
        );
    }
    let (tone, words) = match teleop.state {
        TeleopState::Driving if is_stuck => {
            let why = if is_boat {
                AGROUND
            } else {
                "Commanded but not moving: stuck, or its motors do not respond"
            };
            return Headline::new(Tone::Warning, "Not moving", why);
        }
        TeleopState::Driving if is_stopped_by_monitor(teleop) => (Tone::Warning, "Motion blocked"),
        TeleopState::Driving => (Tone::Good, "Driving"),
        TeleopState::Stopping(StopReason::Released) => (Tone::Waiting, "Stopping"),
        TeleopState::Stopping(_) => (Tone::Warning, "Stopping"),
        TeleopState::Idle | TeleopState::Held => match (teleop.is_drifting, brakes) {
            (false, true) => (Tone::Waiting, "Stopping"),
            (false, false) => (Tone::Waiting, "Standing"),
            (true, true) => (Tone::Warning, "Stopping"),
            // A boat has no brakes: it may start to drift at any time.
            (true, false) if is_still => (Tone::Warning, "Standing, not held"),
            (true, false) => (Tone::Warning, "Drifting"),
        },
        TeleopState::SafeBoot => (Tone::Waiting, "Self-test"),
        TeleopState::EStop => (Tone::Warning, "Emergency stop"),
        TeleopState::Fault(_) => (Tone::Warning, "Fault"),
    };
    Headline {
        tone,
        words: words.to_owned(),
        advice: advice(teleop, teleop_client, is_boat, is_still),
        hint: None,
        without_driver: None,
    }
}

fn advice(
    teleop: &TeleopStatus,
    teleop_client: &TeleopClientState,
    is_boat: bool,
    is_still: bool,
) -> Option<String> {
    let is_mine = teleop_client.lease.held().is_some();
    if is_mine && follows_keys(teleop) && opposing_keys(teleop_client) {
        return Some("Opposing keys cancel each other out".to_owned());
    }
    let words = match (teleop.state, teleop_client.ignored) {
        // The stop ends first, then the vehicle follows the held keys.
        (TeleopState::Stopping(_), _) if teleop.arming == Arming::Pressed => {
            "Slows down first, then follows the keys"
        }
        (TeleopState::Stopping(why), _) => return Some(capitalised(stop(why))),
        (TeleopState::Fault(_), _) => {
            let fault = state(teleop.state);
            return Some(format!("{fault}. Reset it at the vehicle."));
        }
        (TeleopState::EStop, _) if is_boat => {
            "Motors are stopped until the reset. Wind and current may move it"
        }
        (TeleopState::EStop, _) => "Motors are stopped until the reset.",
        (_, Some(why)) if is_mine => {
            let why = ignored(why, teleop.last_stop);
            return Some(format!("Release all keys: {why}"));
        }
        (TeleopState::Held, None) if is_mine && is_monitor_late(teleop) => {
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
            // The monitor scales both alike: one of them alone may be free.
            let axes = direction_signs(teleop.requested);
            let requests_both = axes.iter().filter(|sign| **sign != 0).count() > 1;
            match (is_mine && requests_both, is_boat) {
                (true, _) => "Stopped by the collision monitor: try one direction alone",
                (false, true) => "No thrust: stopped by the collision monitor",
                (false, false) => "Stopped by the collision monitor",
            }
        }
        (TeleopState::Idle | TeleopState::Held, _) if teleop.is_drifting && is_still => {
            "No thrust: wind and current may move it"
        }
        (TeleopState::Idle | TeleopState::Held, _) if teleop.is_drifting => {
            "No thrust: it coasts, and wind and current move it"
        }
        (TeleopState::Held | TeleopState::Driving, _) if is_mine => {
            if teleop_client.limits[1] > 0.0 {
                "W A S D or arrows drive while held, Q and E go sideways"
            } else {
                "W A S D or arrows drive while held"
            }
        }
        _ => return None,
    };
    Some(words.to_owned())
}

const fn is_monitor_late(teleop: &TeleopStatus) -> bool {
    matches!(
        teleop.collision_monitor,
        CollisionMonitorState::Stale | CollisionMonitorState::Silent
    )
}

const fn follows_keys(teleop: &TeleopStatus) -> bool {
    match teleop.state {
        TeleopState::Driving | TeleopState::Stopping(StopReason::Released) => true,
        TeleopState::Held => !is_monitor_late(teleop),
        _ => false,
    }
}

/// Whether the held keys cancel each other out: the command is neutral although keys are held in opposite directions.
pub(super) fn opposing_keys(teleop_client: &TeleopClientState) -> bool {
    use DriveKey::{A, D, Down, E, Left, Q, Right, S, Up, W};
    let is_held = |keys: [DriveKey; 2]| keys.iter().any(|key| teleop_client.keys.contains(key));
    teleop_client.drive_input.is_neutral()
        && [
            [[W, Up], [S, Down]],
            [[A, Left], [D, Right]],
            [[Q; 2], [E; 2]],
        ]
        .into_iter()
        .any(|[one, other]| is_held(one) && is_held(other))
}

/// Text for motion without an operator command: what moves the vehicle, as far as it is known. A boat without thrust
/// drifts slowly, which is no reason to warn. Each message has exactly one tone.
fn unexpected_motion(model: &ConsoleModel, teleop: &TeleopStatus) -> Option<Headline> {
    const BY_ITSELF: &str = "Moves by itself";
    const COMMANDED_TO_STAND: &str = "Commanded to stand, but moving";
    let speed_mps = model.moves()?;
    let speed = signed(f64::from(speed_mps), 2);
    let (tone, words, cause, hint) = match (teleop.state, model.is_boat() || teleop.is_drifting) {
        _ if model.is_on_simulated_route() => (
            Tone::Waiting,
            BY_ITSELF.to_owned(),
            "Follows the simulation's route",
            ON_ROUTE,
        ),
        (TeleopState::Idle, false) => (
            Tone::Waiting,
            BY_ITSELF.to_owned(),
            "Its own program moves it, or it rolls",
            WITHOUT_OPERATOR,
        ),
        (TeleopState::Idle, true) if speed_mps.abs() > DRIFTING_MPS => (
            Tone::Warning,
            "Moves or drifts".to_owned(),
            "Its own program moves it, or it coasts or drifts",
            ADRIFT,
        ),
        (TeleopState::EStop | TeleopState::Fault(_), false) => (
            Tone::Warning,
            state(teleop.state),
            COMMANDED_TO_STAND,
            AGAINST_COMMAND,
        ),
        (TeleopState::SafeBoot | TeleopState::Held, false) => (
            Tone::Warning,
            WITHOUT_COMMAND.to_owned(),
            COMMANDED_TO_STAND,
            AGAINST_COMMAND,
        ),
        _ => return None,
    };
    let mut advice = format!("{cause}: {speed} m/s");
    if teleop.state == TeleopState::Idle {
        advice += ". No operator drives it.";
    }
    let without_driver = match teleop.state {
        TeleopState::EStop | TeleopState::Fault(_) => WITHOUT_COMMAND.to_owned(),
        _ => words.clone(),
    };
    Some(Headline {
        tone,
        without_driver: Some(without_driver),
        words,
        advice: Some(advice),
        hint: Some(hint),
    })
}
