//! What was there and is gone: beams that pass through it say so (`algorithms.md` §1, "Dynamic obstacles").
//!
//! A beam that crosses a cell below the top of what stood there, on its way to a farther hit, is evidence
//! that it is gone; after [`SCANS_TO_CLEAR`] such scans without a new hit the cell is cleared.
//!
//! The design takes every beam for evidence that is at most 5 cm above the highest point. Of a vehicle that
//! drives on, that erases what is real: while the plane of beams rises over the top of a box or a pavement, scan
//! after scan passes 0 to 5 cm above it. So that margin is granted only where rising over a top cannot be the
//! reason: the vehicle has not moved since the last hit; or the thing was first seen well above the ground and
//! touches nothing that stands on it (it came from the side, and did not rise from the ground as the beams swept
//! up its face), was seen for less than a second or at one height only, and the beam goes on to well below its
//! top. Otherwise a beam must pass clearly below the top.

use nalgebra::Point2;

use super::elevation_cell::ElevationCell;
use super::grid::CellIndex;
use super::ground_plane::GroundPlane;
use super::ray::{FixedPoint, RayWalk};
use super::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use super::rolling_grid::{RollingGrid, Slot};
use super::scan_hits::ScanHits;

/// Scans with a beam through a thing after which it is gone.
const SCANS_TO_CLEAR: u8 = 5;
/// How far above a thing's top a beam may pass and still say that it is gone, metres.
const MARGIN_M: f32 = 0.05;
/// How far below the top of a thing that may just have been risen over, metres: three times the noise.
const CLEARLY_BELOW_M: f32 = 0.03;
/// A vehicle that moved less has not moved, metres.
const STANDSTILL_M: f32 = 0.01;
/// Seen first so far above the ground, a thing came from the side, metres: a scan later the beams of a
/// vehicle at 3 m/s are 1.6 cm higher, and what is less than 5 cm high counts as ground.
const SIDE_GAP_M: f32 = 0.07;
/// Seen in a slice no higher, a thing has not been risen along, metres.
const SLICE_M: f32 = 0.08;
/// A walking person leaves a cell in half a second; at 25 Hz a box of 15 cm is swept in 28 scans at 1 m/s.
const BRIEF_SCANS: u16 = 25;

/// Of so many beams a scan looks at one, at another one every time: what is gone is then seen to be gone
/// within two seconds, for an eighth of the work.
const BEAMS_IN_TURN: usize = 8;

/// Cells along the edge of a block: a block is one word of bits.
const BLOCK: i32 = 8;
/// About how long the edge of a quarter is, whatever the cells, metres: a beam over open ground passes a few.
const QUARTER_M: f64 = 1.6;

/// Which cells hold something: their bits in blocks, and how high the quarters are, to say whether to look there.
#[derive(Clone, Debug)]
pub(super) struct RayClearing {
    cell_m: f64,
    blocks: RollingGrid<u64>,
    /// Blocks along the edge of a quarter.
    quarter_blocks: i32,
    /// At least as high as everything in each quarter, metres; −∞ where nothing stood since it was entered. It is
    /// never lowered: looking at empty blocks costs little, and a count would not survive places that are taken.
    quarter_tops_m: RollingGrid<f32>,
    turn: usize,
    crossed: Vec<(CellIndex, Slot)>,
}

impl RayClearing {
    pub(super) fn new(cells: u32, cell_m: f64) -> Self {
        let blocks = cells.div_ceil(BLOCK.unsigned_abs()) + 2;
        let quarter_blocks = ((QUARTER_M / (f64::from(BLOCK) * cell_m)) as i32).max(1);
        let quarters = blocks.div_ceil(quarter_blocks.unsigned_abs()) + 2;
        Self {
            cell_m,
            blocks: RollingGrid::new(blocks, 0),
            quarter_blocks,
            quarter_tops_m: RollingGrid::new(quarters, f32::NEG_INFINITY),
            turn: 0,
            crossed: Vec::new(),
        }
    }

    pub(super) fn center_on(&mut self, cell: CellIndex) {
        let (block, _) = block_of(cell);
        self.blocks.center_on(block);
        self.quarter_tops_m.center_on(self.quarter_of(block));
    }

    fn quarter_of(&self, block: CellIndex) -> CellIndex {
        CellIndex {
            x: block.x.div_euclid(self.quarter_blocks),
            y: block.y.div_euclid(self.quarter_blocks),
        }
    }

    /// Something up to `top_m` stands in `cell` now.
    pub(super) fn mark(&mut self, cell: CellIndex, top_m: f32) {
        let (block, bit) = block_of(cell);
        if let Some(slot) = self.blocks.slot(block) {
            *self.blocks.at_mut(block, slot) |= bit;
        }
        let quarter = self.quarter_of(block);
        if let Some(slot) = self.quarter_tops_m.slot(quarter) {
            let highest_m = self.quarter_tops_m.at_mut(quarter, slot);
            *highest_m = highest_m.max(top_m);
        }
    }

    /// Nothing stands in `cell` any more.
    pub(super) fn unmark(&mut self, cell: CellIndex) {
        let (block, bit) = block_of(cell);
        if let Some(slot) = self.blocks.slot(block) {
            *self.blocks.at_mut(block, slot) &= !bit;
        }
    }

    pub(super) fn erase(&mut self) {
        self.blocks.erase();
        self.quarter_tops_m.erase();
    }

    /// Counts the scan's beams through what stands in `grid`; returns the cells where it is gone.
    pub(super) fn cleared_cells(
        &mut self,
        scan: &RegisteredScan,
        plane: &GroundPlane,
        grid: &mut RollingGrid<ElevationCell>,
        hits: &ScanHits,
        travel_m: f32,
    ) -> Vec<CellIndex> {
        self.crossed.clear();
        self.turn = (self.turn + 1) % BEAMS_IN_TURN;
        let beams = scan.beams.iter().skip(self.turn);
        for beam in beams.step_by(BEAMS_IN_TURN) {
            if beam.outcome == BeamOutcome::Hit {
                self.trace_beam(beam, plane, grid, travel_m);
            }
        }
        self.crossed.sort_unstable();
        self.crossed.dedup();
        let mut gone = Vec::new();
        for &(cell, slot) in &self.crossed {
            // Something is still there: the beam passed beside it.
            if around(cell).any(|at| hits.contains(grid, at)) {
                continue;
            }
            let value = grid.at_mut(cell, slot);
            value.crossed_scans += 1;
            if value.crossed_scans >= SCANS_TO_CLEAR {
                gone.push(cell);
            }
        }
        gone
    }

    fn trace_beam(
        &mut self,
        beam: &RegisteredBeam,
        plane: &GroundPlane,
        grid: &RollingGrid<ElevationCell>,
        travel_m: f32,
    ) {
        let quarter_m = f64::from(BLOCK * self.quarter_blocks) * self.cell_m;
        let (from, to) = (beam.origin_in_odom, beam.end_in_odom);
        let fixed = |x: f64, y: f64| FixedPoint::from_metres(x, y, quarter_m);
        let (Some(start), Some(end)) = (fixed(from.x, from.y), fixed(to.x, to.y)) else {
            return;
        };
        let line = Line::new(beam, plane);
        // As much as the beam can fall between the middle of a quarter and its farthest corner.
        let fall_m = (line.rise_per_m.abs() * quarter_m) as f32;
        let walk = RayWalk::new(start, end);
        let (mut at, mut error) = (start.cell(), walk.error);
        for _ in 0..=walk.steps {
            let index = CellIndex { x: at.0, y: at.1 };
            let Some(&top_m) = self.quarter_tops_m.get(index) else {
                // The window is convex and holds the sensor: what follows is outside too.
                return;
            };
            let height_m = line.height_beside(index.centre(quarter_m)) - fall_m;
            if height_m <= top_m + MARGIN_M {
                self.visit_quarter(index, &line, grid, travel_m);
            }
            if error < 0 {
                at.0 += walk.step_x;
                error += walk.error_after_x;
            } else {
                at.1 += walk.step_y;
                error -= walk.error_after_y;
            }
        }
    }

    fn visit_quarter(
        &mut self,
        quarter: CellIndex,
        line: &Line,
        grid: &RollingGrid<ElevationCell>,
        travel_m: f32,
    ) {
        let block_m = f64::from(BLOCK) * self.cell_m;
        // Half of a block's diagonal, and half a cell.
        let reach_m = 0.7072 * block_m + 0.5 * self.cell_m;
        for row in 0..self.quarter_blocks {
            for column in 0..self.quarter_blocks {
                let block = CellIndex {
                    x: quarter.x * self.quarter_blocks + column,
                    y: quarter.y * self.quarter_blocks + row,
                };
                let bits = self.blocks.get(block).copied().unwrap_or(0);
                if bits != 0 && line.passes(block.centre(block_m), reach_m) {
                    self.visit_block(block, bits, line, grid, travel_m);
                }
            }
        }
    }

    fn visit_block(
        &mut self,
        block: CellIndex,
        mut bits: u64,
        line: &Line,
        grid: &RollingGrid<ElevationCell>,
        travel_m: f32,
    ) {
        while bits != 0 {
            let bit = bits.trailing_zeros().cast_signed();
            bits &= bits - 1;
            let cell = CellIndex {
                x: block.x * BLOCK + bit % BLOCK,
                y: block.y * BLOCK + bit / BLOCK,
            };
            let Some(height_m) = line.height_over(cell.centre(self.cell_m), self.cell_m) else {
                continue;
            };
            if let Some(slot) = grid.slot(cell)
                && Self::is_evidence(grid.at(cell, slot), height_m, line.end_height_m, travel_m)
            {
                self.crossed.push((cell, slot));
            }
        }
    }

    /// Whether a beam at this height through the cell, to a hit at `end_m`, says that what stood there is gone.
    fn is_evidence(cell: &ElevationCell, height_m: f32, end_m: f32, travel_m: f32) -> bool {
        let is_vehicle_still = travel_m - cell.hit_at_travel_m < STANDSTILL_M;
        let is_brief = cell.scans() < BRIEF_SCANS || cell.slice_m() < SLICE_M;
        let goes_down = end_m < cell.max_m() - MARGIN_M;
        let has_passed_by = is_brief && goes_down && !cell.is_grounded();
        let highest_m = if is_vehicle_still || has_passed_by {
            cell.max_m() + MARGIN_M
        } else {
            cell.max_m() - CLEARLY_BELOW_M
        };
        height_m <= highest_m
    }

    pub(super) fn bytes(&self) -> usize {
        self.blocks.bytes() + self.quarter_tops_m.bytes()
    }
}

/// A beam seen from above, with its height over the ground plane.
struct Line {
    from: Point2<f64>,
    /// Unit vector.
    along: nalgebra::Vector2<f64>,
    length_m: f64,
    from_height_m: f64,
    end_height_m: f32,
    rise_per_m: f64,
}

impl Line {
    fn new(beam: &RegisteredBeam, plane: &GroundPlane) -> Self {
        let (from, to) = (beam.origin_in_odom.xy(), beam.end_in_odom.xy());
        // Not nalgebra's norm: its square root in software takes ten times as long, for every beam.
        let length_m = libm::sqrt((to - from).norm_squared()).max(1e-9);
        let from_height_m = plane.height_m(&beam.origin_in_odom);
        let to_height_m = plane.height_m(&beam.end_in_odom);
        Self {
            from,
            along: (to - from) / length_m,
            length_m,
            from_height_m,
            end_height_m: to_height_m as f32,
            rise_per_m: (to_height_m - from_height_m) / length_m,
        }
    }

    /// The beam's height where it is nearest to a point.
    fn height_beside(&self, point: Point2<f64>) -> f32 {
        let along_m = (point - self.from).dot(&self.along);
        (self.from_height_m + along_m * self.rise_per_m) as f32
    }

    /// Whether it comes as near to a point on its way.
    fn passes(&self, point: Point2<f64>, reach_m: f64) -> bool {
        let to_point = point - self.from;
        let along_m = to_point.dot(&self.along);
        to_point.perp(&self.along).abs() <= reach_m && along_m <= self.length_m + reach_m
    }

    /// The beam's height over a cell that it crosses well, on its way to a hit beyond the next cell.
    fn height_over(&self, center: Point2<f64>, cell_m: f64) -> Option<f32> {
        let to_center = center - self.from;
        let along_m = to_center.dot(&self.along);
        let beside_m = to_center.perp(&self.along);
        let crosses = beside_m.abs() <= 0.5 * cell_m
            && along_m > 0.0
            && along_m + 1.5 * cell_m < self.length_m;
        crosses.then_some((self.from_height_m + along_m * self.rise_per_m) as f32)
    }
}

fn block_of(cell: CellIndex) -> (CellIndex, u64) {
    let block = CellIndex {
        x: cell.x.div_euclid(BLOCK),
        y: cell.y.div_euclid(BLOCK),
    };
    let bit = cell.y.rem_euclid(BLOCK) * BLOCK + cell.x.rem_euclid(BLOCK);
    (block, 1 << bit)
}

/// Whether what stands in a cell rose from the ground while the beams swept up its face.
pub(super) fn rises_from_ground(cell: &ElevationCell) -> bool {
    cell.gap_m() <= SIDE_GAP_M
}

/// The cell and the eight around it.
pub(super) fn around(cell: CellIndex) -> impl Iterator<Item = CellIndex> {
    (-1..=1).flat_map(move |dy| {
        (-1..=1).map(move |dx| CellIndex {
            x: cell.x + dx,
            y: cell.y + dy,
        })
    })
}
