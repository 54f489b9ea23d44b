//! One cell of the elevation map: statistics of its heights, and its class in the obstacle map.

use crate::ground_plane::Bounds;
use crate::obstacle::ObstacleRule;

/// Statistics of the heights in one cell, metres above the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElevationCell {
    mean_m: f32,
    /// Sum of squared deviations from the mean (Welford 1962), m².
    squares_m2: f32,
    min_m: f32,
    max_m: f32,
    /// Mean of the points within the thresholds.
    ground_mean_m: f32,
    /// Lowest point clearly above the ground.
    lowest_raised_m: f32,
    /// Travelled distance at the last hit, metres.
    pub(crate) hit_at_travel_m: f32,
    points: u32,
    /// Milliseconds since the map's first scan.
    last_seen_ms: u32,
    /// Counts of about the newest [`RECENT`] points.
    recent: u16,
    above: u16,
    /// Above the ground on narrow bodies; not among `above`.
    narrow: u16,
    below: u16,
    ground_points: u16,
    scans: u16,
    /// Index of the cell in the list of the scan that hit it last; [`super::ScanHits::bounds`] checks
    /// whether that is this scan.
    pub(crate) hit: u16,
    /// Scans with a beam through the obstacle since the last hit.
    pub(crate) crossed_scans: u8,
    pub(super) class: CellClass,
    /// Travelled distance at which the obstacle was first observed to stand on the ground, or to
    /// touch one that does; +∞ if never.
    pub(crate) grounded_at_travel_m: f32,
}

/// Class of a cell of the obstacle map (\[LOD\] §4.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellClass {
    /// No point.
    Unknown,
    /// Within the thresholds.
    Free,
    /// Beyond one of them.
    Obstacle,
}

/// Points for the 5 % rule. Of all points ever, 5 % would be too many for a kerb that is reached
/// after a minute of standing in front of it.
const RECENT: u16 = 512;

impl ElevationCell {
    /// Without information.
    pub const UNKNOWN: Self = Self {
        mean_m: 0.0,
        squares_m2: 0.0,
        min_m: f32::INFINITY,
        max_m: f32::NEG_INFINITY,
        ground_mean_m: 0.0,
        lowest_raised_m: f32::INFINITY,
        hit_at_travel_m: 0.0,
        points: 0,
        last_seen_ms: 0,
        hit: 0,
        recent: 0,
        above: 0,
        narrow: 0,
        below: 0,
        ground_points: 0,
        scans: 0,
        crossed_scans: 0,
        class: CellClass::Unknown,
        grounded_at_travel_m: f32::INFINITY,
    };

    /// Whether it has a point.
    pub const fn is_known(&self) -> bool {
        self.points > 0
    }

    /// Mean height; `None` if unknown.
    pub fn mean_m(&self) -> Option<f32> {
        self.is_known().then_some(self.mean_m)
    }

    /// Least height; +∞ if unknown.
    pub const fn min_m(&self) -> f32 {
        self.min_m
    }

    /// Greatest height; −∞ if unknown.
    pub const fn max_m(&self) -> f32 {
        self.max_m
    }

    /// Variance of the heights, m²; 0 for fewer than two points.
    pub fn variance_m2(&self) -> f32 {
        if self.points < 2 {
            0.0
        } else {
            self.squares_m2 / (self.points - 1) as f32
        }
    }

    /// Number of points.
    pub const fn points(&self) -> u32 {
        self.points
    }

    /// Number of scans with a point in it.
    pub const fn scans(&self) -> u16 {
        self.scans
    }

    /// Time of the last such scan, milliseconds since the map's first scan.
    pub const fn last_seen_ms(&self) -> u32 {
        self.last_seen_ms
    }

    /// Class in the obstacle map.
    pub const fn class(&self) -> CellClass {
        self.class
    }

    /// Whether it holds something that beams below its top cannot pass.
    pub(crate) const fn is_raised(&self) -> bool {
        matches!(self.class, CellClass::Obstacle) && self.above > 0
    }

    /// Height above ground at which the obstacle was first observed, metres: near 0 if the beams
    /// swept up its face, more if it came from the side.
    pub(crate) fn gap_m(&self) -> f32 {
        self.lowest_raised_m - self.ground_mean_m
    }

    pub(crate) fn is_grounded(&self) -> bool {
        self.grounded_at_travel_m.is_finite()
    }

    /// Height of the slice that was observed, metres.
    pub(crate) fn slice_m(&self) -> f32 {
        self.max_m - self.lowest_raised_m
    }

    /// Mean of the points within the thresholds; of all where none is.
    pub(crate) fn ground_m(&self) -> Option<f32> {
        if self.has_ground() {
            Some(self.ground_mean_m)
        } else {
            self.mean_m()
        }
    }

    /// Whether any point was within the thresholds.
    pub(super) const fn has_ground(&self) -> bool {
        self.ground_points > 0
    }

    /// Adds a point; one on a narrow body is no obstacle by being high.
    pub(crate) fn add(&mut self, height_m: f32, ground: Bounds, is_narrow: bool) {
        self.add_height(height_m);
        if self.recent >= RECENT {
            self.recent /= 2;
            self.above /= 2;
            self.narrow /= 2;
            self.below /= 2;
        }
        self.recent += 1;
        if height_m > ground.raised_above_m && !is_narrow {
            self.lowest_raised_m = self.lowest_raised_m.min(height_m);
        }
        if height_m > ground.highest_m {
            self.above += u16::from(!is_narrow);
            self.narrow += u16::from(is_narrow);
        } else if height_m < ground.lowest_m {
            self.below += 1;
        } else {
            self.ground_points = self.ground_points.saturating_add(1);
            self.ground_mean_m += (height_m - self.ground_mean_m) / f32::from(self.ground_points);
        }
    }

    /// Adds a point that counts for the heights and not for the class.
    pub(super) fn add_height(&mut self, height_m: f32) {
        self.points = self.points.saturating_add(1);
        let deviation_m = height_m - self.mean_m;
        self.mean_m += deviation_m / self.points as f32;
        self.squares_m2 += deviation_m * (height_m - self.mean_m);
        self.min_m = self.min_m.min(height_m);
        self.max_m = self.max_m.max(height_m);
    }

    /// Finishes a scan that had points in it.
    pub(crate) fn end_scan(&mut self, now_ms: u32, travel_m: f32) {
        self.scans = self.scans.saturating_add(1);
        self.last_seen_ms = now_ms;
        self.hit_at_travel_m = travel_m;
        self.crossed_scans = 0;
    }

    pub(super) fn classify(&mut self, rule: ObstacleRule, ground: Bounds) {
        match rule {
            ObstacleRule::Mean => self.classify_by_mean(ground),
            ObstacleRule::Points => self.classify_by_points(),
        }
    }

    /// Rule `mean` (docs/methods.md, section 1).
    pub(crate) fn classify_by_mean(&mut self, ground: Bounds) {
        self.class = self.known_class(!ground.contains(self.mean_m));
    }

    /// Rule `points`: at least 2 points and 5 % of the recent ones beyond a threshold
    /// (docs/methods.md, section 1).
    pub(crate) fn classify_by_points(&mut self) {
        let beyond = |count: u16| count >= 2 && u32::from(count) * 20 >= u32::from(self.recent);
        let is_raised = beyond(self.above) && self.above >= self.narrow;
        self.class = self.known_class(is_raised || beyond(self.below));
    }

    fn known_class(&self, is_obstacle: bool) -> CellClass {
        match (self.is_known(), is_obstacle) {
            (false, _) => CellClass::Unknown,
            (true, false) => CellClass::Free,
            (true, true) => CellClass::Obstacle,
        }
    }

    /// With all heights moved.
    pub(super) fn raised_by(&self, rise_m: f32) -> Self {
        Self {
            mean_m: self.mean_m + rise_m,
            min_m: self.min_m + rise_m,
            max_m: self.max_m + rise_m,
            ground_mean_m: self.ground_mean_m + rise_m,
            lowest_raised_m: self.lowest_raised_m + rise_m,
            ..*self
        }
    }

    /// Forgets all points.
    pub(super) const fn restart(&mut self) {
        *self = Self {
            hit: self.hit,
            ..Self::UNKNOWN
        };
    }

    /// Removes the obstacle; keeps the ground observed below it.
    pub(crate) fn clear(&mut self) {
        let ground = (self.ground_points, self.ground_mean_m, self.last_seen_ms);
        *self = Self::UNKNOWN;
        let (points, mean_m, last_seen_ms) = ground;
        if points > 0 {
            self.points = u32::from(points);
            self.recent = points.min(RECENT);
            self.ground_points = points;
            (self.mean_m, self.ground_mean_m) = (mean_m, mean_m);
            (self.min_m, self.max_m) = (mean_m, mean_m);
            self.last_seen_ms = last_seen_ms;
            self.scans = 1;
            self.class = CellClass::Free;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const GROUND: Bounds = Bounds {
        lowest_m: -0.1,
        highest_m: 0.1,
        raised_above_m: 0.05,
    };

    fn cell(points_m: &[f32]) -> ElevationCell {
        let mut cell = ElevationCell::UNKNOWN;
        for &height_m in points_m {
            cell.add(height_m, GROUND, false);
        }
        cell.classify_by_points();
        cell
    }

    #[test]
    fn a_cell_is_grass_if_most_of_what_is_high_is_narrow() {
        let with = |wide: usize, narrow: usize, height_m: f32| {
            let mut cell = cell(&[0.0; 5]);
            for is_narrow in [vec![false; wide], vec![true; narrow]].concat() {
                cell.add(height_m, GROUND, is_narrow);
            }
            cell.classify_by_points();
            cell
        };
        assert_eq!(with(3, 4, 0.5).class(), CellClass::Free);
        assert_eq!(with(4, 4, 0.5).class(), CellClass::Obstacle);
        assert_eq!(with(0, 4, -0.5).class(), CellClass::Obstacle, "a hole");
        assert!((with(3, 4, 0.5).max_m() - 0.5).abs() < 1e-6);
    }

    #[test]
    fn two_points_and_one_in_twenty_make_an_obstacle() {
        let ground = |n: usize| vec![0.0; n];
        let with = |n: usize, extra: &[f32]| cell(&[&ground(n), extra].concat()).class();
        assert_eq!(with(0, &[]), CellClass::Unknown);
        assert_eq!(with(5, &[]), CellClass::Free);
        assert_eq!(with(5, &[0.5]), CellClass::Free, "one point");
        assert_eq!(with(38, &[0.5; 2]), CellClass::Obstacle);
        assert_eq!(with(39, &[0.5; 2]), CellClass::Free, "2 of 41");
        assert_eq!(with(5, &[-0.5; 2]), CellClass::Obstacle);
        // A kerb that is reached after a minute of standing in front of it.
        assert_eq!(with(9000, &[0.15; 28]), CellClass::Obstacle);
    }

    #[test]
    fn the_mean_hides_a_pole() {
        let mut pole = cell(&[&[0.0; 18][..], &[0.6; 2]].concat());
        assert_eq!(pole.class(), CellClass::Obstacle);
        pole.classify_by_mean(GROUND);
        assert_eq!(pole.class(), CellClass::Free);
        let mut kerb = cell(&[0.0, 0.21]);
        kerb.classify_by_mean(GROUND);
        assert_eq!(kerb.class(), CellClass::Obstacle);
    }

    #[test]
    fn cleared_cell_keeps_its_ground() {
        let mut cell = cell(&[0.02, 0.5, 0.9]);
        cell.clear();
        assert_eq!((cell.mean_m(), cell.points()), (Some(0.02), 1));
        assert_eq!((cell.min_m(), cell.max_m()), (0.02, 0.02));
        assert_eq!(cell.class(), CellClass::Free);
        let mut never_ground = ElevationCell::UNKNOWN;
        never_ground.add(0.5, GROUND, false);
        never_ground.clear();
        assert_eq!(never_ground, ElevationCell::UNKNOWN);
    }

    proptest! {
        #[test]
        fn statistics_are_those_of_all_points(
            heights_m in prop::collection::vec(-3.0..3.0f32, 1..300),
        ) {
            let mut cell = ElevationCell::UNKNOWN;
            for &height_m in &heights_m {
                cell.add(height_m, GROUND, false);
            }
            let n = heights_m.len() as f64;
            let mean = heights_m.iter().map(|&z| f64::from(z)).sum::<f64>() / n;
            let squares: f64 = heights_m.iter().map(|&z| (f64::from(z) - mean).powi(2)).sum();
            let variance = if heights_m.len() < 2 { 0.0 } else { squares / (n - 1.0) };
            prop_assert!((f64::from(cell.mean_m().unwrap()) - mean).abs() < 1e-4);
            prop_assert!((f64::from(cell.variance_m2()) - variance).abs() < 1e-3);
            let least_m = heights_m.iter().copied().fold(f32::INFINITY, f32::min);
            let greatest_m = heights_m.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            prop_assert_eq!(cell.min_m().to_bits(), least_m.to_bits());
            prop_assert_eq!(cell.max_m().to_bits(), greatest_m.to_bits());
            prop_assert_eq!(cell.points() as usize, heights_m.len());
        }
    }
}
