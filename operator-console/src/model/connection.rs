//! How well the link does: round trip, age of the newest message, bytes that arrive.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

use super::incoming::RequestId;

/// Over which the rate is measured.
const RATE_WINDOW: Duration = Duration::from_secs(2);
const PING_PERIOD: Duration = Duration::from_secs(1);
/// An answer that takes longer is not waited for.
const PING_TIMEOUT: Duration = Duration::from_secs(5);
/// Without any message for this long, a robot that sends poses is not heard. It sends 20 a second and more: this is the
/// time of 8. A link that loses every tenth, each by itself, loses 8 in a row once in two months; one that jitters would
/// have to shift them by 350 ms. With what a frame takes, the operator is told within 500 ms.
pub const SILENT_AFTER: Duration = Duration::from_millis(400);
/// The same where poses do not come steadily: before the first, without any (a status comes twice a second), and for a
/// second after a silence, so that a link that only just holds is not called lost with every breath.
pub const SILENT_AFTER_UNSTEADY: Duration = Duration::from_millis(1500);

/// What the link is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkState {
    /// No message has come yet, and none is missed.
    Waiting,
    /// Messages come.
    Live,
    /// Messages came, by this link or before it began, but not lately.
    Silent,
}

/// What was heard of the robot before this link to it began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastContact {
    /// When that was last.
    pub last: Monotonic,
    /// From when on it is missed: a link takes its time to be opened.
    pub expected_from: Monotonic,
    /// It had said that its data had ended.
    pub had_ended: bool,
}

/// Measures the link from what arrives.
#[derive(Clone, Debug, Default)]
pub struct Connection {
    before: Option<LastContact>,
    last_message: Option<Monotonic>,
    /// Whether poses came often enough to miss them soon.
    is_steady: bool,
    round_trip: Option<Duration>,
    pings: VecDeque<(RequestId, Monotonic)>,
    /// When that was asked which gave the round trip.
    answered: Option<Monotonic>,
    last_ping: Option<Monotonic>,
    /// Arrivals within the window, in slices of a tenth of it.
    arrivals: VecDeque<(Monotonic, usize)>,
    bytes: u64,
    messages: u64,
    is_present: Option<bool>,
}

impl Connection {
    /// The state at `now`.
    pub fn state(&self, now: Monotonic) -> LinkState {
        match (self.last_message, self.before) {
            (Some(at), _) if now.since(at) <= self.silent_after() => LinkState::Live,
            (None, before) if before.is_none_or(|before| now < before.expected_from) => {
                LinkState::Waiting
            }
            (Some(_) | None, _) => LinkState::Silent,
        }
    }

    /// Without any message for this long, the robot is silent.
    pub const fn silent_after(&self) -> Duration {
        if self.is_steady {
            SILENT_AFTER
        } else {
            SILENT_AFTER_UNSTEADY
        }
    }

    /// Time since the robot was heard last, by this link or before it began; `None` where it never was.
    pub fn age(&self, now: Monotonic) -> Option<Duration> {
        let before = self.before.map(|before| before.last);
        self.last_message.or(before).map(|at| now.since(at))
    }

    /// Whether the robot said before this link began that its data had ended.
    pub fn had_ended_before(&self) -> bool {
        self.before.is_some_and(|before| before.had_ended)
    }

    /// When the newest message came by this link; `None` before the first.
    pub const fn last_message_at(&self) -> Option<Monotonic> {
        self.last_message
    }

    /// The last round trip that was measured, while the robot answers.
    pub const fn round_trip(&self) -> Option<Duration> {
        self.round_trip
    }

    /// Payload that arrives, kilobits (10³ bits) per second over the last 2 s.
    pub fn kbps(&self, now: Monotonic) -> f64 {
        let recent = self
            .arrivals
            .iter()
            .filter(|(at, _)| now.since(*at) < RATE_WINDOW);
        let bytes: usize = recent.map(|(_, bytes)| bytes).sum();
        bytes as f64 * 8e-3 / RATE_WINDOW.as_secs_f64()
    }

    /// Payload bytes and messages that arrived in all.
    pub const fn totals(&self) -> (u64, u64) {
        (self.bytes, self.messages)
    }

    /// Whether the robot's presence token is there; `None` while nothing is known of it. For display only.
    pub const fn is_present(&self) -> Option<bool> {
        self.is_present
    }

    pub(super) fn add_bytes(&mut self, bytes: usize, now: Monotonic) {
        self.bytes += bytes as u64;
        self.messages += 1;
        let slice = RATE_WINDOW / 10;
        match self.arrivals.back_mut() {
            Some((at, sum)) if now.since(*at) < slice => *sum += bytes,
            Some(_) | None => self.arrivals.push_back((now, bytes)),
        }
        while self
            .arrivals
            .front()
            .is_some_and(|(at, _)| now.since(*at) >= RATE_WINDOW)
        {
            self.arrivals.pop_front();
        }
    }

    pub(super) const fn set_last_contact(&mut self, before: LastContact) {
        self.before = Some(before);
    }

    /// A message of the robot made sense.
    pub(super) fn on_message(&mut self, now: Monotonic) {
        self.last_message = Some(now);
    }

    /// Whether poses come steadily.
    pub(super) const fn set_steady(&mut self, is_steady: bool) {
        self.is_steady = is_steady;
    }

    pub(super) fn set_present(&mut self, is_present: bool) {
        self.is_present = Some(is_present);
    }

    /// Waits no longer for answers that would be too late.
    pub(super) fn expire_pings(&mut self, now: Monotonic) {
        while let Some((_, at)) = self.pings.front().copied() {
            if now.since(at) < PING_TIMEOUT {
                break;
            }
            self.pings.pop_front();
            // One that was lost between others that were answered takes nothing from them.
            if self.answered.is_none_or(|answered| answered < at) {
                self.round_trip = None;
            }
        }
    }

    /// Whether it is time to ask for a round trip.
    pub(super) fn is_ping_due(&self, now: Monotonic) -> bool {
        self.last_ping.is_none_or(|at| now.since(at) >= PING_PERIOD)
    }

    pub(super) fn on_ping(&mut self, request: RequestId, now: Monotonic) {
        self.last_ping = Some(now);
        self.pings.push_back((request, now));
    }

    /// An answer came; true if it was to a ping.
    pub(super) fn on_pong(&mut self, request: RequestId, now: Monotonic) -> bool {
        let Some(index) = self.pings.iter().position(|(asked, _)| *asked == request) else {
            return false;
        };
        if let Some((_, at)) = self.pings.remove(index) {
            self.round_trip = Some(now.since(at));
            self.answered = Some(at);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    #[test]
    fn rates_are_those_of_the_last_seconds() {
        let mut link = Connection::default();
        for ms in (0..10_000).step_by(50) {
            link.add_bytes(100, at(ms));
        }
        // 2000 bytes a second.
        assert!(
            (link.kbps(at(9_999)) - 16.0).abs() < 1.7,
            "{}",
            link.kbps(at(9_999))
        );
        assert!(link.kbps(at(20_000)) < f64::EPSILON);
        assert!(link.arrivals.len() <= 11);
        assert_eq!(link.totals(), (20_000, 200));
    }

    #[test]
    fn silence_and_round_trips_are_seen() {
        let mut link = Connection::default();
        assert_eq!(link.state(at(0)), LinkState::Waiting);
        link.on_message(at(100));
        assert_eq!(link.state(at(1_600)), LinkState::Live);
        assert_eq!(link.state(at(1_601)), LinkState::Silent);
        link.set_steady(true);
        assert_eq!(link.state(at(500)), LinkState::Live);
        assert_eq!(link.state(at(501)), LinkState::Silent);
        assert!(link.is_ping_due(at(0)));
        link.on_ping(RequestId(1), at(0));
        assert!(!link.is_ping_due(at(900)));
        assert!(!link.on_pong(RequestId(2), at(50)));
        assert!(link.on_pong(RequestId(1), at(70)));
        assert_eq!(link.round_trip(), Some(Duration::from_millis(70)));
        link.on_ping(RequestId(3), at(1_000));
        assert!(link.is_ping_due(at(6_000)));
        link.expire_pings(at(6_000));
        assert_eq!(link.round_trip(), None, "no answer any more");
    }

    #[test]
    fn a_robot_that_was_heard_before_is_missed_and_its_age_counts_from_then() {
        let mut link = Connection::default();
        link.set_last_contact(LastContact {
            last: at(1_000),
            expected_from: at(5_000),
            had_ended: false,
        });
        let state_and_age = |link: &Connection, ms| (link.state(at(ms)), link.age(at(ms)).unwrap());
        let s = Duration::from_secs;
        assert_eq!(state_and_age(&link, 4_000), (LinkState::Waiting, s(3)));
        assert_eq!(state_and_age(&link, 5_000), (LinkState::Silent, s(4)));
        link.on_message(at(9_000));
        assert_eq!(state_and_age(&link, 10_000), (LinkState::Live, s(1)));
        assert_eq!(state_and_age(&link, 11_000), (LinkState::Silent, s(2)));
    }

    #[test]
    fn one_ping_that_is_lost_takes_nothing_from_those_around_it() {
        let mut link = Connection::default();
        for (n, ms) in [(1, 0), (2, 1_000), (3, 2_000)] {
            link.on_ping(RequestId(n), at(ms));
        }
        assert!(link.on_pong(RequestId(1), at(30)));
        assert!(link.on_pong(RequestId(3), at(2_050)));
        link.expire_pings(at(6_500));
        assert_eq!(link.round_trip(), Some(Duration::from_millis(50)));
        assert_eq!(link.pings, []);
    }
}
