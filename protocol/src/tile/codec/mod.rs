//! Tile cells ⇄ bytes.
//!
//! A tile travels as one *band* of 64 rows, or as two of 32 where one would not fit a message. Bands are
//! coded one by one:
//!
//! | byte | content |
//! | --- | --- |
//! | 0 | format version, 1 |
//! | 1 | first row |
//! | 2 | rows, 1 … 64 |
//! | 3 | coding: 0 codes; 1 codes, zstd; 2 median-edge symbols, zstd |
//! | 4 … | the low bytes of all cells, then their high bytes; for codings 1 and 2 as one zstd frame |
//!
//! Median-edge prediction (`median_edge.rs`) wins on terrain. On occupancy and class layers, whose cells
//! repeat exactly, it loses by half to the codes themselves, so the encoder tries both and keeps the
//! smaller. zstd level 1 throughout: level 3 is no smaller on either.

mod decode;
mod encode;
mod median_edge;

pub use decode::{DecodeError, Decoder, PartialTile};
pub use encode::Encoder;

use super::{TILE_CELLS, TILE_SIDE};

/// The version that [`Encoder`] writes and [`Decoder`] reads.
pub const FORMAT_VERSION: u8 = 1;

/// No band is longer: with the tile's key, boot, epoch, revision and digest a message stays ≤ 8 KiB.
pub const MAX_BAND_BYTES: usize = 8 * 1024 - 128;

const HEADER_BYTES: usize = 4;

/// Half a tile fits one band, if need be uncompressed.
const HALF_ROWS: usize = TILE_SIDE / 2;
const _: () = assert!(HEADER_BYTES + 2 * HALF_ROWS * TILE_SIDE <= MAX_BAND_BYTES);

/// What a band's payload holds; the number is on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    Codes = 0,
    CodesZstd = 1,
    MedianEdgeZstd = 2,
}

impl Coding {
    fn from_wire(number: u8) -> Option<Self> {
        [Self::Codes, Self::CodesZstd, Self::MedianEdgeZstd]
            .into_iter()
            .find(|&coding| coding as u8 == number)
    }
}

/// Writes the low bytes of `words`, then their high bytes, into the first `2·words.len()` bytes of
/// `planes`, which are returned.
fn split_planes<'a>(words: &[u16], planes: &'a mut [u8; 2 * TILE_CELLS]) -> &'a [u8] {
    let planes = &mut planes[..2 * words.len()];
    let (low_bytes, high_bytes) = planes.split_at_mut(words.len());
    for ((word, low), high) in words.iter().zip(low_bytes).zip(high_bytes) {
        [*low, *high] = word.to_le_bytes();
    }
    planes
}

/// The inverse of [`split_planes`]; `planes` holds twice as many bytes as `words` words.
fn join_planes(planes: &[u8], words: &mut [u16]) {
    let (low_bytes, high_bytes) = planes.split_at(words.len());
    for ((word, low), high) in words.iter_mut().zip(low_bytes).zip(high_bytes) {
        *word = u16::from_le_bytes([*low, *high]);
    }
}

#[cfg(test)]
mod tests;
