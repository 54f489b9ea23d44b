//! Why the vehicle stopped last. Its status tells only of stops on the way; an emergency stop may be newer than those.

use protocol::message::{Event, StopReason, TeleopState, TeleopStatus};

use super::labels;
use crate::model::StopBeforeEStop;
use crate::theme::Tone;

/// The newest stop, in words; `events` of the robot, the oldest first, and what it told of when an emergency stop
/// was heard. `None` before the first.
pub(super) fn last_stop<'a>(
    teleop: &TeleopStatus,
    stop_before_estop: Option<StopBeforeEStop>,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<(Tone, String)> {
    if let Some(estop) = teleop.estop {
        let words = format!("emergency stop {}", estop.number);
        return Some((Tone::Warning, words));
    }
    let is_stopping = matches!(teleop.state, TeleopState::Stopping(_));
    let newest = events.rev().find_map(is_emergency);
    // Events are heard once or never: what the status tells of since is newer.
    let is_newest = stop_before_estop.is_some_and(|before| before.last_stop == teleop.last_stop);
    if newest == Some(true) && is_newest && !is_stopping {
        return Some((Tone::Warning, "emergency stop, reset since".to_owned()));
    }
    let stop = teleop.last_stop?;
    let tone = match stop {
        StopReason::Released => Tone::Waiting,
        StopReason::Age
        | StopReason::NotFinite
        | StopReason::CollisionMonitorStale
        | StopReason::LeaseEnded(_) => Tone::Warning,
    };
    Some((tone, labels::stop(stop).to_owned()))
}

/// Whether an event is an emergency stop, or another stop; `None` where it is none.
fn is_emergency(event: &Event) -> Option<bool> {
    match event.kind.as_str() {
        "estop" => Some(true),
        "involuntary_stop" => Some(false),
        "teleop_state" if event.message.starts_with("stopping") => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{EStopStatus, Severity};

    use super::*;
    use crate::test_support::idle_teleop_status;

    fn event(kind: &str, message: &str) -> Event {
        Event {
            kind: kind.to_owned(),
            severity: Severity::Info,
            message: message.to_owned(),
        }
    }

    #[test]
    fn the_newest_stop_is_told_whatever_told_of_it() {
        let released = event("teleop_state", "stopping after driving");
        let estop = event("estop", "emergency stop 3, by anna");
        let rest = [
            event("teleop_state", "emergency stop after driving"),
            event("estop_reset", "emergency stop 3 reset by anna"),
            event("teleop_state", "held after idle"),
            event("teleop_state", "driving after held"),
        ];
        let mut teleop = idle_teleop_status();
        teleop.last_stop = Some(StopReason::Released);
        let before = |stop| {
            let last_stop = Some(stop);
            Some(StopBeforeEStop { last_stop })
        };
        let told = |teleop: &TeleopStatus, first: &[&Event]| {
            let events = first.iter().copied().chain(&rest);
            last_stop(teleop, before(StopReason::Released), events)
        };
        let let_go = Some((Tone::Waiting, "keys released".to_owned()));
        let emergency = |words: &str| Some((Tone::Warning, words.to_owned()));
        assert_eq!(told(&teleop, &[]), let_go);
        let reset = emergency("emergency stop, reset since");
        assert_eq!(told(&teleop, &[&released, &estop]), reset);
        assert_eq!(told(&teleop, &[&estop, &released]), let_go);
        let involuntary = event("involuntary_stop", "stopping after driving");
        assert_eq!(told(&teleop, &[&estop, &involuntary]), let_go);
        // While nobody heard it.
        let late = |before| last_stop(&teleop, before, [&released, &estop].into_iter());
        assert_eq!(late(before(StopReason::Age)), let_go);
        assert_eq!(late(None), let_go, "it began anew since");
        // What it does is newer than what was heard of it.
        teleop.state = TeleopState::Stopping(StopReason::Released);
        assert_eq!(told(&teleop, &[&released, &estop]), let_go);
        teleop.state = TeleopState::EStop;
        teleop.estop = Some(EStopStatus {
            number: 3,
            is_stored: true,
        });
        assert_eq!(told(&teleop, &[]), emergency("emergency stop 3"));
        assert_eq!(last_stop(&idle_teleop_status(), None, rest.iter()), None);
    }
}
