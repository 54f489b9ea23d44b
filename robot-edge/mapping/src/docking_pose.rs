//! Places and headings at which a boat's footprint lies on gentle ground between clear water and land.

use std::f64::consts::{SQRT_2, TAU};

use nalgebra::Vector2;

use super::docking::BoatFootprint;
use super::docking_grid::{Counts, DockingGrid, Ground};

/// Headings that are tried, 15° apart.
const HEADINGS: usize = 24;
/// Least share of the cells below the boat that are of moderate cost. The rest may be level or unknown: a
/// tilting laser leaves holes. None may be lethal.
const MIN_MODERATE_SHARE: f64 = 0.9;
/// Least share of the cells behind the boat that are clear water. The rest may be unknown or the edge of the
/// ramp, which the waterline cuts at an angle. None may be lethal.
const MIN_WATER_SHARE: f64 = 0.8;
/// Boats longer than this many cells find no berth: a bound on work and memory.
const MAX_CELLS: f64 = 256.0;

/// A boat on land.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct DockingPose {
    /// The place of the middle cell of its footprint.
    pub(super) centre: usize,
    /// Which of the headings.
    pub(super) heading: usize,
}

/// What a boat covers at each heading, in cells.
#[derive(Clone, Debug, Default)]
pub(super) struct DockingTemplates {
    /// One per heading; empty where the boat is too large.
    shapes: Vec<DockingTemplate>,
    /// From the middle of a berth it is no farther to clear water, cells.
    max_steps_to_water: u32,
    /// From the middle of a berth it is farther to a lethal cell, cells.
    lethal_clearance: u32,
}

#[derive(Clone, Debug)]
struct DockingTemplate {
    direction: Vector2<f64>,
    footprint_mask: CellMask,
    /// As large as the footprint, and right behind it.
    water: CellMask,
    /// The same right ahead: the land may begin there, no farther from the stern than twice the boat's length,
    /// as far as a slope beside water counts as a beach.
    ahead: CellMask,
    /// Cells of moderate cost that the footprint must have,
    min_moderate: u32,
    /// and of clear water that must be behind it.
    min_water: u32,
    /// Cells of land that are below the boat or ahead: as many as the boat is wide, a few stray hits are no land;
    min_land: u32,
    /// and where all are ahead, no more clear water there.
    max_water_ahead: u32,
}

/// A set of cells around a middle one, as stretches of rows.
#[derive(Clone, Debug, Default)]
struct CellMask {
    row_spans: Vec<RowSpan>,
    cells: u32,
}

/// Columns `from .. to` of row `y`, counted from the middle cell.
#[derive(Clone, Copy, Debug)]
struct RowSpan {
    y: i32,
    from: i32,
    to: i32,
}

impl DockingTemplates {
    pub(super) fn new(boat: &BoatFootprint, cell_m: f64) -> Self {
        let cells = |metres: f64| metres / cell_m;
        let (length, width) = (cells(boat.length_m), cells(boat.width_m));
        let fits = |size: f64| size > 0.0 && size <= MAX_CELLS;
        if !(fits(length) && fits(width)) {
            return Self::default();
        }
        let shapes = (0..HEADINGS).map(|heading| {
            let angle_rad = TAU * heading as f64 / HEADINGS as f64;
            let direction = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad));
            let rectangle = |ahead: f64| CellMask::rectangle(direction, ahead, length, width);
            let [footprint_mask, water, ahead] = [0.0, -length, length].map(rectangle);
            DockingTemplate {
                direction,
                min_moderate: footprint_mask.share(MIN_MODERATE_SHARE),
                // Of a boat so small that no cell is behind it none is known to be water.
                min_water: water.share(MIN_WATER_SHARE).max(1),
                min_land: libm::ceil(width) as u32,
                max_water_ahead: ahead.cells - ahead.share(MIN_WATER_SHARE),
                footprint_mask,
                water,
                ahead,
            }
        });
        // No cell of the water behind a berth is farther than this.
        let to_water = 1.5 * length + 0.5 * width;
        // So many steps, all of them over corners, are within the circle that fits into the footprint.
        let to_side = 0.5 * width.min(length) / SQRT_2;
        Self {
            shapes: shapes.collect(),
            max_steps_to_water: to_water as u32 + 1,
            lethal_clearance: to_side as u32,
        }
    }

    pub(super) const fn headings(&self) -> usize {
        self.shapes.len()
    }

    /// Where the bow points.
    pub(super) fn direction(&self, heading: usize) -> Vector2<f64> {
        self.shapes[heading].direction
    }

    /// All berths, by place and heading.
    pub(super) fn docking_poses(&self, window: &DockingGrid<'_>) -> Vec<DockingPose> {
        let mut docking_poses = Vec::new();
        let to_water = window.steps_to(Ground::ClearWater);
        let to_lethal = window.steps_to(Ground::Lethal);
        for (centre, (to_water, to_lethal)) in to_water.into_iter().zip(to_lethal).enumerate() {
            // Most places are ruled out without a look at each heading.
            if window.ground(centre) != Ground::Moderate
                || to_water > self.max_steps_to_water
                || to_lethal <= self.lethal_clearance
            {
                continue;
            }
            for (heading, shape) in self.shapes.iter().enumerate() {
                if shape.is_docking_pose(window, centre) {
                    docking_poses.push(DockingPose { centre, heading });
                }
            }
        }
        docking_poses
    }

    /// The places of the cells below a boat.
    pub(super) fn cells<'a>(
        &'a self,
        window: &'a DockingGrid<'_>,
        docking_pose: DockingPose,
    ) -> impl Iterator<Item = usize> + 'a {
        let shape = &self.shapes[docking_pose.heading].footprint_mask;
        shape.cell_ranges(window, docking_pose.centre).flatten()
    }
}

impl DockingTemplate {
    fn is_docking_pose(&self, window: &DockingGrid<'_>, centre: usize) -> bool {
        let below = self.footprint_mask.counts(window, centre);
        let holds = |below: &Counts| below.moderate >= self.min_moderate;
        let Some(below) = below.filter(holds) else {
            return false;
        };
        let behind = self.water.counts(window, centre);
        behind.is_some_and(|behind| behind.water >= self.min_water)
            && (below.land >= self.min_land || self.leads_to_land(window, centre))
    }

    /// A sonar sees the bed of shallow water as gentle as a beach: what sets a shoal apart is that no land follows.
    fn leads_to_land(&self, window: &DockingGrid<'_>, centre: usize) -> bool {
        let ahead = self.ahead.counts(window, centre);
        ahead
            .is_some_and(|ahead| ahead.land >= self.min_land && ahead.water <= self.max_water_ahead)
    }
}

impl CellMask {
    /// The cells whose centres are in a rectangle of `length` along `direction` and `width` across, cells,
    /// its centre `ahead` cells from that of the middle cell.
    fn rectangle(direction: Vector2<f64>, ahead: f64, length: f64, width: f64) -> Self {
        let reach = libm::ceil(ahead.abs() + 0.5 * (length + width)) as i32;
        let is_inside = |x: i32, y: i32| {
            let cell = Vector2::new(f64::from(x), f64::from(y));
            let (along, across) = (cell.dot(&direction) - ahead, cell.perp(&direction));
            along.abs() <= 0.5 * length && across.abs() <= 0.5 * width
        };
        let mut shape = Self::default();
        for y in -reach..=reach {
            // A rectangle is convex: one stretch a row.
            let mut inside = (-reach..=reach).filter(|&x| is_inside(x, y));
            if let Some(from) = inside.next() {
                let to = inside.next_back().unwrap_or(from) + 1;
                shape.row_spans.push(RowSpan { y, from, to });
                shape.cells += to.abs_diff(from);
            }
        }
        shape
    }

    fn share(&self, share: f64) -> u32 {
        libm::ceil(share * f64::from(self.cells)) as u32
    }

    /// Where its cells are, as far as the window reaches.
    fn cell_ranges<'a>(
        &'a self,
        window: &'a DockingGrid<'_>,
        centre: usize,
    ) -> impl Iterator<Item = std::ops::Range<usize>> + 'a {
        let (x, y) = (
            (centre % window.width()).cast_signed(),
            (centre / window.width()).cast_signed(),
        );
        self.row_spans.iter().map(move |row_span| {
            let along = |cells: i32| x + cells as isize;
            window.row_span(
                y + row_span.y as isize,
                along(row_span.from),
                along(row_span.to),
            )
        })
    }

    /// What stands on its cells; `None` where any is lethal.
    fn counts(&self, window: &DockingGrid<'_>, centre: usize) -> Option<Counts> {
        let mut counts = Counts::default();
        for row_span in self.cell_ranges(window, centre) {
            counts += window.counts(row_span);
            if counts.lethal > 0 {
                return None;
            }
        }
        Some(counts)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::docking_grid::DockingColumn;
    use crate::grid::CellIndex;

    proptest! {
        /// What is ruled out beforehand would have been no berth.
        #[test]
        fn no_docking_pose_is_missed(
            kinds in prop::collection::vec(
                prop_oneof![
                    6 => Just((0.0, true, false)),
                    4 => Just((0.5, false, true)),
                    2 => Just((0.5, false, false)),
                    1 => Just((1.0, false, true)),
                    1 => Just((f32::NAN, false, false)),
                ],
                16,
            ),
            length_m in 0.5..5.0_f64,
            width_m in 0.5..5.0_f64,
        ) {
            let boat = BoatFootprint { length_m, width_m };
            let shapes = DockingTemplates::new(&boat, 1.0);
            // Patches of 4 × 4 columns.
            let columns: Vec<_> = (0..256)
                .map(|at| kinds[at / 64 * 4 + at % 16 / 4])
                .map(|(cost, is_clear_water, rises_from_water)| DockingColumn {
                    cost,
                    is_clear_water,
                    rises_from_water,
                })
                .collect();
            let window = DockingGrid::new(CellIndex { x: 0, y: 0 }, 16, 1.0, &columns);
            let all = (0..256).flat_map(|centre| {
                let headings = 0..shapes.headings();
                headings.map(move |heading| DockingPose { centre, heading })
            });
            let docking_poses = all.filter(|docking_pose| {
                window.ground(docking_pose.centre) == Ground::Moderate
                    && shapes.shapes[docking_pose.heading].is_docking_pose(&window, docking_pose.centre)
            });
            prop_assert_eq!(shapes.docking_poses(&window), docking_poses.collect::<Vec<_>>());
        }
    }
}
