//! The known cells of a published layer.

use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::TILE_SIDE;
use protocol::tile_store::TileStore;

/// Index and code of every known cell of `layer`.
pub(super) fn known_cells(
    store: &TileStore,
    layer: LayerId,
) -> impl Iterator<Item = ([i64; 2], u16)> {
    let cells = store.tiles(layer).flat_map(|(key, stored)| {
        let (x, y) = key.first_cell();
        let rows = stored.cells().into_iter();
        rows.flat_map(|cells| cells.codes().chunks_exact(TILE_SIDE))
            .zip(y..)
            .flat_map(move |(row, y)| (x..).zip(row).map(move |(x, &code)| ([x, y], code)))
    });
    cells.filter(|(_, code)| *code != UNKNOWN)
}
