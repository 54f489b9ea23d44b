use protocol::tile::{BootId, TileKey};
use protocol::tile_store::{LayerGrid, TileStore};

use super::*;
use crate::publishing::cells_to_tiles::tile_of;

/// A raster from cell (0, 0), for which there are tiles.
fn raster(layer: LayerId, tiles: (i32, i32), code: impl Fn(usize, usize) -> u16) -> Raster {
    let mut store = TileStore::new(BootId([1; 16]), 1000);
    store.set_grid(LayerGrid { layer, cell_m: 0.5 }).unwrap();
    for (ty, tx) in (0..tiles.1).flat_map(|ty| (0..tiles.0).map(move |tx| (ty, tx))) {
        let cells = tile_of(|x, y| code(64 * tx as usize + x, 64 * ty as usize + y));
        assert!(store.publish(TileKey { layer, tx, ty }, cells).is_ok());
    }
    let raster = Raster::of_layer(&store, layer, MAX_RASTER_CELLS);
    raster.unwrap().unwrap()
}

#[test]
fn grid_has_its_values_in_rows_from_the_least_y() {
    let layer = LayerId::Elevation;
    let raster = raster(layer, (1, 1), |x, y| match (x, y) {
        (10, 20) => 32768 + 200,
        (12, 23) => 32768 - 100,
        _ => 0,
    });
    let stamp = RobotTime::from_nanos(1_700_000_000_250_000_000);
    let message = grid(stamp, &raster);
    let time = message.timestamp.unwrap();
    assert_eq!((time.sec(), time.nsec()), (1_700_000_000, 250_000_000));
    let at = message.pose.unwrap().position.unwrap();
    assert_eq!(
        [at.x, at.y, at.z].map(f64::to_bits),
        [5.0, 10.0, 0.0].map(f64::to_bits)
    );
    assert_eq!((message.column_count, message.row_stride), (3, 24));
    let cells: Vec<(f32, [u8; 4])> = message
        .data
        .chunks(8)
        .map(|cell| {
            let value = f32::from_le_bytes(cell[..4].try_into().unwrap());
            (value, cell[4..].try_into().unwrap())
        })
        .collect();
    assert_eq!(cells.len(), 12);
    let palette = palette_for(&raster);
    assert_eq!(cells[0], (1.0, palette.color(32768 + 200)));
    assert_eq!(cells[11], (-0.5, palette.color(32768 - 100)));
    let is_unknown = |(value, color): &(f32, [u8; 4])| value.is_nan() && color[3] == 0;
    assert!(cells[1..11].iter().all(is_unknown));
}

#[test]
fn large_map_is_coarser_and_stays_in_place() {
    // 2112 × 2048 cells: more than a message holds. One of them is occupied.
    let layer = LayerId::Occupancy;
    let raster = raster(
        layer,
        (33, 32),
        |x, y| if (x, y) == (100, 7) { 240 } else { 10 },
    );
    let message = grid(RobotTime::from_nanos(-5), &raster);
    assert_eq!(message.timestamp.unwrap().nsec(), 0);
    assert_eq!(message.column_count, 1056);
    let cell = message.cell_size.unwrap();
    assert_eq!(
        [cell.x, cell.y].map(f64::to_bits),
        [1.0_f64, 1.0].map(f64::to_bits)
    );
    let value = |column: usize, row: usize| {
        let at = row * message.row_stride as usize + 8 * column;
        f32::from_le_bytes(message.data[at..at + 4].try_into().unwrap())
    };
    let decode = |code| layer.quantisation().decode(code).unwrap();
    assert_eq!(value(50, 3).to_bits(), decode(240).to_bits());
    assert_eq!(value(51, 3).to_bits(), decode(10).to_bits());
    assert_eq!(message.data.len(), 8 * 1056 * 1024);
}
