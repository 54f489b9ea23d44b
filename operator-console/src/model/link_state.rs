//! State of the link (round trip, age of the newest message, rate) and its quality for each stream, now and over the
//! last minutes.
//!
//! Sequence numbers run over all keys and all consoles, and tokens are issued more often than sent, so gaps in numbers
//! do not show a loss. But the rate of poses is specified (`SPEC.md`, section 2).

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

use super::messages::RequestId;

const PING_PERIOD: Duration = Duration::from_secs(2);
const PING_TIMEOUT: Duration = Duration::from_secs(5);
/// A robot that sends poses is silent after this time without a message, without and with a lease holder.
///
/// While nobody drives it sends 5 poses a second, and statuses and map heads between them. While somebody drives it sends 50, and with
/// the time of a frame the operator sees a cut within 500 ms. A link with 10 % independent loss loses 5 poses in a row, and the other
/// messages of that time, less than once in a year.
const SILENT_AFTER: [Duration; 2] = [Duration::from_secs(1), Duration::from_millis(400)];
/// The same if poses do not arrive steadily: before the first pose, without poses (a status comes twice a second), and
/// for a second after a silence, so that a weak link does not flicker.
pub const SILENT_AFTER_UNSTEADY: Duration = Duration::from_millis(1500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkState {
    /// No message has arrived yet, and none is overdue.
    Waiting,
    Live,
    /// Messages arrived, on this link or before it, but not recently.
    Silent,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastContact {
    pub last: Monotonic,
    /// From this time on the robot counts as silent: a link takes time to open.
    pub expected_from: Monotonic,
    /// The robot had reported the end of its data.
    pub had_ended: bool,
}

#[derive(Clone, Debug, Default)]
pub struct Connection {
    pub(super) before: Option<LastContact>,
    pub(super) last_message: Option<Monotonic>,
    /// The time after which the robot is silent, if poses arrive often enough to detect it early.
    pub(super) steady_limit: Option<Duration>,
    round_trip: Option<Duration>,
    pings: VecDeque<(RequestId, Monotonic)>,
    /// When the ping was sent that gave the round trip.
    answered: Option<Monotonic>,
    last_ping: Option<Monotonic>,
    /// Arrivals within the window, in slices of a tenth of it.
    arrivals: VecDeque<(Monotonic, usize)>,
    bytes: u64,
    messages: u64,
    pub(super) is_present: Option<bool>,
}

impl Connection {
    pub fn state(&self, now: Monotonic) -> LinkState {
        match (self.last_message, self.before) {
            (Some(at), _) if now.since(at) <= self.silent_after() => LinkState::Live,
            (None, before) if before.is_none_or(|before| now < before.expected_from) => {
                LinkState::Waiting
            }
            (Some(_) | None, _) => LinkState::Silent,
        }
    }

    /// Time without a message after which the robot is silent.
    pub fn silent_after(&self) -> Duration {
        self.steady_limit.unwrap_or(SILENT_AFTER_UNSTEADY)
    }

    pub fn age(&self, now: Monotonic) -> Option<Duration> {
        let before = self.before.map(|before| before.last);
        self.last_message.or(before).map(|at| now.since(at))
    }

    pub const fn last_message_at(&self) -> Option<Monotonic> {
        self.last_message
    }

    pub const fn round_trip(&self) -> Option<Duration> {
        self.round_trip
    }

    /// Payload rate over the last 2 s, kbit/s.
    pub fn kbps(&self, now: Monotonic) -> f64 {
        let recent = self.arrivals.iter();
        let recent = recent.filter(|(at, _)| now.since(*at) < WINDOW);
        let bytes: usize = recent.map(|(_, bytes)| bytes).sum();
        bytes as f64 * 8e-3 / WINDOW.as_secs_f64()
    }

    pub const fn totals(&self) -> (u64, u64) {
        (self.bytes, self.messages)
    }

    pub const fn is_present(&self) -> Option<bool> {
        self.is_present
    }

    pub(super) fn add_bytes(&mut self, bytes: usize, now: Monotonic) {
        self.bytes += bytes as u64;
        self.messages += 1;
        let slice = WINDOW / 10;
        match self.arrivals.back_mut() {
            Some((at, sum)) if now.since(*at) < slice => *sum += bytes,
            Some(_) | None => self.arrivals.push_back((now, bytes)),
        }
        self.arrivals.retain(|(at, _)| now.since(*at) < WINDOW);
    }

    pub(super) fn expire_pings(&mut self, now: Monotonic) {
        while let Some((_, at)) = self.pings.front().copied() {
            if now.since(at) < PING_TIMEOUT {
                break;
            }
            self.pings.pop_front();
            // A lost ping between answered ones does not clear the round trip.
            if self.answered.is_none_or(|answered| answered < at) {
                self.round_trip = None;
            }
        }
    }

    pub(super) fn is_ping_due(&self, now: Monotonic) -> bool {
        self.last_ping.is_none_or(|at| now.since(at) >= PING_PERIOD)
    }

    pub(super) fn on_ping(&mut self, request: RequestId, now: Monotonic) {
        self.last_ping = Some(now);
        self.pings.push_back((request, now));
    }

    pub(super) fn on_pong(&mut self, request: RequestId, now: Monotonic) -> bool {
        let index = self.pings.iter().position(|(asked, _)| *asked == request);
        let ping = index.and_then(|index| self.pings.remove(index));
        if let Some((_, at)) = ping {
            self.round_trip = Some(now.since(at));
            self.answered = Some(at);
        }
        ping.is_some()
    }
}

const WINDOW: Duration = Duration::from_secs(2);
const MAX_POSES: usize = 200;
/// Poses a second without and with a lease holder.
const POSE_HZ: [f32; 2] = [5.0, 50.0];
/// Poses in the window without and with a lease holder. A link that loses half of the poses still carries them.
const STEADY_POSES: [usize; 2] = [5, 20];
/// Without a pose for this long, without and with a lease holder, the shown state is out of date.
const POSE_LATE: [Duration; 2] = [Duration::from_millis(1500), Duration::from_millis(600)];
/// Share of the poses that the robot's own jitter may move out of the window; one pose at least.
const JITTER: f32 = 0.02;
const SAMPLE_PERIOD: Duration = Duration::from_millis(500);
const MAX_SAMPLES: usize = 600;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stream {
    Pose,
    Status,
    MapHead,
    Tiles,
}

impl Stream {
    pub const ALL: [Self; 4] = [Self::Pose, Self::Status, Self::MapHead, Self::Tiles];
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSample {
    pub at: Monotonic,
    pub round_trip: Option<Duration>,
    pub pose_hz: f32,
    /// Share of the expected poses that did not arrive, 0 … 1; `None` if unknown.
    pub missing: Option<f32>,
    /// Payload rate, kbit/s.
    pub kbps: f32,
    /// Age of the newest message of each stream, in the order of [`Stream::ALL`].
    pub ages: [Option<Duration>; Stream::ALL.len()],
}

#[derive(Clone, Debug, Default)]
pub struct LinkQuality {
    last: [Option<Monotonic>; Stream::ALL.len()],
    poses: VecDeque<Monotonic>,
    is_held: bool,
    /// Since when the present rate of poses is expected.
    rated: Option<Monotonic>,
    samples: VecDeque<LinkSample>,
}

impl LinkQuality {
    pub fn age(&self, stream: Stream, now: Monotonic) -> Option<Duration> {
        self.last[stream as usize].map(|at| now.since(at))
    }

    pub fn pose_hz(&self, now: Monotonic) -> f32 {
        let recent = self.poses.iter().filter(|at| now.since(**at) < WINDOW);
        recent.count() as f32 / WINDOW.as_secs_f32()
    }

    /// The time after which the robot is silent, if poses arrived steadily: only then does their absence mean anything.
    pub(super) fn steady_limit(&self) -> Option<Duration> {
        let is_held = usize::from(self.is_held);
        (self.poses.len() >= STEADY_POSES[is_held]).then_some(SILENT_AFTER[is_held])
    }

    pub const fn expected_hz(&self) -> f32 {
        POSE_HZ[self.is_held as usize]
    }

    pub const fn pose_late(&self) -> Duration {
        POSE_LATE[self.is_held as usize]
    }

    /// Share of the expected poses of the last 2 s that did not arrive, 0 … 1; `None` until the rate is known for that
    /// long.
    pub fn missing(&self, now: Monotonic) -> Option<f32> {
        self.rated.filter(|at| now.since(*at) >= WINDOW)?;
        let expected = self.expected_hz() * WINDOW.as_secs_f32();
        let lost = expected - self.pose_hz(now) * WINDOW.as_secs_f32();
        let is_jitter = lost <= (JITTER * expected).max(1.0);
        Some(if is_jitter { 0.0 } else { lost / expected })
    }

    pub const fn samples(&self) -> &VecDeque<LinkSample> {
        &self.samples
    }

    pub(super) fn on_message(&mut self, stream: Stream, now: Monotonic) {
        self.last[stream as usize] = Some(now);
    }

    /// Sets whether an operator holds the lease, which determines the expected rate.
    pub(super) fn rate(&mut self, is_held: bool, now: Monotonic) {
        if self.rated.is_none() || self.is_held != is_held {
            self.rated = Some(now);
            self.is_held = is_held;
        }
    }

    pub(super) fn pose(&mut self, now: Monotonic) {
        self.on_message(Stream::Pose, now);
        self.poses.retain(|at| now.since(*at) < WINDOW);
        if self.poses.len() >= MAX_POSES {
            self.poses.pop_front();
        }
        self.poses.push_back(now);
    }

    pub(super) fn sample(
        &mut self,
        round_trip: Option<Duration>,
        missing: Option<f32>,
        kbps: f64,
        now: Monotonic,
    ) {
        let last = self.samples.back();
        if last.is_some_and(|last| now.since(last.at) < SAMPLE_PERIOD) {
            return;
        }
        if self.samples.len() == MAX_SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(LinkSample {
            at: now,
            round_trip,
            pose_hz: self.pose_hz(now),
            missing,
            kbps: kbps as f32,
            ages: Stream::ALL.map(|stream| self.age(stream, now)),
        });
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "whole numbers of poses in two seconds")]

    use super::*;
    use crate::test_support::at;

    #[test]
    fn rates_are_those_of_the_last_seconds() {
        let mut link = Connection::default();
        for ms in (0..10_000).step_by(50) {
            link.add_bytes(100, at(ms));
        }
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
        link.last_message = Some(at(100));
        assert_eq!(link.state(at(1_600)), LinkState::Live);
        assert_eq!(link.state(at(1_601)), LinkState::Silent);
        for (limit, ms) in SILENT_AFTER.into_iter().zip([1_100, 500]) {
            link.steady_limit = Some(limit);
            assert_eq!(link.state(at(ms)), LinkState::Live);
            assert_eq!(link.state(at(ms + 1)), LinkState::Silent);
        }
        assert!(link.is_ping_due(at(0)));
        link.on_ping(RequestId(1), at(0));
        assert!(!link.is_ping_due(at(1_900)) && link.is_ping_due(at(2_000)));
        assert!(!link.on_pong(RequestId(2), at(50)));
        assert!(link.on_pong(RequestId(1), at(70)));
        assert_eq!(link.round_trip(), Some(Duration::from_millis(70)));
        link.on_ping(RequestId(3), at(1_000));
        assert!(link.is_ping_due(at(6_000)));
        link.expire_pings(at(6_000));
        assert_eq!(link.round_trip(), None, "no answer any more");
    }

    #[test]
    fn contact_before_the_link_counts_for_silence_and_age() {
        let before = LastContact {
            last: at(1_000),
            expected_from: at(5_000),
            had_ended: false,
        };
        let mut link = Connection {
            before: Some(before),
            ..Connection::default()
        };
        let state_and_age = |link: &Connection, ms| (link.state(at(ms)), link.age(at(ms)).unwrap());
        let s = Duration::from_secs;
        assert_eq!(state_and_age(&link, 4_000), (LinkState::Waiting, s(3)));
        assert_eq!(state_and_age(&link, 5_000), (LinkState::Silent, s(4)));
        link.last_message = Some(at(9_000));
        assert_eq!(state_and_age(&link, 10_000), (LinkState::Live, s(1)));
        assert_eq!(state_and_age(&link, 11_000), (LinkState::Silent, s(2)));
    }

    #[test]
    fn lost_ping_keeps_the_round_trip() {
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

    fn after(is_held: bool, comes: impl Fn(u64) -> bool) -> LinkQuality {
        let mut quality = LinkQuality::default();
        quality.rate(is_held, at(0));
        let period_ms = if is_held { 20 } else { 200 };
        for n in (0..10_000 / period_ms).filter(|n| comes(*n)) {
            quality.pose(at(period_ms * n));
        }
        quality
    }

    #[test]
    fn rates_are_those_of_the_last_two_seconds() {
        let now = at(9_990);
        let whole = after(true, |_| true);
        assert_eq!((whole.pose_hz(now), whole.expected_hz()), (50.0, 50.0));
        assert_eq!(whole.missing(now), Some(0.0));
        let every_fourth_lost = after(true, |n| n % 4 != 1);
        assert_eq!(every_fourth_lost.missing(now), Some(0.25));
        assert_eq!(whole.missing(at(20_000)), Some(1.0));
        let age = whole.age(Stream::Pose, at(20_000));
        assert_eq!(age, Some(Duration::from_millis(10_020)));
        assert_eq!(whole.age(Stream::Status, at(20_000)), None);
        // Of 10 poses, one may be late.
        let idle = |lost| after(false, move |n| n % 10 >= lost).missing(now);
        assert_eq!([0, 1, 3].map(idle), [Some(0.0), Some(0.0), Some(0.3)]);
    }

    #[test]
    fn change_of_rate_is_no_loss() {
        let mut quality = after(true, |_| true);
        quality.rate(false, at(9_990));
        assert_eq!(quality.expected_hz(), 5.0);
        assert_eq!(quality.missing(at(9_990)), None);
        quality.rate(false, at(11_000));
        assert_eq!(quality.missing(at(11_990)), Some(1.0));
        assert_eq!(LinkQuality::default().missing(at(9_990)), None);
    }

    #[test]
    fn poses_are_steady_a_second_after_they_return() {
        for (is_held, count, period_ms) in [(true, 20, 50), (false, 5, 200)] {
            let limit = Some(SILENT_AFTER[usize::from(is_held)]);
            let mut quality = after(is_held, |_| true);
            assert_eq!(quality.steady_limit(), limit);
            for n in 0..count {
                quality.pose(at(30_000 + period_ms * n));
                let is_steady = n + 1 == count;
                assert_eq!(quality.steady_limit(), limit.filter(|_| is_steady), "{n}");
            }
            let mut slow = LinkQuality::default();
            slow.rate(is_held, at(0));
            for n in 0..100 {
                slow.pose(at(3 * period_ms * n));
            }
            assert_eq!(slow.steady_limit(), None, "less than half");
        }
    }

    #[test]
    fn memory_is_bounded() {
        let mut quality = LinkQuality::default();
        for n in 0..10_000 {
            quality.pose(at(n));
            quality.sample(None, None, 0.0, at(1000 * n));
        }
        assert!(quality.poses.len() <= MAX_POSES);
        assert_eq!(quality.samples().len(), MAX_SAMPLES);
    }
}
