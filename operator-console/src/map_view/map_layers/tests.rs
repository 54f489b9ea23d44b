use eframe::egui::{Color32, ColorImage, ImageData, Rect, pos2, vec2};

use super::super::layer_stack::LayerCommand;
use super::super::probe::tests::model_of;
use super::super::tests::{publish, store_of};
use super::*;
use crate::model::ConsoleModel;
use crate::test_support::{at, push_tile};

struct Rig {
    ctx: Context,
    robot: TileStore,
    model: ConsoleModel,
    layers: MapLayers,
    stack: LayerStack,
}

impl Rig {
    /// Costs that are free everywhere above shores in the upper half.
    fn new() -> Self {
        let mut robot = store_of(&[LayerId::Cost, LayerId::Shore]);
        let free = LayerId::Cost.quantisation().encode(0.0);
        publish(&mut robot, LayerId::Cost, (0, 0), |_, _| free);
        publish(&mut robot, LayerId::Shore, (0, 0), |_, y| {
            u16::from(y >= 32)
        });
        let mut stack = LayerStack::default();
        stack.apply(LayerCommand::Below(LayerId::Shore, LayerId::Cost));
        Self {
            ctx: Context::default(),
            model: model_of(&robot),
            robot,
            layers: MapLayers::default(),
            stack,
        }
    }

    /// The robot maps shores in these rows (by y).
    fn find_shores(&mut self, code: u16, rows: std::ops::Range<usize>) {
        let shore = |_, y| code * u16::from(rows.contains(&y));
        let key = publish(&mut self.robot, LayerId::Shore, (0, 0), shore);
        push_tile(&mut self.model, &self.robot, key, at(2_100));
    }

    /// Images uploaded in a frame.
    fn frame(&mut self) -> Vec<ColorImage> {
        let changed = self.model.take_changed_tiles();
        let mut time = FrameTime::of_tiles(usize::MAX);
        let map = self.model.map();
        let is_done = self.layers.update(map, changed, &self.stack, &mut time);
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(800.0, 600.0));
        let (camera, store) = (Camera::on(screen), map.store());
        let view = &camera;
        let is_made = self
            .layers
            .prepare(&self.ctx, &self.stack, store, view, &mut time);
        assert!(is_done && is_made);
        let mut delta = self.ctx.tex_manager().write().take_delta();
        let images = delta.set.values().flatten().map(|part| {
            let ImageData::Color(image) = &part.image;
            ColorImage::clone(image)
        });
        let images = images.collect();
        delta.clear();
        images
    }

    /// Colour of free ground over unknown cells.
    fn free(&self) -> Color32 {
        let palette = self.layers.palette(LayerId::Cost);
        Coloring::new(palette, false).plain(LayerId::Cost.quantisation().encode(0.0))
    }
}

/// Columns and rows of these pixels, from the upper left.
fn places(images: &[ColorImage], color: Color32) -> Vec<[usize; 2]> {
    let places = images.iter().flat_map(|image| {
        let pixels = image.pixels.iter().enumerate();
        let found = pixels.filter(move |(_, pixel)| **pixel == color);
        found.map(|(at, _)| [at % image.width(), at / image.width()])
    });
    places.collect()
}

#[test]
fn free_cells_have_colour_over_unknown_cells() {
    let mut rig = Rig::new();
    let images = rig.frame();
    // The tile is in the lower left corner of its chunk, 64 texels wide; shores are known in its upper half.
    let seen = places(&images, rig.free());
    assert_eq!(seen.len(), 64 * 32);
    assert!(seen.iter().all(|[x, y]| *x < 64 && *y >= 512 - 32));
    assert_eq!(rig.frame(), []);

    // Other shore classes do not change the costs.
    let is_clear = |image: &ColorImage| {
        let mut pixels = image.pixels.iter();
        image.size == [64, 64] && pixels.all(|pixel| *pixel == Color32::TRANSPARENT)
    };
    rig.find_shores(2, 32..64);
    let images = rig.frame();
    assert_eq!(places(&images, rig.free()), [] as [[usize; 2]; 0]);
    assert!(!images.is_empty() && !images.iter().any(is_clear));
    // Costs become transparent over new shores.
    rig.find_shores(2, 0..64);
    assert_eq!(
        rig.frame().iter().filter(|image| is_clear(image)).count(),
        1
    );
    rig.find_shores(2, 63..64);
    let seen = places(&rig.frame(), rig.free());
    assert_eq!(seen.len(), 64 * 63);
    assert!(seen.iter().all(|[_, y]| *y > 0));
}

#[test]
fn invisible_layers_do_not_count_as_below() {
    let mut rig = Rig::new();
    rig.frame();
    rig.stack.apply(LayerCommand::Opacity(LayerId::Shore, 0.0));
    let seen = places(&rig.frame(), rig.free());
    assert_eq!(seen.len(), 64 * 64);
    rig.stack.apply(LayerCommand::Opacity(LayerId::Shore, 0.1));
    assert_eq!(places(&rig.frame(), rig.free()).len(), 64 * 32);
    // The lowest layer does not depend on the others.
    rig.stack
        .apply(LayerCommand::Below(LayerId::Cost, LayerId::Shore));
    let textures = rig.layers.textures();
    assert_eq!(places(&rig.frame(), rig.free()).len(), 64 * 64);
    assert_eq!(rig.layers.textures(), textures);
}
