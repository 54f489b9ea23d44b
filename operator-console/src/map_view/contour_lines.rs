//! Depth contours over the layer of depths, with numbers. Pieces are kept tile by tile, so that a change costs the tiles
//! around it only.

use std::collections::{BTreeMap, BTreeSet};

use eframe::egui::{Align2, Color32, FontId, Painter, Rect, Stroke, vec2};
use protocol::contours::contours_of_tile;
use protocol::layer::LayerId;
use protocol::tile::{TILE_SIDE, TileKey};
use protocol::tile_store::TileStore;

use super::camera::Camera;
use super::chunks::{FrameTime, TILE_CELLS};

const INK: Color32 = Color32::from_rgb(30, 36, 52);
const PAPER: Color32 = Color32::from_rgba_premultiplied(160, 165, 170, 170);
const WIDTH: f32 = 1.0;
const FONT: f32 = 11.0;
/// Lines in smaller cells are not drawn, points: they would cover the colours.
const CELL_MIN: f64 = 0.8;
/// Smaller tiles have no number, points.
const NUMBERED_TILE_MIN: f64 = 90.0;

#[derive(Default)]
pub(super) struct ContourLines {
    tiles: BTreeMap<(i32, i32), TileLines>,
    stale: BTreeSet<(i32, i32)>,
}

/// In cells from the tile's lower left corner.
#[derive(Clone, Debug, Default, PartialEq)]
struct TileLines {
    pieces: Vec<[[f32; 2]; 2]>,
    /// A depth, m, and where it is on its line: nearest to the middle of the tile.
    number: Option<(f32, [f32; 2])>,
}

impl ContourLines {
    /// A tile has changed; lines depend on the cells beside theirs.
    pub(super) fn change(&mut self, key: TileKey) {
        if key.layer == LayerId::Depth {
            for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                let beside = key.tx.checked_add(dx).zip(key.ty.checked_add(dy));
                self.stale.extend(beside);
            }
        }
    }

    /// Computes stale tiles within `time`. Returns whether none is left.
    pub(super) fn update(&mut self, store: &TileStore, time: &mut FrameTime) -> bool {
        let cells = |(tx, ty)| {
            let layer = LayerId::Depth;
            store.get(TileKey { layer, tx, ty })?.cells()
        };
        while !self.stale.is_empty() && time.take_tile() {
            let Some(at) = self.stale.pop_first() else {
                break;
            };
            self.tiles.remove(&at);
            if cells(at).is_some() {
                self.tiles.insert(at, TileLines::of(at, cells));
            }
        }
        self.stale.is_empty()
    }

    pub(super) fn paint(&self, painter: &Painter, camera: &Camera, cell_m: f64) {
        let cell_points = camera.points_per_m * cell_m;
        if cell_points < CELL_MIN {
            return;
        }
        let tile_m = TILE_CELLS as f64 * cell_m;
        let [west, south, east, north] = camera.visible_m();
        let is_visible = |(tx, ty): (i32, i32)| {
            let [x, y] = [tx, ty].map(|tile| f64::from(tile) * tile_m);
            x < east && x + tile_m > west && y < north && y + tile_m > south
        };
        let visible = || self.tiles.iter().filter(|(at, _)| is_visible(**at));
        let screen = |(tx, ty): (i32, i32), [x, y]: [f32; 2]| {
            let along =
                |tile: i32, cells: f32| f64::from(tile) * tile_m + f64::from(cells) * cell_m;
            camera.to_screen([along(tx, x), along(ty, y)])
        };
        for (at, lines) in visible() {
            for ends in &lines.pieces {
                let ends = ends.map(|end| screen(*at, end));
                painter.line_segment(ends, Stroke::new(WIDTH, INK));
            }
        }
        if TILE_CELLS as f64 * cell_points < NUMBERED_TILE_MIN {
            return;
        }
        for (at, lines) in visible() {
            if let Some((depth_m, place)) = lines.number {
                let font = FontId::proportional(FONT);
                let text = painter.layout_no_wrap(depth_m.to_string(), font, INK);
                let place = screen(*at, place);
                let card = Rect::from_center_size(place, text.size() + vec2(3.0, 0.0));
                painter.rect_filled(card, 2.0, PAPER);
                let corner = Align2::CENTER_CENTER.anchor_size(place, text.size()).min;
                painter.galley(corner, text, INK);
            }
        }
    }
}

impl TileLines {
    fn of<'a>(
        at: (i32, i32),
        cells: impl Fn((i32, i32)) -> Option<&'a protocol::tile::TileCells>,
    ) -> Self {
        let first = [at.0, at.1].map(|tile| i64::from(tile) * TILE_CELLS);
        let middle = 0.5 * TILE_SIDE as f32;
        let mut lines = Self::default();
        let mut nearest = f32::INFINITY;
        for piece in contours_of_tile(at, cells) {
            let within = |axis: usize, cells: f64| (cells - first[axis] as f64) as f32;
            let ends = piece.ends.map(|[x, y]| [within(0, x), within(1, y)]);
            let [x, y] = ends[0];
            let away = (x - middle).abs() + (y - middle).abs();
            if away < nearest {
                nearest = away;
                lines.number = Some((piece.depth_m, ends[0]));
            }
            lines.pieces.push(ends);
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::publish;
    use super::*;
    use crate::test_support::store_of;

    #[test]
    fn lines_follow_the_tiles_around_a_change() {
        let mut store = store_of(&[LayerId::Depth]);
        let mut lines = ContourLines::default();
        let code = |depth_m| LayerId::Depth.quantisation().encode(depth_m);
        let slope = |x: usize, _| code(1.0 + x as f32 * 0.02);
        for tile in [(0, 0), (1, 0)] {
            lines.change(publish(&mut store, LayerId::Depth, tile, slope));
        }
        assert!(!lines.update(&store, &mut FrameTime::of_tiles(3)));
        assert!(lines.update(&store, &mut FrameTime::of_tiles(100)));
        assert_eq!(lines.tiles.len(), 2, "not of unknown tiles");
        // 1.5 m and 2 m, and the jump back to 1 m where the second tile begins.
        let of = |lines: &ContourLines, tile| lines.tiles[&tile].clone();
        let first = of(&lines, (0, 0));
        let on_line = first
            .pieces
            .iter()
            .flatten()
            .filter(|[x, _]| (x - 25.5).abs() < 0.1);
        assert_eq!(on_line.count(), 2 * 63);
        assert_eq!(first.number.map(|(depth_m, _)| depth_m), Some(1.5));
        // The neighbour changes: so do the lines along the edge.
        lines.change(publish(&mut store, LayerId::Depth, (1, 0), |_, _| {
            code(2.2)
        }));
        assert!(lines.update(&store, &mut FrameTime::of_tiles(100)));
        assert_ne!(of(&lines, (0, 0)), first);
        assert_eq!(of(&lines, (1, 0)).pieces, [] as [[[f32; 2]; 2]; 0]);
        let (layer, tx, ty) = (LayerId::Cost, 0, 0);
        lines.change(TileKey { layer, tx, ty });
        assert!(lines.stale.is_empty());
    }
}
