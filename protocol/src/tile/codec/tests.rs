//! Round trips, golden bytes and hostile bytes.

use proptest::prelude::*;

use super::*;
use crate::layer::LayerId;
use crate::tile::{TILE_CELLS, TileCells};

/// A deterministic tile of `layer`: a wall, an unknown part, and typical values of the layer.
fn pattern(layer: LayerId) -> TileCells {
    TileCells::from_fn(|x, y| {
        let wall = x == 20 || (y == 41 && x > 20);
        let speckle = ((x * 7) ^ (y * 13)) % 11 == 0;
        if (x + y / 3) % 64 > 50 {
            return 0;
        }
        match layer {
            LayerId::Occupancy if wall => 246,
            LayerId::Occupancy if speckle => 24 + (x as u16 % 5) * 40,
            LayerId::Occupancy => 6,
            LayerId::Elevation => 32768 + (x * x / 40) as u16 + 300 * u16::from(wall),
            LayerId::Obstacle => 1 + u16::from(wall || speckle),
            LayerId::Cost => 1 + (y as u16) * 3,
            LayerId::Rigidity => 1 + u16::from((x / 16 + y / 16) % 2 == 0),
            LayerId::Shore => 1 + (x as u16 / 8) % 4,
            LayerId::Intra => {
                if wall {
                    251
                } else {
                    1 + (x as u16 * 5) % 40
                }
            }
            LayerId::Depth => 301 + (x * x / 10) as u16 - 250 * u16::from(wall),
            LayerId::Inter => {
                if wall {
                    1
                } else {
                    251 - (y as u16 * 7) % 60
                }
            }
        }
    })
}

fn any_code(layer: LayerId) -> BoxedStrategy<u16> {
    let max = (0..=u16::MAX)
        .rev()
        .find(|&code| layer.quantisation().is_code(code))
        .unwrap_or_default();
    prop_oneof![Just(0), Just(max), 0..=max].boxed()
}

fn any_tile() -> impl Strategy<Value = (LayerId, TileCells)> {
    prop::sample::select(LayerId::ALL.to_vec()).prop_flat_map(|layer| {
        prop::collection::vec(any_code(layer), TILE_CELLS)
            .prop_map(move |codes| (layer, TileCells::from_fn(|x, y| codes[y * TILE_SIDE + x])))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_tile_of_every_layer_survives((layer, cells) in any_tile()) {
        let bands = encode(layer, &cells);
        for band in &bands {
            prop_assert!(band.len() <= MAX_BAND_BYTES);
        }
        let decoded = decode(layer, &bands, None).unwrap();
        prop_assert_eq!(decoded.codes(), cells.codes());
    }

    #[test]
    fn differences_to_any_tile_make_the_tile(
        (layer, cells) in any_tile(),
        kept in prop::collection::vec(any::<bool>(), TILE_CELLS),
        is_base_known in any::<bool>(),
    ) {
        let other = if is_base_known { pattern(layer) } else { TileCells::unknown() };
        let base = TileCells::from_fn(|x, y| {
            let of = if kept[y * TILE_SIDE + x] { &cells } else { &other };
            of.codes()[y * TILE_SIDE + x]
        });
        if let Some(band) = encode_differences(layer, &cells, &base) {
            prop_assert!(band.len() <= MAX_BAND_BYTES);
            let decoded = decode(layer, &[&band], Some(&base)).unwrap();
            prop_assert_eq!(decoded.codes(), cells.codes());
            prop_assert!(matches!(decode(layer, &[&band], None), Err(DecodeError::NoBase)));
        }
    }

    #[test]
    fn random_bytes_are_an_error_or_a_legal_tile(
        layer in prop::sample::select(LayerId::ALL.to_vec()),
        first in prop_oneof![Just(0_u8), any::<u8>()],
        count in prop_oneof![Just(64_u8), any::<u8>()],
        coding in 0_u8..4,
        payload in prop::collection::vec(any::<u8>(), 0..9000),
    ) {
        let mut band = vec![FORMAT_VERSION, first, count, coding];
        band.extend(payload);
        if let Ok(cells) = decode(layer, &[band], Some(&pattern(layer))) {
            prop_assert_eq!(cells.check(layer), Ok(()));
        }
    }

    #[test]
    fn mutated_bytes_are_an_error_or_a_legal_tile(
        layer in prop::sample::select(LayerId::ALL.to_vec()),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut band = encode(layer, &pattern(layer)).remove(0);
        for (place, byte) in edits {
            let place = place.index(band.len());
            band[place] = byte;
        }
        if let Some(cut) = cut {
            band.truncate(cut.index(band.len()));
        }
        if let Ok(cells) = decode(layer, &[band], Some(&pattern(layer))) {
            prop_assert_eq!(cells.check(layer), Ok(()));
        }
    }
}

/// Length and BLAKE3 of the bands: bytes of any version must be those of this one.
#[test]
fn bytes_are_the_same_everywhere() {
    let mut hasher = blake3::Hasher::new();
    let mut lengths = Vec::new();
    for layer in LayerId::ALL {
        let cells = pattern(layer);
        let mut base = cells.clone();
        for (place, code) in base.codes_mut().iter_mut().enumerate() {
            *code = if place % 40 < 5 { 1 } else { *code };
        }
        let bands = [
            encode(layer, &cells).remove(0),
            encode_differences(layer, &cells, &base).unwrap(),
        ];
        for band in &bands {
            hasher.update(band);
        }
        lengths.push(bands.map(|band| band.len()));
    }
    assert_eq!(
        format!("{lengths:?}"),
        "[[375, 207], [136, 686], [284, 101], [51, 245], [57, 105], [53, 122], [112, 180], [109, 229], [155, 515]]"
    );
    assert_eq!(
        hasher.finalize().to_hex().as_str(),
        "e017e9fb9c6d53cd7b3cd1aaa0bdd2c3b4bad5aa78d9326364a2be45a1267111"
    );
}

#[test]
fn cells_that_do_not_compress_travel_in_two_bands_in_any_order() {
    let mut state = 1_u32;
    let noise = TileCells::from_fn(|_, _| {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        (state >> 16) as u16
    });
    let bands = encode(LayerId::Elevation, &noise);
    let lengths: Vec<usize> = bands.iter().map(Vec::len).collect();
    assert_eq!(lengths, [4100, 4100]);

    let mut tile = PartialTile::new(LayerId::Elevation);
    tile.add_band(&bands[1], None).unwrap();
    assert!(!tile.is_complete());
    assert!(matches!(
        tile.clone().finish(),
        Err(DecodeError::Incomplete(32))
    ));
    let again = tile.add_band(&bands[1], None);
    assert!(matches!(again, Err(DecodeError::DuplicateRow(32))));
    tile.add_band(&bands[0], None).unwrap();
    assert_eq!(tile.finish().unwrap(), noise);
}

#[test]
fn each_fault_has_its_own_error() {
    let check = |band: &[u8], expected: &str| {
        let error = decode(LayerId::Occupancy, &[band], None).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    };
    check(&[], "0 bytes is shorter");
    check(&[2, 0, 64], "3 bytes is shorter");
    check(&[1], "version 1");
    check(&[1, 0, 64, 0, 9], "version 1");
    check(&[2, 0, 64, 3], "coding 3");
    check(&[2, 0, 0, 0], "0 rows from row 0");
    check(&[2, 60, 5, 0], "5 rows from row 60");
    check(&[2, 255, 255, 0], "255 rows from row 255");
    check(&[2, 0, 63, 1, 1, 2, 3], "63 modelled rows");
    check(&[2, 0, 64, 2, 1, 2, 3], "ask for the tile");
    check(&[2, 0, 64, 0, 1, 2, 3], "holds 3 bytes, its rows 8192");
    check(&vec![2; MAX_BAND_BYTES + 1], "longer than the 8064");
    let mut half = vec![2, 0, 1, 0];
    half.extend([0; 128]);
    check(&half, "63 of its 64 rows");
    let mut longer = encode(LayerId::Occupancy, &pattern(LayerId::Occupancy)).remove(0);
    longer.extend([0; 9]);
    check(&longer, "bytes more than its cells need");

    let beyond = TileCells::from_fn(|_, _| 252);
    let mut foreign = encode(LayerId::Occupancy, &beyond);
    check(&foreign.remove(0), "does not use");
}
