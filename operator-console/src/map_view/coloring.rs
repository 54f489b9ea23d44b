//! Codes → colours on the screen, and which values they are spread over.
//!
//! The lowest layer that is shown has the colours of its palette. What lies over another lets through where it has
//! nothing to say: free cells of obstacles, low probabilities and low costs, where a layer below knows anything, and the
//! unknown of every layer.

use eframe::egui::Color32;
use protocol::layer::{LayerId, Palette, Pattern, Quantisation, Scheme, UNKNOWN};
use protocol::tile::TILE_SIDE;
use protocol::tile_store::TileStore;

/// Cells that are looked at to fit colours, at most: about 2 ms. Of a larger map, rows and tiles are left out evenly.
const MAX_FITTED_CELLS: usize = 1 << 20;

/// A palette as a table, so that a cell costs one look-up.
#[derive(Clone, Debug)]
pub(super) struct Coloring {
    palette: Palette,
    is_over: bool,
    table: Vec<Color32>,
    /// The same where nothing is known below; empty where that makes no difference.
    alone: Vec<Color32>,
    /// The pattern of each code and the colour of its marks; empty where the layer's classes have none.
    marks: Vec<(Pattern, Color32)>,
}

impl Coloring {
    /// The colours of `palette` for a layer that lies over another, or over none.
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
        // What is unknown is left to what lies below, or to what the map lies on.
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

    pub(super) const fn palette(&self) -> &Palette {
        &self.palette
    }

    /// Whether they are those of a layer over another.
    pub(super) const fn is_over(&self) -> bool {
        self.is_over
    }

    /// Whether what is known below makes a difference.
    pub(super) fn lets_through(&self) -> bool {
        !self.alone.is_empty()
    }

    /// The colour of a code where nothing is known below.
    pub(super) fn alone(&self, code: u16) -> Color32 {
        let color = self.alone.get(usize::from(code));
        color.copied().unwrap_or_else(|| self.plain(code))
    }

    /// Whether a colour depends on where it is.
    pub(super) fn has_patterns(&self) -> bool {
        !self.marks.is_empty()
    }

    /// The colour of a texel of a cell: `x` counts to the right, `y` down.
    pub(super) fn color_at(&self, code: u16, x: usize, y: usize) -> Color32 {
        match self.marks.get(usize::from(code)) {
            Some((pattern, color)) if pattern.is_mark(x, y) => *color,
            Some(_) | None => self.plain(code),
        }
    }

    /// The colour of a code where nothing has a pattern.
    pub(super) fn plain(&self, code: u16) -> Color32 {
        let color = self.table.get(usize::from(code));
        color.copied().unwrap_or_default()
    }

    /// The colour of unknown cells.
    pub(super) fn unknown(&self) -> Color32 {
        self.table.first().copied().unwrap_or_default()
    }
}

/// The palette of `layer` that goes by `scheme`; the layer's default where it has no such.
pub(super) fn palette_of(layer: LayerId, scheme: Scheme) -> Palette {
    let mut palettes = layer.palettes();
    let palette = palettes.find(|palette| palette.scheme() == scheme);
    palette.unwrap_or_else(|| layer.default_palette())
}

/// How much of what lies below a cell of `layer` hides: 0 nothing … 1 everything.
fn cover(layer: LayerId, code: u16) -> f32 {
    let Some(value) = layer.quantisation().decode(code) else {
        return 0.0;
    };
    match layer {
        LayerId::Obstacle => f32::from(value > 0.0),
        LayerId::Occupancy => ((value - 0.25) / 0.5).clamp(0.0, 1.0),
        LayerId::Cost => (value / 0.3).clamp(0.0, 1.0),
        LayerId::Elevation | LayerId::Rigidity | LayerId::Shore => 1.0,
    }
}

/// `palette` over all but the lowest and highest 1 % of the cells in `store`, as exported pictures have it; of a great
/// map, of cells spread over all of it.
pub(super) fn fitted_to(palette: Palette, store: &TileStore) -> Palette {
    let layer = palette.layer();
    let mut counts = vec![0_u32; usize::from(u16::MAX) + 1];
    let tiles = || store.tiles(layer).filter_map(|(_, tile)| tile.cells());
    let rows = tiles().count() * TILE_SIDE;
    // Odd, so that it is not the same rows of every tile.
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
    use protocol::tile::{BootId, TileCells, TileKey};
    use protocol::tile_store::LayerGrid;

    use super::*;

    #[test]
    fn the_table_is_the_palette() {
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
    fn what_lies_over_another_layer_lets_through_where_nothing_is() {
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
    fn what_lies_over_nothing_known_has_the_colours_of_its_palette() {
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
    fn a_great_map_is_fitted_by_a_part_of_it() {
        let layer = LayerId::Elevation;
        let mut store = TileStore::new(BootId([1; 16]), 10);
        store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        // 900 tiles are 3.5 times as many cells as are looked at; heights rise from west to east.
        for index in 0..900_u16 {
            let code = layer.quantisation().encode(f32::from(index / 30) * 0.1);
            let key = TileKey {
                layer,
                tx: i32::from(index / 30),
                ty: i32::from(index % 30),
            };
            let cells = TileCells::from_fn(|_, _| code);
            drop(store.publish(key, cells).unwrap());
        }
        let (low, high) = fitted_to(layer.default_palette(), &store).range();
        assert!(
            low.abs() < 1e-3 && (high - 3.0).abs() < 0.11,
            "{low} {high}"
        );
    }

    #[test]
    fn a_fitted_palette_leaves_out_the_last_hundredth() {
        let layer = LayerId::Elevation;
        let mut store = TileStore::new(BootId([1; 16]), 10);
        let palette = layer.default_palette();
        assert_eq!(fitted_to(palette, &store), palette);
        store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        let code = |height_m| layer.quantisation().encode(height_m);
        let cells = TileCells::from_fn(|x, y| match (x, y) {
            (0, 0..30) => code(90.0),
            _ => code(2.0 + y as f32 / 63.0),
        });
        let key = TileKey {
            layer,
            tx: 0,
            ty: 0,
        };
        drop(store.publish(key, cells).unwrap());
        let (low, high) = fitted_to(palette, &store).range();
        assert!(
            (low - 2.0).abs() < 1e-3 && (high - 3.0).abs() < 1e-3,
            "{low} {high}"
        );
    }
}
