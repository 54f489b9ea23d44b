//! Map cells become tiles, and shores those of the protocol, here and nowhere else.

use protocol::geodesy::GeodeticPoint;
use protocol::layer::{LayerId, Quantisation, UNKNOWN};
use protocol::message::{self, Shores};
use protocol::shores::convex_outline;
use protocol::tile::{TileCells, TileKey};

use mapping::cost_map::CostCell;
use mapping::docking::DockingSite;
use mapping::elevation::{CellClass, ElevationCell};
use mapping::grid::{CellIndex, GridTile, TILE_EDGE, TileIndex};
use mapping::occupancy_grid::LogOdds;
use mapping::rigidity::Rigidity;
use mapping::shore::{ShoreClass, ShoreCluster};
use mapping::shore_layer::{ShoreCell, ShoreLayer};

/// Turns cells of the mapping core into the codes that are published.
#[derive(Clone, Debug)]
pub struct CellCoder {
    /// Code of every log-odds value, indexed by its bits.
    occupancy: Box<[u16]>,
}

impl CellCoder {
    /// Builds the table: 65,536 logistic functions once, instead of one per cell and publication.
    pub fn new() -> Self {
        let quantisation = LayerId::Occupancy.quantisation();
        let code = |bits: u16| {
            let probability = LogOdds::from_steps(bits.cast_signed()).probability();
            probability.map_or(UNKNOWN, |p| quantisation.encode(p as f32))
        };
        Self {
            occupancy: (0..=u16::MAX).map(code).collect(),
        }
    }

    /// The code of a cell of the elevation map: its mean height.
    pub fn elevation(cell: &ElevationCell) -> u16 {
        let quantisation = LayerId::Elevation.quantisation();
        cell.mean_m()
            .map_or(UNKNOWN, |mean_m| quantisation.encode(mean_m))
    }

    pub const fn obstacle(class: CellClass) -> u16 {
        match class {
            CellClass::Unknown => UNKNOWN,
            CellClass::Free => 1,
            CellClass::Obstacle => 2,
        }
    }

    pub fn cost(cell: &CostCell) -> u16 {
        LayerId::Cost.quantisation().encode(cell.cost)
    }

    /// A cell with its code; both metrics have the same.
    pub fn metric((cell, value): (CellIndex, f32)) -> (CellIndex, u16) {
        (cell, LayerId::Intra.quantisation().encode(value))
    }

    pub fn depth(depth_m: f32) -> u16 {
        LayerId::Depth.quantisation().encode(depth_m)
    }

    pub const fn rigidity(rigidity: Rigidity) -> u16 {
        match rigidity {
            Rigidity::Unlabelled => UNKNOWN,
            Rigidity::Traversable => 1,
            Rigidity::Rigid => 2,
        }
    }

    pub const fn shore(cell: Option<ShoreCell>) -> u16 {
        match cell {
            None => UNKNOWN,
            Some(ShoreCell::Cluster(ShoreClass::Sparse)) => 1,
            Some(ShoreCell::Cluster(ShoreClass::Dense)) => 2,
            Some(ShoreCell::Cluster(ShoreClass::Solid)) => 3,
            Some(ShoreCell::DockingSite) => 4,
        }
    }

    pub fn occupancy(&self, tile: &GridTile<i16>) -> TileCells {
        let mut cells = TileCells::unknown();
        for (code, &steps) in cells.codes_mut().iter_mut().zip(tile.cells.iter()) {
            *code = self.occupancy[usize::from(steps.cast_unsigned())];
        }
        cells
    }
}

impl Default for CellCoder {
    fn default() -> Self {
        Self::new()
    }
}

// Tiles of the mapping core and of the wire are the same squares.
const _: () = assert!(TILE_EDGE == protocol::tile::TILE_SIDE);

/// Keeps what `before` knows where `cells` know nothing.
pub fn fill_unknown(cells: &mut TileCells, before: &TileCells) {
    for (code, &old) in cells.codes_mut().iter_mut().zip(before.codes()) {
        // Always stored, so that the compiler makes vectors of it.
        *code = if *code == UNKNOWN { old } else { *code };
    }
}

/// Sets the code of the cell at `place` (row by row) of a tile.
pub fn set_code(cells: &mut TileCells, place: usize, code: u16) {
    cells.codes_mut()[place] = code;
}

pub const fn key(layer: LayerId, index: TileIndex) -> TileKey {
    TileKey {
        layer,
        tx: index.x,
        ty: index.y,
    }
}

/// All that is known of shores, in cells of `cell_m`; `datum` is where on Earth `odom` is.
pub fn shores(layer: &ShoreLayer, cell_m: f64, datum: Option<GeodeticPoint>) -> Shores {
    let clusters = layer.clusters().map(cluster).collect();
    let sites = layer.docking_sites().iter().map(site).collect();
    Shores::gather(cell_m, datum, clusters, sites)
}

fn cluster(cluster: &ShoreCluster) -> message::ShoreCluster {
    message::ShoreCluster {
        number: cluster.number,
        class: shore_class(cluster.class),
        voxels: cluster.voxels,
        rigid_voxels: cluster.rigid_voxels,
        center_m: cluster
            .centre_in_odom
            .xy()
            .map(|metres| metres as f32)
            .into(),
        outline: convex_outline(cluster.columns.iter().map(|cell| (cell.x, cell.y))),
    }
}

const fn shore_class(class: ShoreClass) -> message::ShoreClass {
    match class {
        ShoreClass::Sparse => message::ShoreClass::Sparse,
        ShoreClass::Dense => message::ShoreClass::Dense,
        ShoreClass::Solid => message::ShoreClass::Solid,
    }
}

fn site(site: &DockingSite) -> message::DockingSite {
    message::DockingSite {
        number: site.number,
        center_m: site.centre_in_odom.map(|metres| metres as f32).into(),
        heading_rad: site.heading_rad as f32,
        width_m: site.width_m as f32,
        vegetation: site.vegetation.map(shore_class),
        price: site.price as f32,
        approach_m: site.approach_in_odom.map(|metres| metres as f32).into(),
    }
}

/// A change of a value by this part of its unit is visible: a probability by 0.1, a height by 0.1 m.
const VISIBLE_PART: u16 = 10;

/// The cells `after`, without those that only waver.
pub(super) fn with_visible_changes(
    layer: LayerId,
    before: &TileCells,
    after: &TileCells,
) -> TileCells {
    let step = match layer.quantisation() {
        Quantisation::Linear { steps_per_unit, .. } => steps_per_unit / VISIBLE_PART,
        Quantisation::Classes(_) => 1,
    };
    let mut cells = after.clone();
    for (code, &before) in cells.codes_mut().iter_mut().zip(before.codes()) {
        let is_visible = (*code == UNKNOWN) != (before == UNKNOWN) || code.abs_diff(before) >= step;
        // Always stored, so that the compiler makes vectors of it.
        *code = if is_visible { *code } else { before };
    }
    cells
}

#[cfg(test)]
pub(crate) fn uniform_tile(code: u16) -> TileCells {
    tile_of(|_, _| code)
}

#[cfg(test)]
pub(crate) fn tile_of(code: impl FnMut(usize, usize) -> u16) -> TileCells {
    TileCells::from_fn(code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapping::grid::TiledGrid;

    #[test]
    fn log_odds_become_probabilities_in_steps_of_a_250th() {
        let mut grid = TiledGrid::new(LogOdds::UNKNOWN.steps());
        let index = TileIndex { x: -3, y: 7 };
        let cells = grid.touch(index);
        for (cell, p) in cells.iter_mut().zip([0.5, 0.02, 0.3, 0.6, 0.98]) {
            *cell = LogOdds::from_probability(p).steps();
        }
        let codes = CellCoder::new().occupancy(grid.get(index).unwrap());
        assert_eq!(codes.codes()[..6], [126, 6, 76, 151, 246, 0]);
        assert_eq!(key(LayerId::Occupancy, index).first_cell(), (-192, 448));
    }

    #[test]
    fn what_was_known_stays_where_nothing_newer_is() {
        let mut cells = TileCells::from_fn(|x, y| if y == 0 { x as u16 % 3 } else { UNKNOWN });
        let before = TileCells::from_fn(|_, y| if y < 2 { 7 } else { UNKNOWN });
        fill_unknown(&mut cells, &before);
        assert_eq!(cells.codes()[..4], [7, 1, 2, 7]);
        assert_eq!(cells.codes()[64..67], [7, 7, 7]);
        assert_eq!(cells.known(), 128);
    }
}
