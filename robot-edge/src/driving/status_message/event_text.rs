//! What happened, as people read it in the log.

use protocol::keys::OperatorId as OperatorName;

use super::reason_text::{lease_end_text, stop_reason_text};
use crate::driving::shared_drive_state::{DriveEvent, MonitorReenabled};
use teleop::arbiter::FaultReason;
use teleop::emergency_stop::EStopSource;
use teleop::lease::GrantReason;
use teleop::{ArbiterEvent, Mode, OperatorId};

/// What happened, in a word and in a sentence.
pub(in crate::driving) fn event_text(
    drive_event: &DriveEvent,
    names: &[OperatorName],
) -> (&'static str, String) {
    let name = |id: OperatorId| {
        let known = names.get(id.0 as usize);
        known.map_or_else(|| format!("operator {}", id.0), ToString::to_string)
    };
    let event = match *drive_event {
        DriveEvent::Arbiter(event) => event,
        DriveEvent::MonitorUnavailable { unavailable_reason } => {
            let unavailable_reason = unavailable_reason.map_or_else(
                || "it did not respond".to_owned(),
                |unavailable_reason| unavailable_reason.to_string(),
            );
            return (
                "involuntary_stop",
                format!("stopping: the collision monitor could not judge, {unavailable_reason}"),
            );
        }
        DriveEvent::Motors(fault) => return ("motors", fault.to_string()),
        DriveEvent::LoopFailed(failure) => return ("fault", failure.to_string()),
        DriveEvent::Recording { is_on, by } => {
            let done = if is_on { "started" } else { "stopped" };
            return (
                "recording",
                format!("a recording was {done} by {}", name(by)),
            );
        }
        DriveEvent::MonitorSwitched { is_on, by } => {
            let (kind, to) = if is_on {
                ("collision_monitor", "on")
            } else {
                ("collision_monitor_off", "off")
            };
            return (
                kind,
                format!("the collision monitor was switched {to} by {}", name(by)),
            );
        }
        DriveEvent::MonitorReenabled(why) => {
            let why = match why {
                MonitorReenabled::Granted(to) => format!("{} has the lease from now on", name(to)),
                MonitorReenabled::EStopped => "an emergency stop".to_owned(),
                MonitorReenabled::Reset => "a reset".to_owned(),
            };
            return (
                "collision_monitor",
                format!("the collision monitor is on again: {why}"),
            );
        }
    };
    match event {
        ArbiterEvent::ModeChanged { from, to } => {
            let text = match to {
                Mode::Stopping { reason, .. } => format!("stopping: {}", stop_reason_text(reason)),
                Mode::Idle | Mode::Held | Mode::Driving => {
                    format!("{}{}", ended_mode_text(from), mode_text(to))
                }
                Mode::SafeBoot | Mode::EStop | Mode::Fault(_) => mode_text(to).to_owned(),
            };
            (mode_event_kind(to), text)
        }
        ArbiterEvent::LeaseRequested { by } => {
            ("lease_requested", format!("{} asks to drive", name(by)))
        }
        ArbiterEvent::LeaseGranted { to, how, .. } => {
            let how = match how {
                GrantReason::Request => "asked and the lease was free",
                GrantReason::HandOver => "it was handed over",
                GrantReason::TakeOver => "as supervisor, whoever drove",
            };
            ("lease_granted", format!("{} drives: {how}", name(to)))
        }
        ArbiterEvent::LeaseEnded { operator, why } => (
            "lease_ended",
            format!(
                "{} no longer drives: {}",
                name(operator),
                lease_end_text(why)
            ),
        ),
        ArbiterEvent::EStopped { id, by } => {
            let by = match by {
                Some(EStopSource::Operator(operator)) => name(operator),
                Some(EStopSource::Local) => "somebody at the vehicle".to_owned(),
                None => "the run before".to_owned(),
            };
            ("estop", format!("emergency stop {}, by {by}", id.0))
        }
        ArbiterEvent::Reset { id, by } => {
            let by = by.map_or_else(
                || "somebody at the vehicle".to_owned(),
                |caller| name(caller.operator),
            );
            (
                "estop_reset",
                format!("emergency stop {} reset by {by}", id.0),
            )
        }
        ArbiterEvent::Refused {
            caller, refusal, ..
        } => (
            "refused",
            format!("a request of {}: {refusal}", name(caller.operator)),
        ),
    }
}

/// A fault and a stop that nobody asked for matter more than other changes of state.
const fn mode_event_kind(to: Mode) -> &'static str {
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
const fn mode_text(mode: Mode) -> &'static str {
    match mode {
        Mode::SafeBoot => "the self-test runs",
        Mode::Idle => "nobody drives",
        Mode::Held => "waits for the driver's keys",
        Mode::Driving => "obeys the driver's keys",
        Mode::Stopping { .. } => "stopping",
        Mode::EStop => "emergency stop: nothing moves until a reset",
        Mode::Fault(FaultReason::SelfTest) => "fault: the self-test failed",
        Mode::Fault(FaultReason::Actuator) => "fault: the motors do not respond",
    }
}

/// What has ended, where people were kept from driving by it.
const fn ended_mode_text(from: Mode) -> &'static str {
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
    use measurement::time::Monotonic;
    use teleop::arbiter::StopReason;
    use teleop::collision_monitor::UnavailableReason;
    use teleop::lease::LeaseEnd;

    fn stops(reason: StopReason) -> DriveEvent {
        let since = Monotonic::default();
        let to = Mode::Stopping { reason, since };
        let from = Mode::Driving;
        DriveEvent::Arbiter(ArbiterEvent::ModeChanged { from, to })
    }

    #[test]
    fn a_stop_says_why() {
        let unavailable_reason = Some(UnavailableReason::PoseTooOld(Some(Duration::from_millis(
            420,
        ))));
        for (drive_event, kind, text) in [
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
                DriveEvent::MonitorUnavailable { unavailable_reason },
                "involuntary_stop",
                "stopping: the collision monitor could not judge, its newest pose was 0.42 s old",
            ),
        ] {
            assert_eq!(event_text(&drive_event, &[]), (kind, text.to_owned()));
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
            let events = event_text(
                &DriveEvent::Arbiter(ArbiterEvent::ModeChanged { from, to }),
                &[],
            );
            assert_eq!(events, ("teleop_state", text.to_owned()));
        }
    }

    #[test]
    fn who_no_longer_drives_is_told_why_as_it_is_of_the_stop() {
        let operator = OperatorId(0);
        let names = ["anna".parse().unwrap()];
        for (why, kind, status_message) in [
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
            let ended = DriveEvent::Arbiter(ArbiterEvent::LeaseEnded { operator, why });
            let text = format!("anna no longer drives: {status_message}");
            assert_eq!(event_text(&ended, &names), ("lease_ended", text));
            let stopped = stops(StopReason::LeaseEnded(why));
            assert_eq!(
                event_text(&stopped, &names),
                (kind, format!("stopping: {status_message}"))
            );
        }
    }
}
