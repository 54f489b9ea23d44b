//! The ground around a cell, for gradients that are gentle (`algorithms.md` §1, "Smooth slopes").
//!
//! Ground grows from cell to cell: around a cell lie free cells, each of which says how high the ground
//! can be here if it rises or falls no steeper than `max_slope_deg`. A kerb is higher than the road beside
//! it allows and a gradient is not. A plane fitted to the cells around would lie halfway up a step, which
//! hides half of it; this one never does.

use super::elevation_cell::{Bounds, CellClass, ElevationCell};
use super::grid::CellIndex;
use super::rolling_grid::RollingGrid;

/// How far around a cell the ground is looked for, metres.
const REACH_M: f64 = 0.6;
/// A point so far above the ground is none of it: three times the noise of an attitude 9 m away, metres.
const RAISED_M: f32 = 0.05;

impl Bounds {
    /// The ground plane itself.
    pub(super) const PLANE: Self = Self {
        lowest_m: 0.0,
        highest_m: 0.0,
        raised_above_m: RAISED_M,
    };

    /// Wider by the depth and height that are no obstacle yet.
    pub(super) fn beyond(self, h_neg_m: f32, h_pos_m: f32) -> Self {
        Self {
            lowest_m: self.lowest_m - h_neg_m,
            highest_m: self.highest_m + h_pos_m,
            raised_above_m: self.raised_above_m,
        }
    }
}

/// Finds the ground around cells.
#[derive(Clone, Debug)]
pub(super) struct LocalGround {
    /// Offsets of the cells around, each with how much the ground may rise or fall on the way, metres.
    around: Vec<(i32, i32, f32)>,
}

impl LocalGround {
    pub(super) fn new(cell_m: f64, max_slope_deg: f64) -> Self {
        let slope = libm::tan(max_slope_deg.to_radians());
        // At least the next cells, or no ground could grow.
        let reach = ((REACH_M / cell_m) as i32).max(1);
        let mut around = Vec::new();
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let distance_m = libm::hypot(f64::from(dx), f64::from(dy)) * cell_m;
                let is_near = distance_m <= REACH_M.max(1.5 * cell_m);
                if (dx, dy) != (0, 0) && is_near {
                    around.push((dx, dy, (slope * distance_m) as f32));
                }
            }
        }
        Self { around }
    }

    /// Between which heights the ground at `cell` must lie: the plane where nothing free is near.
    pub(super) fn around(&self, grid: &RollingGrid<ElevationCell>, cell: CellIndex) -> Bounds {
        let free = self.around.iter().filter_map(|&(dx, dy, rise_m)| {
            let at = CellIndex {
                x: cell.x + dx,
                y: cell.y + dy,
            };
            let neighbour = grid.get(at)?;
            let is_free = neighbour.class() == CellClass::Free;
            is_free.then_some((neighbour.mean_m()?, rise_m))
        });
        let found = free.fold(None, |bounds: Option<Bounds>, (mean_m, rise_m)| {
            let (low_m, high_m) = (mean_m - rise_m, mean_m + rise_m);
            let (lowest_m, highest_m) = match bounds {
                Some(bounds) => (bounds.lowest_m.max(low_m), bounds.highest_m.min(high_m)),
                None => (low_m, high_m),
            };
            Some(Bounds {
                lowest_m,
                highest_m,
                raised_above_m: highest_m + RAISED_M,
            })
        });
        found.unwrap_or(Bounds::PLANE)
    }
}
