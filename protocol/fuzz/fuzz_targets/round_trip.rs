//! Any cells → bands → the same cells, and bands within their limit; also as differences.
//!
//! Input: a byte that says which layer; one that says how many rows are noise, which does not compress; then
//! runs of cells, each a byte for its length and two for its code, over and over until the tile is full.
#![no_main]

use libfuzzer_sys::fuzz_target;
use protocol::layer::LayerId;
use protocol::tile::codec::{MAX_BAND_BYTES, decode, encode, encode_differences};
use protocol::tile::{TILE_SIDE, TileCells};

fuzz_target!(|input: &[u8]| {
    let &[layer, noisy_rows, ref runs @ ..] = input else {
        return;
    };
    let runs = runs.as_chunks::<3>().0;
    if runs.is_empty() {
        return;
    }
    let layer = LayerId::ALL[usize::from(layer) % LayerId::ALL.len()];
    let greatest = match layer {
        LayerId::Elevation | LayerId::Depth => u16::MAX,
        LayerId::Occupancy | LayerId::Cost | LayerId::Intra | LayerId::Inter => 251,
        LayerId::Obstacle | LayerId::Rigidity => 2,
        LayerId::Shore => 4,
    };
    let mut cells = TileCells::unknown();
    let mut empty = &mut cells.codes_mut()[..];
    for &[length, low, high] in runs.iter().cycle() {
        let length = (1 + usize::from(length)).min(empty.len());
        let (run, behind) = empty.split_at_mut(length);
        let code = u16::from_le_bytes([low, high]);
        run.fill(if code <= greatest {
            code
        } else {
            code % (greatest + 1)
        });
        empty = behind;
        if empty.is_empty() {
            break;
        }
    }
    let noisy_cells = TILE_SIDE * usize::from(noisy_rows).min(TILE_SIDE);
    let mut state = u32::from(noisy_rows);
    for code in &mut cells.codes_mut()[..noisy_cells] {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        *code = ((state >> 16) % (u32::from(greatest) + 1)) as u16;
    }
    assert_eq!(cells.check(layer), Ok(()));
    let bands = encode(layer, &cells);
    assert!(matches!(bands.len(), 1 | 2));
    assert!(bands.iter().all(|band| band.len() <= MAX_BAND_BYTES));
    let decoded = decode(layer, &bands, None).unwrap();
    assert!(decoded == cells, "{layer}: other cells");
    // The tile as it is, after one with other runs.
    let mut base = cells.clone();
    base.codes_mut().rotate_left(runs.len());
    if let Some(band) = encode_differences(layer, &cells, &base) {
        assert!(band.len() <= MAX_BAND_BYTES);
        let decoded = decode(layer, &[band], Some(&base)).unwrap();
        assert!(decoded == cells, "{layer}: other cells after differences");
    }
});
