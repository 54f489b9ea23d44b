//! The map: the layers that the model holds, one over the other, seen through a camera that the operator moves.

mod beneath;
mod camera;
mod card_place;
mod chunk_build;
mod chunks;
mod coloring;
mod drawing;
mod edges;
mod frame_time;
mod gestures;
mod highest_codes;
mod known_tiles;
mod legend_card;
mod legend_place;
mod look;
mod map_layers;
mod marking;
mod navigation;
mod overlays;
mod probe;
mod probe_card;
mod probe_source;
mod quads;
mod ruler;
mod scroll_keys;
mod stack;
mod surroundings;
mod tile_textures;
mod toolbar;

use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;

use eframe::egui::{Pos2, Rect, Vec2, vec2};
use protocol::layer::{LayerId, Palette};
use protocol::tile::TileKey;

pub use camera::Camera;
pub use look::{MapLook, Orientation, Overlay, Sight};
pub use marking::ShoreMark;
pub use probe::{ProbeData, ProbedCell};
pub use ruler::{Leg, Ruler};
pub use stack::{LayerCommand, LayerStack, StackLayer};
pub use surroundings::{LastScan, SensorField, Stopping, Surroundings};
pub use toolbar::ToolbarData;

use crate::command::Look;
use crate::model::ConsoleModel;

use frame_time::FrameTime;
use gestures::Gestures;
use legend_card::LegendCard;
use map_layers::MapLayers;
use marking::Marking;
use overlays::shores::is_told;

/// Magnification of a step by key or button.
const ZOOM_STEP: f64 = 1.4;
const CARD_MARGIN: f32 = 12.0;

/// The map view. It outlives the robots it shows.
pub struct MapView {
    camera: Camera,
    look: MapLook,
    screen: Rect,
    layers: MapLayers,
    /// Whether changes of the map wait to be looked at.
    is_behind: bool,
    /// Whether the operator has chosen layers of the robot that is shown.
    has_chosen: bool,
    surroundings: Surroundings,
    marking: Marking,
    gestures: Gestures,
    /// The point that is read wherever the pointer is.
    pinned_m: Option<[f64; 2]>,
    /// What is measured, while clicks measure.
    ruler: Option<Ruler>,
    /// Whether what would be under the pointer is in the middle, for hands on the keyboard.
    is_aiming: bool,
    legends: LegendCard,
    /// How large the card with what is read was, and where the buttons were, when they were drawn last.
    card_size: Vec2,
    buttons: Rect,
    /// Lower edge of the banner of a lost link, or else the upper edge of the map.
    roof: f32,
    /// What stands on the map but legends and scale bar, as of the last frame.
    standing: Vec<Rect>,
}

impl Default for MapView {
    fn default() -> Self {
        Self {
            camera: Camera::default(),
            look: MapLook::default(),
            screen: Rect::NOTHING,
            layers: MapLayers::default(),
            is_behind: false,
            has_chosen: false,
            surroundings: Surroundings::default(),
            marking: Marking::default(),
            gestures: Gestures::default(),
            pinned_m: None,
            ruler: None,
            is_aiming: false,
            legends: LegendCard::default(),
            card_size: Vec2::ZERO,
            buttons: Rect::NOTHING,
            roof: 0.0,
            standing: Vec::new(),
        }
    }
}

impl MapView {
    /// The look of the map, to be kept.
    pub const fn look_state(&self) -> &MapLook {
        &self.look
    }

    /// Brings back a look that was kept.
    pub fn restore(&mut self, look: MapLook) {
        self.look = look;
        if self.look.sight == Sight::Free {
            self.look.sight = Sight::Whole;
        }
        self.camera.turn_up(FRAC_PI_2);
    }

    /// The layers.
    pub const fn stack(&self) -> &LayerStack {
        &self.look.stack
    }

    /// The layers that are wanted of the robot.
    pub fn shown_layers(&self) -> BTreeSet<LayerId> {
        let shown = self.stack().layers().iter().filter(|held| held.is_shown);
        shown.map(|held| held.layer).collect()
    }

    /// The colours of a layer, over the values that they are spread over now.
    pub fn palette(&self, layer: LayerId) -> Palette {
        self.layers.palette(layer)
    }

    /// Known tiles of a layer.
    pub fn tiles(&self, layer: LayerId) -> usize {
        self.layers.tiles(layer)
    }

    /// The tile of a layer that was measured last.
    pub fn newest(&self, layer: LayerId) -> Option<TileKey> {
        self.layers.newest(layer)
    }

    /// What the camera keeps in sight.
    pub const fn sight(&self) -> Sight {
        self.look.sight
    }

    /// What is measured, while clicks measure.
    pub const fn ruler(&self) -> Option<&Ruler> {
        self.ruler.as_ref()
    }

    /// The point that is read wherever the pointer is, metres in `odom`.
    pub const fn pinned_m(&self) -> Option<[f64; 2]> {
        self.pinned_m
    }

    /// The shore or docking site that a click in a list showed last, while there is one.
    pub const fn marked(&self) -> Option<ShoreMark> {
        self.marking.chosen()
    }

    /// What stands out, too, because the hand was over it in a list.
    pub const fn hovered(&self) -> Option<ShoreMark> {
        self.marking.hovered()
    }

    /// Textures that are held, a mebibyte each.
    pub fn textures(&self) -> usize {
        self.layers.textures()
    }

    /// Whether everything that changed is on the screen.
    pub const fn is_up_to_date(&self) -> bool {
        !self.is_behind
    }

    /// Where it is on the screen, as of the last frame.
    pub const fn place(&self) -> Rect {
        self.screen
    }

    /// Where a point of `odom`, metres, is on the screen.
    pub fn place_of(&self, point_m: [f64; 2]) -> Pos2 {
        self.camera.to_screen(self.screen, point_m)
    }

    /// Lowest and greatest x and y on the screen, metres in `odom`.
    pub fn visible_m(&self) -> [f64; 4] {
        self.camera.visible_m(self.screen)
    }

    /// What is drawn on the map and is not in it, from now on.
    pub fn surround(&mut self, surroundings: Surroundings) {
        self.surroundings = surroundings;
    }

    /// Another robot: nothing of the last one stays on the screen.
    pub fn forget(&mut self) {
        self.layers.forget();
        self.surroundings = Surroundings::default();
        self.marking = Marking::default();
        self.has_chosen = false;
        self.pinned_m = None;
        self.ruler = None;
        self.is_aiming = false;
        self.look.sight = Sight::Whole;
    }

    /// Does what is wanted of a layer.
    pub fn obey(&mut self, command: LayerCommand, model: &ConsoleModel) {
        self.has_chosen = true;
        match command {
            LayerCommand::Only(layer) => {
                let layers = model.info().into_iter().flat_map(|info| &info.layers);
                let offered = layers.map(|offered| offered.layer).collect();
                self.look.stack.show_only(layer, &offered);
            }
            LayerCommand::Fit(layer) => self.layers.fit_colors(layer, model.map().store()),
            LayerCommand::Show(..)
            | LayerCommand::Opacity(..)
            | LayerCommand::Scheme(..)
            | LayerCommand::Above(..)
            | LayerCommand::Below(..) => self.look.stack.obey(command),
        }
    }

    /// Looks elsewhere, or otherwise.
    pub fn look(&mut self, look: Look) {
        match look {
            Look::Whole => self.look.sight = Sight::Whole,
            Look::Follow(true) => self.look.sight = Sight::Vehicle,
            Look::Follow(false) => self.look.sight = Sight::Free,
            Look::At(point_m) => {
                self.look.sight = Sight::Free;
                self.camera.center_on(point_m);
            }
            Look::In => self.zoom(self.screen.center(), ZOOM_STEP),
            Look::Out => self.zoom(self.screen.center(), 1.0 / ZOOM_STEP),
            Look::Beside([right, down]) => {
                self.look.sight = Sight::Free;
                self.camera.pan(-vec2(right, down) * self.screen.size());
            }
            Look::Up(orientation) => {
                self.look.orientation = orientation;
                if orientation == Orientation::NorthUp {
                    self.camera.turn_up(FRAC_PI_2);
                }
            }
            Look::Draw(overlay, is_on) => self.look.draw(overlay, is_on),
            Look::Measure(is_on) => self.ruler = is_on.then(Ruler::default),
            Look::Point => {
                self.is_aiming = true;
                self.point(self.camera.to_odom(self.screen, self.screen.center()));
            }
            Look::TakeBack => self.take_back(),
            Look::Mark(mark, point_m) => {
                self.marking.choose(mark);
                self.look(Look::At(point_m));
            }
            Look::Hover(mark) => self.marking.hover(mark),
        }
    }

    /// Leaves what was begun last: measuring, or else reading one point.
    pub fn escape(&mut self) {
        self.is_aiming = false;
        if self.ruler.take().is_none() {
            self.pinned_m = None;
        }
    }

    /// Takes over what changed in the model.
    pub fn update(&mut self, model: &mut ConsoleModel) {
        self.show_something(model);
        self.marking.keep(|mark| {
            let shores = model.shores();
            shores.is_some_and(|shores| is_told(shores, model.site_names(), mark))
        });
        let changed = model.take_changed_tiles();
        let mut time = FrameTime::new();
        let is_done = self
            .layers
            .update(model.map(), changed, &self.look.stack, &mut time);
        self.is_behind = !is_done;
    }

    /// Where a look that was kept shows nothing of what the robot maps, its first layer.
    fn show_something(&mut self, model: &ConsoleModel) {
        let Some(info) = model.info().filter(|_| !self.has_chosen) else {
            return;
        };
        let mut offered = info.layers.iter().map(|offered| offered.layer);
        if !offered
            .clone()
            .any(|layer| self.stack().get(layer).is_shown)
            && let Some(first) = offered.next()
        {
            self.look.stack.obey(LayerCommand::Show(first, true));
        }
    }
}

#[cfg(test)]
mod tests;
