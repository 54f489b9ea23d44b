//! The map: the layers that the model holds, one over the other, seen through a camera that the operator moves.

mod camera;
mod card_place;
mod chunk_builder;
mod chunks;
mod coloring;
mod drawing;
mod frame_time;
mod gestures;
mod layer_compositing;
mod layer_stack;
mod legend_card;
mod legend_place;
mod map_controls;
mod map_layers;
mod max_codes;
mod navigation;
mod overlays;
mod probe;
mod probe_card;
mod probe_source;
mod robot_overlay;
mod ruler;
mod scroll_keys;
mod shore_selection;
mod tile_mesh;
mod tile_presence;
mod tile_textures;
mod toolbar;
mod view_settings;

use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;

use eframe::egui::{Pos2, Rect, Vec2, vec2};
use protocol::layer::{LayerId, Palette};
use protocol::tile::TileKey;

pub use camera::Camera;
pub use layer_stack::{LayerCommand, LayerStack, StackLayer};
pub use probe::{ProbeData, ProbedCell};
pub use robot_overlay::{LastScan, RobotOverlay, SensorField, Stopping};
pub use ruler::{Leg, Ruler};
pub use shore_selection::ShoreMark;
pub use toolbar::ToolbarData;
pub use view_settings::{CameraMode, Orientation, Overlay, ViewSettings};

use crate::command::Look;
use crate::model::ConsoleModel;

use frame_time::FrameTime;
use gestures::GestureTracker;
use legend_card::LegendCard;
use map_layers::MapLayers;
use overlays::shores::is_listed;
use shore_selection::ShoreSelection;

/// Magnification of a step by key or button.
const ZOOM_STEP: f64 = 1.4;
const CARD_MARGIN: f32 = 12.0;

/// The map view. It outlives the robots it shows.
pub struct MapView {
    camera: Camera,
    settings: ViewSettings,
    screen: Rect,
    layers: MapLayers,
    /// Whether changes of the map wait to be looked at.
    is_behind: bool,
    /// Whether the operator has chosen layers of the robot that is shown.
    has_chosen_layers: bool,
    robot_overlay: RobotOverlay,
    shore_selection: ShoreSelection,
    gestures: GestureTracker,
    /// The point that is read wherever the pointer is.
    pinned_m: Option<[f64; 2]>,
    /// What is measured, while clicks measure.
    ruler: Option<Ruler>,
    /// Whether what would be under the pointer is in the middle, for hands on the keyboard.
    is_center_probed: bool,
    legends: LegendCard,
    /// How large the card with what is read was, and where the buttons were, when they were drawn last.
    card_size: Vec2,
    buttons: Rect,
    /// Lower edge of the banner of a lost link, or else the upper edge of the map.
    map_top: f32,
    /// What stands on the map but legends and scale bar, as of the last frame.
    occluders: Vec<Rect>,
}

impl Default for MapView {
    fn default() -> Self {
        Self {
            camera: Camera::default(),
            settings: ViewSettings::default(),
            screen: Rect::NOTHING,
            layers: MapLayers::default(),
            is_behind: false,
            has_chosen_layers: false,
            robot_overlay: RobotOverlay::default(),
            shore_selection: ShoreSelection::default(),
            gestures: GestureTracker::default(),
            pinned_m: None,
            ruler: None,
            is_center_probed: false,
            legends: LegendCard::default(),
            card_size: Vec2::ZERO,
            buttons: Rect::NOTHING,
            map_top: 0.0,
            occluders: Vec::new(),
        }
    }
}

impl MapView {
    /// The look of the map, to be kept.
    pub const fn settings(&self) -> &ViewSettings {
        &self.settings
    }

    /// Brings back a look that was kept.
    pub fn restore(&mut self, look: ViewSettings) {
        self.settings = look;
        if self.settings.camera_mode == CameraMode::Free {
            self.settings.camera_mode = CameraMode::FitMap;
        }
        self.camera.turn_up(FRAC_PI_2);
    }

    /// The layers.
    pub const fn stack(&self) -> &LayerStack {
        &self.settings.stack
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
    pub const fn camera_mode(&self) -> CameraMode {
        self.settings.camera_mode
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
        self.shore_selection.selected()
    }

    /// What stands out, too, because the hand was over it in a list.
    pub const fn hovered(&self) -> Option<ShoreMark> {
        self.shore_selection.hovered()
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
    pub fn set_robot_overlay(&mut self, robot_overlay: RobotOverlay) {
        self.robot_overlay = robot_overlay;
    }

    /// Another robot: nothing of the last one stays on the screen.
    pub fn forget(&mut self) {
        self.layers.forget();
        self.robot_overlay = RobotOverlay::default();
        self.shore_selection = ShoreSelection::default();
        self.has_chosen_layers = false;
        self.pinned_m = None;
        self.ruler = None;
        self.is_center_probed = false;
        self.settings.camera_mode = CameraMode::FitMap;
    }

    /// Does what is wanted of a layer.
    pub fn apply(&mut self, command: LayerCommand, model: &ConsoleModel) {
        self.has_chosen_layers = true;
        match command {
            LayerCommand::Only(layer) => {
                let layers = model.info().into_iter().flat_map(|info| &info.layers);
                let offered = layers.map(|offered| offered.layer).collect();
                self.settings.stack.show_only(layer, &offered);
            }
            LayerCommand::Fit(layer) => self.layers.fit_colors(layer, model.map().store()),
            LayerCommand::Show(..)
            | LayerCommand::Opacity(..)
            | LayerCommand::Scheme(..)
            | LayerCommand::Above(..)
            | LayerCommand::Below(..) => self.settings.stack.apply(command),
        }
    }

    /// Looks elsewhere, or otherwise.
    pub fn look(&mut self, look: Look) {
        match look {
            Look::Whole => self.settings.camera_mode = CameraMode::FitMap,
            Look::Follow(true) => self.settings.camera_mode = CameraMode::FollowVehicle,
            Look::Follow(false) => self.settings.camera_mode = CameraMode::Free,
            Look::At(point_m) => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera.center_on(point_m);
            }
            Look::In => self.zoom(self.screen.center(), ZOOM_STEP),
            Look::Out => self.zoom(self.screen.center(), 1.0 / ZOOM_STEP),
            Look::Beside([right, down]) => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera.pan(-vec2(right, down) * self.screen.size());
            }
            Look::Up(orientation) => {
                self.settings.orientation = orientation;
                if orientation == Orientation::NorthUp {
                    self.camera.turn_up(FRAC_PI_2);
                }
            }
            Look::Draw(overlay, is_on) => self.settings.draw(overlay, is_on),
            Look::Measure(is_on) => self.ruler = is_on.then(Ruler::default),
            Look::Point => {
                self.is_center_probed = true;
                self.point(self.camera.to_odom(self.screen, self.screen.center()));
            }
            Look::UndoPoint => self.undo_point(),
            Look::Mark(mark, point_m) => {
                self.shore_selection.select(mark);
                self.look(Look::At(point_m));
            }
            Look::Hover(mark) => self.shore_selection.hover(mark),
        }
    }

    /// Leaves what was begun last: measuring, or else reading one point.
    pub fn escape(&mut self) {
        self.is_center_probed = false;
        if self.ruler.take().is_none() {
            self.pinned_m = None;
        }
    }

    /// Takes over what changed in the model.
    pub fn update(&mut self, model: &mut ConsoleModel) {
        self.show_first_layer(model);
        self.shore_selection.retain(|mark| {
            let shores = model.shores();
            shores.is_some_and(|shores| is_listed(shores, model.site_names(), mark))
        });
        let changed = model.take_changed_tiles();
        let mut time = FrameTime::new();
        let is_done = self
            .layers
            .update(model.map(), changed, &self.settings.stack, &mut time);
        self.is_behind = !is_done;
    }

    /// Where a look that was kept shows nothing of what the robot maps, its first layer.
    fn show_first_layer(&mut self, model: &ConsoleModel) {
        let Some(info) = model.info().filter(|_| !self.has_chosen_layers) else {
            return;
        };
        let mut offered = info.layers.iter().map(|offered| offered.layer);
        if !offered
            .clone()
            .any(|layer| self.stack().get(layer).is_shown)
            && let Some(first) = offered.next()
        {
            self.settings.stack.apply(LayerCommand::Show(first, true));
        }
    }
}

#[cfg(test)]
mod tests;
