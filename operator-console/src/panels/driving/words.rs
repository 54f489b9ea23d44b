//! States and reasons of driving as the operator reads them.

use protocol::message::{
    Answer, Arming, Clamp, FaultReason, LeaseEnd, LeaseRequest, Refusal, Setting, StopReason,
    TeleopState,
};

use crate::helm::{Asked, Note, WhyNot};
use crate::role::WATCHES;
use crate::teleop_input::Loss;

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
        StopReason::Released => "keys let go",
        StopReason::Age => "commands too old",
        StopReason::NotFinite => "nonsense was asked for",
        StopReason::GuardStale => "the guard's data came too late",
        StopReason::LeaseEnded(LeaseEnd::Released) => "the lease was given back",
        StopReason::LeaseEnded(LeaseEnd::Expired) => "the console fell silent",
        StopReason::LeaseEnded(LeaseEnd::Renewed) => "the lease was asked for anew",
        StopReason::LeaseEnded(LeaseEnd::HandedOver) => "handed over",
        StopReason::LeaseEnded(LeaseEnd::TakenOver) => "taken over",
        StopReason::LeaseEnded(LeaseEnd::Revoked) => "the operator was struck off",
        StopReason::LeaseEnded(LeaseEnd::Reset) => "an emergency stop was reset",
        StopReason::LeaseEnded(LeaseEnd::Fault) => "the vehicle is at fault",
    }
}

const fn fault(why: FaultReason) -> &'static str {
    match why {
        FaultReason::SelfTest => "the self-test failed",
        FaultReason::Actuator => "the motors do not obey",
    }
}

/// Why a vehicle may not move that is told to go, and the same when that is over.
pub const fn stuck(is_boat: bool) -> [&'static str; 2] {
    if is_boat {
        [
            "aground, held, or its motors do not obey",
            "aground, held, or its motors did not obey",
        ]
    } else {
        [
            "stuck, or its motors do not obey",
            "stuck, or its motors did not obey",
        ]
    }
}

/// What keeps the vehicle from doing what is asked for.
pub const fn clamp(clamp: Clamp) -> &'static str {
    match clamp {
        Clamp::Speed => "the vehicle's greatest speed",
        Clamp::Ramp => "its acceleration",
        Clamp::Age => "the age of commands",
        Clamp::Guard => "the collision guard",
        Clamp::Stop => "its state",
    }
}

/// Why what is held down counts for nothing, where the robot stopped for `last_stop` last.
pub fn ignored(why: Loss, last_stop: Option<StopReason>) -> String {
    let words = loss(why);
    match (why, last_stop) {
        (Loss::Stopped, Some(reason)) if reason != StopReason::Released => {
            format!("{words}, {}", stop(reason))
        }
        (
            Loss::Focus
            | Loss::Sight
            | Loss::Typing
            | Loss::Gamepad
            | Loss::Link
            | Loss::Robot
            | Loss::Lease
            | Loss::Renewed
            | Loss::EStop
            | Loss::Stopped
            | Loss::Frozen,
            _,
        ) => words.to_owned(),
    }
}

/// The same in general.
pub const fn loss(loss: Loss) -> &'static str {
    match loss {
        Loss::Focus => "the window lost the keyboard",
        Loss::Sight => "the window was hidden",
        Loss::Typing => "text was typed",
        Loss::Gamepad => "the gamepad went away",
        Loss::Link => "the link was lost",
        Loss::Robot => "the robot was restarted",
        Loss::Lease => "they were down before you drove",
        Loss::Renewed => "the lease was asked for anew",
        Loss::EStop => "emergency stop",
        Loss::Stopped => "the robot stopped by itself",
        Loss::Frozen => "this program stood still",
    }
}

/// Whether a press would count on the vehicle.
pub const fn arming(arming: Arming) -> &'static str {
    match arming {
        Arming::Locked => "Let go of everything",
        Arming::Neutral => "Ready",
        Arming::Pressed => "Obeyed",
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
fn refusal_of(what: &Asked, why: Refusal) -> String {
    let is_take_over = matches!(what, Asked::Lease(LeaseRequest::TakeOver));
    if is_take_over && why == Refusal::Role {
        // Who reads it may drive, and would look for a fault in their keys.
        return "only supervisors take over".to_owned();
    }
    refusal(why)
}

/// A note, and whether it says that something was not done.
pub fn note(note: &Note) -> (String, bool) {
    match note {
        Note::Answered(what, Answer::Refused(why)) => {
            let why = refusal_of(what, *why);
            (format!("{} refused: {why}", asked(what)), true)
        }
        Note::Answered(what, answer) => (format!("{}: {}", asked(what), outcome(*answer)), false),
        Note::NotAnswered(what) => (format!("{}: no answer", asked(what)), true),
        Note::NotSent(what, why) => {
            let why = match why {
                WhyNot::NoToken => "the robot gives no tokens",
                WhyNot::TooMany => "too many wait",
            };
            (format!("{} not sent: {why}", asked(what)), true)
        }
        Note::LeaseGained(epoch) => (format!("lease held, grant {epoch}"), false),
        Note::LeaseLost => ("lease lost".to_owned(), false),
        Note::LeaseGivenBack => ("lease given back".to_owned(), false),
        Note::ResetEndedDriving => (
            "the reset ended driving: press Drive anew".to_owned(),
            false,
        ),
        Note::EStopPressed => ("emergency stop pressed".to_owned(), false),
        Note::EStopAcknowledged(number) => (format!("emergency stop {number} acknowledged"), false),
        Note::EStopRefused(why) => (format!("emergency stop refused: {}", refusal(*why)), true),
        Note::EStopNotInForce => (
            "the emergency stop is not in force: it was refused, or reset since".to_owned(),
            true,
        ),
        Note::NothingToStop => (
            "nothing to stop: this robot is not driven over the network".to_owned(),
            true,
        ),
        Note::OnlyWatches => (WATCHES.to_owned(), true),
        Note::Lost(why) => (format!("keys count no more: {}", loss(*why)), false),
    }
}

fn asked(asked: &Asked) -> String {
    match asked {
        Asked::Lease(LeaseRequest::Request) => "lease request".to_owned(),
        Asked::Lease(LeaseRequest::Release) => "lease release".to_owned(),
        Asked::Lease(LeaseRequest::TakeOver) => "lease take-over".to_owned(),
        Asked::Lease(LeaseRequest::Consent(to)) => format!("lease consent {to}"),
        Asked::Lease(LeaseRequest::Refuse(whom)) => format!("lease refuse {whom}"),
        Asked::Reset(number) => format!("reset of emergency stop {number}"),
        Asked::Set(Setting::BudgetKbps(kbps)) => format!("budget {kbps}"),
        Asked::Set(Setting::Guard(is_on)) => format!("guard {}", switch(*is_on)),
        Asked::Set(Setting::Recording(is_on)) => format!("recording {}", switch(*is_on)),
    }
}

fn outcome(answer: Answer) -> String {
    match answer {
        Answer::Done => "done".to_owned(),
        Answer::Granted(epoch) => format!("granted, grant {epoch}"),
        Answer::Waiting => "waiting".to_owned(),
        Answer::EStopped(number) => format!("stopped, number {number}"),
        Answer::Refused(why) => format!("refused: {}", refusal(why)),
    }
}

const fn switch(is_on: bool) -> &'static str {
    if is_on { "on" } else { "off" }
}
