//! Colours of cell codes, and the value range of colour scales.
//!
//! The lowest shown layer has the colours of its palette. An upper layer is transparent where it is unknown, and over
//! known cells also where it is free or has low values.

use eframe::egui::Color32;
use protocol::layer::{LayerId, Palette, Pattern, Quantisation, Scheme, UNKNOWN};
use protocol::tile::TILE_SIDE;
use protocol::tile_store::TileStore;

/// Cells used to fit colours, at most: about 2 ms. Larger maps are sampled evenly.
const MAX_FITTED_CELLS: usize = 1 << 20;

#[derive(Clone, Debug)]
pub(super) struct Coloring {
    pub(super) palette: Palette,
    pub(super) is_over: bool,
    table: Vec<Color32>,
    /// Colours over unknown cells; empty if they are the same.
    alone: Vec<Color32>,
    /// Pattern of each code and its colour; empty without patterns.
    marks: Vec<(Pattern, Color32)>,
}

impl Coloring {
    pub(super) fn new(palette: Palette, is_over: bool) -> Self {
        let last = match palette.layer().quantisation() {
            Quantisation::Linear { max_code, .. } => max_code,
            Quantisation::Classes(classes) => classes.len() as u16,
        };
        let of = |[red, green, blue, alpha]: [u8; 4]| {
            Color32::from_rgba_unmultiplied(red, green, blue, alpha)
        };
        let codes = || UNKNOWN..=last;
        let has_patterns = codes().any(|code| palette.pattern(code) != Pattern::Plain);
        let mark = |code| (palette.pattern(code), of(palette.mark_color(code)));
        let covering = |code, part: f32| {
            let [red, green, blue, alpha] = palette.color(code);
            of([red, green, blue, (f32::from(alpha) * part).round() as u8])
        };
        let color = |code| {
            let part = if is_over {
                cover(palette.layer(), code)
            } else {
                1.0
            };
            covering(code, part)
        };
        // Unknown cells are transparent.
        let alone = |code| covering(code, f32::from(code != UNKNOWN));
        let lets_through =
            is_over && codes().any(|code| code != UNKNOWN && cover(palette.layer(), code) < 1.0);
        Self {
            palette,
            is_over,
            table: codes().map(color).collect(),
            alone: codes().filter(|_| lets_through).map(alone).collect(),
            marks: codes().filter(|_| has_patterns).map(mark).collect(),
        }
    }

    /// Whether the colours depend on the layers below.
    pub(super) fn lets_through(&self) -> bool {
        !self.alone.is_empty()
    }

    pub(super) fn alone(&self, code: u16) -> Color32 {
        let color = self.alone.get(usize::from(code));
        color.copied().unwrap_or_else(|| self.plain(code))
    }

    pub(super) fn has_patterns(&self) -> bool {
        !self.marks.is_empty()
    }

    /// Colour of a texel: `x` counts to the right, `y` down.
    pub(super) fn color_at(&self, code: u16, x: usize, y: usize) -> Color32 {
        match self.marks.get(usize::from(code)) {
            Some((pattern, color)) if pattern.is_mark(x, y) => *color,
            Some(_) | None => self.plain(code),
        }
    }

    pub(super) fn plain(&self, code: u16) -> Color32 {
        let color = self.table.get(usize::from(code));
        color.copied().unwrap_or_default()
    }
}

pub(super) fn palette_of(layer: LayerId, scheme: Scheme) -> Palette {
    let mut palettes = layer.palettes();
    let palette = palettes.find(|palette| palette.scheme() == scheme);
    palette.unwrap_or_else(|| layer.default_palette())
}

/// Opacity of a cell over other layers, 0 … 1.
fn cover(layer: LayerId, code: u16) -> f32 {
    let Some(value) = layer.quantisation().decode(code) else {
        return 0.0;
    };
    match layer {
        LayerId::Obstacle => f32::from(value > 0.0),
        LayerId::Occupancy => ((value - 0.25) / 0.5).clamp(0.0, 1.0),
        LayerId::Cost => (value / 0.3).clamp(0.0, 1.0),
        LayerId::Elevation
        | LayerId::Rigidity
        | LayerId::Shore
        | LayerId::Intra
        | LayerId::Inter
        | LayerId::Depth => 1.0,
    }
}

/// Fits the range to all but the lowest and highest 1 % of the cells, as exported pictures do.
pub(super) fn fitted_to(palette: Palette, store: &TileStore) -> Palette {
    let layer = palette.layer();
    let mut counts = vec![0_u32; usize::from(u16::MAX) + 1];
    let tiles = || store.all_shown(layer).map(|(_, cells)| cells);
    let rows = tiles().count() * TILE_SIDE;
    // Odd, so that the sampled rows differ from tile to tile.
    let stride = (rows / (MAX_FITTED_CELLS / TILE_SIDE)) | 1;
    let mut next = 0;
    for (index, cells) in tiles().enumerate() {
        let first = index * TILE_SIDE;
        while next < first + TILE_SIDE {
            for code in cells.row(next - first) {
                counts[usize::from(*code)] += 1;
            }
            next += stride;
        }
    }
    counts[usize::from(UNKNOWN)] = 0;
    let known: u32 = counts.iter().sum();
    let value_of_rank = |rank: u32| {
        let mut seen = 0;
        let code = counts.iter().position(|count| {
            seen += count;
            seen > rank
        });
        code.and_then(|code| layer.quantisation().decode(code as u16))
    };
    let low = value_of_rank(known / 100);
    let high = value_of_rank(known.saturating_sub(1 + known / 100));
    match (low, high) {
        (Some(low), Some(high)) => palette.fitted(low, high),
        (None, _) | (_, None) => palette,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::publish;
    use super::*;
    use crate::test_support::store_of;

    #[test]
    fn colour_table_equals_the_palette() {
        for palette in LayerId::ALL.into_iter().flat_map(LayerId::palettes) {
            let coloring = Coloring::new(palette, false);
            for (code, color) in (0..=u16::MAX).zip(&coloring.table) {
                assert_eq!(color.to_srgba_unmultiplied(), palette.color(code));
                let [x, y] = [3, 1];
                let color = coloring.color_at(code, x, y).to_srgba_unmultiplied();
                assert_eq!(color, palette.color_at(code, x, y));
            }
            let layers = [LayerId::Rigidity, LayerId::Shore];
            assert_eq!(coloring.has_patterns(), layers.contains(&palette.layer()));
            let is_code = |code| palette.layer().quantisation().is_code(code);
            let codes = (0..=u16::MAX).filter(|code| is_code(*code)).count();
            assert_eq!(coloring.table.len(), codes);
        }
    }

    #[test]
    fn upper_layers_are_transparent_where_free() {
        let color = |layer: LayerId, scheme, code| {
            Coloring::new(palette_of(layer, scheme), true).color_at(code, 1, 1)
        };
        let clear = Color32::TRANSPARENT;
        for layer in LayerId::ALL {
            for scheme in layer.schemes() {
                assert_eq!(color(layer, *scheme, UNKNOWN), clear, "{layer} {scheme:?}");
            }
        }
        let obstacle = |code| color(LayerId::Obstacle, Scheme::OkabeIto, code);
        assert_eq!(obstacle(1), clear);
        assert!(obstacle(2).is_opaque());
        for (layer, scheme) in [
            (LayerId::Cost, Scheme::Magma),
            (LayerId::Occupancy, Scheme::Grey),
        ] {
            let at = |value| color(layer, scheme, layer.quantisation().encode(value));
            assert_eq!(at(0.0), clear);
            assert!(at(1.0).is_opaque());
        }
        let dots = LayerId::Shore.quantisation();
        assert!(color(LayerId::Shore, Scheme::OkabeIto, dots.encode(1.0)).is_opaque());
    }

    #[test]
    fn the_lowest_layer_has_its_palette() {
        for palette in LayerId::ALL.into_iter().flat_map(LayerId::palettes) {
            let layer = palette.layer();
            let [over, lowest] = [true, false].map(|is_over| Coloring::new(palette, is_over));
            let lets_through = [LayerId::Obstacle, LayerId::Occupancy, LayerId::Cost];
            assert_eq!(over.lets_through(), lets_through.contains(&layer));
            assert!(!lowest.lets_through(), "nothing lies below it");
            assert_eq!(over.alone(UNKNOWN), Color32::TRANSPARENT);
            for code in 1..lowest.table.len() as u16 {
                assert_eq!(over.alone(code), lowest.plain(code), "{layer} {code}");
            }
        }
    }

    #[test]
    fn large_maps_are_sampled_for_fitting() {
        let layer = LayerId::Elevation;
        let mut store = store_of(&[layer]);
        // 900 tiles have 3.5 times the sampled number of cells. Heights rise from west to east.
        for index in 0..900_u16 {
            let code = layer.quantisation().encode(f32::from(index / 30) * 0.1);
            let tile = (i32::from(index / 30), i32::from(index % 30));
            publish(&mut store, layer, tile, |_, _| code);
        }
        let (low, high) = fitted_to(layer.default_palette(), &store).range();
        assert!(
            low.abs() < 1e-3 && (high - 3.0).abs() < 0.11,
            "{low} {high}"
        );
    }

    #[test]
    fn fitted_palette_omits_extreme_values() {
        let layer = LayerId::Elevation;
        let palette = layer.default_palette();
        assert_eq!(fitted_to(palette, &store_of(&[])), palette);
        let mut store = store_of(&[layer]);
        let code = |height_m| layer.quantisation().encode(height_m);
        publish(&mut store, layer, (0, 0), |x, y| match (x, y) {
            (0, 0..30) => code(90.0),
            _ => code(2.0 + y as f32 / 63.0),
        });
        let (low, high) = fitted_to(palette, &store).range();
        assert!(
            (low - 2.0).abs() < 1e-3 && (high - 3.0).abs() < 1e-3,
            "{low} {high}"
        );
    }
}
