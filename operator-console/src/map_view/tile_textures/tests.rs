use eframe::egui::vec2;
use protocol::tile::{BootId, TileCells};
use protocol::tile_store::LayerGrid;

use super::*;

const LAYER: LayerId = LayerId::Occupancy;
const CELL_M: f64 = 0.1;

/// Place (`None` for a whole texture) and size.
type Upload = (Option<[usize; 2]>, [usize; 2]);

struct Rig {
    ctx: Context,
    store: TileStore,
    known: KnownTiles,
    coloring: Coloring,
    textures: TileTextures,
    camera: Camera,
}

impl Rig {
    fn new() -> Self {
        let mut store = TileStore::new(BootId([1; 16]), 100);
        store
            .set_grid(LayerGrid {
                layer: LAYER,
                cell_m: CELL_M,
            })
            .unwrap();
        Self {
            ctx: Context::default(),
            store,
            known: KnownTiles::default(),
            coloring: Coloring::new(LAYER.default_palette()),
            textures: TileTextures::default(),
            camera: Camera::default(),
        }
    }

    fn put(&mut self, (tx, ty): (i32, i32), code: u16) {
        let key = TileKey {
            layer: LAYER,
            tx,
            ty,
        };
        drop(
            self.store
                .publish(key, TileCells::from_fn(|_, _| code))
                .unwrap(),
        );
        self.known.update(&self.store, key);
        self.textures.changed((tx, ty));
    }

    /// Whether nothing is left to do after one frame, and what it uploads.
    fn frame(&mut self) -> (bool, Vec<Upload>) {
        let look = LayerLook {
            layer: LAYER,
            cell_m: CELL_M,
            store: &self.store,
            known: &self.known,
            coloring: &self.coloring,
        };
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0));
        let is_complete = self
            .textures
            .prepare(&self.ctx, &look, &self.camera, screen);
        let mut delta = self.ctx.tex_manager().write().take_delta();
        let mut uploads: Vec<_> = delta
            .set
            .values()
            .flatten()
            .map(|part| (part.pos, part.image.size()))
            .filter(|(at, size)| at.is_some() || *size == [CHUNK_TEXELS; 2])
            .collect();
        uploads.sort_unstable();
        delta.clear();
        (is_complete, uploads)
    }

    fn look_at(&mut self, center_m: [f64; 2], points_per_m: f64) {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0));
        let factor = points_per_m / self.camera.points_per_m();
        self.camera.zoom_about(screen, screen.center(), factor);
        self.camera.center_on(center_m);
    }
}

#[test]
fn a_changed_tile_changes_exactly_its_part_and_nothing_is_uploaded_twice() {
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
fn a_tile_far_away_costs_nothing_until_it_is_seen() {
    let mut rig = Rig::new();
    rig.put((0, 0), 1);
    rig.frame();
    rig.put((1000, 1000), 1);
    assert_eq!(rig.frame(), (true, vec![]));
    rig.look_at([6400.0, 6400.0], 40.0);
    assert_eq!(rig.frame(), (true, vec![(None, [512, 512])]));
}

#[test]
fn textures_are_bounded_and_come_again() {
    let mut rig = Rig::new();
    for column in 0..200 {
        rig.put((8 * column, 0), 1);
    }
    for column in 0..200 {
        rig.look_at([f64::from(column) * 51.2 + 1.0, 1.0], 40.0);
        assert!(rig.frame().0);
        assert!(rig.textures.len() <= MAX_CHUNKS);
    }
    assert_eq!(rig.textures.len(), MAX_CHUNKS);
    rig.look_at([1.0, 1.0], 40.0);
    assert!(rig.frame().1.contains(&(None, [512, 512])));
    assert_eq!(rig.frame().1, []);
}

#[test]
fn a_great_map_takes_several_frames_and_few_textures() {
    let mut rig = Rig::new();
    for index in 0..4_900 {
        rig.put((index % 70, index / 70), 251);
    }
    // 448 m on 600 points: the third level, where a chunk is 64×64 tiles.
    rig.look_at([224.0, 224.0], 1.25);
    let mut frames = 0;
    while !rig.frame().0 {
        frames += 1;
        assert!(frames < 10);
    }
    // The first is more than a frame's worth.
    assert_eq!((frames, rig.textures.len()), (1, 4));
    rig.put((69, 69), 1);
    assert_eq!(rig.frame(), (true, vec![(Some([40, 464]), [8, 8])]));
}
