//! A request that is repeated until it is answered, one at a time, so that it never fills a link that urgent data needs.

use std::time::Duration;

use measurement::time::Monotonic;

use super::messages::RequestId;

/// The link reports the end of a request after 10 s at most. That report can be lost too.
pub(super) const ANSWER_TIMEOUT: Duration = Duration::from_secs(12);

/// Delay that doubles with each failure in a row.
#[derive(Clone, Debug)]
pub(super) struct Backoff {
    first: Duration,
    longest: Duration,
    pub(super) failures: u32,
    pub(super) not_before: Monotonic,
}

impl Default for Backoff {
    fn default() -> Self {
        Self::new(Duration::from_millis(500), Duration::from_secs(8))
    }
}

impl Backoff {
    pub(super) const fn new(first: Duration, longest: Duration) -> Self {
        Self {
            first,
            longest,
            failures: 0,
            not_before: Monotonic::from_nanos(0),
        }
    }

    pub(super) fn is_due(&self, now: Monotonic) -> bool {
        now >= self.not_before
    }

    pub(super) const fn succeed(&mut self) {
        self.failures = 0;
    }

    pub(super) fn fail(&mut self, now: Monotonic) {
        let delay = self.first * 2u32.pow(self.failures.min(8));
        self.failures = self.failures.saturating_add(1);
        self.not_before = now + delay.min(self.longest);
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct RetryTimer {
    open: Option<(RequestId, Monotonic)>,
    pub(super) backoff: Backoff,
}

impl RetryTimer {
    /// Sends a request if one is due; the answer to the last one is awaited for `timeout`.
    pub(super) fn request(
        &mut self,
        timeout: Duration,
        now: Monotonic,
        number: impl FnOnce() -> RequestId,
    ) -> Option<RequestId> {
        let is_waiting = self
            .open
            .is_some_and(|(_, sent_at)| now.since(sent_at) < timeout);
        if is_waiting || !self.backoff.is_due(now) {
            return None;
        }
        let request = number();
        self.open = Some((request, now));
        Some(request)
    }

    pub(super) fn is_answered(&mut self, request: RequestId) -> bool {
        self.open.take_if(|(open, _)| *open == request).is_some()
    }

    /// No more answers to a request will come; true if it was the last one here.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) -> bool {
        let is_unanswered = self.is_answered(request);
        if is_unanswered {
            self.backoff.fail(now);
        }
        is_unanswered
    }
}
