//! A question that is asked again until it is answered, one at a time, so that it never takes a link that something more
//! urgent needs. Pure: the present is a parameter.

use std::time::Duration;

use measurement::time::Monotonic;

use super::incoming::RequestId;

/// The link says when no answer will come, after 10 s at most. That may be lost as anything else.
pub(super) const ANSWER_TIMEOUT: Duration = Duration::from_secs(12);
const FIRST_BACK_OFF: Duration = Duration::from_millis(500);
const LONGEST_BACK_OFF: Duration = Duration::from_secs(8);

/// When to ask, and what was asked.
#[derive(Clone, Debug, Default)]
pub(super) struct RetryTimer {
    asked: Option<(RequestId, Monotonic)>,
    not_before: Monotonic,
    /// Questions in a row that were not answered.
    failures: u32,
}

impl RetryTimer {
    /// Whether it is time to ask.
    pub(super) fn is_due(&self, now: Monotonic) -> bool {
        self.is_due_after(ANSWER_TIMEOUT, now)
    }

    /// The same where an answer is waited for no longer than that.
    pub(super) fn is_due_after(&self, patience: Duration, now: Monotonic) -> bool {
        let is_waiting = self
            .asked
            .is_some_and(|(_, asked_at)| now.since(asked_at) < patience);
        !is_waiting && now >= self.not_before
    }

    /// It is asked now, by this number.
    pub(super) const fn ask(&mut self, request: RequestId, now: Monotonic) {
        self.asked = Some((request, now));
    }

    /// An answer came; whether it is one to the last question.
    pub(super) fn is_answered(&mut self, request: RequestId) -> bool {
        let is_answer = self.asked.is_some_and(|(asked, _)| asked == request);
        if is_answer {
            self.asked = None;
        }
        is_answer
    }

    /// The answer made sense: the next question need not wait.
    pub(super) const fn succeed(&mut self) {
        self.failures = 0;
    }

    /// The next question has time until then.
    pub(super) const fn wait_until(&mut self, at: Monotonic) {
        self.not_before = at;
    }

    /// No more answers to a question will come; true if it was asked here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        let is_unanswered = self.is_answered(request);
        if is_unanswered {
            self.fail(now);
        }
        is_unanswered
    }

    /// It went wrong: the next question waits, the longer the more often that was so.
    pub(super) fn fail(&mut self, now: Monotonic) {
        let back_off = FIRST_BACK_OFF * 2u32.saturating_pow(self.failures.min(8));
        self.not_before = now + back_off.min(LONGEST_BACK_OFF);
        self.failures += 1;
    }
}
