//! Map and truth, cell by cell.

use std::fmt;

use protocol::export::Trinary;
use protocol::layer::LayerId;
use protocol::tile::TILE_SIDE;
use protocol::tile_store::TileStore;
use robot_edge::simulation::truth::{CellKind, TruthCell, TruthGrid};

/// The truth of a world, and how well a laser could see it.
pub(super) struct Truth {
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
pub(super) enum Asked {
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
pub(super) struct Confusion {
    counts: [[u64; 3]; 4],
}

/// One known cell of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KnownCell {
    pub(super) index: [i64; 2],
    /// What is truly there.
    pub(super) truth: TruthCell,
    pub(super) asked: Asked,
    /// What the map says, as exports and `--summary` do.
    pub(super) map: Trinary,
}

impl Truth {
    /// `range_noise_m`: standard deviation of a range.
    pub(super) fn new(grid: TruthGrid, range_noise_m: f64) -> Self {
        Self {
            grid,
            scatter_m: 3.0 * range_noise_m,
        }
    }

    /// What is truly there.
    pub(super) fn grid(&self) -> &TruthGrid {
        &self.grid
    }

    /// What the truth asks of a cell.
    pub(super) fn asked(&self, cell: TruthCell) -> Asked {
        let clear_m = self.grid.cell_m() * std::f64::consts::FRAC_1_SQRT_2 + self.scatter_m;
        match cell.kind {
            CellKind::Free if cell.surface_distance_m > clear_m => Asked::Free,
            CellKind::Occupied if cell.surface_distance_m <= self.near_m() => Asked::Occupied,
            CellKind::Inside if cell.surface_distance_m > clear_m => Asked::Nothing,
            CellKind::Free | CellKind::Occupied | CellKind::Inside => Asked::Edge,
        }
    }

    /// Readings of a surface at most this far from a cell's centre stay within the cell, metres.
    pub(super) fn near_m(&self) -> f64 {
        // Walls are placed to the centimetre, so that many lie exactly at the limit.
        0.5 * self.grid.cell_m() - self.scatter_m + 1e-9
    }

    /// Centre of a cell in the world, metres.
    pub(super) fn centre_m(&self, index: [i64; 2]) -> [f64; 2] {
        index.map(|i| (i as f64 + 0.5) * self.grid.cell_m())
    }

    /// Every cell of which the published map knows something.
    pub(super) fn known_cells(&self, store: &TileStore) -> impl Iterator<Item = KnownCell> {
        let quantisation = LayerId::Occupancy.quantisation();
        let cells = store.tiles(LayerId::Occupancy).flat_map(|(key, stored)| {
            let (x, y) = key.first_cell();
            let rows = stored.cells().into_iter();
            rows.flat_map(|cells| cells.codes().chunks_exact(TILE_SIDE))
                .zip(y..)
                .flat_map(move |(row, y)| (x..).zip(row).map(move |(x, &code)| ([x, y], code)))
        });
        cells.filter_map(move |(index, code)| {
            let probability = quantisation.decode(code)?;
            let truth = self.grid.get(index).expect("the truth covers the map");
            Some(KnownCell {
                index,
                truth,
                asked: self.asked(truth),
                map: Trinary::of(probability),
            })
        })
    }

    /// Compares the published map with the truth.
    pub(super) fn compare(&self, store: &TileStore) -> Confusion {
        let mut confusion = Confusion::default();
        for cell in self.known_cells(store) {
            confusion.counts[cell.asked as usize][cell.map as usize] += 1;
        }
        confusion
    }
}

impl Confusion {
    pub(super) fn count(&self, asked: Asked, map: Trinary) -> u64 {
        self.counts[asked as usize][map as usize]
    }

    /// Share of the decided cells that are to be free and are.
    pub(super) fn free_agreement(&self) -> f64 {
        let right = self.count(Asked::Free, Trinary::Free);
        share(right, right + self.count(Asked::Free, Trinary::Occupied))
    }

    /// Share of the decided cells that are to be occupied and are.
    pub(super) fn occupied_agreement(&self) -> f64 {
        let right = self.count(Asked::Occupied, Trinary::Occupied);
        share(right, right + self.count(Asked::Occupied, Trinary::Free))
    }

    /// Share of the decided cells of both kinds that are as asked.
    pub(super) fn agreement(&self) -> f64 {
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
    pub(super) fn compared(&self) -> (u64, u64) {
        let decided =
            |asked| self.count(asked, Trinary::Free) + self.count(asked, Trinary::Occupied);
        (decided(Asked::Free), decided(Asked::Occupied))
    }

    /// Cells that are to be occupied and are not: free or undecided.
    pub(super) fn surfaces_missed(&self) -> u64 {
        self.count(Asked::Occupied, Trinary::Free) + self.count(Asked::Occupied, Trinary::Undecided)
    }

    /// Known cells that are left out because of where they lie.
    pub(super) fn left_out(&self) -> u64 {
        self.counts[Asked::Edge as usize].iter().sum()
    }

    /// Cells that a comparison could count, were they decided.
    pub(super) fn undecided(&self) -> u64 {
        self.count(Asked::Free, Trinary::Undecided)
            + self.count(Asked::Occupied, Trinary::Undecided)
    }
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole as f64
}

impl fmt::Display for Confusion {
    /// As a Markdown table.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "| the truth asks for | map: free | map: occupied | map: undecided |"
        )?;
        writeln!(f, "| --- | ---: | ---: | ---: |")?;
        let rows = [
            (Asked::Free, "free"),
            (Asked::Occupied, "occupied"),
            (Asked::Nothing, "nothing (inside a solid)"),
            (Asked::Edge, "either (left out: at an edge)"),
        ];
        for (asked, name) in rows {
            let [free, occupied, undecided] =
                [Trinary::Free, Trinary::Occupied, Trinary::Undecided]
                    .map(|map| self.count(asked, map));
            writeln!(f, "| {name} | {free} | {occupied} | {undecided} |")?;
        }
        Ok(())
    }
}
