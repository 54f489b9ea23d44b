//! An emergency stop that is repeated until the robot acknowledges it.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Answer, EStop, EStopStatus, Refusal};

use super::messages::RequestNumber;

/// 10 Hz until acknowledged.
pub(super) const PERIOD: Duration = Duration::from_millis(100);
/// Limit of repetitions that await an answer: those of the last two seconds.
const MAX_ASKED: usize = 20;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PendingEStop {
    press: u64,
    pub(super) since: Monotonic,
    sent: Option<Monotonic>,
    /// Repetitions without an answer, oldest first.
    asked: Vec<RequestNumber>,
    /// Number of the robot's newest emergency stop before the press.
    before: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EStopOutcome {
    /// The vehicle is stopped, and the stop is stored under this number.
    Stopped(u64),
    /// The robot knows the press, but no stop is active: it was refused, or it was obeyed and reset since.
    NotInForce,
    /// Final: repetition does not help.
    Refused(Refusal),
}

impl PendingEStop {
    pub(super) const fn new(press: u64, before: Option<u64>, now: Monotonic) -> Self {
        Self {
            press,
            since: now,
            sent: None,
            asked: Vec::new(),
            before,
        }
    }

    pub(super) const fn body(&self) -> EStop {
        EStop { press: self.press }
    }

    pub(super) fn due(&self, now: Monotonic) -> Monotonic {
        self.sent.map_or(now, |sent| sent + PERIOD)
    }

    pub(super) fn sent(&mut self, request: RequestNumber, now: Monotonic) {
        self.sent = Some(now);
        if self.asked.len() == MAX_ASKED {
            self.asked.remove(0);
        }
        self.asked.push(request);
    }

    pub(super) const fn is_sent(&self) -> bool {
        self.sent.is_some()
    }

    pub(super) fn is_mine(&self, request: RequestNumber) -> bool {
        self.asked.contains(&request)
    }

    pub(super) const fn answered(answer: Answer) -> Option<EStopOutcome> {
        match answer {
            Answer::EStopped(number) => Some(EStopOutcome::Stopped(number)),
            Answer::Refused(Refusal::NoEStop) => Some(EStopOutcome::NotInForce),
            Answer::Refused(
                refusal @ (Refusal::Role | Refusal::UnknownOperator | Refusal::Signature),
            ) => Some(EStopOutcome::Refused(refusal)),
            // The robot was restarted, is overloaded or misunderstood: the stop is sent again.
            Answer::Refused(_) | Answer::Done | Answer::Granted(_) | Answer::Waiting => None,
        }
    }

    /// The number of the stop if a status acknowledges this press or a later one. A stop from before the press does not
    /// count: it may have been reset meanwhile.
    pub(super) fn is_acknowledged_by(&self, estop: Option<EStopStatus>) -> Option<u64> {
        estop
            .filter(|estop| {
                let is_new = self.before.is_none_or(|before| estop.number > before);
                estop.is_stored && self.is_sent() && is_new
            })
            .map(|estop| estop.number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    #[test]
    fn estop_is_sent_at_once_and_at_10_hz() {
        let mut pending = PendingEStop::new(7, None, at(5));
        assert_eq!(pending.due(at(5)), at(5));
        for number in 0..1000 {
            pending.sent(RequestNumber(number), at(5));
        }
        assert_eq!(pending.due(at(5)), at(105));
        assert!(pending.is_mine(RequestNumber(999)) && !pending.is_mine(RequestNumber(979)));
    }

    #[test]
    fn only_newer_stored_stop_acknowledges() {
        let stop = |number, is_stored| Some(EStopStatus { number, is_stored });
        let mut pending = PendingEStop::new(7, Some(3), at(0));
        assert_eq!(pending.is_acknowledged_by(stop(4, true)), None, "not sent");
        pending.sent(RequestNumber(1), at(0));
        assert_eq!(pending.is_acknowledged_by(None), None);
        assert_eq!(pending.is_acknowledged_by(stop(3, true)), None);
        assert_eq!(pending.is_acknowledged_by(stop(4, false)), None);
        assert_eq!(pending.is_acknowledged_by(stop(4, true)), Some(4));
    }

    #[test]
    fn estop_repeats_after_temporary_refusals() {
        for refusal in Refusal::ALL {
            let outcome = PendingEStop::answered(Answer::Refused(refusal));
            let is_final = [Refusal::Role, Refusal::UnknownOperator, Refusal::Signature];
            let expected = if refusal == Refusal::NoEStop {
                Some(EStopOutcome::NotInForce)
            } else {
                is_final
                    .contains(&refusal)
                    .then_some(EStopOutcome::Refused(refusal))
            };
            assert_eq!(outcome, expected, "{refusal:?}");
        }
    }
}
