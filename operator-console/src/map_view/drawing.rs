//! Draws the map: the layers, and what lies over them.

use eframe::egui::accesskit::Role;
use eframe::egui::{Color32, Context, Painter, Pos2, Rect, Sense, Ui, WidgetInfo, vec2};
use measurement::time::Monotonic;
use protocol::layer::LayerId;

use super::frame_time::FrameTime;
use super::map_controls::knows_north;
use super::map_layers::MapLayers;
use super::overlays::scale_bar::{self, ScaleBar};
use super::overlays::shores::ShoreMarks;
use super::overlays::stopping::{self, Motion};
use super::overlays::vehicle::VehicleMark;
use super::overlays::{self, grid, sensors, trail};
use super::{CARD_MARGIN, MapView, Overlay, Ruler, probe, probe_card, ruler};
use crate::command::Look;
use crate::model::ConsoleModel;
use crate::panels::stale::{StaleData, is_position_old};
use crate::theme;

impl MapView {
    /// Draws the map and lets the operator move it; what the buttons on it ask for.
    pub fn show(&mut self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) -> Option<Look> {
        let (screen, response) =
            ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        self.screen = screen;
        let previous_occluders = std::mem::take(&mut self.occluders);
        self.handle_pointer(ui, &response);
        self.update_camera(model);

        let stale = StaleData::new(model, now);
        let is_stale = stale.is_some();
        let is_position_old = is_stale || is_position_old(model, now);
        let (ink, paper) = (ui.visuals().text_color(), theme::card(ui.visuals()));
        let painter = ui.painter_at(screen);
        painter.rect_filled(screen, 0.0, self.ground(ui, model));
        self.paint_layers(ui.ctx(), &painter, model);
        if is_stale {
            painter.rect_filled(screen, 0.0, theme::STALE_OVERLAY);
        }
        let bar_at = screen.left_bottom() + vec2(CARD_MARGIN, -CARD_MARGIN);
        let bar = ScaleBar::new(self.camera.points_per_m(), self.width_beside_legend());
        let bar_place = scale_bar::place(&painter, bar_at, &bar);
        if self.settings.has(Overlay::Grid) {
            let lines = grid::lines(&self.camera, screen);
            let covered = previous_occluders
                .iter()
                .copied()
                .chain(self.legends_place());
            let covered: Vec<_> = covered.chain([bar_place]).collect();
            grid::paint(&painter, &lines, (screen, &covered), ink, paper);
        }
        let vehicle_color = self.vehicle_color(is_position_old);
        self.paint_sensors(&painter, model, vehicle_color);
        let marks = self.shore_marks(model);
        marks.paint_ground(&painter, ink, paper);
        self.paint_vehicle(&painter, model, vehicle_color, is_position_old);
        marks.paint_labels(&painter, ink, paper);
        // A map that can be dragged is hovered through the buttons on it.
        let pointer = response.hover_pos().filter(|at| !self.is_occluded(*at));
        let probed_place = self.probed_place(pointer);
        let measured = self.paint_ruler(&painter, model, probed_place, &marks.labels, ink, paper);
        if self.is_center_probed {
            probe_card::paint_pin(&painter, screen.center());
        }
        response.widget_info(|| {
            let words = measured
                .as_ref()
                .map_or_else(|| "Map".to_owned(), |it| format!("Map, measured: {it}"));
            WidgetInfo::labeled(Role::Canvas, true, words)
        });
        // On a tiny map, legends that somebody opened are over it: half a bar would be of another length.
        let legends = self.legends_place();
        if legends.is_none_or(|legends| !legends.intersects(bar_place)) {
            scale_bar::paint(&painter, bar_at, &bar, ink, paper);
        }
        let has_cards = self.has_room_for_cards();
        if has_cards && let Some(pinned_m) = self.pinned_m {
            probe_card::paint_pin(&painter, self.camera.to_screen(screen, pinned_m));
        }
        // Over all that is in the map, and below all that can be pressed.
        self.banner_ui(ui, stale.as_ref());
        if has_cards {
            self.probe_ui(ui, probed_place, model, now);
        }
        if self.settings.has(Overlay::Legend) {
            self.legend_ui(ui, model);
        }
        let from_buttons = self.buttons_ui(ui);
        let from_compass = self.compass_ui(ui, model);
        if self.settings.has(Overlay::Grid) && self.occluders != previous_occluders {
            // Its numbers keep clear of what stood on the map.
            ui.ctx().request_repaint();
        }
        from_compass.or(from_buttons)
    }

    /// What the legends leave of the map's width, points.
    fn width_beside_legend(&self) -> f32 {
        let legend = if self.settings.has(Overlay::Legend) {
            self.legend_width() + CARD_MARGIN
        } else {
            0.0
        };
        self.screen.width() - legend - 2.0 * CARD_MARGIN
    }

    /// What the map lies on: the colour of what is unknown in the lowest layer, where that has one.
    fn ground(&self, ui: &Ui, model: &ConsoleModel) -> Color32 {
        let shown = MapLayers::shown(self.stack(), model.map().store());
        let lowest = shown.first();
        match lowest.map(|(held, _)| self.layers.palette(held.layer).unknown_color()) {
            Some([red, green, blue, 255]) => Color32::from_rgb(red, green, blue),
            Some([_, _, _, _]) | None => theme::ground(ui.visuals()),
        }
    }

    fn paint_layers(&mut self, ctx: &Context, painter: &Painter, model: &ConsoleModel) {
        let store = model.map().store();
        let view = (&self.camera, self.screen);
        let mut time = FrameTime::new();
        let is_made = self
            .layers
            .prepare(ctx, &self.settings.stack, store, view, &mut time);
        self.is_behind |= !is_made;
        if self.is_behind {
            ctx.request_repaint();
        }
        self.layers
            .paint(painter, &self.settings.stack, store, view);
    }

    /// What is measured, in words, where something is. Its cards stand beside `labels`.
    fn paint_ruler(
        &self,
        painter: &Painter,
        model: &ConsoleModel,
        probed_place: Option<Pos2>,
        labels: &[Rect],
        ink: Color32,
        paper: Color32,
    ) -> Option<String> {
        let ruler = self.ruler.as_ref()?;
        let mut points_m = ruler.points_m().to_vec();
        if let Some(at) = probed_place
            && points_m.len() < ruler::MAX_POINTS
            && points_m
                .last()
                .is_none_or(|last_m| !self.rests_on(*last_m, at))
        {
            points_m.push(self.camera.to_odom(self.screen, at));
        }
        let height = |point_m| probe::value_at(model.map(), LayerId::Elevation, point_m);
        let legs = Ruler::legs(&points_m, height);
        let is_on_earth = knows_north(model);
        let pieces: Vec<_> = legs.iter().map(|leg| leg.label(is_on_earth)).collect();
        let (total, view) = (ruler::total(&legs), (&self.camera, self.screen));
        let words = (&*pieces, total.as_deref());
        overlays::ruler::paint(painter, &points_m, words, view, labels, ink, paper);
        (!legs.is_empty()).then(|| {
            let words = pieces.into_iter().chain(total);
            words.collect::<Vec<_>>().join("; ")
        })
    }

    /// Whether a place on the screen is where this point (metres in `odom`) is drawn.
    fn rests_on(&self, point_m: [f64; 2], place: Pos2) -> bool {
        let drawn = self.camera.to_screen(self.screen, point_m);
        drawn.distance(place) <= overlays::ruler::POINT
    }

    /// Where the vehicle is on the screen.
    pub(super) fn vehicle_place(&self, model: &ConsoleModel) -> Option<Pos2> {
        let vehicle_m = vehicle_m(model)?;
        Some(self.camera.to_screen(self.screen, vehicle_m))
    }

    fn shore_marks(&self, model: &ConsoleModel) -> ShoreMarks {
        let marks = model.shores().map(|shores| {
            let outlines = model.shore_outlines().outlines();
            let inputs = (shores, model.site_names(), outlines);
            let (marked, vehicle_m) = (self.shore_selection.shown(), vehicle_m(model));
            ShoreMarks::new(inputs, &self.camera, self.screen, &marked, vehicle_m)
        });
        marks.unwrap_or_default()
    }

    fn vehicle_color(&self, is_old: bool) -> Color32 {
        if is_old {
            theme::VEHICLE_STALE
        } else {
            self.robot_overlay.color.unwrap_or(theme::VEHICLE)
        }
    }

    fn paint_sensors(&self, painter: &Painter, model: &ConsoleModel, vehicle: Color32) {
        let Some((pose, _)) = model.vehicle().pose() else {
            return;
        };
        if !self.settings.has(Overlay::Sensors) {
            return;
        }
        let view = (&self.camera, self.screen);
        let [x_m, y_m, _] = pose.position_m;
        let heading_rad = model.vehicle().heading_rad().unwrap_or_default();
        for field in &self.robot_overlay.sensors {
            let field_m = sensors::field_m(field, [x_m, y_m], heading_rad);
            sensors::paint_field(painter, &field_m, view, vehicle);
        }
        if let Some(scan) = &self.robot_overlay.scan {
            sensors::paint_scan(painter, scan, view, theme::SCAN);
        }
    }

    fn paint_vehicle(
        &self,
        painter: &Painter,
        model: &ConsoleModel,
        vehicle: Color32,
        is_old: bool,
    ) {
        let lines = trail::lines(model.vehicle().trail(), &self.camera, self.screen);
        let trail = if is_old {
            theme::VEHICLE_STALE
        } else {
            theme::TRAIL
        };
        trail::paint(painter, lines, trail, self.camera.points_per_m());
        let Some((pose, _)) = model.vehicle().pose() else {
            return;
        };
        let view = (&self.camera, self.screen);
        let [x_m, y_m, _] = pose.position_m;
        let heading_rad = model.vehicle().heading_rad().unwrap_or_default();
        let footprint_m = model.info().map(|info| info.footprint_m);
        let offset_m = model.info().map_or(0.0, |info| info.footprint_offset_m);
        if let (Some(stopping), Some(footprint_m), false) =
            (self.robot_overlay.stopping, footprint_m, is_old)
        {
            let motion = Motion {
                position_m: [x_m, y_m],
                heading_rad,
                speed_mps: f64::from(pose.speed_mps),
                turn_rate_radps: f64::from(pose.turn_rate_radps),
                footprint_m: footprint_m.map(f64::from),
                footprint_offset_m: f64::from(offset_m),
            };
            let swept_m = stopping::swept_m(&motion, stopping);
            stopping::paint(painter, &swept_m, view, theme::STOPPING);
        }
        VehicleMark::new(
            self.camera.to_screen(self.screen, [x_m, y_m]),
            self.camera.direction(heading_rad),
            (footprint_m, offset_m),
            self.camera.points_per_m(),
        )
        .paint(painter, vehicle);
        if let Some(barrier) = model.barrier().filter(|_| !is_old) {
            let position_m = barrier.position_m.map(f64::from);
            overlays::barrier::paint(painter, position_m, view, theme::STOPPING);
        }
    }
}

/// Where the vehicle is, metres in `odom`.
fn vehicle_m(model: &ConsoleModel) -> Option<[f64; 2]> {
    let (pose, _) = model.vehicle().pose()?;
    let [x_m, y_m, _] = pose.position_m;
    Some([x_m, y_m])
}
