//! Two sensors that keep their own time, brought together: both at every stamp of either.

use std::collections::VecDeque;

use measurement::drops::DropReason;
use measurement::time::{RobotDuration, RobotTime};

/// What was measured, and when.
pub type Stamped<T> = (RobotTime, T);

/// Samples that wait for those of the other sensor.
#[derive(Clone, Debug)]
pub struct SampleSynchronizer<A, B> {
    a: Samples<A>,
    b: Samples<B>,
    /// The newest stamp that was taken.
    at: Option<RobotTime>,
}

/// The samples of both sensors around a stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SynchronizedSample<A, B> {
    /// A stamp of either sensor.
    pub stamp: RobotTime,
    /// Of the one sensor.
    pub a: Bracket<A>,
    /// Of the other.
    pub b: Bracket<B>,
}

/// The samples at or before and at or after a stamp: the same one, where there is one at the stamp itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket<T> {
    /// At or before.
    pub before: Stamped<T>,
    /// At or after.
    pub after: Stamped<T>,
}

/// Samples of one sensor that wait for the other at most: 100 s at 100 Hz.
pub(super) const MAX_SAMPLES: usize = 10_000;

impl<A, B> Default for SampleSynchronizer<A, B> {
    fn default() -> Self {
        Self {
            a: Samples(VecDeque::new()),
            b: Samples(VecDeque::new()),
            at: None,
        }
    }
}

impl<A: Copy, B: Copy> SampleSynchronizer<A, B> {
    /// Takes a sample of the one sensor; stamps must rise.
    ///
    /// # Errors
    /// [`DropReason::QueueFull`] where too many pending for the other sensor.
    pub fn push_a(&mut self, sample: Stamped<A>) -> Result<(), DropReason> {
        self.a.push(sample, self.at.is_some())
    }

    /// The same of the other sensor.
    ///
    /// # Errors
    /// As [`push_a`](Self::push_a).
    pub fn push_b(&mut self, sample: Stamped<B>) -> Result<(), DropReason> {
        self.b.push(sample, self.at.is_some())
    }

    /// How many samples of each sensor are kept.
    pub fn kept(&self) -> (usize, usize) {
        (self.a.0.len(), self.b.0.len())
    }

    /// The next stamp of either sensor at which both are known; at first, that from which on they are.
    pub fn take_next(&mut self) -> Option<SynchronizedSample<A, B>> {
        let stamp = match self.at {
            None => self.a.first()?.max(self.b.first()?),
            Some(at) => self.a.after(at)?.min(self.b.after(at)?),
        };
        let (a, b) = (self.a.around(stamp)?, self.b.around(stamp)?);
        self.at = Some(stamp);
        self.a.forget_before(stamp);
        self.b.forget_before(stamp);
        Some(SynchronizedSample { stamp, a, b })
    }
}

impl<T> Bracket<T> {
    /// Whether what lies between is known at `stamp`: there is a sample at it, or no gap around it.
    pub fn is_known_at(&self, stamp: RobotTime, max_gap: RobotDuration) -> bool {
        self.after.0 == stamp || self.after.0.since(self.before.0) <= max_gap
    }

    /// How far `stamp` is from the one sample to the other, 0 to 1; 1 where they are the same.
    pub fn fraction(&self, stamp: RobotTime) -> f64 {
        let span = self.after.0.since(self.before.0).as_nanos();
        if span == 0 {
            return 1.0;
        }
        stamp.since(self.before.0).as_nanos() as f64 / span as f64
    }
}

/// Samples in stamp order; before the first meeting, and between, the one ahead of the next stamp is kept.
#[derive(Clone, Debug)]
struct Samples<T>(VecDeque<Stamped<T>>);

impl<T: Copy> Samples<T> {
    /// Before the first meeting the oldest goes where there is no more room; later the newest, because what lies
    /// between must be known from the last meeting on.
    fn push(&mut self, sample: Stamped<T>, has_begun: bool) -> Result<(), DropReason> {
        let is_full = self.0.len() >= MAX_SAMPLES;
        if is_full && has_begun {
            return Err(DropReason::QueueFull);
        }
        self.0.push_back(sample);
        if is_full {
            self.0.pop_front();
        }
        Ok(())
    }

    fn first(&self) -> Option<RobotTime> {
        self.0.front().map(|(stamp, _)| *stamp)
    }

    fn after(&self, stamp: RobotTime) -> Option<RobotTime> {
        let at = self.0.partition_point(|(other, _)| *other <= stamp);
        self.0.get(at).map(|(stamp, _)| *stamp)
    }

    fn around(&self, stamp: RobotTime) -> Option<Bracket<T>> {
        let at = self.0.partition_point(|(other, _)| *other < stamp);
        let after = *self.0.get(at)?;
        let before = if after.0 == stamp {
            after
        } else {
            *self.0.get(at.checked_sub(1)?)?
        };
        Some(Bracket { before, after })
    }

    /// Keeps the last at or before `stamp`.
    fn forget_before(&mut self, stamp: RobotTime) {
        while self.0.get(1).is_some_and(|(second, _)| *second <= stamp) {
            self.0.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> RobotTime {
        RobotTime::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn both_are_known_at_every_stamp_of_either() {
        let mut joined = SampleSynchronizer::default();
        for millis in [0, 100, 200] {
            joined.push_a((at(millis), millis)).unwrap();
        }
        for millis in [50, 100, 130, 150] {
            joined.push_b((at(millis), millis)).unwrap();
        }
        let met: Vec<_> = std::iter::from_fn(|| joined.take_next()).collect();
        let seen: Vec<_> = met
            .iter()
            .map(|joined| {
                let (a, b) = (joined.a, joined.b);
                (a.before.1, a.after.1, b.before.1, b.after.1)
            })
            .collect();
        assert_eq!(
            seen,
            [
                (0, 100, 50, 50),
                (100, 100, 100, 100),
                (100, 200, 130, 130),
                (100, 200, 150, 150),
            ]
        );
        let third = met[2];
        assert!((third.a.fraction(third.stamp) - 0.3).abs() < 1e-12);
        assert!((third.b.fraction(third.stamp) - 1.0).abs() < 1e-12);
        let gap = RobotDuration::from_millis(99);
        assert!(!third.a.is_known_at(third.stamp, gap));
        assert!(third.b.is_known_at(third.stamp, gap));
    }

    #[test]
    fn a_sensor_that_waits_for_ever_takes_bounded_memory() {
        let mut joined = SampleSynchronizer::<i64, i64>::default();
        for millis in 0..20_000 {
            joined.push_a((at(millis), millis)).unwrap();
        }
        assert_eq!(joined.kept(), (MAX_SAMPLES, 0));
        joined.push_b((at(10_500), 0)).unwrap();
        assert_eq!(joined.take_next().unwrap().stamp, at(10_500));
        let full = (0..20_000).map(|n| joined.push_a((at(30_000 + n), n)));
        assert!(full.into_iter().any(|pushed| pushed.is_err()));
    }
}
