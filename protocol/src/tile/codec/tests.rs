//! Round trips, golden bytes and hostile bytes.

use proptest::prelude::*;

use super::*;
use crate::layer::LayerId;
use crate::tile::TileCells;

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
        let bands = Encoder::new().unwrap().encode(&cells);
        for band in &bands {
            prop_assert!(band.len() <= MAX_BAND_BYTES);
        }
        let decoded = Decoder::new().unwrap().decode(layer, &bands).unwrap();
        prop_assert_eq!(decoded.codes(), cells.codes());
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
        if let Ok(cells) = Decoder::new().unwrap().decode(layer, &[band]) {
            prop_assert_eq!(cells.check(layer), Ok(()));
        }
    }

    #[test]
    fn mutated_bytes_are_an_error_or_a_legal_tile(
        layer in prop::sample::select(LayerId::ALL.to_vec()),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut band = Encoder::new().unwrap().encode(&pattern(layer)).remove(0);
        for (place, byte) in edits {
            let place = place.index(band.len());
            band[place] = byte;
        }
        if let Some(cut) = cut {
            band.truncate(cut.index(band.len()));
        }
        if let Ok(cells) = Decoder::new().unwrap().decode(layer, &[band]) {
            prop_assert_eq!(cells.check(layer), Ok(()));
        }
    }
}

const GOLDEN: [(LayerId, &[u8]); 9] = [
    (
        LayerId::Occupancy,
        include_bytes!("../../../golden/tile_v1_occupancy.bin"),
    ),
    (
        LayerId::Elevation,
        include_bytes!("../../../golden/tile_v1_elevation.bin"),
    ),
    (
        LayerId::Obstacle,
        include_bytes!("../../../golden/tile_v1_obstacle.bin"),
    ),
    (
        LayerId::Cost,
        include_bytes!("../../../golden/tile_v1_cost.bin"),
    ),
    (
        LayerId::Rigidity,
        include_bytes!("../../../golden/tile_v1_rigidity.bin"),
    ),
    (
        LayerId::Shore,
        include_bytes!("../../../golden/tile_v1_shore.bin"),
    ),
    (
        LayerId::Intra,
        include_bytes!("../../../golden/tile_v1_intra.bin"),
    ),
    (
        LayerId::Inter,
        include_bytes!("../../../golden/tile_v1_inter.bin"),
    ),
    (
        LayerId::Depth,
        include_bytes!("../../../golden/tile_v1_depth.bin"),
    ),
];

/// Golden bytes must decode as long as format version 1 is read. If a new version of zstd encodes
/// differently, add its bytes and keep these for the decoder.
#[test]
fn golden_bytes() {
    let mut encoder = Encoder::new().unwrap();
    let mut decoder = Decoder::new().unwrap();
    for (layer, golden) in GOLDEN {
        let cells = pattern(layer);
        let decoded = decoder.decode(layer, &[golden]).unwrap();
        assert_eq!(
            decoded.codes(),
            cells.codes(),
            "{layer} decodes to other cells"
        );
        assert_eq!(
            encoder.encode(&cells),
            [golden],
            "{layer} encodes to other bytes"
        );
    }
}

#[test]
fn cells_that_do_not_compress_travel_in_two_bands_in_any_order() {
    let mut state = 1_u32;
    let noise = TileCells::from_fn(|_, _| {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        (state >> 16) as u16
    });
    let bands = Encoder::new().unwrap().encode(&noise);
    let lengths: Vec<usize> = bands.iter().map(Vec::len).collect();
    assert_eq!(lengths, [4100, 4100]);

    let mut decoder = Decoder::new().unwrap();
    let mut tile = PartialTile::new(LayerId::Elevation);
    decoder.decode_band(&bands[1], &mut tile).unwrap();
    assert!(!tile.is_complete());
    assert!(matches!(
        tile.clone().finish(),
        Err(DecodeError::Incomplete(32))
    ));
    let again = decoder.decode_band(&bands[1], &mut tile);
    assert!(matches!(again, Err(DecodeError::DuplicateRow(32))));
    decoder.decode_band(&bands[0], &mut tile).unwrap();
    assert_eq!(tile.finish().unwrap(), noise);
}

#[test]
fn each_fault_has_its_own_error() {
    let check = |band: &[u8], expected: &str| {
        let error = Decoder::new()
            .unwrap()
            .decode(LayerId::Occupancy, &[band])
            .unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    };
    check(&[], "0 bytes is shorter");
    check(&[1, 0, 64], "3 bytes is shorter");
    check(&[2], "version 2");
    check(&[2, 0, 64, 0, 9], "version 2");
    check(&[1, 0, 64, 3], "coding 3");
    check(&[1, 0, 0, 0], "0 rows from row 0");
    check(&[1, 60, 5, 0], "5 rows from row 60");
    check(&[1, 255, 255, 0], "255 rows from row 255");
    check(&[1, 0, 64, 1, 1, 2, 3], "does not decompress");
    check(&[1, 0, 64, 0, 1, 2, 3], "holds 3 bytes, its rows 8192");
    check(&vec![1; MAX_BAND_BYTES + 1], "longer than the 8064");
    let mut half = vec![1, 0, 1, 0];
    half.extend([0; 128]);
    check(&half, "63 of its 64 rows");

    let mut foreign = Encoder::new().unwrap().encode(&pattern(LayerId::Elevation));
    check(&foreign.remove(0), "does not use");
}

#[test]
fn a_decompression_bomb_stops_at_the_size_of_a_tile() {
    let bomb = zstd::bulk::compress(&vec![0; 50_000_000], 19).unwrap();
    assert!(bomb.len() < MAX_BAND_BYTES, "{}", bomb.len());
    let mut band = vec![FORMAT_VERSION, 0, 64, Coding::CodesZstd as u8];
    band.extend(bomb);
    let mut decoder = Decoder::new().unwrap();
    let error = decoder.decode(LayerId::Elevation, &[band]).unwrap_err();
    assert!(matches!(error, DecodeError::Zstd(_)), "{error}");

    let short = zstd::bulk::compress(&[0; 8190], 1).unwrap();
    let mut band = vec![FORMAT_VERSION, 0, 64, Coding::CodesZstd as u8];
    band.extend(short);
    let error = decoder.decode(LayerId::Elevation, &[band]).unwrap_err();
    assert!(error.to_string().contains("holds 8190 bytes"), "{error}");
}

#[test]
fn a_decoder_is_as_good_as_new_after_an_error() {
    let cells = pattern(LayerId::Cost);
    let bands = Encoder::new().unwrap().encode(&cells);
    let mut decoder = Decoder::new().unwrap();
    let mut torn = bands[0].clone();
    torn.truncate(torn.len() / 2);
    assert!(decoder.decode(LayerId::Cost, &[torn]).is_err());
    assert_eq!(decoder.decode(LayerId::Cost, &bands).unwrap(), cells);
}
