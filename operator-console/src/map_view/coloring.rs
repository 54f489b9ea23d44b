//! Codes → colours on the screen, and which values they are spread over.

use eframe::egui::Color32;
use protocol::layer::{LayerId, Palette, Pattern, Quantisation, Scheme, UNKNOWN};
use protocol::tile::{TILE_CELLS, TileCells};
use protocol::tile_store::TileStore;

/// A palette as a table, so that a cell costs one look-up.
#[derive(Clone, Debug)]
pub(super) struct Coloring {
    palette: Palette,
    table: Vec<Color32>,
    /// The pattern of each code and the colour of its marks; empty where the layer's classes have none.
    marks: Vec<(Pattern, Color32)>,
}

impl Coloring {
    pub(super) fn new(palette: Palette) -> Self {
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
        Self {
            palette,
            table: codes().map(|code| of(palette.color(code))).collect(),
            marks: codes().filter(|_| has_patterns).map(mark).collect(),
        }
    }

    /// The colours of `layer` that go by `scheme`; the layer's default where it has no such.
    pub(super) fn of_scheme(layer: LayerId, scheme: Scheme) -> Self {
        let palette = layer.palettes().find(|palette| palette.scheme() == scheme);
        Self::new(palette.unwrap_or_else(|| layer.default_palette()))
    }

    pub(super) const fn palette(&self) -> &Palette {
        &self.palette
    }

    /// Whether a colour depends on where it is.
    pub(super) fn has_patterns(&self) -> bool {
        !self.marks.is_empty()
    }

    /// The colour of a texel of a cell: `x` counts to the right, `y` down.
    pub(super) fn color_at(&self, code: u16, x: usize, y: usize) -> Color32 {
        match self.marks.get(usize::from(code)) {
            Some((pattern, color)) if pattern.is_mark(x, y) => *color,
            Some(_) | None => self
                .table
                .get(usize::from(code))
                .copied()
                .unwrap_or_default(),
        }
    }

    /// The colour of unknown cells.
    pub(super) fn unknown(&self) -> Color32 {
        self.table.first().copied().unwrap_or_default()
    }
}

/// `palette` over all but the lowest and highest 1 % of the cells in `store`, as exported pictures have it.
pub(super) fn fitted_to(palette: Palette, store: &TileStore) -> Palette {
    let layer = palette.layer();
    let mut counts = vec![0_u64; usize::from(u16::MAX) + 1];
    for cells in store.tiles(layer).filter_map(|(_, tile)| tile.cells()) {
        count(&mut counts, cells);
    }
    counts[usize::from(UNKNOWN)] = 0;
    let known: u64 = counts.iter().sum();
    let value_of_rank = |rank: u64| {
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

fn count(counts: &mut [u64], cells: &TileCells) {
    let codes: &[u16; TILE_CELLS] = cells.codes();
    for code in codes {
        counts[usize::from(*code)] += 1;
    }
}

#[cfg(test)]
mod tests {
    use protocol::tile::{BootId, TileKey};
    use protocol::tile_store::LayerGrid;

    use super::*;

    #[test]
    fn the_table_is_the_palette() {
        for palette in LayerId::ALL.into_iter().flat_map(LayerId::palettes) {
            let coloring = Coloring::new(palette);
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
