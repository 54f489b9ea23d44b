//! Cells → bands.

use std::io;

use zstd::bulk::Compressor;
use zstd::zstd_safe::compress_bound;

use super::{
    Coding, FORMAT_VERSION, HALF_ROWS, HEADER_BYTES, MAX_BAND_BYTES, TILE_CELLS, TILE_SIDE,
    median_edge, split_planes,
};
use crate::tile::TileCells;

const ZSTD_LEVEL: i32 = 1;

/// Turns tiles into bytes. Keep one: it holds zstd's working memory and its own buffers.
pub struct Encoder {
    compressor: Compressor<'static>,
    symbols: Box<[u16; TILE_CELLS]>,
    code_planes: Box<[u8; 2 * TILE_CELLS]>,
    symbol_planes: Box<[u8; 2 * TILE_CELLS]>,
    codes_zstd: Vec<u8>,
    symbols_zstd: Vec<u8>,
}

impl Encoder {
    /// Sets zstd up; fails only where zstd refuses its own level 1.
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

    /// The bands of `cells`, each at most [`MAX_BAND_BYTES`] long: one, or two where one does not fit.
    ///
    /// The bytes depend on `cells` (and on the version of zstd) alone, not on what was encoded before.
    pub fn encode(&mut self, cells: &TileCells) -> Vec<Vec<u8>> {
        let codes = cells.codes();
        let whole = self.band(0, codes);
        if whole.len() <= MAX_BAND_BYTES {
            return vec![whole];
        }
        let (lower, upper) = codes.split_at(HALF_ROWS * TILE_SIDE);
        vec![self.band(0, lower), self.band(HALF_ROWS as u8, upper)]
    }

    /// Whole rows in the coding that makes them smallest.
    fn band(&mut self, first_row: u8, codes: &[u16]) -> Vec<u8> {
        let code_planes = split_planes(codes, &mut self.code_planes);
        let symbols = &mut self.symbols[..codes.len()];
        median_edge::to_symbols(codes, symbols);
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
