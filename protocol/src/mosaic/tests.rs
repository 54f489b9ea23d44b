use super::*;
use crate::layer::UNKNOWN;
use crate::tile::BootId;
use crate::tile_store::{LayerGrid, Publication};

/// A store with single elevation cells of 0.5 m at the given places.
fn store(cells: &[(i64, i64, f32)]) -> TileStore {
    let layer = LayerId::Elevation;
    let mut store = TileStore::new(BootId([1; 16]), 100);
    store.set_grid(LayerGrid { layer, cell_m: 0.5 }).unwrap();
    for &(x, y, height_m) in cells {
        let key = TileKey::of_cell(layer, x, y).unwrap();
        let mut tile = store
            .tile(key)
            .map_or_else(TileCells::unknown, |tile| tile.cells);
        let index = (y.rem_euclid(64) * 64 + x.rem_euclid(64)) as usize;
        tile.codes_mut()[index] = layer.quantisation().encode(height_m);
        let published = store.publish(key, tile).unwrap();
        assert_ne!(published, Publication::Unchanged);
    }
    store
}

#[test]
fn raster_is_bounding_box_of_known_cells() {
    let store = store(&[(-3, 70, 1.0), (5, -1, -2.0), (66, 2, 0.5)]);
    let raster = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS)
        .unwrap()
        .unwrap();
    assert_eq!(raster.first_cell(), (-3, -1));
    assert_eq!((raster.width(), raster.height()), (70, 72));
    assert_eq!(raster.corners_m(), ([-1.5, -0.5], [33.5, 35.5]));
    assert_eq!(raster.known_codes().count(), 3);
    let mut row = vec![7; 500];
    raster.read_row(0, &mut row);
    let known = |row: &[u16]| {
        let known = row.iter().enumerate().filter(|(_, code)| **code != UNKNOWN);
        known.map(|(column, _)| column).collect::<Vec<_>>()
    };
    assert_eq!((row.len(), known(&row)), (70, vec![8]));
    raster.read_row(3, &mut row);
    assert_eq!((row.len(), known(&row)), (70, vec![69]));
    raster.read_row(4, &mut row);
    assert_eq!(known(&row), [0; 0]);
    raster.read_row(71, &mut row);
    assert_eq!(known(&row), [0]);
    assert_eq!(raster.value_at(-1.3, 35.2), Some(1.0));
    assert_eq!(
        raster.value_at(2.5, -0.5),
        Some(-2.0),
        "lower edge belongs to the cell"
    );
    assert_eq!(raster.value_at(2.5, 0.0), None, "upper edge to the next");
    assert_eq!(raster.value_at(33.49, 1.49), Some(0.5));
    assert_eq!(raster.value_at(33.5, 1.4), None);
    assert_eq!(raster.value_at(f64::NAN, 0.0), None);
}

#[test]
fn one_cell_is_a_raster_and_none_is_not() {
    let layer = LayerId::Elevation;
    let one = Raster::of_layer(&store(&[(-65, 63, 0.0)]), layer, 1)
        .unwrap()
        .unwrap();
    assert_eq!(
        (one.width(), one.height(), one.first_cell()),
        (1, 1, (-65, 63))
    );
    assert_eq!(one.known_codes().collect::<Vec<_>>(), [32768]);
    assert_eq!(Raster::of_layer(&store(&[]), layer, 1), Ok(None));
    assert_eq!(
        Raster::of_layer(&store(&[]), LayerId::Shore, 1),
        Err(MosaicError::NoGrid(LayerId::Shore))
    );
}

#[test]
fn a_raster_too_large_is_refused_with_its_size() {
    let far = i64::from(i32::MAX) * 64;
    let store = store(&[(-far, -far, 0.0), (far, far, 0.0)]);
    let error = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS).unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("274877906817×274877906817 cells"),
        "{message}"
    );
}

#[test]
fn too_long_narrow_rasters_are_refused() {
    let side = MAX_RASTER_SIDE.cast_signed();
    let spanned = |first: i64, last: i64| {
        let store = store(&[(0, first, 0.0), (0, last, 0.0)]);
        let raster = Raster::of_layer(&store, LayerId::Elevation, MAX_RASTER_CELLS);
        raster.map(|raster| raster.unwrap().height())
    };
    assert_eq!(spanned(-5, side - 6), Ok(1 << 20));
    let error = spanned(-5, side - 5).unwrap_err().to_string();
    assert!(error.contains("1×1048577 cells"), "{error}");
    assert!(error.contains("use larger cells"), "{error}");
}

#[test]
fn a_raster_is_what_the_store_was_when_it_was_taken() {
    let layer = LayerId::Elevation;
    let mut store = store(&[(0, 0, 1.0)]);
    let known = KnownTiles::of_layer(&store, layer).unwrap();
    let key = TileKey::of_cell(layer, 0, 0).unwrap();
    let code = layer.quantisation().encode(2.0);
    let newer = TileCells::from_fn(|_, _| code);
    assert_ne!(store.publish(key, newer).unwrap(), Publication::Unchanged);
    let before = known.into_raster(MAX_RASTER_CELLS).unwrap().unwrap();
    let after = Raster::of_layer(&store, layer, MAX_RASTER_CELLS)
        .unwrap()
        .unwrap();
    assert_eq!((before.width(), before.value_at(0.1, 0.1)), (1, Some(1.0)));
    assert_eq!((after.width(), after.value_at(0.1, 0.1)), (64, Some(2.0)));
}
