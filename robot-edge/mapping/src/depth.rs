//! Depth of the water (docs/methods.md, section 4): of each cell the shoalest sounding that more than
//! one ping has made.
//!
//! A chart shows the least depth, because that is what a keel meets (IHO S-44: shoal-biased
//! soundings); but a least depth alone would keep each false echo for ever. As CUBE does (Calder and
//! Mayer 2003), a cell has hypotheses, here two: a shoaler one needs a second ping before it counts.
//! The octree gives no depths: at flat angles later beams free voxels of the bed.

use nalgebra::Point3;

use crate::grid::{CellIndex, TiledGrid};

/// Limit of stored tiles, 48 MiB; beyond it the farthest are removed. 0.4 km² at 0.3 m.
const MAX_TILES: usize = 1024;
/// Soundings after which a mean follows new ones.
const MEMORY: u8 = 16;

/// Depth below the water level, in cells as large as the octree's voxels.
#[derive(Clone, Debug)]
pub struct DepthMap {
    cell_m: f64,
    cells: TiledGrid<Cell>,
    changed: Vec<(CellIndex, f32)>,
    /// The highest hit in each cell of the current ping.
    soundings: Vec<(CellIndex, f32)>,
}

/// What pings have said of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cell {
    /// What counts.
    bed: Hypothesis,
    /// What differs from it and may replace it.
    other: Hypothesis,
    /// Water level at the last change, z of `odom`, metres.
    water_m: f32,
}

/// A height on which pings agree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Hypothesis {
    /// z of `odom`, metres.
    mean_m: f32,
    /// 0 without a sounding.
    pings: u8,
}

impl DepthMap {
    pub(super) fn new(cell_m: f64) -> Self {
        Self {
            cell_m,
            cells: TiledGrid::new(Cell::default()),
            changed: Vec::new(),
            soundings: Vec::new(),
        }
    }

    /// Adds the hits of one ping of a sonar, with the water level at `water_m`, z of `odom`. Hits
    /// above it are left out.
    pub(super) fn add_ping(
        &mut self,
        hits: impl Iterator<Item = Point3<f64>>,
        water_m: f64,
        vehicle_in_odom: Point3<f64>,
    ) {
        let below = hits.filter(|hit| hit.z < water_m);
        let sounding = |hit: Point3<f64>| {
            let cell = CellIndex::containing(hit.xy(), self.cell_m);
            (cell, hit.z as f32)
        };
        self.soundings.clear();
        self.soundings.extend(below.map(sounding));
        // The highest of each cell is the last.
        self.soundings.sort_unstable_by(|a, b| {
            (a.0.y, a.0.x)
                .cmp(&(b.0.y, b.0.x))
                .then(a.1.total_cmp(&b.1))
        });
        let per_cell = self.soundings.chunk_by(|a, b| a.0 == b.0);
        for &(cell, z_m) in per_cell.filter_map(<[_]>::last) {
            let (tile, place) = cell.split();
            let held = &mut self.cells.touch(tile)[place];
            held.add(z_m, self.cell_m as f32);
            held.water_m = water_m as f32;
            self.changed.push((cell, held.depth_m()));
        }
        self.cells.take_changed();
        let centre = CellIndex::containing(vehicle_in_odom.xy(), self.cell_m);
        self.cells.evict_farthest(centre.split().0, MAX_TILES);
    }

    /// Depth of a cell, metres; `None` without a sounding.
    pub fn depth_m(&self, cell: CellIndex) -> Option<f32> {
        let (tile, place) = cell.split();
        let held = self.cells.get(tile)?.cells[place];
        (held.bed.pings > 0).then(|| held.depth_m())
    }

    /// Cells changed since the last call and their depths, metres; a later entry of the same cell
    /// replaces an earlier one.
    pub fn take_changed(&mut self) -> Vec<(CellIndex, f32)> {
        std::mem::take(&mut self.changed)
    }

    /// Erases the map and its untaken changes.
    pub(super) fn erase(&mut self) {
        self.cells.erase();
        self.changed.clear();
    }

    /// Memory, bytes.
    pub fn bytes(&self) -> usize {
        self.cells.bytes()
    }
}

impl Cell {
    /// Adds the highest hit of a ping; what is farther than `apart_m` from a hypothesis is not of it.
    fn add(&mut self, z_m: f32, apart_m: f32) {
        if self.bed.pings == 0 || self.bed.is_near(z_m, apart_m) {
            self.bed.add(z_m);
            return;
        }
        if !self.other.is_near(z_m, apart_m) {
            self.other = Hypothesis::default();
        }
        self.other.add(z_m);
        // Two pings have the other one: it counts if it is shoaler, or if only one had the bed.
        let is_shoaler = self.other.mean_m > self.bed.mean_m;
        if self.other.pings >= 2 && (is_shoaler || self.bed.pings == 1) {
            self.bed = std::mem::take(&mut self.other);
        }
    }

    fn depth_m(self) -> f32 {
        // A mean of hits below the level may be above the present one.
        (self.water_m - self.bed.mean_m).max(0.0)
    }
}

impl Hypothesis {
    fn is_near(self, z_m: f32, apart_m: f32) -> bool {
        (z_m - self.mean_m).abs() <= apart_m
    }

    fn add(&mut self, z_m: f32) {
        self.pings = (self.pings + 1).min(MEMORY);
        self.mean_m += (z_m - self.mean_m) / f32::from(self.pings);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WATER_M: f64 = 0.1;

    /// A map after pings with these hits at x = 1 m, z of `odom`.
    fn after(pings: &[&[f64]]) -> DepthMap {
        let mut map = DepthMap::new(0.3);
        for hits in pings {
            let hits = hits.iter().map(|&z_m| Point3::new(1.0, 0.1, z_m));
            map.add_ping(hits, WATER_M, Point3::origin());
        }
        map
    }

    fn cell(x_m: f64) -> CellIndex {
        CellIndex::containing(nalgebra::Point2::new(x_m, 0.1), 0.3)
    }

    #[test]
    fn a_shoaler_sounding_counts_when_a_second_ping_confirms_it() {
        let bed: &[f64] = &[-3.9];
        for (pings, depth_m) in [
            (vec![bed], 4.0),
            (vec![&[-4.4, -3.8, -3.9], &[-4.0]], 4.0),
            // A false echo.
            (vec![bed, bed, &[-0.9]], 4.0),
            (vec![bed, bed, &[-0.9], bed, &[-2.0]], 4.0),
            // A false echo came first: the bed needs two pings.
            (vec![&[-0.9], bed], 1.0),
            (vec![&[-0.9], bed, bed], 4.0),
            // A rock, which stays although more pings reach the bed beside it.
            (vec![bed, bed, bed, &[-0.9], &[-1.1]], 1.1),
            (vec![bed, &[-0.9], &[-1.1], bed, bed, bed, bed], 1.1),
        ] {
            let found = after(&pings).depth_m(cell(1.0));
            let error_m = found.map(|found| (found - depth_m).abs());
            assert!(
                error_m.is_some_and(|error_m| error_m < 1e-5),
                "{pings:?}: {found:?}"
            );
        }
    }

    #[test]
    fn hits_above_the_water_are_no_soundings_and_changes_are_taken_once() {
        let mut map = after(&[&[0.2], &[-1.9, 0.5], &[-2.1]]);
        assert_eq!(map.depth_m(cell(4.0)), None);
        let changed = map.take_changed();
        let cells: Vec<_> = changed.iter().map(|(cell, _)| *cell).collect();
        assert_eq!(cells, [cell(1.0); 2]);
        let newest = changed.last().map(|(_, depth_m)| *depth_m);
        assert_eq!(newest, map.depth_m(cell(1.0)));
        assert_eq!(map.take_changed(), []);
        map.erase();
        assert_eq!(map.depth_m(cell(1.0)), None);
    }
}
