//! The columns of a window, with sums that say at once what is in a box or row of them.

use std::ops::Range;

use nalgebra::Point2;

use super::DockingColumn;
use crate::grid::CellIndex;
use crate::rigidity::REACH;
use crate::shore::ShoreClass;

/// A rectangle of columns.
#[derive(Debug)]
pub(super) struct DockingGrid<'a> {
    first: CellIndex,
    width: usize,
    cell_m: f64,
    columns: &'a [DockingColumn],
    /// The densest vegetation that counts as moderate; `None` if none does.
    pub(super) vegetation: Option<ShoreClass>,
    /// Per row: number of columns of each kind before each column, and in the whole row.
    before: Vec<Counts>,
    /// Summed area table: clear water and lethal columns before each corner along both axes.
    below: Vec<[u32; 2]>,
}

/// Cells relative to a middle one, from the first of each up to before the second.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CellBox {
    pub(super) x: [i32; 2],
    pub(super) y: [i32; 2],
}

/// Kind of a column for a boat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ground {
    ClearWater,
    /// Cost above 0 and below 1.
    Moderate,
    Lethal,
    /// Unknown, or level land.
    Other,
}

/// Number of columns of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) water: u32,
    pub(super) moderate: u32,
    pub(super) lethal: u32,
    /// Above the water and not lethal.
    pub(super) land: u32,
}

impl<'a> DockingGrid<'a> {
    /// `columns` are row by row, y upwards, `width` in a row; the first is cell `first`. An
    /// incomplete last row is ignored. Vegetation up to `vegetation` counts as moderate.
    pub(super) fn new(
        first: CellIndex,
        width: usize,
        cell_m: f64,
        columns: &'a [DockingColumn],
        vegetation: Option<ShoreClass>,
    ) -> Self {
        let rows = columns.len().checked_div(width).unwrap_or(0);
        let columns = &columns[..rows * width];
        let mut before = Vec::with_capacity(rows * (width + 1));
        let mut below = vec![[0; 2]; (rows + 1) * (width + 1)];
        for (y, row) in columns.chunks_exact(width.max(1)).enumerate() {
            let mut counts = Counts::default();
            before.push(counts);
            for (x, column) in row.iter().enumerate() {
                counts.add(*column, vegetation);
                before.push(counts);
                let [water, lethal] = below[y * (width + 1) + x + 1];
                below[(y + 1) * (width + 1) + x + 1] =
                    [water + counts.water, lethal + counts.lethal];
            }
        }
        Self {
            first,
            width,
            cell_m,
            columns,
            vegetation,
            before,
            below,
        }
    }

    pub(super) const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    pub(super) const fn columns(&self) -> &[DockingColumn] {
        self.columns
    }

    pub(super) fn ground(&self, at: usize) -> Ground {
        Ground::of(self.columns[at], self.vegetation)
    }

    /// Whether a site may be made of this column: of a gentle slope, or of the densest vegetation
    /// that counts.
    pub(super) fn is_sought(&self, at: usize) -> bool {
        let found = self.columns[at].vegetation.map(|found| found.class);
        self.ground(at) == Ground::Moderate
            && (self.vegetation.is_none() || found == self.vegetation)
    }

    /// Whether vegetation that counts grows there, or close by and nothing else is in the way: stems
    /// sway, and not each is mapped.
    pub(super) fn is_passable(&self, at: usize) -> bool {
        let is_vegetation = |at: usize| {
            let found = self.columns[at].vegetation.map(|found| found.class);
            found.is_some() && found <= self.vegetation
        };
        let mut around = vec![at];
        for _ in 0..REACH {
            around = around.iter().flat_map(|&at| self.neighbours(at)).collect();
        }
        self.ground(at) != Ground::Lethal && around.into_iter().any(is_vegetation)
    }

    pub(super) const fn width(&self) -> usize {
        self.width
    }

    pub(super) fn rows(&self) -> usize {
        self.columns.len().checked_div(self.width).unwrap_or(0)
    }

    pub(super) fn cell(&self, at: usize) -> CellIndex {
        CellIndex {
            x: self
                .first
                .x
                .saturating_add_unsigned((at % self.width) as u32),
            y: self
                .first
                .y
                .saturating_add_unsigned((at / self.width) as u32),
        }
    }

    /// Metres in `odom`.
    pub(super) fn centre(&self, at: usize) -> Point2<f64> {
        self.cell(at).centre(self.cell_m)
    }

    /// Columns that touch one, also across corners, itself included.
    pub(super) fn neighbours(&self, at: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, y) = (at % self.width, at / self.width);
        let (width, rows) = (self.width, self.rows());
        let ys = y.saturating_sub(1)..(y + 2).min(rows);
        ys.flat_map(move |y| {
            let xs = x.saturating_sub(1)..(x + 2).min(width);
            xs.map(move |x| y * width + x)
        })
    }

    /// Columns of clear water, and lethal ones, in a box around a column, clipped to the window.
    pub(super) fn water_and_lethal(&self, at: usize, cells: CellBox) -> [u32; 2] {
        let clip = |middle: usize, cells: [i32; 2], end: usize| {
            cells.map(|cells| middle.saturating_add_signed(cells as isize).min(end))
        };
        let [from_x, to_x] = clip(at % self.width, cells.x, self.width);
        let [from_y, to_y] = clip(at / self.width, cells.y, self.rows());
        let before = |x: usize, y: usize| self.below[y * (self.width + 1) + x];
        let (all, left) = (before(to_x, to_y), before(from_x, to_y));
        let (below, both) = (before(to_x, from_y), before(from_x, from_y));
        [0, 1].map(|kind| all[kind] + both[kind] - left[kind] - below[kind])
    }

    /// Indices of columns `from .. to` of a row, clipped to the window.
    pub(super) fn row_span(&self, y: isize, from: isize, to: isize) -> Range<usize> {
        if y < 0 || y.cast_unsigned() >= self.rows() {
            return 0..0;
        }
        let within = |x: isize| x.max(0).cast_unsigned().min(self.width);
        let row = y.cast_unsigned() * self.width;
        let from = within(from);
        row + from..row + within(to).max(from)
    }

    pub(super) fn counts(&self, row_span: Range<usize>) -> Counts {
        if row_span.is_empty() {
            return Counts::default();
        }
        // Each row has one count more than columns.
        let row = row_span.start / self.width;
        let (start, end) = (
            self.before[row_span.start + row],
            self.before[row_span.end + row],
        );
        Counts {
            water: end.water - start.water,
            moderate: end.moderate - start.moderate,
            lethal: end.lethal - start.lethal,
            land: end.land - start.land,
        }
    }
}

impl Ground {
    fn of(column: DockingColumn, vegetation: Option<ShoreClass>) -> Self {
        let found = column.vegetation.map(|found| found.class);
        if found.is_some() && found <= vegetation {
            Self::Moderate
        } else if column.is_clear_water {
            Self::ClearWater
        } else if column.cost >= 1.0 {
            Self::Lethal
        } else if column.cost > 0.0 {
            Self::Moderate
        } else {
            Self::Other
        }
    }
}

impl Counts {
    fn add(&mut self, column: DockingColumn, vegetation: Option<ShoreClass>) {
        match Ground::of(column, vegetation) {
            Ground::ClearWater => self.water += 1,
            Ground::Lethal => self.lethal += 1,
            Ground::Moderate => {
                self.moderate += 1;
                self.land += u32::from(column.rises_from_water);
            }
            Ground::Other => self.land += u32::from(column.rises_from_water),
        }
    }
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.water += other.water;
        self.moderate += other.moderate;
        self.lethal += other.lethal;
        self.land += other.land;
    }
}

impl CellBox {
    /// All cells that many steps away, also across corners.
    pub(super) const fn around(steps: i32) -> Self {
        Self {
            x: [-steps, steps + 1],
            y: [-steps, steps + 1],
        }
    }
}
