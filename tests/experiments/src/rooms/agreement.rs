//! Map and truth, cell by cell.

use crate::outcome::Table;
use crate::published::known_cells;
use protocol::export::Trinary;
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;
use simulation::truth::{CellKind, TruthCell, TruthGrid};

/// The truth of a world, and how well a laser could see it.
pub(crate) struct Truth {
    grid: TruthGrid,
    /// Three standard deviations of a range: readings scatter this far about a surface.
    scatter_m: f64,
}

/// What the truth asks of a cell.
///
/// A surface that passes within the scatter of an edge between two cells marks either or both of them,
/// however good the map: what such cells hold says where a wall lies in its cell, not whether the map is
/// right. So a cell is asked only where all readings, scatter included, must fall on one side. With the
/// distance `d` from the cell's centre to the nearest surface and cells of side `c`:
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Expected {
    /// No surface passes within the scatter of it (`d > c/√2 + scatter`), and it is outside all solids.
    Free,
    /// A surface passes so near its centre (`d ≤ c/2 − scatter`) that readings of it stay within.
    Occupied,
    /// As far from every surface as [`Expected::Free`], but inside a solid: no beam ends or passes there.
    Unobservable,
    /// All others: cells at edges, which are left out of every comparison.
    Edge,
}

/// How many cells of a map are what, by what is asked of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Confusion {
    counts: [[u64; 3]; 4],
}

/// One known cell of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KnownCell {
    pub(crate) index: [i64; 2],
    /// What is truly there.
    pub(crate) truth: TruthCell,
    pub(crate) expected: Expected,
    /// What the map says, as exports and `--summary` do.
    pub(crate) map: Trinary,
}

impl Truth {
    /// `range_noise_m`: standard deviation of a range.
    pub(crate) fn new(grid: TruthGrid, range_noise_m: f64) -> Self {
        Self {
            grid,
            scatter_m: 3.0 * range_noise_m,
        }
    }

    /// What is truly there.
    pub(crate) fn grid(&self) -> &TruthGrid {
        &self.grid
    }

    /// What the truth asks of a cell.
    pub(crate) fn expected(&self, cell: TruthCell) -> Expected {
        let clear_m = self.grid.cell_m() * std::f64::consts::FRAC_1_SQRT_2 + self.scatter_m;
        match cell.kind {
            CellKind::Free if cell.surface_distance_m > clear_m => Expected::Free,
            CellKind::Occupied if cell.surface_distance_m <= self.near_m() => Expected::Occupied,
            CellKind::Inside if cell.surface_distance_m > clear_m => Expected::Unobservable,
            CellKind::Free | CellKind::Occupied | CellKind::Inside => Expected::Edge,
        }
    }

    /// Readings of a surface at most this far from a cell's centre stay within the cell, metres.
    pub(crate) fn near_m(&self) -> f64 {
        // Walls are placed to the centimetre, so that many lie exactly at the limit.
        0.5 * self.grid.cell_m() - self.scatter_m + 1e-9
    }

    /// Centre of a cell in the world, metres.
    pub(crate) fn centre_m(&self, index: [i64; 2]) -> [f64; 2] {
        index.map(|i| (i as f64 + 0.5) * self.grid.cell_m())
    }

    /// Every cell of which the published map knows something; those beyond the truth, which no laser of its
    /// world reaches, are left out.
    pub(crate) fn known_cells(&self, store: &TileStore) -> impl Iterator<Item = KnownCell> {
        let quantisation = LayerId::Occupancy.quantisation();
        let cells = known_cells(store, LayerId::Occupancy);
        cells.filter_map(move |(index, code)| {
            let probability = quantisation.decode(code)?;
            let truth = self.grid.get(index)?;
            Some(KnownCell {
                index,
                truth,
                expected: self.expected(truth),
                map: Trinary::of(probability),
            })
        })
    }

    /// Compares the published map with the truth.
    pub(crate) fn compare(&self, store: &TileStore) -> Confusion {
        let mut confusion = Confusion::default();
        for cell in self.known_cells(store) {
            confusion.counts[cell.expected as usize][cell.map as usize] += 1;
        }
        confusion
    }
}

impl Confusion {
    pub(crate) fn count(&self, expected: Expected, map: Trinary) -> u64 {
        self.counts[expected as usize][map as usize]
    }

    /// Share of the decided cells that are to be free and are.
    pub(crate) fn free_agreement(&self) -> f64 {
        let right = self.count(Expected::Free, Trinary::Free);
        share(right, right + self.count(Expected::Free, Trinary::Occupied))
    }

    /// Share of the decided cells that are to be occupied and are.
    pub(crate) fn occupied_agreement(&self) -> f64 {
        let right = self.count(Expected::Occupied, Trinary::Occupied);
        share(right, right + self.count(Expected::Occupied, Trinary::Free))
    }

    /// Share of the decided cells of both kinds that are as asked.
    pub(crate) fn agreement(&self) -> f64 {
        let [right, wrong] = [
            (Trinary::Free, Trinary::Occupied),
            (Trinary::Occupied, Trinary::Free),
        ]
        .map(|(free, occupied)| {
            self.count(Expected::Free, free) + self.count(Expected::Occupied, occupied)
        });
        share(right, right + wrong)
    }

    /// How many decided cells are compared: those to be free and those to be occupied.
    pub(crate) fn compared(&self) -> (u64, u64) {
        let decided = |expected| {
            self.count(expected, Trinary::Free) + self.count(expected, Trinary::Occupied)
        };
        (decided(Expected::Free), decided(Expected::Occupied))
    }

    /// Cells that are to be occupied and are not: free or undecided.
    pub(crate) fn surfaces_missed(&self) -> u64 {
        self.count(Expected::Occupied, Trinary::Free)
            + self.count(Expected::Occupied, Trinary::Undecided)
    }

    /// Known cells that are left out because of where they lie.
    pub(crate) fn left_out(&self) -> u64 {
        self.counts[Expected::Edge as usize].iter().sum()
    }

    /// Cells that a comparison could count, were they decided.
    pub(crate) fn undecided(&self) -> u64 {
        self.count(Expected::Free, Trinary::Undecided)
            + self.count(Expected::Occupied, Trinary::Undecided)
    }
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole as f64
}

impl Confusion {
    /// Cells by what the truth asks and what the map says.
    pub(crate) fn table(&self) -> Table {
        let mut table = Table::new(&[
            "the truth asks for",
            "map: free",
            "map: occupied",
            "map: undecided",
        ]);
        for (expected, name) in [
            (Expected::Free, "free"),
            (Expected::Occupied, "occupied"),
            (Expected::Unobservable, "nothing (inside a solid)"),
            (Expected::Edge, "either (left out: at an edge)"),
        ] {
            let [free, occupied, undecided] =
                [Trinary::Free, Trinary::Occupied, Trinary::Undecided]
                    .map(|map| self.count(expected, map).to_string());
            table.push([name.to_owned(), free, occupied, undecided]);
        }
        table
    }
}
