//! Whether the clock of a robot's data stood while the robot was silent, as where its program was suspended and goes on
//! from where it was: then nothing was measured meanwhile, and what is held is no older than the stamps say.
//!
//! Behind a link that was cut, data went on. It comes with stamps that are as much later as the silence was long, or in
//! a heap that waited on the way: so the stamps are looked at for a while before they are believed.

use std::time::Duration;

use measurement::time::Monotonic;

use super::apart;

/// Poses and statuses come more often than that.
const SILENT_AFTER: Duration = Duration::from_secs(1);
/// Stamps are looked at for so long after a silence.
const OBSERVATION_TIME: Duration = Duration::from_secs(1);
/// By so much stamps may run ahead of this machine's clock after a silence: the last before it may have been lost.
const SLACK: Duration = Duration::from_millis(500);

/// Looks at the stamps behind a silence. Pure: the present is a parameter.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ClockStallDetector(Option<Silence>);

/// Nothing was heard.
#[derive(Clone, Copy, Debug)]
struct Silence {
    from: Monotonic,
    to: Monotonic,
    /// The newest stamp before it, nanoseconds.
    stamp_ns: i64,
}

/// The clock of the data stood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ClockStall {
    /// Since when.
    pub(super) from: Monotonic,
    /// For how long.
    pub(super) time: Duration,
}

impl ClockStallDetector {
    /// The robot tells of its newest data; `last` is the newest stamp that it told of before, and when it did so last.
    /// Whether it is clear by that that the clock stood; once a silence.
    pub(super) fn update(
        &mut self,
        last: Option<(i64, Monotonic)>,
        stamp_ns: i64,
        now: Monotonic,
    ) -> Option<ClockStall> {
        if let Some((stamp_ns, from)) = last.filter(|(_, from)| now.since(*from) > SILENT_AFTER) {
            let to = now;
            self.0 = Some(Silence { from, to, stamp_ns });
        }
        let silence = self.0?;
        let since = now.since(silence.to);
        let went = apart(stamp_ns, silence.stamp_ns).filter(|went| *went <= since + SLACK);
        let Some(went) = went else {
            // It was set, or went on all the while.
            self.0 = None;
            return None;
        };
        // A sensor that is dead lets it stand although the robot is heard: that is no reason to be younger.
        if since < OBSERVATION_TIME || went < since / 2 {
            return None;
        }
        self.0 = None;
        Some(ClockStall {
            from: silence.from,
            time: silence.to.since(silence.from),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    /// What is found out of these moments and stamps, both in milliseconds.
    fn found(samples: impl IntoIterator<Item = (u64, i64)>) -> Option<ClockStall> {
        let mut clock_stall = ClockStallDetector::default();
        let mut last = None;
        samples.into_iter().find_map(|(ms, stamp_ms)| {
            let stamp_ns = stamp_ms * 1_000_000;
            let stalled = clock_stall.update(last, stamp_ns, at(ms));
            last = Some((stamp_ns, at(ms)));
            stalled
        })
    }

    /// Heard until 2 s, and from 9 s on: at first with the stamp `then_ms` and with every 50 ms this much later.
    fn behind_silence(then_ms: i64, step_ms: i64) -> Option<ClockStall> {
        let before = (0..=40).map(|n: u32| (50 * u64::from(n), 50 * i64::from(n)));
        let after = (0..100).map(|n: u32| {
            let ms = 9_000 + 50 * u64::from(n);
            (ms, then_ms + step_ms * i64::from(n))
        });
        found(before.chain(after))
    }

    #[test]
    fn a_clock_that_goes_on_from_where_it_was_stood() {
        let stalled = ClockStall {
            from: at(2_000),
            time: Duration::from_secs(7),
        };
        assert_eq!(behind_silence(2_000, 50), Some(stalled));
        assert_eq!(behind_silence(2_050, 50), Some(stalled));
    }

    #[test]
    fn a_clock_that_went_on_or_was_set_or_still_stands_is_not_taken_for_one_that_stood() {
        assert_eq!(behind_silence(9_000, 50), None, "the link was cut");
        assert_eq!(behind_silence(2_050, 400), None, "a heap that waited");
        assert_eq!(behind_silence(1_000, 50), None, "it was set back");
        assert_eq!(behind_silence(2_000, 0), None, "a sensor is dead");
        assert_eq!(behind_silence(5_500, 25), None, "at half the speed");
    }
}
