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
    rows: usize,
    cell_m: f64,
    columns: &'a [DockingColumn],
    /// The densest vegetation that counts as moderate; `None` if none does.
    pub(super) vegetation: Option<ShoreClass>,
    /// Columns that a site may be made of, ascending: of a gentle slope, or of the densest vegetation that counts.
    sought: Vec<usize>,
    /// Per row: number of columns of each kind before each column, and in the whole row. Only the last 16 bits, so that more of them
    /// are in the cache: their differences are no longer than a boat.
    before: Vec<[u16; 4]>,
    /// Summed area table: clear water and lethal columns before each corner along both axes, also of cells outside of the window.
    below: Vec<[u32; 2]>,
    /// Cells outside of the window on each side of that table.
    margin: usize,
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
    /// incomplete last row is ignored. Vegetation up to `vegetation` counts as moderate. Boxes of
    /// [`Self::water_and_lethal`] reach no farther than `margin` cells.
    pub(super) fn new(
        first: CellIndex,
        width: usize,
        cell_m: f64,
        columns: &'a [DockingColumn],
        vegetation: Option<ShoreClass>,
        margin: usize,
    ) -> Self {
        let rows = columns.len().checked_div(width).unwrap_or(0);
        let columns = &columns[..rows * width];
        let mut sought = Vec::new();
        let mut before = Vec::with_capacity(rows * (width + 1));
        let stride = width + 1 + 2 * margin;
        let mut below = vec![[0; 2]; (rows + 1 + 2 * margin) * stride];
        for (y, row) in columns.chunks_exact(width.max(1)).enumerate() {
            let mut counts = Counts::default();
            before.push([0; 4]);
            for (x, column) in row.iter().enumerate() {
                let ground = Ground::of(*column, vegetation);
                counts.add(ground, column.rises_from_water);
                let Counts {
                    water,
                    moderate,
                    lethal,
                    land,
                } = counts;
                before.push([water, moderate, lethal, land].map(|count| count as u16));
                let found = column.vegetation.map(|found| found.class);
                if ground == Ground::Moderate && (vegetation.is_none() || found == vegetation) {
                    sought.push(y * width + x);
                }
                let corner = (y + margin) * stride + margin + x + 1;
                let [water, lethal] = below[corner];
                below[corner + stride] = [water + counts.water, lethal + counts.lethal];
            }
            let last = (y + margin + 1) * stride + margin + width;
            let all = below[last];
            below[last..=last + margin].fill(all);
        }
        let last = (rows + margin) * stride;
        for row in 1..=margin {
            below.copy_within(last..last + stride, last + row * stride);
        }
        Self {
            first,
            width,
            rows,
            cell_m,
            columns,
            vegetation,
            sought,
            before,
            below,
            margin,
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

    pub(super) fn sought(&self) -> &[usize] {
        &self.sought
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
        let (width, rows) = (self.width, self.rows);
        let ys = y.saturating_sub(1)..(y + 2).min(rows);
        ys.flat_map(move |y| {
            let xs = x.saturating_sub(1)..(x + 2).min(width);
            xs.map(move |x| y * width + x)
        })
    }

    const fn stride(&self) -> usize {
        self.width + 1 + 2 * self.margin
    }

    /// Index of a column's lower corner for [`Self::water_and_lethal`].
    pub(super) const fn corner(&self, at: usize) -> usize {
        (at / self.width + self.margin) * self.stride() + at % self.width + self.margin
    }

    /// Corners of a box relative to that of its middle.
    pub(super) fn corners(&self, CellBox { x, y }: CellBox) -> [[isize; 2]; 2] {
        let stride = self.stride().cast_signed();
        y.map(|y| x.map(|x| y as isize * stride + x as isize))
    }

    /// Columns of clear water, and lethal ones, of the window in a box around a column.
    pub(super) fn water_and_lethal(&self, middle: usize, corners: [[isize; 2]; 2]) -> [u32; 2] {
        let before = |offset: isize| self.below[middle.wrapping_add_signed(offset)];
        let [[both, below], [left, all]] = corners.map(|row| row.map(before));
        [0, 1].map(|kind| all[kind] + both[kind] - left[kind] - below[kind])
    }

    /// Columns `from .. to` of a row, clipped to the window: the row, and from where to where in it.
    fn clipped(&self, y: isize, from: isize, to: isize) -> Option<[usize; 3]> {
        let within = |x: isize| x.max(0).cast_unsigned().min(self.width);
        let is_inside = y >= 0 && y.cast_unsigned() < self.rows;
        is_inside.then(|| {
            [
                y.cast_unsigned(),
                within(from),
                within(to).max(within(from)),
            ]
        })
    }

    /// Their indices.
    pub(super) fn row_span(&self, y: isize, from: isize, to: isize) -> Range<usize> {
        self.clipped(y, from, to).map_or(0..0, |[y, from, to]| {
            y * self.width + from..y * self.width + to
        })
    }

    /// What they are.
    pub(super) fn counts(&self, y: isize, from: isize, to: isize) -> Counts {
        let Some([y, from, to]) = self.clipped(y, from, to) else {
            return Counts::default();
        };
        // Each row has one count more than columns.
        let row = y * (self.width + 1);
        let (start, end) = (self.before[row + from], self.before[row + to]);
        let [water, moderate, lethal, land] =
            [0, 1, 2, 3].map(|kind: usize| u32::from(end[kind].wrapping_sub(start[kind])));
        Counts {
            water,
            moderate,
            lethal,
            land,
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
    fn add(&mut self, ground: Ground, rises_from_water: bool) {
        match ground {
            Ground::ClearWater => self.water += 1,
            Ground::Lethal => self.lethal += 1,
            Ground::Moderate => {
                self.moderate += 1;
                self.land += u32::from(rises_from_water);
            }
            Ground::Other => self.land += u32::from(rises_from_water),
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
    /// Steps to its farthest cell along an axis, and one more.
    pub(super) fn reach(self) -> usize {
        let ends = self.x.into_iter().chain(self.y);
        ends.map(|end| end.unsigned_abs() as usize)
            .max()
            .unwrap_or(0)
    }

    /// All cells that many steps away, also across corners.
    pub(super) const fn around(steps: i32) -> Self {
        Self {
            x: [-steps, steps + 1],
            y: [-steps, steps + 1],
        }
    }
}
