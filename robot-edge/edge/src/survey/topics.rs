//! Statistics of each topic: stamps, scans, joint angles, attitudes and satellite fixes.

use std::collections::{BTreeMap, BTreeSet};

use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, GeodeticFix, ImuSample};

#[derive(Clone, Debug, Default, PartialEq)]
pub struct StampSurvey {
    pub count: u64,
    /// The first in file order.
    pub first: Option<RobotTime>,
    /// The last in file order.
    pub last: Option<RobotTime>,
    /// Stamps equal to the previous one.
    pub repeated: u64,
    /// Stamps before the previous one.
    pub backward: u64,
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
            }
        }
    }

    /// Whether fewer than half of `messages` have a later stamp than the one before.
    pub fn is_clock_unusable(&self, messages: u64) -> bool {
        let forward = self.count.saturating_sub(1 + self.repeated + self.backward);
        messages > 1 && 2 * (forward + 1) < messages
    }

    /// Messages per second over the whole span of their stamps. (A message of transforms has several stamps.)
    pub fn rate_hz(&self, messages: u64) -> Option<f64> {
        let span_s = self.duration().as_secs_f64();
        let is_known = messages > 1 && span_s > 0.0 && !self.is_clock_unusable(messages);
        is_known.then(|| (messages - 1) as f64 / span_s)
    }

    pub fn duration(&self) -> RobotDuration {
        match (self.first, self.last) {
            (Some(first), Some(last)) => last.since(first),
            (None, _) | (_, None) => RobotDuration::ZERO,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct ScanSurvey {
    /// Frame of the first scan.
    pub frame: FrameId,
    pub stamps: StampSurvey,
    /// Fewest and most beams.
    pub beams: (usize, usize),
    /// Angle of beam 0 of the first scan, radians.
    pub angle_min_rad: f32,
    /// Angle from beam to beam in the first scan, radians.
    pub angle_increment_rad: f32,
    /// Time from beam to beam in the first scan, seconds.
    pub time_increment_s: f32,
    /// Smallest range that is a measurement, of the first scan, metres.
    pub range_min_m: f32,
    /// Range from which on there is none, of the first scan, metres.
    pub range_max_m: f32,
    pub max_range: MaxRangeSurvey,
    /// Whether every scan has its own pose.
    pub has_own_poses: bool,
}

impl ScanSurvey {
    pub(super) fn new(frame: FrameId, scan: &Scan) -> Self {
        Self {
            frame,
            stamps: StampSurvey::default(),
            beams: (usize::MAX, 0),
            angle_min_rad: scan.angle_min_rad,
            angle_increment_rad: scan.angle_increment_rad,
            time_increment_s: scan.time_increment_s,
            range_min_m: scan.range_min_m,
            range_max_m: scan.range_max_m,
            max_range: MaxRangeSurvey::default(),
            has_own_poses: true,
        }
    }

    pub(super) fn add(&mut self, stamp: RobotTime, scan: &Scan, has_own_pose: bool) {
        self.stamps.add(stamp);
        let beams = scan.ranges_m.len();
        self.beams = (self.beams.0.min(beams), self.beams.1.max(beams));
        self.max_range.add(&scan.ranges_m);
        self.has_own_poses &= has_own_pose;
    }

    /// Angle of the last beam of the longest scan, taking the first scan's start and step, radians.
    pub fn angle_max_rad(&self) -> f32 {
        let steps = self.beams.1.saturating_sub(1) as f32;
        self.angle_min_rad + steps * self.angle_increment_rad
    }

    /// The range from which on this laser has no return, if its messages do not give it, metres.
    pub fn inferred_miss_range_m(&self) -> Option<f32> {
        self.max_range
            .miss_range_m()
            .filter(|&range| range < self.range_max_m)
    }
}

/// Depth of the band below the greatest range, metres.
const BAND_M: f32 = 0.2;

/// Depth of the layer below the band that it is compared with, metres.
const BELOW_M: f32 = 1.0;

/// Longer ranges are damaged, metres.
const LONGEST_M: f32 = 1000.0;

/// A varying greatest range is a miss only if it is longer than any room, metres.
const LONGEST_ROOM_M: f32 = 20.0;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaxRangeSurvey {
    beams: u64,
    /// By millimetre: the number, and the smallest.
    top: BTreeMap<i32, (u64, f32)>,
    max_m: f32,
}

impl MaxRangeSurvey {
    pub(super) fn add(&mut self, ranges_m: &[f32]) {
        self.beams += ranges_m.len() as u64;
        for &range in ranges_m {
            // Ranges that are NaN fail the comparison.
            if range > self.max_m - BAND_M - BELOW_M && range > 0.0 && range < LONGEST_M {
                self.add_top(range);
            }
        }
    }

    fn add_top(&mut self, range_m: f32) {
        let (count, smallest) = self.top.entry(millimetres(range_m)).or_insert((0, range_m));
        *count += 1;
        *smallest = smallest.min(range_m);
        if range_m > self.max_m {
            self.max_m = range_m;
            self.top = self.top.split_off(&millimetres(range_m - BAND_M - BELOW_M));
        }
    }

    /// The greatest range and its number of beams, to the millimetre.
    pub fn greatest(&self) -> Option<(f32, u64)> {
        let (_, &(count, _)) = self.top.last_key_value()?;
        Some((self.max_m, count))
    }

    /// The range from which on this laser has no return, judged by the repetition of its greatest ranges.
    ///
    /// The band of 0.2 m below the greatest range must hold at least 10 beams and 0.05 % of all, and it is a
    /// row of misses in two cases. Either 90 % of it is one value: no wall is that even, as its range changes
    /// from beam to beam. Or the laser's greatest range varies (infinite-corridor: 51.05 to 51.16 m): the
    /// range is longer than a room (20 m), and the band is ten times as dense as the metre below it; then
    /// all of the band is taken. Farther walls that fall into it cost their last 0.2 m.
    pub fn miss_range_m(&self) -> Option<f32> {
        let (_, &(at_max, max_m)) = self.top.last_key_value()?;
        let band_from = millimetres(self.max_m - BAND_M);
        let in_band: u64 = self
            .top
            .range(band_from..)
            .map(|(_, (count, _))| count)
            .sum();
        let below: u64 = self
            .top
            .range(..band_from)
            .map(|(_, (count, _))| count)
            .sum();
        if in_band < 10 || in_band * 2000 < self.beams {
            return None;
        }
        if at_max * 10 >= in_band * 9 {
            return Some(max_m);
        }
        let density_ratio = f64::from(BELOW_M / BAND_M) * in_band as f64 / below as f64;
        let lowest_m = self
            .top
            .range(band_from..)
            .next()
            .map(|(_, (_, smallest))| *smallest);
        lowest_m.filter(|_| self.max_m >= LONGEST_ROOM_M && density_ratio >= 10.0)
    }
}

fn millimetres(range_m: f32) -> i32 {
    libm::roundf(range_m * 1000.0) as i32
}

/// Maximum number of joints of a stream, and of bytes of a name.
const MAX_JOINTS: usize = 1000;
const MAX_NAME_BYTES: usize = 255;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JointSurvey {
    pub names: BTreeSet<String>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AttitudeSurvey {
    pub count: u64,
    /// Number of messages with an orientation; raw ones have only turn rates.
    pub oriented: u64,
}

impl JointSurvey {
    pub(super) fn add(&mut self, joints: &[(String, f64)]) {
        for (name, _) in joints {
            let is_new = self.names.len() < MAX_JOINTS
                && name.len() <= MAX_NAME_BYTES
                && !self.names.contains(name);
            if is_new {
                self.names.insert(name.clone());
            }
        }
    }
}

impl AttitudeSurvey {
    pub(super) fn add(&mut self, sample: &ImuSample) {
        self.count += 1;
        self.oriented += u64::from(sample.orientation_xyzw.is_some());
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FixSurvey {
    pub count: u64,
    /// Number of messages with a valid fix.
    pub fixed: u64,
    pub first: Option<GeodeticFix>,
}

impl FixSurvey {
    pub(super) fn add(&mut self, fix: &GeodeticFix) {
        self.count += 1;
        if fix.status >= 0 {
            self.fixed += 1;
            self.first.get_or_insert(*fix);
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
    fn the_rate_is_that_of_the_whole_span() {
        let stamps = survey(&[0, 100, 200, 300, 300, 290, 390, 9000, 9100]);
        assert_eq!(stamps.rate_hz(9), Some(8.0 / 9.1));
        // Bursts: the usual step is 1 ms, and there are 2 messages a second.
        assert_eq!(
            survey(&[0, 1, 2, 1000, 1001, 1002, 2000, 2001, 2500]).rate_hz(9),
            Some(3.2)
        );
        // Three transforms in each of three messages.
        assert_eq!(
            survey(&[0, 0, 0, 100, 100, 100, 200, 200, 200]).rate_hz(3),
            Some(10.0)
        );
        assert_eq!((stamps.count, stamps.repeated, stamps.backward), (9, 1, 1));
        assert_eq!(stamps.duration(), RobotDuration::from_millis(9100));
    }

    #[test]
    fn stamps_that_stand_still_have_no_rate() {
        for stamps_ms in [&[][..], &[5], &[5, 5, 5], &[5, 5, 5, 5, 10_005]] {
            let messages = stamps_ms.len() as u64;
            let stamps = survey(stamps_ms);
            assert_eq!(stamps.rate_hz(messages), None, "{stamps_ms:?}");
            assert_eq!(stamps.is_clock_unusable(messages), messages > 1);
        }
    }
}

#[cfg(test)]
mod max_range_tests {
    use super::*;

    /// Ranges as (metres, how often).
    fn survey(ranges: &[(f32, usize)]) -> MaxRangeSurvey {
        let mut survey = MaxRangeSurvey::default();
        for &(range, count) in ranges {
            survey.add(&vec![range; count]);
        }
        survey
    }

    #[test]
    fn one_repeated_value_is_a_miss() {
        let aces = survey(&[
            (1.0, 70_000),
            (50.0, 500),
            (49.86, 1),
            (50.0, 120),
            (f32::INFINITY, 9),
        ]);
        assert_eq!(aces.greatest(), Some((50.0, 620)));
        assert_eq!(aces.miss_range_m(), Some(50.0));
        assert_eq!(survey(&[(4.0, 900), (8.19, 30)]).miss_range_m(), Some(8.19));
    }

    #[test]
    fn a_greatest_range_that_varies_is_a_miss_as_a_whole() {
        let corridor = survey(&[
            (20.0, 340_000),
            (50.5, 30),
            (51.05, 218),
            (51.16, 2),
            (51.06, 3720),
            (51.11, 466),
        ]);
        assert_eq!(corridor.greatest(), Some((51.16, 2)));
        assert_eq!(corridor.miss_range_m(), Some(51.05));
    }

    #[test]
    fn walls_are_no_misses() {
        // Seen from one place for long: a far wall, each beam of another length.
        let wall: Vec<_> = (0..100).map(|i| (7.3 - 0.002 * i as f32, 50)).collect();
        assert_eq!(survey(&wall).miss_range_m(), None);
        // Far ranges that thin out.
        let hall: Vec<_> = (0..600).map(|i| (30.0 - 0.01 * i as f32, 1 + i)).collect();
        assert_eq!(survey(&hall).miss_range_m(), None);
        // Too few to decide.
        assert_eq!(survey(&[(3.0, 100), (50.0, 9)]).miss_range_m(), None);
        assert_eq!(
            survey(&[(3.0, 1_000_000), (50.0, 400)]).miss_range_m(),
            None
        );
        assert_eq!(survey(&[]).greatest(), None);
    }
}
