//! The greatest age of a command within the last second, which decides how fast one may go blind.

use std::time::Duration;

use measurement::time::Monotonic;

const BUCKET: Duration = Duration::from_millis(100);

/// Ten whole buckets and the one being filled: at least 1 s is remembered, at most 1.1 s.
const BUCKETS: usize = 11;

/// The greatest of the ages recorded in the last second.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct AgeWindow {
    peak: [Option<Duration>; BUCKETS],
    /// Number of the bucket being filled, counted from the clock's start.
    bucket: u64,
}

impl AgeWindow {
    /// Takes note of an age at the moment `now`; moments never go back.
    pub fn record(&mut self, now: Monotonic, age: Duration) {
        self.advance(now);
        let peak = &mut self.peak[slot_of(self.bucket)];
        *peak = Some(peak.map_or(age, |peak| peak.max(age)));
    }

    /// The greatest age of the second before `now`; absent where none was recorded.
    pub fn peak(&self, now: Monotonic) -> Option<Duration> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
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
