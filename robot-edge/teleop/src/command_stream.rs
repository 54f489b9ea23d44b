//! The drive commands of the lease holder: their age, and arming (neutral, then a press) before anything moves.

use std::time::Duration;

use crate::lease::OperatorId;
use crate::motion::Velocity;
use crate::token::AgeToken;
use measurement::time::Monotonic;
use protocol::message::{DockingChoice, MapPose};

/// One iteration of a console's input loop, as the vehicle knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveCommand {
    /// Who sent it, as its signature proves.
    pub operator: OperatorId,
    /// The grant of the lease that it relies on.
    pub epoch: u64,
    /// Grows with every command of an epoch.
    pub seq: u64,
    /// The newest token that the console had when it read its keys.
    pub token: AgeToken,
    /// What is pressed; [`Velocity::ZERO`] where nothing is.
    pub requested: Velocity,
    /// Stop at once and stay stopped. Obeyed whatever epoch, sequence number and token are.
    pub estop: bool,
    /// The docking site into whose vegetation the operator steers on purpose.
    pub docking: Option<DockingChoice>,
    /// The goal that a planner is to drive to, while nothing is pressed.
    pub goal: Option<MapPose>,
}

/// Arming: after a loss, a reconnect or a stop, a pressed key has no effect until it was released and pressed again
/// (P6).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub(crate) enum ArmingState {
    /// A pressed key has no effect: it must be released first.
    #[default]
    Locked,
    /// No key is pressed, and commands keep arriving.
    Neutral { since: Monotonic },
    /// A key was pressed after a sufficient neutral time, and is not released yet.
    Pressed,
}

impl ArmingState {
    #[must_use]
    pub(crate) const fn after_neutral(self, now: Monotonic) -> Self {
        match self {
            Self::Neutral { .. } => self,
            Self::Locked | Self::Pressed => Self::Neutral { since: now },
        }
    }

    /// After a command with a pressed key; `neutral` is the required neutral time.
    #[must_use]
    pub(crate) fn after_press(self, now: Monotonic, neutral: Duration) -> Self {
        match self {
            Self::Neutral { since } if now.since(since) >= neutral => Self::Pressed,
            Self::Neutral { .. } | Self::Locked => Self::Locked,
            Self::Pressed => Self::Pressed,
        }
    }
}

const BUCKET: Duration = Duration::from_millis(100);

/// Ten whole buckets and the one being filled: at least 1 s is remembered, at most 1.1 s.
const BUCKETS: usize = 11;

#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct AgeWindow {
    peak: [Option<Duration>; BUCKETS],
    /// Number of the bucket being filled, counted from the clock's start.
    bucket: u64,
}

impl AgeWindow {
    pub(crate) fn record(&mut self, now: Monotonic, age: Duration) {
        self.advance(now);
        let peak = &mut self.peak[slot_of(self.bucket)];
        *peak = Some(peak.map_or(age, |peak| peak.max(age)));
    }

    /// The greatest age of the second before `now`; absent where none was recorded.
    pub(crate) fn peak(&self, now: Monotonic) -> Option<Duration> {
        let mut window = *self;
        window.advance(now);
        window.peak.into_iter().flatten().max()
    }

    fn advance(&mut self, now: Monotonic) {
        let bucket = (now.since(Monotonic::default()).as_nanos() / BUCKET.as_nanos()) as u64;
        let passed = bucket.saturating_sub(self.bucket).min(BUCKETS as u64);
        for number in 0..passed {
            self.peak[slot_of(bucket - number)] = None;
        }
        self.bucket = self.bucket.max(bucket);
    }
}

const fn slot_of(bucket: u64) -> usize {
    (bucket % BUCKETS as u64) as usize
}

/// The holder's commands under one grant of the lease.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(super) struct CommandStream {
    /// The greatest sequence number taken.
    pub(super) last_seq: Option<u64>,
    /// When the token of the last command taken was issued.
    pub(super) issued: Option<Monotonic>,
    pub(super) requested: Velocity,
    pub(super) docking: Option<DockingChoice>,
    pub(super) arming: ArmingState,
    pub(super) ages: AgeWindow,
}

impl CommandStream {
    /// An upper bound on the age of the command in force.
    pub(super) fn age(&self, now: Monotonic) -> Option<Duration> {
        self.issued.map(|issued| now.since(issued))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const NEUTRAL: Duration = Duration::from_millis(200);

    fn at(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn a_press_counts_after_enough_of_neutral() {
        let neutral = ArmingState::Locked
            .after_neutral(at(100))
            .after_neutral(at(299));
        assert_eq!(neutral, ArmingState::Neutral { since: at(100) });
        assert_eq!(neutral.after_press(at(300), NEUTRAL), ArmingState::Pressed);
        assert_eq!(neutral.after_press(at(299), NEUTRAL), ArmingState::Locked);
    }

    #[test]
    fn a_key_that_stays_down_counts_as_it_did() {
        let pressed = ArmingState::Pressed.after_press(at(300), NEUTRAL);
        assert_eq!(pressed, ArmingState::Pressed);
        let locked = ArmingState::Locked.after_press(at(10_000), NEUTRAL);
        assert_eq!(locked, ArmingState::Locked);
    }

    proptest! {
        #[test]
        fn at_least_a_second_and_little_more_is_remembered(
            start in 0_u64..10_000,
            samples in prop::collection::vec((0_u64..400, 0_u64..1000), 1..40),
        ) {
            let mut window = AgeWindow::default();
            let (mut now, mut all) = (start, Vec::new());
            for (pause, age) in samples {
                now += pause;
                window.record(at(now), Duration::from_millis(age));
                all.push((now, age));
            }
            let within = |span: u64| {
                let recent = all.iter().filter(|(then, _)| now - then <= span);
                recent.map(|(_, age)| Duration::from_millis(*age)).max()
            };
            let peak = window.peak(at(now));
            prop_assert!(peak >= within(1000));
            prop_assert!(peak <= within(1100));
            prop_assert_eq!(window.peak(at(now + 1100)), None);
            prop_assert_eq!(window.peak(Monotonic::from_nanos(u64::MAX)), None);
        }
    }
}
