//! How well the link carries each stream: rate, what is missing, and age, now and over the last minutes.
//!
//! Messages are numbered over all keys and all consoles, and tokens are issued more often than sent, so that no gap in
//! numbers tells of a loss. But how many poses a second a robot sends is specified (`SPEC.md`, section 2).

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

/// Over which rates are measured.
const WINDOW: Duration = Duration::from_secs(2);
/// Poses within the window at most, at twice the fastest rate.
const MAX_POSES: usize = 200;
/// Poses a second while nobody holds the lease, and while somebody does.
const POSE_HZ: [f32; 2] = [20.0, 50.0];
/// As many poses within the window are steady: 10 a second, which a link that loses half of them still carries.
const STEADY_POSES: usize = 20;
/// Between two samples of the history.
const SAMPLE_PERIOD: Duration = Duration::from_millis(500);
/// Samples that are kept: five minutes.
const MAX_SAMPLES: usize = 600;

/// What comes from the robot, by how it must not be mistaken for one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stream {
    /// Where it is.
    Pose,
    /// How it is doing.
    Status,
    /// What its map is.
    MapHead,
    /// The map itself; only where something changes.
    Tiles,
}

impl Stream {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Pose, Self::Status, Self::MapHead, Self::Tiles];
}

/// The link at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSample {
    /// When.
    pub at: Monotonic,
    /// Round trip; none while no answer.
    pub round_trip: Option<Duration>,
    /// Poses that came a second.
    pub pose_hz: f32,
    /// Share of the poses that should have come and did not, 0 … 1; none where too little is known, or none are known to have
    /// been sent.
    pub missing: Option<f32>,
    /// Payload that came, kbit/s.
    pub kbps: f32,
    /// Age of the newest message of each stream, in the order of [`Stream::ALL`]; none before the first.
    pub ages: [Option<Duration>; Stream::ALL.len()],
}

/// Measures streams by what arrives of them.
#[derive(Clone, Debug, Default)]
pub struct LinkQuality {
    last: [Option<Monotonic>; Stream::ALL.len()],
    /// Arrivals of poses within the window.
    poses: VecDeque<Monotonic>,
    is_held: bool,
    /// Since when poses are to come as often as they are.
    rated: Option<Monotonic>,
    samples: VecDeque<LinkSample>,
}

impl LinkQuality {
    /// Time since the newest message of a stream; none before the first.
    pub fn age(&self, stream: Stream, now: Monotonic) -> Option<Duration> {
        self.last[stream as usize].map(|at| now.since(at))
    }

    /// Poses a second, over the last 2 s.
    pub fn pose_hz(&self, now: Monotonic) -> f32 {
        self.recent(now).count() as f32 / WINDOW.as_secs_f32()
    }

    /// Whether poses came steadily when the last came: only then does their absence say anything soon.
    pub(super) fn is_steady(&self) -> bool {
        self.poses.len() >= STEADY_POSES
    }

    /// How many should come.
    pub const fn expected_hz(&self) -> f32 {
        POSE_HZ[self.is_held as usize]
    }

    /// Share of the poses of the last 2 s that should have come and did not, 0 … 1; none while it is not known for that
    /// long how many should.
    pub fn missing(&self, now: Monotonic) -> Option<f32> {
        self.rated.filter(|at| now.since(*at) >= WINDOW)?;
        // A robot's own 2 % is no loss.
        let share = 1.0 - self.pose_hz(now) / self.expected_hz();
        Some(if share < 0.02 { 0.0 } else { share.min(1.0) })
    }

    /// The last minutes, two samples a second, oldest first.
    pub const fn samples(&self) -> &VecDeque<LinkSample> {
        &self.samples
    }

    pub(super) fn on_message(&mut self, stream: Stream, now: Monotonic) {
        self.last[stream as usize] = Some(now);
    }

    /// Whether somebody holds the lease.
    pub(super) fn rate(&mut self, is_held: bool, now: Monotonic) {
        if self.rated.is_none() || self.is_held != is_held {
            self.rated = Some(now);
            self.is_held = is_held;
        }
    }

    pub(super) fn pose(&mut self, now: Monotonic) {
        self.on_message(Stream::Pose, now);
        while self.poses.len() >= MAX_POSES
            || self
                .poses
                .front()
                .is_some_and(|at| now.since(*at) >= WINDOW)
        {
            self.poses.pop_front();
        }
        self.poses.push_back(now);
    }

    /// To be called often: takes a sample where one is due.
    pub(super) fn sample(
        &mut self,
        round_trip: Option<Duration>,
        missing: Option<f32>,
        kbps: f64,
        now: Monotonic,
    ) {
        let is_due = self
            .samples
            .back()
            .is_none_or(|last| now.since(last.at) >= SAMPLE_PERIOD);
        if !is_due {
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

    fn recent(&self, now: Monotonic) -> impl Iterator<Item = &Monotonic> {
        self.poses.iter().filter(move |at| now.since(**at) < WINDOW)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "whole numbers of poses in two seconds")]

    use super::*;
    use crate::test_support::at;

    fn after(comes: impl Fn(u64) -> bool) -> LinkQuality {
        let mut quality = LinkQuality::default();
        quality.rate(true, at(0));
        for n in (0..500).filter(|n| comes(*n)) {
            quality.pose(at(20 * n));
        }
        quality
    }

    #[test]
    fn rates_are_those_of_the_last_two_seconds() {
        let now = at(9_990);
        let whole = after(|_| true);
        assert_eq!((whole.pose_hz(now), whole.expected_hz()), (50.0, 50.0));
        assert_eq!(whole.missing(now), Some(0.0));
        let every_fourth_lost = after(|n| n % 4 != 1);
        assert_eq!(every_fourth_lost.missing(now), Some(0.25));
        assert_eq!(whole.missing(at(20_000)), Some(1.0));
        let age = whole.age(Stream::Pose, at(20_000));
        assert_eq!(age, Some(Duration::from_millis(10_020)));
        assert_eq!(whole.age(Stream::Status, at(20_000)), None);
    }

    #[test]
    fn nothing_is_missing_while_another_rate_begins() {
        let mut quality = after(|_| true);
        quality.rate(false, at(9_990));
        assert_eq!(quality.expected_hz(), 20.0);
        assert_eq!(quality.missing(at(9_990)), None);
        quality.rate(false, at(11_000));
        assert_eq!(quality.missing(at(11_990)), Some(1.0));
        assert_eq!(LinkQuality::default().missing(at(9_990)), None);
    }

    #[test]
    fn poses_are_steady_a_second_after_they_came_back() {
        let mut quality = after(|_| true);
        assert!(quality.is_steady());
        quality.pose(at(30_000));
        assert!(!quality.is_steady());
        for n in 1..20 {
            quality.pose(at(30_000 + 50 * n));
        }
        assert!(quality.is_steady());
        let mut slow = LinkQuality::default();
        for n in 0..100 {
            slow.pose(at(200 * n));
        }
        assert!(!slow.is_steady(), "5 a second");
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
