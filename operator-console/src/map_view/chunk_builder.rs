//! A chunk on its way to a texture: tile by tile, over as many frames as it takes.

use std::collections::BTreeSet;

use eframe::egui::{Color32, ColorImage};
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::chunks::{CHUNK_TEXELS, ChunkKey, Codes, Level, paint_tile, tile_image};
use super::coloring::Coloring;
use super::frame_time::FrameTime;
use super::layer_compositing::{IndexedLayer, known_below};
use super::tile_presence::TilePresence;

/// A layer as it is to be drawn.
#[derive(Clone, Copy)]
pub(super) struct LayerStyle<'a> {
    pub(super) layer: LayerId,
    pub(super) cell_m: f64,
    pub(super) store: &'a TileStore,
    pub(super) known: &'a TilePresence,
    pub(super) coloring: &'a Coloring,
    /// The layers below it that are seen.
    pub(super) below: &'a [IndexedLayer<'a>],
}

/// The image of a chunk, as far as it is done.
pub(super) struct ChunkBuilder {
    pub(super) key: ChunkKey,
    image: ColorImage,
    /// Yet to be painted, the last first.
    left: Vec<(i32, i32)>,
    /// Painted, and changed since.
    pub(super) changed: BTreeSet<(i32, i32)>,
}

impl ChunkBuilder {
    /// Begins with a chunk; `None` where nothing of it is known.
    pub(super) fn begin(key: ChunkKey, style: LayerStyle<'_>) -> Option<Self> {
        let side = key.level.tiles_per_chunk();
        let left: Vec<_> = style.known.in_square(key.first_tile(), side).collect();
        (!left.is_empty()).then(|| Self {
            key,
            image: ColorImage::filled([CHUNK_TEXELS; 2], style.coloring.unknown()),
            left,
            changed: BTreeSet::new(),
        })
    }

    /// Paints tiles while there is time; whether all are painted.
    pub(super) fn advance(&mut self, style: LayerStyle<'_>, time: &mut FrameTime) -> bool {
        while let Some(tile) = self.left.last().copied() {
            if !time.take_tile() {
                return false;
            }
            self.left.pop();
            let at = self.key.texel_of(tile);
            let first = at[1] * CHUNK_TEXELS + at[0];
            let texels = &mut self.image.pixels[first..];
            style.with_codes(tile, self.key.level, |codes| {
                paint_tile(
                    texels,
                    CHUNK_TEXELS,
                    self.key.level,
                    at,
                    codes,
                    style.coloring,
                );
            });
        }
        true
    }

    /// A tile is not what it was. A tile that is new is not among those that are left.
    pub(super) fn tile_changed(&mut self, tile: (i32, i32)) {
        let tile_at = (i64::from(tile.0), i64::from(tile.1));
        if ChunkKey::of_tile(self.key.level, tile_at) == self.key && !self.left.contains(&tile) {
            self.changed.insert(tile);
        }
    }

    pub(super) fn into_image(self) -> ColorImage {
        self.image
    }
}

impl LayerStyle<'_> {
    /// A tile's part of a chunk.
    pub(super) fn image(&self, tile: (i32, i32), chunk: ChunkKey) -> ColorImage {
        let level = chunk.level;
        let mut image = None;
        self.with_codes(tile, level, |codes| {
            let at = chunk.texel_of(tile);
            image = Some(tile_image(codes, level, at, self.coloring));
        });
        image.unwrap_or_else(|| {
            let unknown: Color32 = self.coloring.unknown();
            ColorImage::filled([level.tile_texels(); 2], unknown)
        })
    }

    /// Hands on the codes of a tile's texels, where it is known.
    fn with_codes(&self, tile: (i32, i32), level: Level, take: impl FnOnce(Codes<'_>)) {
        let step = level.cells_per_texel();
        let drawn = IndexedLayer {
            layer: self.layer,
            cell_m: self.cell_m,
            store: self.store,
            known: self.known,
        };
        let is_over_known = if self.coloring.lets_through() {
            known_below(self.below, (tile, self.cell_m), step)
        } else {
            Vec::new()
        };
        drawn.with_codes(tile, step, |highest| {
            take(Codes {
                highest,
                is_over_known: &is_over_known,
            });
        });
    }
}
