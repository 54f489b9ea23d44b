use eframe::egui::{self, RawInput, Shape, vec2};
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::super::coloring::Coloring;
use super::super::layer_compositing::{IndexedLayer, TilePresence};
use super::super::tests::{publish, store_of};
use super::*;

const LAYER: LayerId = LayerId::Occupancy;
const CELL_M: f64 = 0.1;
const ALLOWANCE: usize = 60;

/// Position (`None` for a whole texture) and size.
type Upload = (Option<[usize; 2]>, [usize; 2]);

struct Rig {
    ctx: Context,
    store: TileStore,
    known: TilePresence,
    coloring: Coloring,
    textures: TileTextures,
    camera: Camera,
}

fn screen() -> Rect {
    Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0))
}

impl Rig {
    fn new() -> Self {
        Self {
            ctx: Context::default(),
            store: store_of(&[LAYER]),
            known: TilePresence::default(),
            coloring: Coloring::new(LAYER.default_palette(), false),
            textures: TileTextures::default(),
            camera: Camera::on(screen()),
        }
    }

    fn put(&mut self, tile: (i32, i32), code: u16) {
        let key = publish(&mut self.store, LAYER, tile, |_, _| code);
        self.known.update(&self.store, key);
        self.textures.changed(tile);
    }

    /// Whether all is done after a frame with time for `tiles` tiles, and its uploads.
    fn frame_of(&mut self, tiles: usize) -> (bool, Vec<Upload>) {
        let bounds_cells = self.known.bounds_cells();
        let style = LayerStyle {
            indexed: IndexedLayer {
                layer: LAYER,
                cell_m: CELL_M,
                store: &self.store,
                known: &self.known,
            },
            coloring: &self.coloring,
            below: &[],
        };
        let mut time = FrameTime::of_tiles(tiles);
        let view = &self.camera;
        let is_complete =
            self.textures
                .prepare(&self.ctx, style, view, bounds_cells, ALLOWANCE, &mut time);
        let mut delta = self.ctx.tex_manager().write().take_delta();
        let mut uploads: Vec<_> = delta
            .set
            .values()
            .flatten()
            .map(|part| (part.pos, part.image.size()))
            .filter(|(at, size)| at.is_some() || *size == [512; 2])
            .collect();
        uploads.sort_unstable();
        delta.clear();
        (is_complete, uploads)
    }

    fn frame(&mut self) -> (bool, Vec<Upload>) {
        self.frame_of(usize::MAX)
    }

    fn look_at(&mut self, center_m: [f64; 2], points_per_m: f64) {
        let factor = points_per_m / self.camera.points_per_m;
        self.camera.zoom_about(screen().center(), factor);
        self.camera.center_on(center_m);
    }

    /// Drawn rectangles in `odom`, m.
    fn drawn_m(&self) -> Vec<[f64; 4]> {
        let input = RawInput {
            screen_rect: Some(screen()),
            ..RawInput::default()
        };
        let mut output = self.ctx.run_ui(input, |ui| {
            let painter = ui.ctx().layer_painter(egui::LayerId::background());
            let view = &self.camera;
            self.textures.paint(&painter, view, CELL_M, 0.5);
        });
        output.textures_delta.clear();
        let meshes = output.shapes.iter().filter_map(|shape| {
            let Shape::Mesh(mesh) = &shape.shape else {
                return None;
            };
            Some(mesh.calc_bounds())
        });
        let pieces = meshes.map(|bounds| {
            let [low_x, low_y] = self.camera.to_odom(bounds.left_bottom());
            let [high_x, high_y] = self.camera.to_odom(bounds.right_top());
            [low_x, low_y, high_x, high_y]
        });
        pieces.collect()
    }
}

#[test]
fn a_changed_tile_uploads_only_its_part() {
    let mut rig = Rig::new();
    assert_eq!(rig.frame(), (true, vec![]), "an empty map has no textures");
    rig.put((0, 0), 1);
    rig.put((-1, 0), 251);
    assert_eq!(rig.frame(), (true, vec![(None, [512, 512]); 2]));
    assert_eq!(rig.frame(), (true, vec![]));
    rig.put((1, 0), 251);
    rig.put((-1, 0), 3);
    assert_eq!(
        rig.frame(),
        (
            true,
            vec![(Some([64, 448]), [64, 64]), (Some([448, 448]), [64, 64])]
        )
    );
    assert_eq!(rig.frame(), (true, vec![]));
}

#[test]
fn many_changes_recreate_a_chunk() {
    let mut rig = Rig::new();
    for index in 0..4_900 {
        rig.put((index % 70, index / 70), 251);
    }
    // 448 m on 600 points: level 3 with 64×64 tiles per chunk and 8×8 texels per tile.
    rig.look_at([224.0, 224.0], 1.25);
    // The base is one chunk of level 4.
    assert_eq!(rig.frame().1, vec![(None, [512, 512]); 5]);
    rig.put((69, 69), 1);
    let parts = vec![(Some([40, 464]), [8, 8]), (Some([276, 232]), [4, 4])];
    assert_eq!(rig.frame(), (true, parts));
    for index in 0..100 {
        rig.put((index % 10, index / 10), 1);
    }
    assert_eq!(rig.frame(), (true, vec![(None, [512, 512]); 2]));
}

#[test]
fn distant_tiles_cost_little() {
    let mut rig = Rig::new();
    rig.put((0, 0), 1);
    rig.frame();
    rig.put((1000, 1000), 1);
    // The base becomes coarser and contains the new tile.
    let (is_complete, uploads) = rig.frame();
    assert!(is_complete && uploads.len() <= 2, "{uploads:?}");
    assert_eq!(rig.frame(), (true, vec![]));
    rig.look_at([6400.0, 6400.0], 40.0);
    assert_eq!(rig.frame(), (true, vec![(None, [512, 512])]));
}

#[test]
fn textures_are_limited_and_recreated() {
    let mut rig = Rig::new();
    for column in 0..200 {
        rig.put((8 * column, 0), 1);
    }
    for column in 0..200 {
        rig.look_at([f64::from(column) * 51.2 + 1.0, 1.0], 40.0);
        assert!(rig.frame().0);
        assert!(rig.textures.len() <= ALLOWANCE);
    }
    assert_eq!(rig.textures.len(), ALLOWANCE);
    rig.look_at([1.0, 1.0], 40.0);
    assert!(rig.frame().1.contains(&(None, [512, 512])));
    assert_eq!(rig.frame().1, []);
}

#[test]
fn missing_chunks_are_replaced_without_holes() {
    let mut rig = Rig::new();
    for index in 0..4_900 {
        rig.put((index % 70, index / 70), 251);
    }
    rig.look_at([224.0, 224.0], 1.25);
    assert!(rig.frame().0);
    // Closer, without time for new chunks.
    for (points_per_m, turn_rad) in [(9.0, 0.0), (3.0, 0.0), (1.25, 0.0), (0.4, 0.0)] {
        rig.camera.turn_up(std::f64::consts::FRAC_PI_2 + turn_rad);
        rig.look_at([200.0, 210.0], points_per_m);
        let (is_complete, uploads) = rig.frame_of(0);
        assert_eq!(uploads, []);
        let seen = rig.camera.visible_m();
        let known = [0.0, 0.0, 448.0, 448.0];
        let expected_m2 = area_m2(overlap(seen, known));
        let drawn_m = rig.drawn_m();
        // Textures are empty beyond known cells, so their drawn area there does not matter.
        let drawn_m2: f64 = drawn_m
            .iter()
            .map(|piece| area_m2(overlap(overlap(*piece, seen), known)))
            .sum();
        let part = drawn_m2 / expected_m2;
        assert!(
            (part - 1.0).abs() < 1e-3,
            "{points_per_m}: {part}, {is_complete}"
        );
    }
}

#[test]
fn a_rotated_map_needs_few_more_chunks() {
    let mut rig = Rig::new();
    for index in 0..4_900 {
        rig.put((index % 70, index / 70), 251);
    }
    rig.look_at([224.0, 224.0], 10.0);
    rig.frame();
    let straight = rig.textures.visible.len();
    rig.camera.turn_up(0.7);
    rig.frame();
    let turned = rig.textures.visible.len();
    assert!(turned <= 2 * straight, "{turned} and {straight}");
}

#[test]
fn recoloring_leaves_no_hole() {
    let mut rig = Rig::new();
    rig.put((0, 0), 1);
    rig.frame();
    rig.textures.recolor();
    let (is_complete, uploads) = rig.frame_of(0);
    assert_eq!((is_complete, uploads), (false, vec![]));
    assert!(!rig.drawn_m().is_empty(), "the old ones are drawn");
    assert_eq!(rig.frame(), (true, vec![(None, [512, 512])]));
}

#[test]
fn a_chunk_built_over_several_frames_misses_no_change() {
    let mut rig = Rig::new();
    for index in 0..40 {
        rig.put((index % 8, index / 8), 251);
    }
    assert_eq!(rig.frame_of(25), (false, vec![]));
    rig.put((0, 0), 1);
    rig.put((7, 7), 1);
    assert_eq!(rig.frame_of(30), (false, vec![(None, [512, 512])]));
    // (0, 0) was still to be painted; (7, 7) is new.
    assert_eq!(rig.frame(), (true, vec![(Some([448, 0]), [64, 64])]));
}

fn overlap(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0].max(b[0]),
        a[1].max(b[1]),
        a[2].min(b[2]),
        a[3].min(b[3]),
    ]
}

fn area_m2([low_x, low_y, high_x, high_y]: [f64; 4]) -> f64 {
    (high_x - low_x).max(0.0) * (high_y - low_y).max(0.0)
}
