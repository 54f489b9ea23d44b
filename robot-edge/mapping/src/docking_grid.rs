//! The columns among which docking sites are sought, and how many of a kind lie in a stretch of a row.

use nalgebra::Point2;

use super::grid::CellIndex;

/// What is known of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DockingColumn {
    /// Its slope cost, 0 to 1, taken with the critical slope for docking; NaN where unknown.
    pub cost: f32,
    /// Water without an obstacle.
    pub is_clear_water: bool,
    /// What was hit there is higher than the water: of a shoal nothing is.
    pub rises_from_water: bool,
}

/// A rectangle of columns.
#[derive(Debug)]
pub struct DockingGrid<'a> {
    first: CellIndex,
    width: usize,
    cell_m: f64,
    columns: &'a [DockingColumn],
    /// How many columns of each kind are before each column of its row; one more a row than its columns.
    before: Vec<Counts>,
}

/// What a column is to a boat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ground {
    ClearWater,
    /// Cost above 0 and below 1.
    Moderate,
    Lethal,
    /// Unknown, or level land.
    Other,
}

/// How many columns of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) water: u32,
    pub(super) moderate: u32,
    pub(super) lethal: u32,
    /// Out of the water and not lethal, moderate or level.
    pub(super) land: u32,
}

impl<'a> DockingGrid<'a> {
    /// `columns` row by row, y upwards, `width` in a row, that of the least x and y standing in cell `first`;
    /// an unfinished last row is left out.
    pub fn new(first: CellIndex, width: usize, cell_m: f64, columns: &'a [DockingColumn]) -> Self {
        let rows = columns.len().checked_div(width).unwrap_or(0);
        let columns = &columns[..rows * width];
        let mut before = Vec::with_capacity(rows * (width + 1));
        for row in columns.chunks_exact(width.max(1)) {
            let mut counts = Counts::default();
            before.push(counts);
            for column in row {
                counts.add(*column);
                before.push(counts);
            }
        }
        Self {
            first,
            width,
            cell_m,
            columns,
            before,
        }
    }

    pub(super) const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    pub(super) const fn columns(&self) -> &[DockingColumn] {
        self.columns
    }

    pub(super) fn ground(&self, at: usize) -> Ground {
        Ground::of(self.columns[at])
    }

    pub(super) const fn width(&self) -> usize {
        self.width
    }

    fn rows(&self) -> usize {
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

    /// The centre of a column, metres in `odom`.
    pub(super) fn centre(&self, at: usize) -> Point2<f64> {
        self.cell(at).centre(self.cell_m)
    }

    /// The columns that touch one, also at corners.
    pub(super) fn neighbours(&self, at: usize) -> impl Iterator<Item = usize> + use<> {
        let (x, y) = (at % self.width, at / self.width);
        let (width, rows) = (self.width, self.rows());
        let ys = y.saturating_sub(1)..(y + 2).min(rows);
        ys.flat_map(move |y| {
            let xs = x.saturating_sub(1)..(x + 2).min(width);
            xs.map(move |x| y * width + x)
        })
    }

    /// How far each column is from the nearest one of a kind, in steps to columns that touch also at corners.
    pub(super) fn steps_to(&self, ground: Ground) -> Vec<u32> {
        let start = |column: &DockingColumn| {
            let is_there = Ground::of(*column) == ground;
            if is_there { 0 } else { u32::MAX }
        };
        let mut steps: Vec<u32> = self.columns.iter().map(start).collect();
        // Whatever way is shortest, one of two passes, along the rows and back, goes its every step after the
        // one before.
        let mut pass = |at: usize| {
            let least = self.neighbours(at).map(|beside| steps[beside]).min();
            let over_there = least.map_or(u32::MAX, |steps| steps.saturating_add(1));
            steps[at] = steps[at].min(over_there);
        };
        (0..self.columns.len()).for_each(&mut pass);
        (0..self.columns.len()).rev().for_each(&mut pass);
        steps
    }

    /// Where columns `from` to `to` of a row stand, as far as the window reaches; empty where it does not.
    pub(super) fn row_span(&self, y: isize, from: isize, to: isize) -> std::ops::Range<usize> {
        if y < 0 || y.cast_unsigned() >= self.rows() {
            return 0..0;
        }
        let within = |x: isize| x.max(0).cast_unsigned().min(self.width);
        let row = y.cast_unsigned() * self.width;
        let from = within(from);
        row + from..row + within(to).max(from)
    }

    /// What stands in a stretch.
    pub(super) fn counts(&self, row_span: std::ops::Range<usize>) -> Counts {
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
    fn of(column: DockingColumn) -> Self {
        if column.is_clear_water {
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
    fn add(&mut self, column: DockingColumn) {
        match Ground::of(column) {
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
