//! What a laser reports where it sees nothing.
//!
//! CARMEN's `FLASER` lines do not say. Their lasers report some great range, always the same or nearly so,
//! and published logs hold 50.00 m, 81.83 m and 81.91 m. Taken as hits these draw arcs of walls.

use std::collections::BTreeMap;

/// Depth of the band below the greatest range that is looked at, metres.
const BAND_M: f32 = 0.2;

/// Depth of the layer below that band that it is compared with, metres.
const BELOW_M: f32 = 1.0;

/// Longest range that counts: what claims more is damaged, metres.
const LONGEST_M: f32 = 1000.0;

/// A range that varies must be at least this long to be taken for a miss: no room is, metres.
const LONGEST_ROOM_M: f32 = 20.0;

/// The longest ranges of a stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaxRangeSurvey {
    beams: u64,
    /// By millimetre: how many, and the smallest.
    top: BTreeMap<i32, (u64, f32)>,
    max_m: f32,
}

impl MaxRangeSurvey {
    pub(super) fn add(&mut self, ranges_m: &[f32]) {
        self.beams += ranges_m.len() as u64;
        for &range in ranges_m {
            // What is not a number is not in this, either.
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

    /// The greatest range and how many beams have it, to the millimetre; `None` where there is no range.
    pub fn greatest(&self) -> Option<(f32, u64)> {
        let (_, &(count, _)) = self.top.last_key_value()?;
        Some((self.max_m, count))
    }

    /// The range from which on this laser saw nothing, judged by how often the greatest ranges repeat.
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

#[cfg(test)]
mod tests {
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
        // Too few to tell.
        assert_eq!(survey(&[(3.0, 100), (50.0, 9)]).miss_range_m(), None);
        assert_eq!(
            survey(&[(3.0, 1_000_000), (50.0, 400)]).miss_range_m(),
            None
        );
        assert_eq!(survey(&[]).greatest(), None);
    }
}
