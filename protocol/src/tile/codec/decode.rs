//! Bands → cells. The bytes come from the network and may be anything.

use std::io;

use zstd::bulk::Decompressor;

use super::{
    Coding, FORMAT_VERSION, MAX_BAND_BYTES, TILE_CELLS, TILE_SIDE, join_planes, median_edge,
};
use crate::layer::LayerId;
use crate::tile::{InvalidCode, TileCells};

/// Turns bytes into tiles. Keep one: it holds zstd's working memory (about 100 kB) and its own buffers.
///
/// Whatever the bytes claim, decoding writes into these buffers, of one tile's size, and allocates nothing.
pub struct Decoder {
    decompressor: Decompressor<'static>,
    planes: Box<[u8; 2 * TILE_CELLS]>,
    symbols: Box<[u16; TILE_CELLS]>,
}

/// A tile of which bands are arriving, in any order.
#[derive(Clone, Debug)]
pub struct PartialTile {
    layer: LayerId,
    cells: TileCells,
    /// Bit y is set when row y is there.
    rows: u64,
}

/// Why bytes are not a tile.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// Too short for a header.
    #[error("tile band of {0} bytes is shorter than its 4-byte header")]
    Truncated(usize),
    /// Longer than any band that is ever sent.
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
    /// Not a zstd frame, or one larger than the band's rows.
    #[error("tile band does not decompress")]
    Zstd(#[source] io::Error),
    /// Fewer or more bytes than the band's rows.
    #[error("tile band holds {found} bytes, its rows {expected}")]
    Length {
        /// Bytes of the rows it claims.
        expected: usize,
        /// Bytes it holds.
        found: usize,
    },
    /// A code that the layer does not use.
    #[error(transparent)]
    Code(#[from] InvalidCode),
    /// A row that an earlier band has brought.
    #[error("tile band brings row {0} a second time")]
    DuplicateRow(u32),
    /// Bands are missing.
    #[error("tile is incomplete: {0} of its 64 rows are missing")]
    Incomplete(u32),
}

impl PartialTile {
    /// A tile of `layer` of which no band has come.
    pub fn new(layer: LayerId) -> Self {
        Self {
            layer,
            cells: TileCells::unknown(),
            rows: 0,
        }
    }

    /// Whether every row has come.
    pub fn is_complete(&self) -> bool {
        self.rows == u64::MAX
    }

    /// The tile's cells, once every row has come and every code is one of the layer's.
    pub fn finish(self) -> Result<TileCells, DecodeError> {
        if !self.is_complete() {
            return Err(DecodeError::Incomplete(self.rows.count_zeros()));
        }
        self.cells.check(self.layer)?;
        Ok(self.cells)
    }
}

impl Decoder {
    /// Sets zstd up.
    pub fn new() -> io::Result<Self> {
        Ok(Self {
            decompressor: Decompressor::new()?,
            planes: Box::new([0; 2 * TILE_CELLS]),
            symbols: Box::new([0; TILE_CELLS]),
        })
    }

    /// The tile of `layer` that `bands`, in any order, make up.
    pub fn decode<B: AsRef<[u8]>>(
        &mut self,
        layer: LayerId,
        bands: &[B],
    ) -> Result<TileCells, DecodeError> {
        let mut tile = PartialTile::new(layer);
        for band in bands {
            self.decode_band(band.as_ref(), &mut tile)?;
        }
        tile.finish()
    }

    /// Adds one band to `tile`; on an error `tile` is as it was.
    pub fn decode_band(&mut self, band: &[u8], tile: &mut PartialTile) -> Result<(), DecodeError> {
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
        if tile.rows & claimed != 0 {
            return Err(DecodeError::DuplicateRow(
                (tile.rows & claimed).trailing_zeros(),
            ));
        }

        let cell_count = usize::from(count) * TILE_SIDE;
        let planes = match coding {
            Coding::Codes => payload,
            Coding::CodesZstd | Coding::MedianEdgeZstd => {
                let planes = &mut self.planes[..2 * cell_count];
                let found = self
                    .decompressor
                    .decompress_to_buffer(payload, planes)
                    .map_err(DecodeError::Zstd)?;
                &self.planes[..found]
            }
        };
        if planes.len() != 2 * cell_count {
            return Err(DecodeError::Length {
                expected: 2 * cell_count,
                found: planes.len(),
            });
        }
        let first_cell = usize::from(first) * TILE_SIDE;
        let codes = &mut tile.cells.codes_mut()[first_cell..][..cell_count];
        match coding {
            Coding::Codes | Coding::CodesZstd => join_planes(planes, codes),
            Coding::MedianEdgeZstd => {
                let symbols = &mut self.symbols[..cell_count];
                join_planes(planes, symbols);
                median_edge::from_symbols(symbols, codes);
            }
        }
        tile.rows |= claimed;
        Ok(())
    }
}

/// A bit for each of `count` rows from `first` on; `None` where that is no row or one outside the tile.
fn row_mask(first: u8, count: u8) -> Option<u64> {
    let (first, count) = (u32::from(first), u32::from(count));
    let inside = count >= 1 && first + count <= TILE_SIDE as u32;
    inside.then(|| (u64::MAX >> (64 - count)) << first)
}
