//! What a row of stamps tells: rate, repetitions, steps back.

use measurement::time::{RobotDuration, RobotTime};

/// Steps that are kept for the median.
const MAX_STEPS: usize = 10_000;

/// The stamps of one stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StampSurvey {
    /// How many.
    pub count: u64,
    /// The first in file order.
    pub first: Option<RobotTime>,
    /// The last in file order.
    pub last: Option<RobotTime>,
    /// How many are the same as the one before.
    pub repeated: u64,
    /// How many are before the one before.
    pub backward: u64,
    /// The first steps forward.
    steps: Vec<RobotDuration>,
}

impl StampSurvey {
    pub(super) fn add(&mut self, stamp: RobotTime) {
        self.count += 1;
        self.first.get_or_insert(stamp);
        if let Some(last) = self.last.replace(stamp) {
            let step = stamp.since(last);
            if step < RobotDuration::ZERO {
                self.backward += 1;
            } else if step == RobotDuration::ZERO {
                self.repeated += 1;
            } else if self.steps.len() < MAX_STEPS {
                self.steps.push(step);
            }
        }
    }

    /// Stamps per second: the inverse of the median step forward. `None` where most stamps take none, so
    /// that the steps tell nothing.
    pub fn rate_hz(&self) -> Option<f64> {
        if (self.steps.len() as u64) < self.repeated + self.backward {
            return None;
        }
        let mut steps = self.steps.clone();
        let middle = steps.len() / 2;
        let (_, median, _) = steps
            .get_mut(..)
            .filter(|steps| !steps.is_empty())?
            .select_nth_unstable(middle);
        Some(1.0 / median.as_secs_f64())
    }

    /// From the first stamp to the last.
    pub fn duration(&self) -> RobotDuration {
        match (self.first, self.last) {
            (Some(first), Some(last)) => last.since(first),
            (None, _) | (_, None) => RobotDuration::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn survey(stamps_ms: &[i64]) -> StampSurvey {
        let mut survey = StampSurvey::default();
        for stamp in stamps_ms {
            survey.add(RobotTime::from_nanos(stamp * 1_000_000));
        }
        survey
    }

    #[test]
    fn the_rate_is_that_of_the_usual_step() {
        let stamps = survey(&[0, 100, 200, 300, 300, 290, 390, 9000, 9100]);
        assert_eq!(stamps.rate_hz(), Some(10.0));
        assert_eq!((stamps.count, stamps.repeated, stamps.backward), (9, 1, 1));
        assert_eq!(stamps.duration(), RobotDuration::from_millis(9100));
    }

    #[test]
    fn stamps_that_stand_still_have_no_rate() {
        assert_eq!(survey(&[]).rate_hz(), None);
        assert_eq!(survey(&[5]).rate_hz(), None);
        assert_eq!(survey(&[5, 5, 5, 10_005]).rate_hz(), None);
    }
}
