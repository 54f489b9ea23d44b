//! What the points in one cell of the elevation map amount to.

/// Statistics of the heights of the points that fell into a cell, metres above the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElevationCell {
    /// Running mean.
    mean_m: f32,
    /// Sum of squared deviations from the mean (Welford 1962), m².
    squares_m2: f32,
    min_m: f32,
    max_m: f32,
    /// Mean of the points that are neither above nor below the thresholds.
    ground_mean_m: f32,
    /// The lowest point that stood clear of the ground.
    lowest_raised_m: f32,
    /// How far the vehicle had driven when the cell was hit last, metres.
    pub(super) hit_at_travel_m: f32,
    points: u32,
    /// Milliseconds since the map's first scan.
    last_seen_ms: u32,
    /// Of the newest [`RECENT`] points or so.
    recent: u16,
    above: u16,
    below: u16,
    ground_points: u16,
    scans: u16,
    /// Where the last scan that hit it lists it; whether that is this scan, its list says.
    pub(super) hit: u16,
    /// Scans with a beam through what stood here, since the last hit.
    pub(super) crossed_scans: u8,
    class: CellClass,
    /// How far the vehicle had driven when what stands in it was seen to stand on the ground, or to belong to
    /// what does; +∞ where it was not.
    pub(super) grounded_at_travel_m: f32,
}

/// What a cell of the obstacle map says ([LOD §4.4]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellClass {
    /// No information.
    Unknown,
    /// Within the thresholds.
    Free,
    /// Beyond one of them.
    Obstacle,
}

/// Heights between which a point is ground, metres above the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    pub(super) lowest_m: f32,
    pub(super) highest_m: f32,
    /// What is higher stands clear of the ground, be it an obstacle or not.
    pub(super) raised_above_m: f32,
}

/// Points whose shares decide. Of the points of all time 5 % are too many for a kerb that is reached after
/// a minute of standing where the beams met the ground in front of it.
const RECENT: u16 = 512;

impl ElevationCell {
    /// A cell that no point fell into.
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
        below: 0,
        ground_points: 0,
        scans: 0,
        crossed_scans: 0,
        class: CellClass::Unknown,
        grounded_at_travel_m: f32::INFINITY,
    };

    /// Whether any point fell into it.
    pub const fn is_known(&self) -> bool {
        self.points > 0
    }

    /// Mean height; `None` where it is unknown.
    pub fn mean_m(&self) -> Option<f32> {
        self.is_known().then_some(self.mean_m)
    }

    /// Least height; +∞ where it is unknown.
    pub const fn min_m(&self) -> f32 {
        self.min_m
    }

    /// Greatest height; −∞ where it is unknown.
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

    /// Points that fell into it.
    pub const fn points(&self) -> u32 {
        self.points
    }

    /// Scans that had a point in it.
    pub const fn scans(&self) -> u16 {
        self.scans
    }

    /// When the last scan had, milliseconds since the map's first.
    pub const fn last_seen_ms(&self) -> u32 {
        self.last_seen_ms
    }

    /// What the obstacle map says of it.
    pub const fn class(&self) -> CellClass {
        self.class
    }

    /// Whether something stands in it that beams below its top cannot pass.
    pub(super) const fn is_raised(&self) -> bool {
        matches!(self.class, CellClass::Obstacle) && self.above > 0
    }

    /// How far above the ground what stands in it was seen first, metres: what stood there while the beams
    /// swept up its face was seen just above the ground, what came from the side was not.
    pub(super) fn gap_m(&self) -> f32 {
        self.lowest_raised_m - self.ground_mean_m
    }

    /// Whether what stands in it was seen to stand on the ground, or to belong to what does.
    pub(super) fn is_grounded(&self) -> bool {
        self.grounded_at_travel_m.is_finite()
    }

    /// The height of the slice in which it was seen, metres.
    pub(super) fn slice_m(&self) -> f32 {
        self.max_m - self.lowest_raised_m
    }

    pub(super) fn add(&mut self, height_m: f32, ground: Bounds) {
        self.points = self.points.saturating_add(1);
        let deviation_m = height_m - self.mean_m;
        self.mean_m += deviation_m / self.points as f32;
        self.squares_m2 += deviation_m * (height_m - self.mean_m);
        self.min_m = self.min_m.min(height_m);
        self.max_m = self.max_m.max(height_m);
        if self.recent >= RECENT {
            self.recent /= 2;
            self.above /= 2;
            self.below /= 2;
        }
        self.recent += 1;
        if height_m > ground.raised_above_m {
            self.lowest_raised_m = self.lowest_raised_m.min(height_m);
        }
        if height_m > ground.highest_m {
            self.above += 1;
        } else if height_m < ground.lowest_m {
            self.below += 1;
        } else {
            self.ground_points = self.ground_points.saturating_add(1);
            self.ground_mean_m += (height_m - self.ground_mean_m) / f32::from(self.ground_points);
        }
    }

    /// A scan had points in it, all of which were added.
    pub(super) fn end_scan(&mut self, now_ms: u32, travel_m: f32) {
        self.scans = self.scans.saturating_add(1);
        self.last_seen_ms = now_ms;
        self.hit_at_travel_m = travel_m;
        self.crossed_scans = 0;
    }

    /// Decides by the mean.
    pub(super) fn classify_by_mean(&mut self, ground: Bounds) {
        let is_ground = (ground.lowest_m..=ground.highest_m).contains(&self.mean_m);
        self.class = self.known_class(!is_ground);
    }

    /// Decides by the points beyond the thresholds: 2 of them, and 5 % of the recent ones.
    pub(super) fn classify_by_points(&mut self) {
        let beyond = |count: u16| count >= 2 && u32::from(count) * 20 >= u32::from(self.recent);
        self.class = self.known_class(beyond(self.above) || beyond(self.below));
    }

    fn known_class(&self, is_obstacle: bool) -> CellClass {
        match (self.is_known(), is_obstacle) {
            (false, _) => CellClass::Unknown,
            (true, false) => CellClass::Free,
            (true, true) => CellClass::Obstacle,
        }
    }

    /// What stood here is gone; the ground that was seen under it stays.
    pub(super) fn clear(&mut self) {
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
            cell.add(height_m, GROUND);
        }
        cell.classify_by_points();
        cell
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
        // A kerb that is reached after a minute of looking at the ground before it.
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
    fn what_is_gone_leaves_its_ground() {
        let mut cell = cell(&[0.02, 0.5, 0.9]);
        cell.clear();
        assert_eq!((cell.mean_m(), cell.points()), (Some(0.02), 1));
        assert_eq!((cell.min_m(), cell.max_m()), (0.02, 0.02));
        assert_eq!(cell.class(), CellClass::Free);
        let mut never_ground = ElevationCell::UNKNOWN;
        never_ground.add(0.5, GROUND);
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
                cell.add(height_m, GROUND);
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
