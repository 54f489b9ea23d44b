//! States and reasons of driving as the operator reads them.

use protocol::message::{
    Answer, Arming, Clamp, FaultReason, LeaseEnd, LeaseRequest, Refusal, Setting, StopReason,
    TeleopState,
};

use crate::role::OBSERVER_HINT;
use crate::teleop_client::{NotSentReason, RequestKind, TeleopNotification};
use crate::teleop_input::InputLockReason;

/// A state, with its reason.
pub fn state(state: TeleopState) -> String {
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

/// Why it stopped.
pub const fn stop(why: StopReason) -> &'static str {
    match why {
        StopReason::Released => "keys released",
        StopReason::Age => "commands too old",
        StopReason::NotFinite => "invalid velocity command",
        StopReason::CollisionMonitorStale => "the monitor's data came too late",
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

/// Why a vehicle may not move that is told to go, and the same when that is over.
pub const fn stuck(is_boat: bool) -> [&'static str; 2] {
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

/// What keeps the vehicle from doing what is asked for.
pub const fn clamp(clamp: Clamp) -> &'static str {
    match clamp {
        Clamp::Speed => "the vehicle's greatest speed",
        Clamp::Ramp => "its acceleration",
        Clamp::Age => "the age of commands",
        Clamp::CollisionMonitor => "the collision monitor",
        Clamp::Stop => "its state",
    }
}

/// Why what is held down counts for nothing, where the robot stopped for `last_stop` last.
pub fn ignored(why: InputLockReason, last_stop: Option<StopReason>) -> String {
    let words = loss(why);
    match (why, last_stop) {
        (InputLockReason::Stopped, Some(reason)) if reason != StopReason::Released => {
            format!("{words}, {}", stop(reason))
        }
        (
            InputLockReason::Focus
            | InputLockReason::WindowHidden
            | InputLockReason::Typing
            | InputLockReason::Gamepad
            | InputLockReason::Link
            | InputLockReason::Robot
            | InputLockReason::Lease
            | InputLockReason::LeaseRenewed
            | InputLockReason::EStop
            | InputLockReason::Stopped
            | InputLockReason::LoopStalled,
            _,
        ) => words.to_owned(),
    }
}

/// The same in general.
pub const fn loss(loss: InputLockReason) -> &'static str {
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

/// Whether a press would count on the vehicle.
pub const fn arming(arming: Arming) -> &'static str {
    match arming {
        Arming::Locked => "Release everything",
        Arming::Neutral => "Ready",
        Arming::Pressed => "Active",
    }
}

/// Why the vehicle does not do it.
pub fn refusal(why: Refusal) -> String {
    match why {
        // It tells strangers no more. Who is struck off, or has got another key, is one.
        Refusal::Signature | Refusal::UnknownOperator => {
            "your name and key are not on this vehicle's list of operators".to_owned()
        }
        Refusal::Malformed
        | Refusal::TooMany
        | Refusal::Role
        | Refusal::OtherBoot
        | Refusal::UnknownToken
        | Refusal::WrongNonce
        | Refusal::TooOld
        | Refusal::NotHolder
        | Refusal::OtherEpoch
        | Refusal::OldSequence
        | Refusal::NotFinite
        | Refusal::NotReady
        | Refusal::Busy
        | Refusal::NotWaiting
        | Refusal::NoEStop
        | Refusal::OtherEStop
        | Refusal::EStopNotStored
        | Refusal::EStopSince
        | Refusal::OutOfRange
        | Refusal::Unavailable => why.to_string(),
    }
}

/// The same of what was asked for.
fn request_refusal(what: &RequestKind, why: Refusal) -> String {
    let is_take_over = matches!(what, RequestKind::Lease(LeaseRequest::TakeOver));
    if is_take_over && why == Refusal::Role {
        // Who reads it may drive, and would look for a fault in their keys.
        return "only supervisors take over".to_owned();
    }
    refusal(why)
}

/// A note, and whether it says that something was not done.
pub fn note(note: &TeleopNotification) -> (String, bool) {
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
