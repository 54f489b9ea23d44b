//! The map: the layers of the model, drawn one over the other, with a camera that the operator moves.

mod ahead;
mod camera;
mod cards;
mod chunks;
mod coloring;
mod contour_lines;
mod drawing;
mod gestures;
mod grid;
mod labels;
mod layer_compositing;
mod legend_card;
mod map_layers;
mod marks;
mod pose_tool;
mod probe;
mod ruler;
mod shores;
mod texture_check;
mod tile_textures;
mod toolbar;
mod vehicle;
mod view_settings;

use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use eframe::egui::{Color32, CursorIcon, Frame, PointerButton, Pos2, Rect, Response, Ui, vec2};
use measurement::time::Monotonic;
use protocol::layer::{LayerId, Palette};
use protocol::message::MapPose;
use protocol::tile::TileKey;

pub use ahead::Ahead;
pub use camera::Camera;
pub use marks::Mark;
pub use pose_tool::PosePurpose;
pub use probe::{ProbeData, ProbedCell};
pub use ruler::{Leg, Ruler};
pub use toolbar::ToolbarData;
pub use view_settings::{
    CameraMode, LayerCommand, LayerStack, Orientation, Overlay, StackLayer, ViewSettings,
};

use crate::command::Look;
use crate::model::ConsoleModel;
use crate::theme;

use camera::around;
use cards::{Cards, free_parts};
use chunks::FrameTime;
use drawing::vehicle_m;
use gestures::GestureTracker;
use legend_card::LegendCard;
use map_layers::MapLayers;
use pose_tool::PoseTool;
use shores::{extent_m, is_listed};
use texture_check::TextureCheck;

const ZOOM_STEP: f64 = 1.4;
const CARD_MARGIN: f32 = 12.0;

/// The map view. It stays when another robot is shown.
#[derive(Default)]
pub struct MapView {
    camera: Camera,
    settings: ViewSettings,
    layers: MapLayers,
    texture_check: TextureCheck,
    is_behind: bool,
    /// Whether the operator has changed the layers of the shown robot.
    has_chosen_layers: bool,
    robot_overlay: RobotOverlay,
    shore_selection: ShoreSelection,
    gestures: GestureTracker,
    pinned_m: Option<[f64; 2]>,
    ruler: Option<Ruler>,
    pose_tool: Option<PoseTool>,
    /// The pose that the operator has drawn.
    said_pose: Option<(PosePurpose, MapPose)>,
    goal_offer: GoalOffer,
    is_center_probed: bool,
    legends: LegendCard,
    cards: Cards,
}

impl MapView {
    pub const fn settings(&self) -> &ViewSettings {
        &self.settings
    }

    pub fn restore(&mut self, look: ViewSettings) {
        self.settings = look;
        if self.settings.camera_mode == CameraMode::Free {
            self.settings.camera_mode = CameraMode::FitMap;
        }
        self.camera.turn_up(FRAC_PI_2);
    }

    pub const fn stack(&self) -> &LayerStack {
        &self.settings.stack
    }

    pub fn shown_layers(&self) -> BTreeSet<LayerId> {
        let shown = self.stack().layers().iter().filter(|held| held.is_shown);
        shown.map(|held| held.layer).collect()
    }

    pub fn palette(&self, layer: LayerId) -> Palette {
        self.layers.palette(layer)
    }

    pub fn tiles(&self, layer: LayerId) -> usize {
        self.layers.tiles(layer)
    }

    pub fn newest(&self, layer: LayerId) -> Option<TileKey> {
        self.layers.newest(layer)
    }

    pub const fn camera_mode(&self) -> CameraMode {
        self.settings.camera_mode
    }

    pub const fn ruler(&self) -> Option<&Ruler> {
        self.ruler.as_ref()
    }

    /// The pose that the operator has drawn since the last call.
    pub const fn take_said_pose(&mut self) -> Option<(PosePurpose, MapPose)> {
        self.said_pose.take()
    }

    pub const fn pinned_m(&self) -> Option<[f64; 2]> {
        self.pinned_m
    }

    pub const fn marked(&self) -> Option<ShoreMark> {
        self.shore_selection.selected
    }

    pub const fn hovered(&self) -> Option<ShoreMark> {
        self.shore_selection.hovered
    }

    pub fn textures(&self) -> usize {
        self.layers.textures()
    }

    /// How often a texture was not what was uploaded and was made again, if there is something new to report.
    pub fn take_repairs(&mut self, now: Monotonic) -> Option<u64> {
        self.texture_check.take_report(now)
    }

    /// Whether the last frame showed all of the map, compared with the map.
    pub const fn is_up_to_date(&self) -> bool {
        !self.is_behind && self.texture_check.is_round_equal()
    }

    /// A picture waits until the map is up to date, so it is compared in each frame.
    pub const fn hurry_checks(&mut self, is_hurried: bool) {
        self.texture_check.is_hurried = is_hurried;
    }

    pub const fn place(&self) -> Rect {
        self.camera.screen
    }

    /// `odom` (m) to screen.
    pub fn place_of(&self, point_m: [f64; 2]) -> Pos2 {
        self.camera.to_screen(point_m)
    }

    pub fn visible_m(&self) -> [f64; 4] {
        self.camera.visible_m()
    }

    pub const fn set_goal_offer(&mut self, goal_offer: GoalOffer) {
        self.goal_offer = goal_offer;
    }

    pub fn set_robot_overlay(&mut self, robot_overlay: RobotOverlay) {
        self.robot_overlay = robot_overlay;
    }

    pub fn forget(&mut self) {
        self.layers.forget();
        self.robot_overlay = RobotOverlay::default();
        self.shore_selection = ShoreSelection::default();
        self.has_chosen_layers = false;
        self.pinned_m = None;
        self.ruler = None;
        self.pose_tool = None;
        self.is_center_probed = false;
        self.settings.camera_mode = CameraMode::FitMap;
    }

    pub fn apply(&mut self, command: LayerCommand, model: &ConsoleModel) {
        self.has_chosen_layers = true;
        match command {
            LayerCommand::Only(layer) => {
                let layers = model.info().into_iter().flat_map(|info| &info.layers);
                let offered = layers.map(|offered| offered.layer).collect();
                self.settings.stack.show_only(layer, &offered);
            }
            LayerCommand::Fit(layer) => self.layers.fit_colors(layer, model.map().store()),
            LayerCommand::Labels(is_on) => self.settings.has_labels = is_on,
            _ => self.settings.stack.apply(command),
        }
    }

    pub fn look(&mut self, look: Look) {
        match look {
            Look::Whole => self.settings.camera_mode = CameraMode::FitMap,
            Look::Follow(true) => self.settings.camera_mode = CameraMode::FollowVehicle,
            Look::Follow(false) => self.settings.camera_mode = CameraMode::Free,
            Look::At(point_m) => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera.center_on(point_m);
            }
            Look::In => self.zoom(self.camera.screen.center(), ZOOM_STEP),
            Look::Out => self.zoom(self.camera.screen.center(), 1.0 / ZOOM_STEP),
            Look::Beside([right, down]) => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera
                    .pan(-vec2(right, down) * self.camera.screen.size());
            }
            Look::Up(orientation) => {
                self.settings.orientation = orientation;
                if orientation == Orientation::NorthUp {
                    self.camera.turn_up(FRAC_PI_2);
                }
            }
            Look::Draw(overlay, is_on) => self.settings.draw(overlay, is_on),
            Look::Measure(is_on) => {
                self.ruler = is_on.then(Ruler::default);
                self.pose_tool = None;
            }
            Look::SetPose(purpose) => {
                self.pose_tool = purpose.map(PoseTool::new);
                self.ruler = None;
            }
            Look::Point => {
                self.is_center_probed = true;
                self.point(self.camera.to_odom(self.camera.screen.center()));
            }
            Look::UndoPoint => self.undo_point(),
            Look::Mark(mark, point_m) => {
                self.shore_selection.selected = Some(mark);
                self.shore_selection.approach_target = Some(mark);
                self.look(Look::At(point_m));
            }
            Look::Hover(mark) => self.shore_selection.hovered = mark,
        }
    }

    /// Ends measuring or setting the pose, or else unpins the point.
    pub fn escape(&mut self) {
        self.is_center_probed = false;
        if self.ruler.take().is_none() && self.pose_tool.take().is_none() {
            self.pinned_m = None;
        }
    }

    pub fn update(&mut self, model: &mut ConsoleModel) {
        self.show_first_layer(model);
        self.pose_tool = self.pose_tool.filter(|tool| match tool.purpose {
            PosePurpose::Locate => can_set_pose(model),
            PosePurpose::Goal => self.goal_offer == GoalOffer::Available,
        });
        let is_listed = |mark: &ShoreMark| {
            let shores = model.shores();
            shores.is_some_and(|shores| is_listed(shores, *mark))
        };
        let selection = &mut self.shore_selection;
        selection.selected = selection.selected.filter(is_listed);
        let changed = model.take_changed_tiles();
        let (stack, mut time) = (&self.settings.stack, FrameTime::new());
        self.is_behind = !self.layers.update(model.map(), changed, stack, &mut time);
    }

    /// Shows the robot's first layer if the settings show none of its layers.
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

/// The camera follows pointer, gestures and keys, or the map and the vehicle.
impl MapView {
    pub(super) fn handle_pointer(
        &mut self,
        ui: &Ui,
        response: &Response,
        vehicle_m: Option<[f64; 2]>,
    ) {
        let drag = response.drag_delta();
        let buttons = [
            PointerButton::Primary,
            PointerButton::Middle,
            PointerButton::Secondary,
        ];
        let pose_tool = self.pose_tool.as_mut();
        let said = pose_tool.and_then(|tool| {
            let pose = tool.drag(response, &self.camera, vehicle_m)?;
            Some((tool.purpose, pose))
        });
        self.said_pose = said.or(self.said_pose);
        let pulls = |button: &&PointerButton| {
            self.pose_tool.is_none() || **button != PointerButton::Primary
        };
        let mut buttons = buttons.iter().filter(pulls);
        let is_pulled = buttons.any(|button| response.dragged_by(*button));
        if is_pulled && drag != vec2(0.0, 0.0) {
            self.camera.pan(drag);
            self.settings.camera_mode = CameraMode::Free;
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        } else if (self.ruler.is_some() || self.pose_tool.is_some()) && response.hovered() {
            ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
        }
        if response.hovered() && ui.input(|input| input.pointer.delta() != vec2(0.0, 0.0)) {
            self.is_center_probed = false;
        }
        if let Some(at) = response.interact_pointer_pos()
            && !self.is_occluded(at)
        {
            self.click(response, at);
        }
        if let Some(at) = response.hover_pos() {
            let gesture = ui.input(|input| self.gestures.take(input));
            if gesture.push != vec2(0.0, 0.0) {
                self.camera.pan(gesture.push);
                self.settings.camera_mode = CameraMode::Free;
            }
            if gesture.zooms() {
                self.zoom(at, gesture.factor);
            }
        }
    }

    fn click(&mut self, response: &Response, at: Pos2) {
        if self.pose_tool.is_some() {
            return;
        }
        let point_m = self.camera.to_odom(at);
        if self.ruler.is_none() && response.double_clicked() {
            self.pinned_m = None;
            self.camera.center_on(point_m);
            self.settings.camera_mode = CameraMode::Free;
        } else if response.clicked() {
            self.point(point_m);
        } else if self.ruler.is_some() && response.secondary_clicked() {
            self.undo_point();
        }
    }

    pub(super) fn point(&mut self, point_m: [f64; 2]) {
        match &mut self.ruler {
            Some(ruler) => ruler.add(point_m),
            None => self.pinned_m = Some(point_m),
        }
    }

    pub(super) fn undo_point(&mut self) {
        match &mut self.ruler {
            Some(ruler) => ruler.undo_point(),
            None => self.pinned_m = None,
        }
    }

    pub(super) fn probed_place(&self, pointer: Option<Pos2>) -> Option<Pos2> {
        if self.is_center_probed {
            Some(self.camera.screen.center())
        } else {
            pointer
        }
    }

    /// In follow mode the vehicle stays centred; in fit mode zooming ends the mode.
    pub(super) fn zoom(&mut self, at: Pos2, factor: f64) {
        match self.settings.camera_mode {
            CameraMode::FollowVehicle => {
                self.camera.zoom_about(self.camera.screen.center(), factor);
            }
            CameraMode::FitMap | CameraMode::Free => {
                self.settings.camera_mode = CameraMode::Free;
                self.camera.zoom_about(at, factor);
            }
        }
    }

    pub(super) fn update_camera(&mut self, model: &ConsoleModel) {
        let vehicle_m = vehicle_m(model);
        if self.settings.orientation == Orientation::RobotUp
            && let Some(heading_rad) = model.vehicle().heading_rad()
        {
            self.camera.turn_up(heading_rad);
        }
        self.approach(model);
        match self.settings.camera_mode {
            CameraMode::Free => {}
            CameraMode::FollowVehicle => {
                if let Some(vehicle_m) = vehicle_m {
                    self.camera.center_on(vehicle_m);
                }
            }
            CameraMode::FitMap => {
                let map_m = self
                    .layers
                    .bounds_m(&self.settings.stack, model.map().store());
                if let Some(bounds_m) = with_point(map_m, vehicle_m) {
                    self.fit(bounds_m);
                }
            }
        }
    }

    fn approach(&mut self, model: &ConsoleModel) {
        if let Some(mark) = self.shore_selection.approach_target.take()
            && let Some(shores) = model.shores()
        {
            let extent_m = extent_m(shores, mark);
            // A removed shore has no extent.
            if !extent_m.is_empty() {
                self.camera.approach(around(&extent_m));
            }
        }
    }

    /// Fits the whole map beside all cards, where it is largest.
    fn fit(&mut self, bounds_m: [f64; 4]) {
        let screen = self.camera.screen;
        let fitted = |part: Rect| {
            let mut camera = self.camera;
            camera.fit(part, bounds_m);
            (camera, part.area())
        };
        let parts = free_parts(screen, &self.cards()).into_iter().map(fitted);
        let largest = parts.max_by(|(a, a_area), (b, b_area)| {
            let by_scale = a.points_per_m.total_cmp(&b.points_per_m);
            by_scale.then(a_area.total_cmp(b_area))
        });
        (self.camera, _) = largest.unwrap_or_else(|| fitted(screen));
    }
}

/// The robot searches for itself in a saved map and takes settings.
fn can_set_pose(model: &ConsoleModel) -> bool {
    let localization = model.localization().newest();
    model.takes_settings() && localization.is_some_and(|newest| newest.is_searching)
}

fn with_point(bounds_m: Option<[f64; 4]>, point_m: Option<[f64; 2]>) -> Option<[f64; 4]> {
    let Some([x, y]) = point_m else {
        return bounds_m;
    };
    let [low_x, low_y, high_x, high_y] = bounds_m.unwrap_or([x, y, x, y]);
    Some([low_x.min(x), low_y.min(y), high_x.max(x), high_y.max(y)])
}

fn card_frame(ui: &Ui, margin: f32) -> Frame {
    let frame = Frame::new().fill(theme::card(ui.visuals()));
    frame.corner_radius(4.0).inner_margin(margin)
}

/// Whether the operator can send a planner to a goal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GoalOffer {
    /// Neither does this console drive, nor is there a planner.
    #[default]
    None,
    NoPlanner,
    NotDriving,
    Available,
}

impl GoalOffer {
    pub const fn new(has_planner: bool, drives: bool) -> Self {
        match (has_planner, drives) {
            (false, false) => Self::None,
            (false, true) => Self::NoPlanner,
            (true, false) => Self::NotDriving,
            (true, true) => Self::Available,
        }
    }

    /// Whether its tool is on, or why it cannot be.
    const fn button(self, is_on: bool) -> Option<Result<bool, &'static str>> {
        match self {
            Self::None => None,
            Self::NoPlanner => Some(Err("No planner takes goals on this vehicle")),
            Self::NotDriving => Some(Err(
                "Request control first: a planner drives under your lease",
            )),
            Self::Available => Some(Ok(is_on)),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotOverlay {
    pub stopping: Option<Stopping>,
    pub sensors: Vec<SensorField>,
    pub scan: Option<LastScan>,
    /// Set if several robots are known.
    pub color: Option<Color32>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stopping {
    pub decel_mps2: f64,
    pub command_age_s: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SensorField {
    /// Position in `base`, x and y, m.
    pub mount_m: [f64; 2],
    /// Direction of its middle, radians, counter-clockwise from x of `base`.
    pub mount_rad: f64,
    pub field_rad: f64,
    /// Minimum and maximum range, m.
    pub range_m: [f64; 2],
}

#[derive(Clone, Debug, PartialEq)]
pub struct LastScan {
    /// m in `odom`.
    pub points_m: Vec<[f64; 2]>,
    pub age: Duration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShoreMark {
    /// Number of a shore.
    Shore(u32),
    /// Number of a docking site.
    Site(u32),
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct ShoreSelection {
    hovered: Option<ShoreMark>,
    selected: Option<ShoreMark>,
    /// Selected, not approached yet.
    approach_target: Option<ShoreMark>,
}

impl ShoreSelection {
    fn shown(&self) -> Vec<ShoreMark> {
        let hovered = self.hovered.filter(|mark| self.selected != Some(*mark));
        self.selected.into_iter().chain(hovered).collect()
    }
}

#[cfg(test)]
mod tests;
