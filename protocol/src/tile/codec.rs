//! Coding of tile cells. Decoders accept any bytes, because they come from the network.
//!
//! A tile is sent as one *band* of 64 rows, or as two of 32 if one does not fit in a message:
//!
//! | byte | content |
//! | --- | --- |
//! | 0 | format version, 1 |
//! | 1 | first row |
//! | 2 | rows, 1 … 64 |
//! | 3 | coding: 0 codes; 1 codes, zstd; 2 median-edge symbols, zstd |
//! | 4 … | the low bytes of all cells, then their high bytes; for codings 1 and 2 as one zstd frame |
//!
//! Median-edge prediction is smaller for terrain. For occupancy and class layers, whose cells repeat exactly, it
//! is twice as large as the codes, so the encoder tries both. zstd level 3 would not be smaller than level 1.
//!
//! The median-edge predictor is that of LOCO-I (Weinberger, Seroussi and Sapiro 2000, §III-A) over known cells. An
//! unknown cell is symbol 0, and later predictions use its own prediction as its value, so that gaps do not disturb
//! them. A known cell is `1 + zigzag(code − prediction)`, the difference modulo 65535 (the number of known codes):
//! every code has exactly one symbol, and a small difference of either sign is a small symbol.

use std::io;

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::compress_bound;

use crate::layer::{LayerId, UNKNOWN};
use crate::tile::{InvalidCode, TILE_CELLS, TILE_SIDE, TileCells};

/// Version that [`Encoder`] writes and [`Decoder`] reads.
pub const FORMAT_VERSION: u8 = 1;

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

/// Writes the low bytes of `words`, then their high bytes, to the start of `planes`, and returns
/// that part.
fn split_planes<'a>(words: &[u16], planes: &'a mut [u8; 2 * TILE_CELLS]) -> &'a [u8] {
    let planes = &mut planes[..2 * words.len()];
    let (low_bytes, high_bytes) = planes.split_at_mut(words.len());
    for ((word, low), high) in words.iter().zip(low_bytes).zip(high_bytes) {
        [*low, *high] = word.to_le_bytes();
    }
    planes
}

/// Inverse of [`split_planes`]; `planes` holds twice as many bytes as `words` words.
fn join_planes(planes: &[u8], words: &mut [u16]) {
    let (low_bytes, high_bytes) = planes.split_at(words.len());
    for ((word, low), high) in words.iter_mut().zip(low_bytes).zip(high_bytes) {
        *word = u16::from_le_bytes([*low, *high]);
    }
}

const ZSTD_LEVEL: i32 = 1;

/// Encodes tiles. Reuse it: it holds zstd's working memory and its own buffers.
pub struct Encoder {
    compressor: Compressor<'static>,
    symbols: Box<[u16; TILE_CELLS]>,
    code_planes: Box<[u8; 2 * TILE_CELLS]>,
    symbol_planes: Box<[u8; 2 * TILE_CELLS]>,
    codes_zstd: Vec<u8>,
    symbols_zstd: Vec<u8>,
}

impl Encoder {
    /// Fails only if zstd refuses its own level 1.
    pub fn new() -> io::Result<Self> {
        let compressed_bytes_max = compress_bound(2 * TILE_CELLS);
        Ok(Self {
            compressor: Compressor::new(ZSTD_LEVEL)?,
            symbols: Box::new([0; TILE_CELLS]),
            code_planes: Box::new([0; 2 * TILE_CELLS]),
            symbol_planes: Box::new([0; 2 * TILE_CELLS]),
            codes_zstd: Vec::with_capacity(compressed_bytes_max),
            symbols_zstd: Vec::with_capacity(compressed_bytes_max),
        })
    }

    /// Bands of `cells`, each at most [`MAX_BAND_BYTES`] long: one, or two if one does not fit.
    ///
    /// The bytes depend on `cells` and the version of zstd only.
    pub fn encode(&mut self, cells: &TileCells) -> Vec<Vec<u8>> {
        let codes = cells.codes();
        let whole = self.band(0, codes);
        if whole.len() <= MAX_BAND_BYTES {
            return vec![whole];
        }
        let (lower, upper) = codes.split_at(HALF_ROWS * TILE_SIDE);
        vec![self.band(0, lower), self.band(HALF_ROWS as u8, upper)]
    }

    /// Encodes whole rows with the smallest coding.
    fn band(&mut self, first_row: u8, codes: &[u16]) -> Vec<u8> {
        let code_planes = split_planes(codes, &mut self.code_planes);
        let symbols = &mut self.symbols[..codes.len()];
        to_symbols(codes, symbols);
        let symbol_planes = split_planes(symbols, &mut self.symbol_planes);

        let mut coding = Coding::Codes;
        let mut payload = code_planes;
        let trials = [
            (Coding::CodesZstd, code_planes, &mut self.codes_zstd),
            (
                Coding::MedianEdgeZstd,
                symbol_planes,
                &mut self.symbols_zstd,
            ),
        ];
        for (trial, planes, compressed) in trials {
            compressed.clear();
            let fits = self.compressor.compress_to_buffer(planes, compressed);
            if fits.is_ok() && compressed.len() < payload.len() {
                coding = trial;
                payload = compressed;
            }
        }

        let rows = (codes.len() / TILE_SIDE) as u8;
        let mut band = Vec::with_capacity(HEADER_BYTES + payload.len());
        band.extend([FORMAT_VERSION, first_row, rows, coding as u8]);
        band.extend(payload);
        band
    }
}

/// Decodes tiles. Reuse it: it holds zstd's working memory (about 100 kB) and its own buffers.
///
/// For any input, decoding writes to these buffers of one tile's size and allocates nothing.
pub struct Decoder {
    decompressor: Decompressor<'static>,
    planes: Box<[u8; 2 * TILE_CELLS]>,
    symbols: Box<[u16; TILE_CELLS]>,
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

    /// Cells of the tile, if it is complete and every code is valid.
    pub fn finish(self) -> Result<TileCells, DecodeError> {
        if !self.is_complete() {
            return Err(DecodeError::Incomplete(self.rows.count_zeros()));
        }
        self.cells.check(self.layer)?;
        Ok(self.cells)
    }
}

impl Decoder {
    /// # Errors
    /// Without memory for zstd.
    pub fn new() -> io::Result<Self> {
        Ok(Self {
            decompressor: Decompressor::new()?,
            planes: Box::new([0; 2 * TILE_CELLS]),
            symbols: Box::new([0; TILE_CELLS]),
        })
    }

    /// Decodes the tile of `layer` from `bands` in any order.
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

    /// Adds one band to `tile`; an error leaves `tile` unchanged.
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
                from_symbols(symbols, codes);
            }
        }
        tile.rows |= claimed;
        Ok(())
    }
}

/// A bit for each of `count` rows from `first` on; `None` if empty or outside the tile.
fn row_mask(first: u8, count: u8) -> Option<u64> {
    let (first, count) = (u32::from(first), u32::from(count));
    let inside = count >= 1 && first + count <= TILE_SIDE as u32;
    inside.then(|| (u64::MAX >> (64 - count)) << first)
}

/// Prediction for the first cell: height 0, the middle of the codes.
const FIRST: u16 = 32768;
/// Known codes, and so residuals: 1 … 65535.
const KNOWN_CODES: i32 = 65535;

/// Replaces whole rows of codes by symbols.
fn to_symbols(codes: &[u16], symbols: &mut [u16]) {
    walk(codes, symbols, |code, prediction| {
        if code == UNKNOWN {
            (UNKNOWN, prediction)
        } else {
            (1 + zigzag(code, prediction), code)
        }
    });
}

/// Replaces whole rows of symbols by codes; every symbol gives a code.
fn from_symbols(symbols: &[u16], codes: &mut [u16]) {
    walk(symbols, codes, |symbol, prediction| match symbol {
        0 => (UNKNOWN, prediction),
        known => {
            let code = unzigzag(known - 1, prediction);
            (code, code)
        }
    });
}

/// Calls `step` with every cell of `from` and its prediction; `step` returns the output and the
/// value for later predictions.
fn walk(from: &[u16], into: &mut [u16], mut step: impl FnMut(u16, u16) -> (u16, u16)) {
    let mut above = [FIRST; TILE_SIDE];
    let mut first_row = true;
    let rows = from
        .chunks_exact(TILE_SIDE)
        .zip(into.chunks_exact_mut(TILE_SIDE));
    for (from, into) in rows {
        let mut left = above[0];
        let mut above_left = above[0];
        for ((&input, output), above) in from.iter().zip(into).zip(&mut above) {
            let prediction = if first_row {
                left
            } else {
                median_edge(left, *above, above_left)
            };
            above_left = *above;
            (*output, left) = step(input, prediction);
            *above = left;
        }
        first_row = false;
    }
}

/// The median of `left`, `above` and `left + above − above_left`.
fn median_edge(left: u16, above: u16, above_left: u16) -> u16 {
    let (low, high) = (left.min(above), left.max(above));
    let gradient = i32::from(left) + i32::from(above) - i32::from(above_left);
    gradient.clamp(i32::from(low), i32::from(high)) as u16
}

fn zigzag(code: u16, prediction: u16) -> u16 {
    let half = KNOWN_CODES / 2;
    let mut residual = i32::from(code) - i32::from(prediction);
    if residual > half {
        residual -= KNOWN_CODES;
    } else if residual < -half {
        residual += KNOWN_CODES;
    }
    ((residual << 1) ^ (residual >> 31)) as u16
}

fn unzigzag(zigzag: u16, prediction: u16) -> u16 {
    let residual = i32::from(zigzag >> 1) ^ -i32::from(zigzag & 1);
    let code = i32::from(prediction) + residual;
    (if code < 1 {
        code + KNOWN_CODES
    } else if code > KNOWN_CODES {
        code - KNOWN_CODES
    } else {
        code
    }) as u16
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod median_edge_tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn predictor_follows_edges_and_planes() {
        assert_eq!(median_edge(10, 20, 5), 20, "rising edge");
        assert_eq!(median_edge(10, 20, 30), 10, "falling edge");
        assert_eq!(median_edge(10, 20, 12), 18, "plane");
        assert_eq!(median_edge(65535, 65535, 1), 65535);
    }

    #[test]
    fn a_plane_with_a_hole_costs_nothing_after_its_edges() {
        let codes: Vec<u16> = (0..64 * 64)
            .map(|i| {
                let (x, y) = (i % 64, i / 64);
                let hole = (20..40).contains(&x) && (20..40).contains(&y);
                if hole { UNKNOWN } else { 30000 + 3 * x - 7 * y }
            })
            .collect();
        let mut symbols = vec![0; codes.len()];
        to_symbols(&codes, &mut symbols);
        for y in 1..64 {
            for x in 1..64 {
                assert!(
                    symbols[64 * y + x] <= 1,
                    "({x}, {y}): {}",
                    symbols[64 * y + x]
                );
            }
        }
    }

    #[test]
    fn every_symbol_is_a_code_and_back() {
        for prediction in [1, 2, 32768, 65534, 65535] {
            for zig in (0..65535).step_by(7).chain([65533, 65534]) {
                let code = unzigzag(zig, prediction);
                assert_ne!(code, UNKNOWN);
                assert_eq!(zigzag(code, prediction), zig, "{prediction} {zig}");
            }
        }
    }

    proptest! {
        #[test]
        fn any_rows_survive(codes in prop::collection::vec(any::<u16>(), 64 * 5)) {
            let mut symbols = vec![0; codes.len()];
            let mut back = vec![0; codes.len()];
            to_symbols(&codes, &mut symbols);
            from_symbols(&symbols, &mut back);
            prop_assert_eq!(codes, back);
        }
    }
}
