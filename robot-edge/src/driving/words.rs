//! Between the arbiter's terms and those of the protocol.

use protocol::keys::OperatorId as OperatorName;
use protocol::message::{
    self, Answer, CommandCounters, Drive, EStopStatus, Guard, LeaseStatus, RefusedCount, Settings,
    TeleopState, TeleopStatus,
};
use protocol::signed::{SignedError, Stamp};

use super::board::Notice;
use crate::teleop::arbiter::{FaultReason, StopReason};
use crate::teleop::arming::Arming;
use crate::teleop::emergency_stop::EStopSource;
use crate::teleop::lease::{How, LeaseEnd};
use crate::teleop::report::Clamp;
use crate::teleop::{
    self, AgeToken, GuardVerdict, Happening, Mode, OperatorId, Refusal, TeleopReport, Velocity,
};

/// What can be switched beside the arbiter, and what is counted there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Switches {
    /// Bytes for tiles, kbit/s.
    pub budget_kbps: u32,
    /// Whether the collision guard is on.
    pub guard: bool,
    /// Whether recordings can be started and stopped.
    pub can_record: bool,
    /// Whether one runs.
    pub recording: bool,
    /// Messages that were dropped because too many waited.
    pub overflown: u64,
    /// Why it stopped last.
    pub last_stop: Option<StopReason>,
}

pub(super) fn token(stamp: &Stamp) -> AgeToken {
    AgeToken {
        boot_id: u128::from_be_bytes(stamp.boot.0),
        n: stamp.token.n,
        nonce: stamp.token.nonce,
    }
}

pub(super) fn velocity(drive: &Drive) -> Velocity {
    Velocity {
        linear_mps: drive.linear_mps.into(),
        angular_radps: drive.angular_radps.into(),
    }
}

/// Why a message was refused before the arbiter saw it.
pub(super) const fn refused(error: &SignedError) -> Refusal {
    match error {
        SignedError::TooLong(_) | SignedError::Unreadable(_) => Refusal::Malformed,
        SignedError::Signature => Refusal::Signature,
    }
}

pub(super) const fn refusal(refusal: Refusal) -> message::Refusal {
    match refusal {
        Refusal::Malformed => message::Refusal::Malformed,
        Refusal::TooMany => message::Refusal::TooMany,
        Refusal::Signature => message::Refusal::Signature,
        Refusal::Role => message::Refusal::Role,
        Refusal::OtherBoot => message::Refusal::OtherBoot,
        Refusal::UnknownToken => message::Refusal::UnknownToken,
        Refusal::WrongNonce => message::Refusal::WrongNonce,
        Refusal::TooOld => message::Refusal::TooOld,
        Refusal::NotHolder => message::Refusal::NotHolder,
        Refusal::OtherEpoch => message::Refusal::OtherEpoch,
        Refusal::OldSequence => message::Refusal::OldSequence,
        Refusal::NotFinite => message::Refusal::NotFinite,
        Refusal::NotReady => message::Refusal::NotReady,
        Refusal::Busy => message::Refusal::Busy,
        Refusal::NotWaiting => message::Refusal::NotWaiting,
        Refusal::NoEStop => message::Refusal::NoEStop,
        Refusal::OtherEStop => message::Refusal::OtherEStop,
        Refusal::EStopNotStored => message::Refusal::EStopNotStored,
        Refusal::EStopSince => message::Refusal::EStopSince,
    }
}

pub(super) const fn answer(answer: teleop::Answer) -> Answer {
    match answer {
        teleop::Answer::Granted { epoch } => Answer::Granted(epoch),
        teleop::Answer::Waiting => Answer::Waiting,
        teleop::Answer::Done => Answer::Done,
        teleop::Answer::EStopped(id) => Answer::EStopped(id.0),
        teleop::Answer::Refused(why) => Answer::Refused(refusal(why)),
    }
}

/// How driving is going, for everybody.
pub(super) fn status(
    report: &TeleopReport,
    names: &[OperatorName],
    switches: Switches,
) -> TeleopStatus {
    let name = |id: OperatorId| names.get(id.0 as usize).cloned();
    let lease = report.lease;
    let ms = |age: std::time::Duration| u32::try_from(age.as_millis()).unwrap_or(u32::MAX);
    TeleopStatus {
        state: state(report.mode),
        last_stop: switches.last_stop.map(stop_reason),
        is_drifting: report.is_drifting,
        lease: LeaseStatus {
            epoch: lease.epoch,
            holder: lease.holder.and_then(|holder| name(holder.operator)),
            next: lease.next.and_then(|(next, _)| name(next)),
            waiting: lease.waiting.and_then(|waiting| name(waiting.operator)),
        },
        arming: match report.arming {
            Arming::Locked => message::Arming::Locked,
            Arming::Neutral { .. } => message::Arming::Neutral,
            Arming::Pressed => message::Arming::Pressed,
        },
        age_ms: report.age.map(ms),
        greatest_age_ms: report.greatest_age.map(ms),
        speed_allowed_mps: report.speed_allowed_mps as f32,
        requested: on_the_wire(report.requested),
        applied: on_the_wire(report.applied),
        clamp: report.clamp.map(|clamp| match clamp {
            Clamp::Vehicle => message::Clamp::Speed,
            Clamp::Age => message::Clamp::Age,
            Clamp::Guard => message::Clamp::Guard,
            Clamp::Ramp => message::Clamp::Ramp,
        }),
        guard: guard(report.guard),
        estop: report.estop.map(|estop| EStopStatus {
            number: estop.id.0,
            is_stored: estop.is_stored,
        }),
        counters: counters(report, switches.overflown),
        settings: Settings {
            budget_kbps: switches.budget_kbps,
            guard: switches.guard,
            recording: switches.recording,
        },
    }
}

/// What happened, in a word and in a sentence.
pub(super) fn event(notice: &Notice, names: &[OperatorName]) -> (&'static str, String) {
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
    };
    match happening {
        Happening::Mode { from, to } => {
            let text = match to {
                Mode::Stopping { reason, .. } => format!("stopping: {}", why_stopped(reason)),
                Mode::SafeBoot
                | Mode::Idle
                | Mode::Held
                | Mode::Driving
                | Mode::EStop
                | Mode::Fault(_) => format!("{} after {}", said(to), said(from)),
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
        Happening::LeaseEnded { operator, why } => {
            let why = match why {
                LeaseEnd::Released => "it was given back",
                LeaseEnd::Expired => "no command came",
                LeaseEnd::Renewed => "it was asked for anew",
                LeaseEnd::HandedOver => "it was handed over",
                LeaseEnd::TakenOver => "a supervisor took it",
                LeaseEnd::Revoked => "no operator any more",
                LeaseEnd::Reset => "an emergency stop was reset",
                LeaseEnd::Fault => "the vehicle is at fault",
            };
            (
                "lease_ended",
                format!("{} no longer drives: {why}", name(operator)),
            )
        }
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
        Happening::Refused { caller, refusal } => (
            "refused",
            format!("a request of {}: {refusal}", name(caller.operator)),
        ),
    }
}

const fn why_stopped(reason: StopReason) -> &'static str {
    match reason {
        StopReason::Released => "nothing is pressed",
        StopReason::Age => "the commands are too old",
        StopReason::NotFinite => "what was asked for is no number",
        StopReason::GuardStale => "the collision guard could not judge",
        StopReason::LeaseEnded(why) => match why {
            LeaseEnd::Released => "the lease was given back",
            LeaseEnd::Expired => "no command came",
            LeaseEnd::Renewed => "the lease was asked for anew",
            LeaseEnd::HandedOver => "the lease was handed over",
            LeaseEnd::TakenOver => "a supervisor took the lease",
            LeaseEnd::Revoked => "who drove is no operator any more",
            LeaseEnd::Reset => "an emergency stop was reset",
            LeaseEnd::Fault => "the vehicle is at fault",
        },
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

const fn said(mode: Mode) -> &'static str {
    match mode {
        Mode::SafeBoot => "starting",
        Mode::Idle => "idle",
        Mode::Held => "held",
        Mode::Driving => "driving",
        Mode::Stopping { .. } => "stopping",
        Mode::EStop => "emergency stop",
        Mode::Fault(_) => "fault",
    }
}

const fn state(mode: Mode) -> TeleopState {
    match mode {
        Mode::SafeBoot => TeleopState::SafeBoot,
        Mode::Idle => TeleopState::Idle,
        Mode::Held => TeleopState::Held,
        Mode::Driving => TeleopState::Driving,
        Mode::Stopping { reason, .. } => TeleopState::Stopping(stop_reason(reason)),
        Mode::EStop => TeleopState::EStop,
        Mode::Fault(FaultReason::SelfTest) => TeleopState::Fault(message::FaultReason::SelfTest),
        Mode::Fault(FaultReason::Actuator) => TeleopState::Fault(message::FaultReason::Actuator),
    }
}

const fn stop_reason(reason: StopReason) -> message::StopReason {
    match reason {
        StopReason::Released => message::StopReason::Released,
        StopReason::Age => message::StopReason::Age,
        StopReason::NotFinite => message::StopReason::NotFinite,
        StopReason::GuardStale => message::StopReason::GuardStale,
        StopReason::LeaseEnded(why) => message::StopReason::LeaseEnded(match why {
            LeaseEnd::Released => message::LeaseEnd::Released,
            LeaseEnd::Expired => message::LeaseEnd::Expired,
            LeaseEnd::Renewed => message::LeaseEnd::Renewed,
            LeaseEnd::HandedOver => message::LeaseEnd::HandedOver,
            LeaseEnd::TakenOver => message::LeaseEnd::TakenOver,
            LeaseEnd::Revoked => message::LeaseEnd::Revoked,
            LeaseEnd::Reset => message::LeaseEnd::Reset,
            LeaseEnd::Fault => message::LeaseEnd::Fault,
        }),
    }
}

fn guard(verdict: Option<GuardVerdict>) -> Guard {
    match verdict {
        None => Guard::Silent,
        Some(GuardVerdict::Off) => Guard::Off,
        Some(GuardVerdict::Stale) => Guard::Stale,
        Some(GuardVerdict::Limits(limits)) => {
            let shown = message::GuardLimits {
                forward_mps: limits.forward_mps as f32,
                reverse_mps: limits.reverse_mps as f32,
                left_radps: limits.left_radps as f32,
                right_radps: limits.right_radps as f32,
            };
            if limits.is_blind {
                Guard::Blind(shown)
            } else {
                Guard::On(shown)
            }
        }
    }
}

fn counters(report: &TeleopReport, overflown: u64) -> CommandCounters {
    let counters = report.counters;
    let refused = Refusal::ALL.into_iter().map(|why| {
        let beside = if why == Refusal::TooMany {
            overflown
        } else {
            0
        };
        RefusedCount {
            reason: refusal(why),
            count: counters.refused(why).saturating_add(beside),
        }
    });
    let mut refused: Vec<_> = refused.filter(|refused| refused.count > 0).collect();
    refused.sort_by_key(|refused| refused.reason);
    CommandCounters {
        accepted: counters.accepted,
        involuntary_stops: counters.involuntary_stops,
        refused,
    }
}

const fn on_the_wire(velocity: Velocity) -> message::Velocity {
    message::Velocity {
        linear_mps: velocity.linear_mps as f32,
        angular_radps: velocity.angular_radps as f32,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::clock::Monotonic;
    use crate::teleop::guard::Lack;

    #[test]
    fn a_stop_says_why() {
        let stops = |reason| {
            let since = Monotonic::default();
            let to = Mode::Stopping { reason, since };
            let from = Mode::Driving;
            Notice::Arbiter(Happening::Mode { from, to })
        };
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
}
