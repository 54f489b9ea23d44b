//! An emergency stop on its way: repeated until the robot says that it stands.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Answer, EStop, EStopStatus, Refusal};

use super::messages::RequestNumber;

/// "10 Hz until acknowledged."
pub(super) const PERIOD: Duration = Duration::from_millis(100);
/// Repetitions whose answers are waited for at most: those of the last two seconds.
const MAX_ASKED: usize = 20;

/// A press of the emergency stop that the robot has not acknowledged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct PendingEStop {
    press: u64,
    /// When it was pressed.
    pub(super) since: Monotonic,
    sent: Option<Monotonic>,
    /// Repetitions that may be answered yet, oldest first.
    asked: Vec<RequestNumber>,
    /// The newest emergency stop that the robot had told of before.
    before: Option<u64>,
}

/// What became of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum EStopOutcome {
    /// The vehicle stands, and this number is stored.
    Stopped(u64),
    /// The robot knows the press, and no stop is in force: it was refused, or obeyed and reset by somebody since.
    NotInForce,
    /// It is no use to repeat it.
    Refused(Refusal),
}

impl PendingEStop {
    /// A new press.
    pub(super) const fn new(press: u64, before: Option<u64>, now: Monotonic) -> Self {
        Self {
            press,
            since: now,
            sent: None,
            asked: Vec::new(),
            before,
        }
    }

    /// What is sent.
    pub(super) const fn body(&self) -> EStop {
        EStop { press: self.press }
    }

    /// When it is to be sent again.
    pub(super) fn due(&self, now: Monotonic) -> Monotonic {
        self.sent.map_or(now, |sent| sent + PERIOD)
    }

    /// It is sent, as this request.
    pub(super) fn sent(&mut self, request: RequestNumber, now: Monotonic) {
        self.sent = Some(now);
        if self.asked.len() == MAX_ASKED {
            self.asked.remove(0);
        }
        self.asked.push(request);
    }

    /// Whether it was ever sent.
    pub(super) const fn is_sent(&self) -> bool {
        self.sent.is_some()
    }

    /// Whether this is one of its repetitions.
    pub(super) fn is_mine(&self, request: RequestNumber) -> bool {
        self.asked.contains(&request)
    }

    /// What an answer to one of them means.
    pub(super) const fn answered(answer: Answer) -> Option<EStopOutcome> {
        match answer {
            Answer::EStopped(number) => Some(EStopOutcome::Stopped(number)),
            Answer::Refused(Refusal::NoEStop) => Some(EStopOutcome::NotInForce),
            Answer::Refused(
                refusal @ (Refusal::Role | Refusal::UnknownOperator | Refusal::Signature),
            ) => Some(EStopOutcome::Refused(refusal)),
            // A robot that was restarted, or is flooded, or that misunderstands: it is told again.
            Answer::Refused(_) | Answer::Done | Answer::Granted(_) | Answer::Waiting => None,
        }
    }

    /// Whether a status tells of this press, or a later one. One that was in force before tells nothing: it may have
    /// been reset meanwhile.
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
    fn it_is_sent_at_once_and_ten_times_a_second() {
        let mut pending = PendingEStop::new(7, None, at(5));
        assert_eq!(pending.due(at(5)), at(5));
        for number in 0..1000 {
            pending.sent(RequestNumber(number), at(5));
        }
        assert_eq!(pending.due(at(5)), at(105));
        assert!(pending.is_mine(RequestNumber(999)) && !pending.is_mine(RequestNumber(979)));
    }

    #[test]
    fn only_a_stored_stop_that_is_newer_acknowledges_it() {
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
    fn what_may_pass_is_repeated() {
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
