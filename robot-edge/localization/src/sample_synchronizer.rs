//! Synchronizes two sensors: samples of both around every stamp of either.

use std::collections::VecDeque;

use measurement::drops::DropReason;
use measurement::time::{RobotDuration, RobotTime};

pub(crate) type Stamped<T> = (RobotTime, T);

/// Samples that wait for those of the other sensor.
#[derive(Clone, Debug)]
pub(crate) struct SampleSynchronizer<A, B> {
    a: Samples<A>,
    b: Samples<B>,
    /// The newest emitted stamp.
    at: Option<RobotTime>,
}

/// The samples of both sensors around a stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SynchronizedSample<A, B> {
    pub(crate) stamp: RobotTime,
    pub(crate) a: Bracket<A>,
    pub(crate) b: Bracket<B>,
}

/// Samples at or before and at or after a stamp; equal if there is one at the stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bracket<T> {
    pub(crate) before: Stamped<T>,
    pub(crate) after: Stamped<T>,
}

/// Limit of the waiting samples of one sensor, 100 s at 100 Hz.
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
    /// Takes a sample of the first sensor; stamps must increase.
    ///
    /// # Errors
    /// [`DropReason::QueueFull`] if too many samples wait for the other sensor.
    pub(crate) fn push_a(&mut self, sample: Stamped<A>) -> Result<(), DropReason> {
        self.a.push(sample, self.at.is_some())
    }

    pub(crate) fn push_b(&mut self, sample: Stamped<B>) -> Result<(), DropReason> {
        self.b.push(sample, self.at.is_some())
    }

    #[cfg(test)]
    pub(crate) fn kept(&self) -> (usize, usize) {
        (self.a.0.len(), self.b.0.len())
    }

    /// The next stamp of either sensor at which both are known.
    pub(crate) fn take_next(&mut self) -> Option<SynchronizedSample<A, B>> {
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
    /// Whether interpolation at `stamp` is valid: a sample at it, or no gap around it.
    pub(crate) fn is_known_at(&self, stamp: RobotTime, max_gap: RobotDuration) -> bool {
        self.after.0 == stamp || self.after.0.since(self.before.0) <= max_gap
    }

    /// Interpolation fraction of `stamp`, 0 to 1; 1 if both samples are equal.
    pub(crate) fn fraction(&self, stamp: RobotTime) -> f64 {
        let span = self.after.0.since(self.before.0).as_nanos();
        if span == 0 {
            return 1.0;
        }
        stamp.since(self.before.0).as_nanos() as f64 / span as f64
    }
}

/// Samples in stamp order; the last one before the next output stamp is kept.
#[derive(Clone, Debug)]
struct Samples<T>(VecDeque<Stamped<T>>);

impl<T: Copy> Samples<T> {
    /// Beyond the limit, drops the oldest before the first output, later the newest, because the
    /// samples since the last output must stay complete.
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
    fn both_sensors_are_known_at_every_stamp() {
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
