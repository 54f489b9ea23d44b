//! Bands into a tile, as they come from the network: any bytes are an error or a legal tile.
//!
//! Input: a byte that says which layer; then bands, each behind its length in two bytes. In a band whose
//! coding has bit 7 set the payload stands for itself, repeated to the length of its rows and compressed
//! here: mutation hardly ever makes a zstd frame that unpacks, and what lies behind it wants fuzzing too.
#![no_main]

use std::cell::RefCell;

use libfuzzer_sys::fuzz_target;
use protocol::layer::LayerId;
use protocol::tile::TileCells;
use protocol::tile::codec::{Decoder, PartialTile};
use zstd::bulk::Compressor;

struct Tools {
    decoder: Decoder,
    again: Decoder,
    compressor: Compressor<'static>,
}

thread_local! {
    static TOOLS: RefCell<Tools> = RefCell::new(Tools {
        decoder: Decoder::new().unwrap(),
        again: Decoder::new().unwrap(),
        compressor: Compressor::new(1).unwrap(),
    });
}

fuzz_target!(|input: &[u8]| {
    TOOLS.with_borrow_mut(|tools| assemble(input, tools));
});

fn assemble(input: &[u8], tools: &mut Tools) {
    let Some((&layer, mut rest)) = input.split_first() else {
        return;
    };
    let layer = LayerId::ALL[usize::from(layer) % LayerId::ALL.len()];
    let mut tile = PartialTile::new(layer);
    let mut accepted: Vec<Vec<u8>> = Vec::new();
    while let Some((length, behind)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes(*length)).min(behind.len());
        let (band, behind) = behind.split_at(length);
        rest = behind;
        let band = packed(band, &mut tools.compressor);
        let was_complete = tile.is_complete();
        let result = tools.decoder.decode_band(&band, &mut tile);
        assert!(result.is_err() || !was_complete, "a row came twice");
        if result.is_ok() {
            assert!(
                tools.decoder.decode_band(&band, &mut tile).is_err(),
                "twice"
            );
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
    let again = tools.again.decode(layer, &accepted);
    assert_eq!(codes(again.ok().as_ref()), codes(finished.ok().as_ref()));
}

fn codes(cells: Option<&TileCells>) -> Option<&[u16]> {
    cells.map(|cells| &cells.codes()[..])
}

fn packed(band: &[u8], compressor: &mut Compressor<'_>) -> Vec<u8> {
    match band {
        &[version, first, rows, coding, ref payload @ ..]
            if coding & 0x80 != 0 && !payload.is_empty() && rows <= 64 =>
        {
            let coding = coding & 0x7F;
            let bytes = 128 * usize::from(rows);
            let planes: Vec<u8> = payload.iter().copied().cycle().take(bytes).collect();
            let mut band = vec![version, first, rows, coding];
            if coding == 0 {
                band.extend(planes);
            } else {
                band.extend(compressor.compress(&planes).unwrap());
            }
            band
        }
        _ => band.to_vec(),
    }
}
