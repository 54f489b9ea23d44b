//! Ray clearing: removes obstacles that later beams pass through (docs/methods.md, section 1, "Ray
//! clearing").
//!
//! A beam that crosses a cell below the top of its obstacle, on the way to a farther hit, is
//! evidence. After [`SCANS_TO_CLEAR`] such scans without a new hit the cell is cleared.
//!
//! \[LOD\] accepts every beam up to 5 cm above the top. While the vehicle drives, that erases real
//! obstacles: the scan plane rises over the top of a box or a kerb, and scan after scan passes 0 to
//! 5 cm above it. Therefore the margin is granted only if the vehicle is stationary since the last
//! hit; or if the obstacle came from the side (first observed well above the ground, touching
//! nothing grounded), was observed for less than a second or at one height only, and the beam
//! continues to well below its top. Otherwise a beam must pass clearly below the top.

use nalgebra::Point2;

use crate::elevation::{ElevationCell, ScanHits};
use crate::grid::{CellIndex, CellSize};
use crate::ground_plane::GroundPlane;
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use crate::rolling_grid::{RollingGrid, Slot};
use crate::scan_marks::{FixedPoint, RayWalk};

const SCANS_TO_CLEAR: u8 = 5;
/// Greatest height of a beam above the top, metres, if the margin is granted.
const MARGIN_M: f32 = 0.05;
/// Least depth of a beam below the top otherwise, metres: three times the noise.
const CLEARLY_BELOW_M: f32 = 0.03;
/// Travel below which the vehicle is stationary, metres.
const STANDSTILL_M: f32 = 0.01;
/// An obstacle first observed higher above the ground came from the side, metres: within a scan the
/// beams of a vehicle at 3 m/s rise by 1.6 cm, and less than 5 cm counts as ground.
const SIDE_GAP_M: f32 = 0.07;
/// Greatest slice of an obstacle that was observed at one height only, metres.
const SLICE_M: f32 = 0.08;
/// Scans of a brief obstacle: a walking person leaves a cell in half a second; at 25 Hz and 1 m/s a
/// box of 15 cm is swept in 28 scans.
const BRIEF_SCANS: u16 = 25;

/// Each scan tests one of this many beams, in turn: obstacles are cleared within two seconds for an
/// eighth of the work.
const BEAMS_IN_TURN: usize = 8;

/// Cells along the edge of a block, whose bits are one word.
const BLOCK: i32 = 8;
/// Approximate edge of a quarter, metres: a beam over open ground crosses few of them.
const QUARTER_M: f64 = 1.6;

/// Index of the raised cells: a bit per cell in blocks, and an upper bound of the height per
/// quarter, to skip empty parts.
#[derive(Clone, Debug)]
pub(super) struct RayClearing {
    size: CellSize,
    /// Along x, metres; y is stretched so that cells are squares.
    cell_m: f64,
    blocks: RollingGrid<u64>,
    quarter_blocks: i32,
    /// Upper bound of the heights in each quarter, metres; −∞ if it was always empty. It is never
    /// lowered: testing empty blocks is cheap.
    quarter_tops_m: RollingGrid<f32>,
    turn: usize,
    crossed: Vec<(CellIndex, Slot)>,
}

impl RayClearing {
    /// For a window of so many columns and rows.
    pub(super) fn new(cells: [u32; 2], size: CellSize) -> Self {
        let [cell_m, _] = size.sides_m();
        let blocks = cells.map(|cells| cells.div_ceil(BLOCK.unsigned_abs()) + 2);
        let quarter_blocks = ((QUARTER_M / (f64::from(BLOCK) * cell_m)) as i32).max(1);
        let quarters = blocks.map(|blocks| blocks.div_ceil(quarter_blocks.unsigned_abs()) + 2);
        Self {
            size,
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

    /// Sets a raised cell and its height.
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

    /// Counts the scan's beams through obstacles of `grid`; returns the cells to clear.
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
            // The obstacle is still observed: the beam passed beside it.
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
        let line = Line::new(beam, plane, self.size);
        let fixed = |point: Point2<f64>| FixedPoint::from_metres(point.x, point.y, quarter_m);
        let (Some(start), Some(end)) = (fixed(line.from), fixed(line.to)) else {
            return;
        };
        // Greatest descent of the beam between the middle of a quarter and its farthest corner.
        let fall_m = (line.rise_per_m.abs() * quarter_m) as f32;
        let walk = RayWalk::new(start, end);
        let (mut at, mut error) = (start.cell(), walk.error);
        for _ in 0..=walk.steps {
            let index = CellIndex { x: at.0, y: at.1 };
            let Some(&top_m) = self.quarter_tops_m.get(index) else {
                // The window is convex and holds the sensor: the rest is outside too.
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

    /// Whether a beam at `height_m` over the cell, to a hit at `end_m`, is evidence that the
    /// obstacle is gone.
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

/// A beam in plan view, its y stretched so that cells are squares, with its height above the ground
/// plane.
struct Line {
    from: Point2<f64>,
    to: Point2<f64>,
    /// Unit vector.
    along: nalgebra::Vector2<f64>,
    length_m: f64,
    from_height_m: f64,
    end_height_m: f32,
    rise_per_m: f64,
}

impl Line {
    fn new(beam: &RegisteredBeam, plane: &GroundPlane, size: CellSize) -> Self {
        let [from, to] = [beam.origin_in_odom, beam.end_in_odom].map(|end| size.squared(end.xy()));
        // Faster than nalgebra's norm, whose software square root takes ten times as long.
        let length_m = libm::sqrt((to - from).norm_squared()).max(1e-9);
        let from_height_m = plane.height_m(&beam.origin_in_odom);
        let to_height_m = plane.height_m(&beam.end_in_odom);
        Self {
            from,
            to,
            along: (to - from) / length_m,
            length_m,
            from_height_m,
            end_height_m: to_height_m as f32,
            rise_per_m: (to_height_m - from_height_m) / length_m,
        }
    }

    /// Height where the beam is nearest to a point.
    fn height_beside(&self, point: Point2<f64>) -> f32 {
        let along_m = (point - self.from).dot(&self.along);
        (self.from_height_m + along_m * self.rise_per_m) as f32
    }

    /// Whether the beam passes a point within `reach_m`.
    fn passes(&self, point: Point2<f64>, reach_m: f64) -> bool {
        let to_point = point - self.from;
        let along_m = to_point.dot(&self.along);
        to_point.perp(&self.along).abs() <= reach_m && along_m <= self.length_m + reach_m
    }

    /// Height over a cell, if the beam crosses it well and ends beyond the next cell.
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

/// Whether the obstacle rose from the ground while the beams swept up its face.
pub(super) fn rises_from_ground(cell: &ElevationCell) -> bool {
    cell.gap_m() <= SIDE_GAP_M
}

/// A cell and its eight neighbours.
pub(super) fn around(cell: CellIndex) -> impl Iterator<Item = CellIndex> {
    (-1..=1).flat_map(move |dy| {
        (-1..=1).map(move |dx| CellIndex {
            x: cell.x + dx,
            y: cell.y + dy,
        })
    })
}
