//! What happened, as people read it in the log.

use protocol::keys::OperatorId as OperatorName;

use super::reasons::{why_ended, why_stopped};
use crate::driving::board::{GuardAgain, Notice};
use crate::teleop::arbiter::FaultReason;
use crate::teleop::emergency_stop::EStopSource;
use crate::teleop::lease::How;
use crate::teleop::{Happening, Mode, OperatorId};

/// What happened, in a word and in a sentence.
pub(in crate::driving) fn event(notice: &Notice, names: &[OperatorName]) -> (&'static str, String) {
    let name = |id: OperatorId| {
        let known = names.get(id.0 as usize);
        known.map_or_else(|| format!("operator {}", id.0), ToString::to_string)
    };
    let happening = match *notice {
        Notice::Arbiter(happening) => happening,
        Notice::Unguarded { lack } => {
            let lack = lack.map_or_else(|| "it said nothing".to_owned(), |lack| lack.to_string());
            return (
                "involuntary_stop",
                format!("stopping: the collision guard could not judge, {lack}"),
            );
        }
        Notice::Motors(fault) => return ("motors", fault.to_string()),
        Notice::LoopFailed(failure) => return ("fault", failure.to_string()),
        Notice::Recording { is_on, by } => {
            let done = if is_on { "started" } else { "stopped" };
            return (
                "recording",
                format!("a recording was {done} by {}", name(by)),
            );
        }
        Notice::Guard { is_on, by } => {
            let (kind, to) = if is_on {
                ("guard", "on")
            } else {
                ("guard_off", "off")
            };
            return (
                kind,
                format!("the collision guard was switched {to} by {}", name(by)),
            );
        }
        Notice::GuardAgain(why) => {
            let why = match why {
                GuardAgain::Granted(to) => format!("{} has the lease from now on", name(to)),
                GuardAgain::EStopped => "an emergency stop".to_owned(),
                GuardAgain::Reset => "a reset".to_owned(),
            };
            return ("guard", format!("the collision guard is on again: {why}"));
        }
    };
    match happening {
        Happening::Mode { from, to } => {
            let text = match to {
                Mode::Stopping { reason, .. } => format!("stopping: {}", why_stopped(reason)),
                Mode::Idle | Mode::Held | Mode::Driving => {
                    format!("{}{}", over(from), said(to))
                }
                Mode::SafeBoot | Mode::EStop | Mode::Fault(_) => said(to).to_owned(),
            };
            (mode_kind(to), text)
        }
        Happening::LeaseRequested { by } => {
            ("lease_requested", format!("{} asks to drive", name(by)))
        }
        Happening::LeaseGranted { to, how, .. } => {
            let how = match how {
                How::Request => "asked and the lease was free",
                How::HandOver => "it was handed over",
                How::TakeOver => "as supervisor, whoever drove",
            };
            ("lease_granted", format!("{} drives: {how}", name(to)))
        }
        Happening::LeaseEnded { operator, why } => (
            "lease_ended",
            format!("{} no longer drives: {}", name(operator), why_ended(why)),
        ),
        Happening::EStopped { id, by } => {
            let by = match by {
                Some(EStopSource::Operator(operator)) => name(operator),
                Some(EStopSource::Local) => "somebody at the vehicle".to_owned(),
                None => "the run before".to_owned(),
            };
            ("estop", format!("emergency stop {}, by {by}", id.0))
        }
        Happening::Reset { id, by } => {
            let by = by.map_or_else(
                || "somebody at the vehicle".to_owned(),
                |caller| name(caller.operator),
            );
            (
                "estop_reset",
                format!("emergency stop {} reset by {by}", id.0),
            )
        }
        Happening::Refused {
            caller, refusal, ..
        } => (
            "refused",
            format!("a request of {}: {refusal}", name(caller.operator)),
        ),
    }
}

/// A fault and a stop that nobody asked for matter more than other changes of state.
const fn mode_kind(to: Mode) -> &'static str {
    match to {
        Mode::Fault(_) => "fault",
        Mode::Stopping { reason, .. } if !reason.is_voluntary() => "involuntary_stop",
        Mode::SafeBoot
        | Mode::Idle
        | Mode::Held
        | Mode::Driving
        | Mode::Stopping { .. }
        | Mode::EStop => "teleop_state",
    }
}

/// A state, as true of what stands as of a boat that drifts.
const fn said(mode: Mode) -> &'static str {
    match mode {
        Mode::SafeBoot => "the self-test runs",
        Mode::Idle => "nobody drives",
        Mode::Held => "waits for the driver's keys",
        Mode::Driving => "obeys the driver's keys",
        Mode::Stopping { .. } => "stopping",
        Mode::EStop => "emergency stop: nothing moves until a reset",
        Mode::Fault(FaultReason::SelfTest) => "fault: the self-test failed",
        Mode::Fault(FaultReason::Actuator) => "fault: the motors do not obey",
    }
}

/// What has ended, where people were kept from driving by it.
const fn over(from: Mode) -> &'static str {
    match from {
        Mode::SafeBoot => "self-test passed, ",
        Mode::EStop => "emergency stop over, ",
        // A fault ends in a self-test.
        Mode::Idle | Mode::Held | Mode::Driving | Mode::Stopping { .. } | Mode::Fault(_) => "",
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::clock::Monotonic;
    use crate::teleop::arbiter::StopReason;
    use crate::teleop::guard::Lack;
    use crate::teleop::lease::LeaseEnd;

    fn stops(reason: StopReason) -> Notice {
        let since = Monotonic::default();
        let to = Mode::Stopping { reason, since };
        let from = Mode::Driving;
        Notice::Arbiter(Happening::Mode { from, to })
    }

    #[test]
    fn a_stop_says_why() {
        let lack = Some(Lack::Pose(Some(Duration::from_millis(420))));
        for (notice, kind, text) in [
            (
                stops(StopReason::Age),
                "involuntary_stop",
                "stopping: the commands are too old",
            ),
            (
                stops(StopReason::Released),
                "teleop_state",
                "stopping: nothing is pressed",
            ),
            (
                Notice::Unguarded { lack },
                "involuntary_stop",
                "stopping: the collision guard could not judge, its newest pose was 0.42 s old",
            ),
        ] {
            assert_eq!(event(&notice, &[]), (kind, text.to_owned()));
        }
    }

    #[test]
    fn a_state_is_told_in_words_that_hold_on_land_and_water() {
        let stopping = Mode::Stopping {
            reason: StopReason::Released,
            since: Monotonic::default(),
        };
        for (from, to, text) in [
            (stopping, Mode::Held, "waits for the driver's keys"),
            (Mode::Held, Mode::Driving, "obeys the driver's keys"),
            (Mode::Held, Mode::Idle, "nobody drives"),
            (
                Mode::SafeBoot,
                Mode::Idle,
                "self-test passed, nobody drives",
            ),
            (
                Mode::EStop,
                Mode::Idle,
                "emergency stop over, nobody drives",
            ),
            (
                Mode::Driving,
                Mode::EStop,
                "emergency stop: nothing moves until a reset",
            ),
        ] {
            let told = event(&Notice::Arbiter(Happening::Mode { from, to }), &[]);
            assert_eq!(told, ("teleop_state", text.to_owned()));
        }
    }

    #[test]
    fn who_no_longer_drives_is_told_why_as_it_is_of_the_stop() {
        let operator = OperatorId(0);
        let names = ["anna".parse().unwrap()];
        for (why, kind, words) in [
            (
                LeaseEnd::HandedOver,
                "teleop_state",
                "the lease was handed over",
            ),
            (
                LeaseEnd::Revoked,
                "involuntary_stop",
                "the leave to drive was taken away",
            ),
        ] {
            let ended = Notice::Arbiter(Happening::LeaseEnded { operator, why });
            let text = format!("anna no longer drives: {words}");
            assert_eq!(event(&ended, &names), ("lease_ended", text));
            let stopped = stops(StopReason::LeaseEnded(why));
            assert_eq!(
                event(&stopped, &names),
                (kind, format!("stopping: {words}"))
            );
        }
    }
}
