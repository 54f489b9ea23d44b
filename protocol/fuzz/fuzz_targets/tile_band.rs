//! Bands into a tile, as they come from the network: any bytes are an error or a legal tile.
//!
//! Input: a byte that says which layer; one whose every code the base has; then bands, each behind its length in two bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use protocol::layer::LayerId;
use protocol::tile::TileCells;
use protocol::tile::codec::{PartialTile, decode};

fuzz_target!(|input: &[u8]| {
    let &[layer, code, ref rest @ ..] = input else {
        return;
    };
    let mut rest = rest;
    let layer = LayerId::ALL[usize::from(layer) % LayerId::ALL.len()];
    let base = TileCells::from_fn(|_, _| code.into());
    let mut tile = PartialTile::new(layer);
    let mut accepted: Vec<&[u8]> = Vec::new();
    while let Some((length, behind)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes(*length)).min(behind.len());
        let (band, behind) = behind.split_at(length);
        rest = behind;
        let was_complete = tile.is_complete();
        let result = tile.add_band(band, Some(&base));
        assert!(result.is_err() || !was_complete, "a row came twice");
        if result.is_ok() {
            assert!(tile.add_band(band, Some(&base)).is_err(), "twice");
            accepted.push(band);
        }
    }
    let is_complete = tile.is_complete();
    let finished = tile.finish();
    if let Ok(cells) = &finished {
        assert!(is_complete);
        assert_eq!(cells.check(layer), Ok(()));
    }
    // Neither the order of bands nor refused bands between them matter.
    accepted.reverse();
    let again = decode(layer, &accepted, Some(&base));
    assert_eq!(codes(again.ok().as_ref()), codes(finished.ok().as_ref()));
});

fn codes(cells: Option<&TileCells>) -> Option<&[u16]> {
    cells.map(|cells| &cells.codes()[..])
}
