//! The map: one layer of what the model holds, seen through a camera that the operator moves.

mod camera;
mod chunks;
mod coloring;
mod known_tiles;
mod overlays;
mod probe;

mod tile_textures;
mod toolbar;

use eframe::egui::{
    Align, Color32, Context, CursorIcon, Key, Layout, Painter, PointerButton, Pos2, Rect, Response,
    Sense, Ui, UiBuilder, vec2,
};
use protocol::layer::{LayerId, Palette, Scheme};
use robot_edge::clock::Monotonic;

pub use camera::Camera;
pub use probe::ProbeData;
pub use toolbar::{Sight, ToolbarData};

use crate::command::Look;
use crate::model::ConsoleModel;
use crate::panels::stale::{StaleData, is_position_old};
use crate::theme;

use coloring::{Coloring, fitted_to};
use known_tiles::KnownTiles;
use overlays::scale_bar::{self, ScaleBar};
use overlays::shores::ShoreMarks;
use overlays::trail;
use overlays::vehicle::VehicleMark;
use tile_textures::{LayerLook, TileTextures};

/// Magnification of a step by key or button.
const ZOOM_STEP: f64 = 1.4;
/// Points of scrolling that magnify e-fold.
const SCROLL_PER_E: f64 = 450.0;
const CARD_MARGIN: f32 = 12.0;

/// The map view. It outlives the robots it shows.
pub struct MapView {
    camera: Camera,
    sight: Sight,
    screen: Rect,
    coloring: Coloring,
    known: KnownTiles,
    textures: TileTextures,
    /// Tiles known when the colours were fitted last.
    fitted_at: usize,
}

impl Default for MapView {
    fn default() -> Self {
        Self {
            camera: Camera::default(),
            sight: Sight::Whole,
            screen: Rect::NOTHING,
            coloring: Coloring::new(LayerId::Occupancy.default_palette()),
            known: KnownTiles::default(),
            textures: TileTextures::default(),
            fitted_at: 0,
        }
    }
}

impl MapView {
    /// The layer that is shown.
    pub const fn layer(&self) -> LayerId {
        self.coloring.palette().layer()
    }

    /// The colours it is shown in.
    pub const fn palette(&self) -> &Palette {
        self.coloring.palette()
    }

    /// What the camera keeps in sight.
    pub const fn sight(&self) -> Sight {
        self.sight
    }

    /// Lowest and greatest x and y on the screen, metres in `odom`.
    pub fn visible_m(&self) -> [f64; 4] {
        self.camera.visible_m(self.screen)
    }

    /// Another robot: nothing of the last one stays on the screen.
    pub fn forget(&mut self) {
        self.known = KnownTiles::default();
        self.textures.clear();
        self.sight = Sight::Whole;
        self.fitted_at = 0;
    }

    /// Shows another layer.
    pub fn show_layer(&mut self, layer: LayerId, model: &ConsoleModel) {
        if layer != self.layer() {
            self.known = KnownTiles::of_layer(model.map().store(), layer);
            self.fitted_at = 0;
            self.recolor(Coloring::new(layer.default_palette()));
        }
    }

    /// Shows the layer in other colours.
    pub fn show_scheme(&mut self, scheme: Scheme) {
        if scheme != self.palette().scheme() {
            self.fitted_at = 0;
            self.recolor(Coloring::of_scheme(self.layer(), scheme));
        }
    }

    /// Spreads the colours over the values of the map.
    pub fn fit_colors(&mut self, model: &ConsoleModel) {
        let fitted = fitted_to(*self.palette(), model.map().store());
        self.fitted_at = self.known.len();
        if fitted != *self.palette() {
            self.recolor(Coloring::new(fitted));
        }
    }

    /// Looks elsewhere.
    pub fn look(&mut self, look: Look) {
        match look {
            Look::Whole => self.sight = Sight::Whole,
            Look::Follow(true) => self.sight = Sight::Vehicle,
            Look::Follow(false) => self.sight = Sight::Free,
            Look::At(point_m) => {
                self.sight = Sight::Free;
                self.camera.center_on(point_m);
            }
            Look::In => self.zoom(self.screen.center(), ZOOM_STEP),
            Look::Out => self.zoom(self.screen.center(), 1.0 / ZOOM_STEP),
        }
    }

    /// Takes over what changed in the model.
    pub fn update(&mut self, model: &mut ConsoleModel) {
        let offered = model.info().map(|info| &info.layers);
        let is_offered = |layer| offered.is_none_or(|all| all.iter().any(|one| one.layer == layer));
        if !is_offered(self.layer())
            && let Some(first) = offered.and_then(|all| all.first())
        {
            self.show_layer(first.layer, model);
        }
        let layer = self.layer();
        let changed = model.take_changed_tiles();
        let store = model.map().store();
        for key in changed.into_iter().filter(|key| key.layer == layer) {
            self.known.update(store, key);
            self.textures.changed((key.tx, key.ty));
        }
        // Heights are not known beforehand: as the map grows, so does the range of its colours, seldom
        // enough that a colour keeps its meaning.
        if self.palette().scheme() == Scheme::Cividis
            && self.known.len() >= 2 * self.fitted_at.max(1)
        {
            self.fit_colors(model);
        }
    }

    /// What the map says under the pointer, where that is over the map.
    pub fn probe(&self, ctx: &Context, model: &ConsoleModel, now: Monotonic) -> Option<ProbeData> {
        let at = ctx.pointer_latest_pos()?;
        self.screen.contains(at).then(|| {
            let point_m = self.camera.to_odom(self.screen, at);
            ProbeData::new(model.map(), self.layer(), point_m, now)
        })
    }

    /// Draws the map and lets the operator move it; what the buttons on it ask for.
    pub fn show(&mut self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) -> Option<Look> {
        let (screen, response) =
            ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        self.screen = screen;
        self.move_by_hand(ui, &response);
        let from_keys = (!ui.ctx().egui_wants_keyboard_input())
            .then(|| look_of_keys(ui.ctx(), self.sight))
            .flatten();
        self.keep_in_sight(model);

        let is_stale = StaleData::new(model, now).is_some();
        let is_position_old = is_stale || is_position_old(model, now);
        let painter = ui.painter_at(screen);
        painter.rect_filled(screen, 0.0, self.ground(ui));
        self.paint_tiles(ui.ctx(), &painter, model);
        if is_stale {
            painter.rect_filled(screen, 0.0, theme::STALE_VEIL);
        }
        self.paint_shores(ui, &painter, model);
        self.paint_vehicle(&painter, model, is_position_old);
        scale_bar::paint(
            &painter,
            screen.left_bottom() + vec2(CARD_MARGIN, -CARD_MARGIN),
            &ScaleBar::new(self.camera.points_per_m()),
            ui.visuals().text_color(),
            theme::card(ui.visuals()),
        );
        let from_buttons = self.buttons_ui(ui);
        from_keys.or(from_buttons)
    }

    fn buttons_ui(&self, ui: &mut Ui) -> Option<Look> {
        let top_right = UiBuilder::new()
            .max_rect(self.screen.shrink(CARD_MARGIN))
            .layout(Layout::top_down(Align::Max));
        ui.scope_builder(top_right, |ui| {
            toolbar::toolbar_ui(ui, ToolbarData { sight: self.sight })
        })
        .inner
    }

    fn move_by_hand(&mut self, ui: &Ui, response: &Response) {
        let drag = response.drag_delta();
        let is_pulled = [
            PointerButton::Primary,
            PointerButton::Middle,
            PointerButton::Secondary,
        ]
        .into_iter()
        .any(|button| response.dragged_by(button));
        if is_pulled && drag != vec2(0.0, 0.0) {
            self.camera.pan(drag);
            self.sight = Sight::Free;
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        }
        if let Some(at) = response.interact_pointer_pos()
            && response.double_clicked()
        {
            let point_m = self.camera.to_odom(self.screen, at);
            self.camera.center_on(point_m);
            self.sight = Sight::Free;
        }
        if let Some(at) = response.hover_pos() {
            let (pinch, scroll) =
                ui.input(|input| (input.zoom_delta(), input.smooth_scroll_delta().y));
            let factor = f64::from(pinch) * libm::exp(f64::from(scroll) / SCROLL_PER_E);
            if (factor - 1.0).abs() > 1e-6 {
                self.zoom(at, factor);
            }
        }
    }

    /// Who follows the vehicle goes on following it; who saw the whole map chose a part of it.
    fn zoom(&mut self, at: Pos2, factor: f64) {
        match self.sight {
            Sight::Vehicle => self
                .camera
                .zoom_about(self.screen, self.screen.center(), factor),
            Sight::Whole | Sight::Free => {
                self.sight = Sight::Free;
                self.camera.zoom_about(self.screen, at, factor);
            }
        }
    }

    fn keep_in_sight(&mut self, model: &ConsoleModel) {
        let vehicle_m = model.vehicle().pose().map(|(pose, _)| {
            let [x, y, _] = pose.position_m;
            [x, y]
        });
        match self.sight {
            Sight::Free => {}
            Sight::Vehicle => {
                if let Some(vehicle_m) = vehicle_m {
                    self.camera.center_on(vehicle_m);
                }
            }
            Sight::Whole => {
                let cell_m = model.map().store().cell_m(self.layer());
                let map_m = cell_m.and_then(|cell_m| {
                    let edges = self.known.bounds_cells()?;
                    Some(edges.map(|cell| cell as f64 * cell_m))
                });
                if let Some(bounds_m) = with_point(map_m, vehicle_m) {
                    self.camera.fit(self.fit_screen(), bounds_m);
                }
            }
        }
    }

    /// The screen as `fit` takes it: the same middle, but away from bar, buttons and edges.
    fn fit_screen(&self) -> Rect {
        self.screen
            .shrink2(vec2(0.0, toolbar::HEIGHT + CARD_MARGIN))
    }

    fn ground(&self, ui: &Ui) -> Color32 {
        match self.palette().unknown_color() {
            [red, green, blue, 255] => Color32::from_rgb(red, green, blue),
            [_, _, _, _] => theme::ground(ui.visuals()),
        }
    }

    fn paint_tiles(&mut self, ctx: &Context, painter: &Painter, model: &ConsoleModel) {
        let store = model.map().store();
        let Some(cell_m) = store.cell_m(self.layer()) else {
            return;
        };
        let look = LayerLook {
            layer: self.layer(),
            cell_m,
            store,
            known: &self.known,
            coloring: &self.coloring,
        };
        if !self.textures.prepare(ctx, &look, &self.camera, self.screen) {
            ctx.request_repaint();
        }
        self.textures
            .paint(painter, &self.camera, self.screen, cell_m);
    }

    fn paint_shores(&self, ui: &Ui, painter: &Painter, model: &ConsoleModel) {
        if let Some(shores) = model.shores() {
            let (ink, paper) = (ui.visuals().text_color(), theme::card(ui.visuals()));
            let marks = ShoreMarks::new(shores, &self.camera, self.screen);
            marks.paint(painter, ink, paper);
        }
    }

    fn paint_vehicle(&self, painter: &Painter, model: &ConsoleModel, is_old: bool) {
        let lines = trail::lines(model.vehicle().trail(), &self.camera, self.screen);
        let (vehicle, trail) = if is_old {
            (theme::VEHICLE_STALE, theme::VEHICLE_STALE)
        } else {
            (theme::VEHICLE, theme::TRAIL)
        };
        trail::paint(painter, lines, trail, self.camera.points_per_m());
        let Some((pose, _)) = model.vehicle().pose() else {
            return;
        };
        let [x_m, y_m, _] = pose.position_m;
        VehicleMark::new(
            self.camera.to_screen(self.screen, [x_m, y_m]),
            model.vehicle().heading_rad().unwrap_or_default(),
            model.info().map(|info| info.footprint_m),
            self.camera.points_per_m(),
        )
        .paint(painter, vehicle);
    }

    fn recolor(&mut self, coloring: Coloring) {
        self.coloring = coloring;
        self.textures.clear();
    }
}

fn with_point(bounds_m: Option<[f64; 4]>, point_m: Option<[f64; 2]>) -> Option<[f64; 4]> {
    let Some([x, y]) = point_m else {
        return bounds_m;
    };
    let [low_x, low_y, high_x, high_y] = bounds_m.unwrap_or([x, y, x, y]);
    Some([low_x.min(x), low_y.min(y), high_x.max(x), high_y.max(y)])
}

fn look_of_keys(ctx: &Context, sight: Sight) -> Option<Look> {
    ctx.input(|input| {
        if input.modifiers.any() && !input.modifiers.shift_only() {
            return None;
        }
        [
            (Key::F, Look::Whole),
            (Key::V, Look::Follow(sight != Sight::Vehicle)),
            (Key::Plus, Look::In),
            (Key::Equals, Look::In),
            (Key::Minus, Look::Out),
        ]
        .into_iter()
        .find_map(|(key, look)| input.key_pressed(key).then_some(look))
    })
}
