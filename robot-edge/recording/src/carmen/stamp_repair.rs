//! Stamps of real CARMEN logs, made fit to order data by.
//!
//! Published logs hold stamps that run backwards for a while (intel, by up to 0.9 s), lines stamped from
//! memory nobody set (the `ODOM` lines of corrected logs: 0, 1e-42), stamps of two clocks in turn
//! (belgioioso: 0 and 1.02e9), and 32-bit clocks that wrap (infinite-corridor). The *order* of the lines is
//! right in all of them, so a stream's stamps are kept only where they agree with it.

use measurement::time::{RobotDuration, RobotTime};

/// A step longer than this, either way, is a change of clock: no log lasts 11 days.
const CLOCK_CHANGE: RobotDuration = RobotDuration::from_millis(1_000_000_000);

/// What was done to a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Repair {
    /// Nothing.
    None,
    /// It went back by this much, and was held at the one before.
    Held(RobotDuration),
    /// It is of another clock, which is taken to go on where the old one stood.
    ClockChange,
}

/// The stamps of one stream so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StampRepair {
    last: Option<RobotTime>,
    clock_offset: RobotDuration,
}

impl StampRepair {
    /// The stamp to use for a line stamped `raw`: never before the one returned last.
    pub(super) fn repair(&mut self, raw: RobotTime) -> (RobotTime, Repair) {
        let stamp = raw + self.clock_offset;
        let Some(last) = self.last else {
            self.last = Some(stamp);
            return (stamp, Repair::None);
        };
        let step = stamp.since(last);
        if step > CLOCK_CHANGE || last.since(stamp) > CLOCK_CHANGE {
            self.clock_offset = last.since(raw);
            return (last, Repair::ClockChange);
        }
        if step < RobotDuration::ZERO {
            return (last, Repair::Held(last.since(stamp)));
        }
        self.last = Some(stamp);
        (stamp, Repair::None)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn seconds(secs: f64) -> RobotTime {
        RobotTime::from_secs_f64(secs).unwrap()
    }

    fn check(stamps_s: &[f64], expected_s: &[f64], repaired: usize) {
        let mut repair = StampRepair::default();
        let mut repairs = 0;
        for (&raw, &expected) in stamps_s.iter().zip(expected_s) {
            let (stamp, done) = repair.repair(seconds(raw));
            repairs += usize::from(done != Repair::None);
            let error = stamp.as_secs_f64() - expected;
            assert!(error.abs() < 1e-6, "{raw} became {stamp}, not {expected}");
        }
        assert_eq!(repairs, repaired);
    }

    #[test]
    fn good_stamps_stay() {
        check(&[10.0, 10.0, 10.5, 1000.0], &[10.0, 10.0, 10.5, 1000.0], 0);
    }

    #[test]
    fn a_stamp_that_goes_back_is_held() {
        check(&[10.0, 9.5, 9.9, 10.1], &[10.0, 10.0, 10.0, 10.1], 2);
        check(&[21.0, 0.0, 1.08e-42, 22.7], &[21.0, 21.0, 21.0, 22.7], 2);
    }

    #[test]
    fn time_goes_on_where_the_clock_changes() {
        let wrap = 4_294_967_296.0;
        check(
            &[5.0, wrap - 2.0, wrap - 1.5, 0.5, 1.0],
            &[5.0, 5.0, 5.5, 5.5, 6.0],
            2,
        );
        check(
            &[1.018e9, 0.0, 1.018e9, 1.018e9 + 1.0],
            &[1.018e9, 1.018e9, 1.018e9, 1.018e9 + 1.0],
            2,
        );
    }

    proptest! {
        #[test]
        fn time_never_goes_back(stamps in prop::collection::vec(any::<i64>(), 0..50)) {
            let mut repair = StampRepair::default();
            let mut last = RobotTime::MIN;
            for nanos in stamps {
                let (stamp, _) = repair.repair(RobotTime::from_nanos(nanos));
                prop_assert!(stamp >= last);
                last = stamp;
            }
        }
    }
}
