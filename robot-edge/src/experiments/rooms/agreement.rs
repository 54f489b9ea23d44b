//! Map and truth, cell by cell.

use crate::experiments::outcome::Table;
use crate::experiments::published::known_cells;
use crate::simulation::truth::{CellKind, TruthCell, TruthGrid};
use protocol::export::Trinary;
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

/// The truth of a world, and how well a laser could see it.
pub(in crate::experiments) struct Truth {
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
pub(in crate::experiments) enum Asked {
    /// No surface passes within the scatter of it (`d > c/√2 + scatter`), and it is outside all solids.
    Free,
    /// A surface passes so near its centre (`d ≤ c/2 − scatter`) that readings of it stay within.
    Occupied,
    /// As far from every surface as [`Asked::Free`], but inside a solid: no beam ends or passes there.
    Nothing,
    /// All others: cells at edges, which are left out of every comparison.
    Edge,
}

/// How many cells of a map are what, by what is asked of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::experiments) struct Confusion {
    counts: [[u64; 3]; 4],
}

/// One known cell of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::experiments) struct KnownCell {
    pub(in crate::experiments) index: [i64; 2],
    /// What is truly there.
    pub(in crate::experiments) truth: TruthCell,
    pub(in crate::experiments) asked: Asked,
    /// What the map says, as exports and `--summary` do.
    pub(in crate::experiments) map: Trinary,
}

impl Truth {
    /// `range_noise_m`: standard deviation of a range.
    pub(in crate::experiments) fn new(grid: TruthGrid, range_noise_m: f64) -> Self {
        Self {
            grid,
            scatter_m: 3.0 * range_noise_m,
        }
    }

    /// What is truly there.
    pub(in crate::experiments) fn grid(&self) -> &TruthGrid {
        &self.grid
    }

    /// What the truth asks of a cell.
    pub(in crate::experiments) fn asked(&self, cell: TruthCell) -> Asked {
        let clear_m = self.grid.cell_m() * std::f64::consts::FRAC_1_SQRT_2 + self.scatter_m;
        match cell.kind {
            CellKind::Free if cell.surface_distance_m > clear_m => Asked::Free,
            CellKind::Occupied if cell.surface_distance_m <= self.near_m() => Asked::Occupied,
            CellKind::Inside if cell.surface_distance_m > clear_m => Asked::Nothing,
            CellKind::Free | CellKind::Occupied | CellKind::Inside => Asked::Edge,
        }
    }

    /// Readings of a surface at most this far from a cell's centre stay within the cell, metres.
    pub(in crate::experiments) fn near_m(&self) -> f64 {
        // Walls are placed to the centimetre, so that many lie exactly at the limit.
        0.5 * self.grid.cell_m() - self.scatter_m + 1e-9
    }

    /// Centre of a cell in the world, metres.
    pub(in crate::experiments) fn centre_m(&self, index: [i64; 2]) -> [f64; 2] {
        index.map(|i| (i as f64 + 0.5) * self.grid.cell_m())
    }

    /// Every cell of which the published map knows something; those beyond the truth, which no laser of its
    /// world reaches, are left out.
    pub(in crate::experiments) fn known_cells(
        &self,
        store: &TileStore,
    ) -> impl Iterator<Item = KnownCell> {
        let quantisation = LayerId::Occupancy.quantisation();
        let cells = known_cells(store, LayerId::Occupancy);
        cells.filter_map(move |(index, code)| {
            let probability = quantisation.decode(code)?;
            let truth = self.grid.get(index)?;
            Some(KnownCell {
                index,
                truth,
                asked: self.asked(truth),
                map: Trinary::of(probability),
            })
        })
    }

    /// Compares the published map with the truth.
    pub(in crate::experiments) fn compare(&self, store: &TileStore) -> Confusion {
        let mut confusion = Confusion::default();
        for cell in self.known_cells(store) {
            confusion.counts[cell.asked as usize][cell.map as usize] += 1;
        }
        confusion
    }
}

impl Confusion {
    pub(in crate::experiments) fn count(&self, asked: Asked, map: Trinary) -> u64 {
        self.counts[asked as usize][map as usize]
    }

    /// Share of the decided cells that are to be free and are.
    pub(in crate::experiments) fn free_agreement(&self) -> f64 {
        let right = self.count(Asked::Free, Trinary::Free);
        share(right, right + self.count(Asked::Free, Trinary::Occupied))
    }

    /// Share of the decided cells that are to be occupied and are.
    pub(in crate::experiments) fn occupied_agreement(&self) -> f64 {
        let right = self.count(Asked::Occupied, Trinary::Occupied);
        share(right, right + self.count(Asked::Occupied, Trinary::Free))
    }

    /// Share of the decided cells of both kinds that are as asked.
    pub(in crate::experiments) fn agreement(&self) -> f64 {
        let [right, wrong] = [
            (Trinary::Free, Trinary::Occupied),
            (Trinary::Occupied, Trinary::Free),
        ]
        .map(|(free, occupied)| {
            self.count(Asked::Free, free) + self.count(Asked::Occupied, occupied)
        });
        share(right, right + wrong)
    }

    /// How many decided cells are compared: those to be free and those to be occupied.
    pub(in crate::experiments) fn compared(&self) -> (u64, u64) {
        let decided =
            |asked| self.count(asked, Trinary::Free) + self.count(asked, Trinary::Occupied);
        (decided(Asked::Free), decided(Asked::Occupied))
    }

    /// Cells that are to be occupied and are not: free or undecided.
    pub(in crate::experiments) fn surfaces_missed(&self) -> u64 {
        self.count(Asked::Occupied, Trinary::Free) + self.count(Asked::Occupied, Trinary::Undecided)
    }

    /// Known cells that are left out because of where they lie.
    pub(in crate::experiments) fn left_out(&self) -> u64 {
        self.counts[Asked::Edge as usize].iter().sum()
    }

    /// Cells that a comparison could count, were they decided.
    pub(in crate::experiments) fn undecided(&self) -> u64 {
        self.count(Asked::Free, Trinary::Undecided)
            + self.count(Asked::Occupied, Trinary::Undecided)
    }
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole as f64
}

impl Confusion {
    /// Cells by what the truth asks and what the map says.
    pub(in crate::experiments) fn table(&self) -> Table {
        let mut table = Table::new(&[
            "the truth asks for",
            "map: free",
            "map: occupied",
            "map: undecided",
        ]);
        for (asked, name) in [
            (Asked::Free, "free"),
            (Asked::Occupied, "occupied"),
            (Asked::Nothing, "nothing (inside a solid)"),
            (Asked::Edge, "either (left out: at an edge)"),
        ] {
            let [free, occupied, undecided] =
                [Trinary::Free, Trinary::Occupied, Trinary::Undecided]
                    .map(|map| self.count(asked, map).to_string());
            table.push([name.to_owned(), free, occupied, undecided]);
        }
        table
    }
}
