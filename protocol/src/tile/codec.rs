//! Coding of tile cells. Decoders accept any bytes, because they come from the network.
//!
//! A tile is sent as one *band* of 64 rows, or as two of 32 if one does not fit in a message:
//!
//! | byte | content |
//! | --- | --- |
//! | 0 | format version, 2 |
//! | 1 | first row |
//! | 2 | rows, 1 … 64 |
//! | 3 | coding: 0 codes; 1 modelled; 2 modelled, as differences to an earlier revision |
//! | 4 … | coding 0: the low bytes of all cells, then their high bytes; else what a range coder makes of all cells |
//!
//! A model predicts each cell from its neighbours: a third fewer bytes than zstd finds, and as differences a fifth to a
//! twelfth of them (docs/benchmarks.md).

mod cell_model;
mod range_coder;

use self::cell_model::code_cells;
use self::range_coder::{RangeDecoder, RangeEncoder};
use crate::layer::LayerId;
use crate::tile::{InvalidCode, TILE_SIDE, TileCells};

/// Version that is written and read.
pub const FORMAT_VERSION: u8 = 2;

/// Limit of a band: with the tile's key, boot, epoch, revision and digest a message stays ≤ 8 KiB.
pub const MAX_BAND_BYTES: usize = 8 * 1024 - 128;

const HEADER_BYTES: usize = 4;

/// Half a tile fits in one band, even uncompressed.
const HALF_ROWS: usize = TILE_SIDE / 2;
const _: () = assert!(HEADER_BYTES + 2 * HALF_ROWS * TILE_SIDE <= MAX_BAND_BYTES);

/// Content of a band's payload; the number is on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    Codes = 0,
    Modelled = 1,
    Differences = 2,
}

impl Coding {
    fn from_wire(number: u8) -> Option<Self> {
        [Self::Codes, Self::Modelled, Self::Differences]
            .into_iter()
            .find(|&coding| coding as u8 == number)
    }
}

/// Bands of a tile, each at most [`MAX_BAND_BYTES`] long: one, or two if one does not fit.
pub fn encode(layer: LayerId, cells: &TileCells) -> Vec<Vec<u8>> {
    modelled(layer, cells, None).map_or_else(
        || {
            let halves = cells.codes().as_chunks::<{ HALF_ROWS * TILE_SIDE }>().0;
            let first_rows = [0, HALF_ROWS as u8].into_iter();
            first_rows
                .zip(halves)
                .map(|(row, codes)| plain(row, codes))
                .collect()
        },
        |band| vec![band],
    )
}

/// One band: what differs from `base`, which the receiver must have. `None` if that is not shorter than the codes.
pub fn encode_differences(layer: LayerId, cells: &TileCells, base: &TileCells) -> Option<Vec<u8>> {
    modelled(layer, cells, Some(base))
}

fn modelled(layer: LayerId, cells: &TileCells, base: Option<&TileCells>) -> Option<Vec<u8>> {
    let mut encoder = RangeEncoder::new();
    code_cells(
        &mut encoder,
        layer,
        &mut cells.codes().clone(),
        base.map(TileCells::codes),
    );
    let coding = base.map_or(Coding::Modelled, |_| Coding::Differences);
    let mut band = vec![FORMAT_VERSION, 0, TILE_SIDE as u8, coding as u8];
    band.extend(encoder.finish());
    (band.len() <= MAX_BAND_BYTES).then_some(band)
}

/// Whole rows without any model.
fn plain(first_row: u8, codes: &[u16]) -> Vec<u8> {
    let rows = (codes.len() / TILE_SIDE) as u8;
    let mut band = vec![FORMAT_VERSION, first_row, rows, Coding::Codes as u8];
    band.extend(codes.iter().map(|code| code.to_le_bytes()[0]));
    band.extend(codes.iter().map(|code| code.to_le_bytes()[1]));
    band
}

/// A tile whose bands arrive in any order.
#[derive(Clone, Debug)]
pub struct PartialTile {
    layer: LayerId,
    cells: TileCells,
    /// Bit y is set if row y has arrived.
    rows: u64,
}

/// Reason why bytes are no tile.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// Too short for a header.
    #[error("tile band of {0} bytes is shorter than its 4-byte header")]
    Truncated(usize),
    /// Longer than any band.
    #[error("tile band of {0} bytes is longer than the {MAX_BAND_BYTES} allowed")]
    TooLong(usize),
    /// Another version of the format.
    #[error(
        "tile format is version {0}, this program reads {FORMAT_VERSION}: update the older side"
    )]
    Version(u8),
    /// A coding that this version does not define.
    #[error("tile band coding {0} is not defined")]
    Coding(u8),
    /// Rows outside the tile, or none.
    #[error("tile band claims {count} rows from row {first} on, a tile has rows 0 to 63")]
    Rows {
        /// First row claimed.
        first: u8,
        /// Number of rows claimed.
        count: u8,
    },
    /// Fewer or more bytes than the band's rows.
    #[error("tile band holds {found} bytes, its rows {expected}")]
    Length {
        /// Bytes of the rows it claims.
        expected: usize,
        /// Bytes it holds.
        found: usize,
    },
    /// More bytes than the modelled cells need.
    #[error("tile band holds {0} bytes more than its cells need")]
    Unread(usize),
    /// Modelled cells that are not those of a whole tile.
    #[error("tile band claims {0} modelled rows, which must be 64")]
    NotWhole(u8),
    /// Differences to a revision that the receiver does not have.
    #[error("tile band holds differences to a revision that is not here: ask for the tile")]
    NoBase,
    /// A code that the layer does not use.
    #[error(transparent)]
    Code(#[from] InvalidCode),
    /// A row of an earlier band.
    #[error("tile band brings row {0} a second time")]
    DuplicateRow(u32),
    /// Bands are missing.
    #[error("tile is incomplete: {0} of its 64 rows are missing")]
    Incomplete(u32),
}

impl PartialTile {
    /// A tile of `layer` without bands.
    pub fn new(layer: LayerId) -> Self {
        Self {
            layer,
            cells: TileCells::unknown(),
            rows: 0,
        }
    }

    /// Whether every row has arrived.
    pub fn is_complete(&self) -> bool {
        self.rows == u64::MAX
    }

    /// Adds one band; an error leaves the tile unchanged. `base`: what differences are to.
    pub fn add_band(&mut self, band: &[u8], base: Option<&TileCells>) -> Result<(), DecodeError> {
        if band.len() > MAX_BAND_BYTES {
            return Err(DecodeError::TooLong(band.len()));
        }
        let &[version, first, count, coding, ref payload @ ..] = band else {
            return Err(match band.first() {
                Some(&version) if version != FORMAT_VERSION => DecodeError::Version(version),
                Some(_) | None => DecodeError::Truncated(band.len()),
            });
        };
        if version != FORMAT_VERSION {
            return Err(DecodeError::Version(version));
        }
        let coding = Coding::from_wire(coding).ok_or(DecodeError::Coding(coding))?;
        let claimed = row_mask(first, count).ok_or(DecodeError::Rows { first, count })?;
        if self.rows & claimed != 0 {
            let row = (self.rows & claimed).trailing_zeros();
            return Err(DecodeError::DuplicateRow(row));
        }
        let base = match coding {
            Coding::Codes => {
                let first_cell = usize::from(first) * TILE_SIDE;
                let cell_count = usize::from(count) * TILE_SIDE;
                if payload.len() != 2 * cell_count {
                    return Err(DecodeError::Length {
                        expected: 2 * cell_count,
                        found: payload.len(),
                    });
                }
                let (low, high) = payload.split_at(cell_count);
                let codes = &mut self.cells.codes_mut()[first_cell..][..cell_count];
                for ((code, low), high) in codes.iter_mut().zip(low).zip(high) {
                    *code = u16::from_le_bytes([*low, *high]);
                }
                self.rows |= claimed;
                return Ok(());
            }
            Coding::Modelled => None,
            Coding::Differences => Some(base.ok_or(DecodeError::NoBase)?.codes()),
        };
        if claimed != u64::MAX {
            return Err(DecodeError::NotWhole(count));
        }
        let mut decoder = RangeDecoder::new(payload);
        let mut cells = TileCells::unknown();
        code_cells(&mut decoder, self.layer, cells.codes_mut(), base);
        if decoder.unread() > 0 {
            return Err(DecodeError::Unread(decoder.unread()));
        }
        self.cells = cells;
        self.rows = claimed;
        Ok(())
    }

    /// Cells of the tile, if it is complete and every code is valid.
    pub fn finish(self) -> Result<TileCells, DecodeError> {
        if !self.is_complete() {
            return Err(DecodeError::Incomplete(self.rows.count_zeros()));
        }
        self.cells.check(self.layer)?;
        Ok(self.cells)
    }
}

/// Decodes a tile of `layer` from `bands` in any order; `base` is what differences are to.
pub fn decode<B: AsRef<[u8]>>(
    layer: LayerId,
    bands: &[B],
    base: Option<&TileCells>,
) -> Result<TileCells, DecodeError> {
    let mut tile = PartialTile::new(layer);
    for band in bands {
        tile.add_band(band.as_ref(), base)?;
    }
    tile.finish()
}

/// A bit for each of `count` rows from `first` on; `None` if empty or outside the tile.
fn row_mask(first: u8, count: u8) -> Option<u64> {
    let (first, count) = (u32::from(first), u32::from(count));
    let inside = count >= 1 && first + count <= TILE_SIDE as u32;
    inside.then(|| (u64::MAX >> (64 - count)) << first)
}

#[cfg(test)]
mod tests;
