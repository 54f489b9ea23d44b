//! Decodes bands and holds the first band of a tile until its second arrives.

use std::collections::BTreeMap;

use protocol::message::TileBand;
use protocol::tile::codec::{DecodeError, PartialTile};
use protocol::tile::{BootId, Tile, TileCells, TileKey};
use protocol::wire::Header;

/// Bands that may wait; beyond this limit the oldest is dropped.
const MAX_PARTIAL_TILES: usize = 64;

#[derive(Default)]
pub(super) struct TileIntake {
    /// By tile, boot and revision: bands of different publications do not match.
    partial_tiles: BTreeMap<(TileKey, BootId, u64), PartialTile>,
    /// Bands that were dropped.
    pub(super) abandoned: u64,
}

impl TileIntake {
    /// Takes one band and returns the tile that it completes. `base`: the cells that it may hold the differences to.
    pub(super) fn take(
        &mut self,
        key: TileKey,
        header: Header,
        band: &TileBand,
        base: Option<&TileCells>,
    ) -> Result<Option<Tile>, DecodeError> {
        let boot = header.boot;
        let whole = (key, boot, band.revision);
        let waiting = self.partial_tiles.remove(&whole);
        let waits = waiting.is_some();
        let mut partial = waiting.unwrap_or_else(|| PartialTile::new(key.layer));
        if let Err(why) = partial.add_band(&band.rows, base) {
            // The same band twice: the later one replaces the first.
            if !matches!(why, DecodeError::DuplicateRow(_)) {
                // The valid band keeps waiting.
                if waits {
                    self.partial_tiles.insert(whole, partial);
                }
                return Err(why);
            }
            partial = PartialTile::new(key.layer);
            partial.add_band(&band.rows, base)?;
        }
        if !partial.is_complete() {
            self.partial_tiles.insert(whole, partial);
            self.keep_limit();
            return Ok(None);
        }
        // Halves of older revisions are void.
        self.partial_tiles
            .retain(|(other_key, other, revision), _| {
                *other_key != key || (*other == boot && *revision > band.revision)
            });
        Ok(Some(Tile {
            key,
            boot,
            epoch: band.epoch,
            revision: band.revision,
            stamp_ns: header.robot_time_ns,
            check: band.check,
            cells: partial.finish()?,
        }))
    }

    fn keep_limit(&mut self) {
        if self.partial_tiles.len() <= MAX_PARTIAL_TILES {
            return;
        }
        let oldest = self
            .partial_tiles
            .keys()
            .min_by_key(|(_, _, revision)| *revision);
        if let Some(oldest) = oldest.copied() {
            self.partial_tiles.remove(&oldest);
            self.abandoned += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use protocol::layer::LayerId;
    use protocol::tile::codec;

    use super::*;

    const HEADER: Header = Header {
        boot: BootId([5; 16]),
        seq: 1,
        robot_time_ns: 42,
    };

    fn key(tx: i32) -> TileKey {
        TileKey {
            layer: LayerId::Elevation,
            tx,
            ty: 0,
        }
    }

    /// Noise does not compress, so it takes two bands.
    fn noise() -> (TileCells, Vec<TileBand>) {
        let mut cells = TileCells::unknown();
        let mut state = 1u32;
        for code in cells.codes_mut() {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *code = (state >> 17) as u16;
        }
        let check = cells.digest().check();
        let bands = codec::encode(LayerId::Elevation, &cells);
        assert_eq!(bands.len(), 2);
        let band = |rows| TileBand {
            epoch: 0,
            revision: 7,
            base: 0,
            check,
            rows,
        };
        (cells, bands.into_iter().map(band).collect())
    }

    #[test]
    fn bands_complete_a_tile_in_any_order() {
        let (cells, bands) = noise();
        for order in [[0, 0, 1], [1, 1, 0]] {
            let mut intake = TileIntake::default();
            assert_eq!(
                intake.take(key(0), HEADER, &bands[order[0]], None).unwrap(),
                None
            );
            assert_eq!(
                intake.take(key(0), HEADER, &bands[order[1]], None).unwrap(),
                None
            );
            let tile = intake
                .take(key(0), HEADER, &bands[order[2]], None)
                .unwrap()
                .unwrap();
            assert_eq!((tile.revision, tile.stamp_ns), (7, 42));
            assert_eq!(tile.cells, cells);
            assert!(intake.partial_tiles.is_empty());
        }
    }

    #[test]
    fn bands_of_other_revisions_do_not_match_and_are_bounded() {
        let (_, bands) = noise();
        let mut intake = TileIntake::default();
        let other = Header {
            boot: BootId([6; 16]),
            ..HEADER
        };
        let newer = TileBand {
            revision: 8,
            ..bands[1].clone()
        };
        assert_eq!(intake.take(key(0), HEADER, &bands[0], None).unwrap(), None);
        assert_eq!(intake.take(key(0), HEADER, &newer, None).unwrap(), None);
        assert_eq!(intake.take(key(0), other, &bands[1], None).unwrap(), None);
        for tx in 1..=100 {
            intake.take(key(tx), HEADER, &bands[0], None).unwrap();
        }
        assert_eq!(intake.partial_tiles.len(), MAX_PARTIAL_TILES);
        assert_eq!(intake.abandoned, 103 - MAX_PARTIAL_TILES as u64);
        let garbage = TileBand {
            rows: vec![9; 40],
            ..newer
        };
        for tx in 0..200 {
            assert!(intake.take(key(tx), HEADER, &garbage, None).is_err());
        }
        assert_eq!(intake.partial_tiles.len(), MAX_PARTIAL_TILES);
    }
}
