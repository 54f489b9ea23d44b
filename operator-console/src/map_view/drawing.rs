//! Draws the map: layers, overlays, cards and buttons.

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align, Align2, Area, Color32, Context, Frame, Id, Layout, Order, Painter, Pos2, Rect, Sense,
    Ui, UiBuilder, WidgetInfo, pos2, vec2,
};
use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::message::CollisionMonitorState;

use super::chunks::FrameTime;
use super::grid::{self, COMPASS_SIZE, CompassData, ScaleBar};
use super::legend_card::{Drawn, LegendPlace};
use super::map_layers::MapLayers;
use super::marks::Mark;
use super::probe::{self, ProbeData};
use super::shores::ShoreMarks;
use super::toolbar::{self, ToolbarData};
use super::vehicle::{self, Motion, VehicleMark};
use super::{CARD_MARGIN, CameraMode, MapView, Overlay, Ruler, legend_card, ruler};
use crate::command::Look;
use crate::model::ConsoleModel;
use crate::panels::data_age::{StaleData, is_position_old, stale_ui};
use crate::panels::notice::NoticeRoom;
use crate::theme;

const PADDING: f32 = 8.0;
/// Distance of cards above the scale bar from the lower edge, points.
const OVER_SCALE_BAR: f32 = 60.0;
/// Size of the longest scale bar with its margins, points.
const SCALE_BAR: [f32; 2] = [190.0, OVER_SCALE_BAR];
/// Smaller maps have no probe card, because it would hide them. Width and height, points.
pub(super) const MIN_MAP_FOR_CARDS: [f32; 2] = [200.0, 160.0];
/// A narrower card has too many lines, points.
const MIN_CARD_WIDTH: f32 = 330.0;
/// On narrower maps the probe card has short texts, points.
const NARROW: f32 = 480.0;
/// Maximum number of drawn scan points; more are subsampled.
const MAX_SCAN_POINTS: usize = 4_000;
/// Scan points fade until this age.
const SCAN_LIFETIME: Duration = Duration::from_secs(2);
/// Large enough for the obstacle to be visible inside, points.
const RING_RADIUS: f32 = 10.0;

impl MapView {
    pub fn show(&mut self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) -> Option<Look> {
        let (screen, response) =
            ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        self.camera.screen = screen;
        let previous_occluders = std::mem::take(&mut self.occluders);
        self.handle_pointer(ui, &response);
        self.update_camera(model);

        let stale = StaleData::new(model, now);
        let is_stale = stale.is_some();
        let is_position_old = is_stale || is_position_old(model, now);
        let (ink, paper) = (ui.visuals().text_color(), theme::card(ui.visuals()));
        let painter = ui.painter_at(screen);
        painter.rect_filled(screen, 0.0, self.ground(ui, model));
        self.paint_layers(ui.ctx(), &painter, model, now);
        if is_stale {
            painter.rect_filled(screen, 0.0, theme::STALE_OVERLAY);
        }
        let bar_at = screen.left_bottom() + vec2(CARD_MARGIN, -CARD_MARGIN);
        let bar = ScaleBar::new(self.camera.points_per_m, self.width_beside_legend());
        let (bar_place, bar_text) = grid::scale_bar_card(&painter, bar_at, &bar, ink);
        if self.settings.has(Overlay::Grid) {
            let lines = grid::grid_lines(&self.camera);
            let covered = previous_occluders
                .iter()
                .copied()
                .chain(self.legends_place());
            let covered: Vec<_> = covered.chain([bar_place]).collect();
            grid::paint_grid(&painter, &lines, (screen, &covered), ink, paper);
        }
        self.paint_sensors(&painter, model);
        let marks = self.shore_marks(model);
        marks.paint_ground(&painter, ink, paper);
        self.paint_vehicle(&painter, model, is_position_old);
        marks.paint_labels(&painter, ink, paper);
        // A draggable map is also hovered through its buttons.
        let pointer = response.hover_pos().filter(|at| !self.is_occluded(*at));
        let probed_place = self.probed_place(pointer);
        let labels = marks.label_places();
        let measured = self.paint_ruler(&painter, model, probed_place, &labels, ink, paper);
        if self.is_center_probed {
            probe::paint_pin(&painter, screen.center());
        }
        response.widget_info(|| {
            let words = measured
                .as_ref()
                .map_or_else(|| "Map".to_owned(), |it| format!("Map, measured: {it}"));
            WidgetInfo::labeled(Role::Canvas, true, words)
        });
        // On a tiny map opened legends may cover the scale bar. A partly covered bar would show a wrong length.
        let legends = self.legends_place();
        if legends.is_none_or(|legends| !legends.intersects(bar_place)) {
            grid::paint_scale_bar(&painter, &bar, (bar_place, bar_text), ink, paper);
        }
        let has_cards = self.has_room_for_cards();
        if has_cards && let Some(pinned_m) = self.pinned_m {
            probe::paint_pin(&painter, self.camera.to_screen(pinned_m));
        }
        // Above the map, below the buttons.
        self.banner_ui(ui, stale.as_ref());
        if has_cards {
            self.probe_ui(ui, probed_place, model, now);
        }
        if self.settings.has(Overlay::Legend) {
            self.legend_ui(ui, model, is_position_old);
        }
        let from_buttons = self.buttons_ui(ui);
        let from_compass = self.compass_ui(ui, model);
        if self.settings.has(Overlay::Grid) && self.occluders != previous_occluders {
            // The grid numbers avoid cards at their new positions.
            ui.ctx().request_repaint();
        }
        from_compass.or(from_buttons)
    }

    fn width_beside_legend(&self) -> f32 {
        let legend = if self.settings.has(Overlay::Legend) {
            legend_card::width(self.camera.screen) + CARD_MARGIN
        } else {
            0.0
        };
        self.camera.screen.width() - legend - 2.0 * CARD_MARGIN
    }

    /// Background: the colour of unknown cells of the lowest layer, if it is opaque.
    fn ground(&self, ui: &Ui, model: &ConsoleModel) -> Color32 {
        let shown = MapLayers::shown(self.stack(), model.map().store());
        let lowest = shown.first();
        match lowest.map(|(held, _)| self.layers.palette(held.layer).unknown_color()) {
            Some([red, green, blue, 255]) => Color32::from_rgb(red, green, blue),
            Some([_, _, _, _]) | None => theme::ground(ui.visuals()),
        }
    }

    fn paint_layers(
        &mut self,
        ctx: &Context,
        painter: &Painter,
        model: &ConsoleModel,
        now: Monotonic,
    ) {
        let store = model.map().store();
        if let Some((layer, key, texture)) = self.texture_check.take_different()
            && self.layers.drop_chunk(layer, key, texture)
        {
            // It is made again as a hole in this frame.
            self.texture_check.repairs += 1;
        }
        let view = &self.camera;
        let (mut holes, mut time) = (FrameTime::for_holes(), FrameTime::new());
        let stack = &self.settings.stack;
        let is_made = self
            .layers
            .prepare(ctx, stack, store, view, &mut holes, &mut time);
        self.is_behind |= !is_made;
        if self.is_behind {
            ctx.request_repaint();
        }
        if let Some(number) = self.texture_check.next(now)
            && let Some(sample) = self.layers.sample(stack, store, number)
        {
            painter.add(self.texture_check.request(sample, view.screen));
        }
        self.layers.paint(painter, stack, store, view);
    }

    /// Draws the measured line. Returns its text. Its labels avoid `labels`.
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
            points_m.push(self.camera.to_odom(at));
        }
        let height = |point_m| probe::value_at(model.map(), LayerId::Elevation, point_m);
        let legs = Ruler::legs(&points_m, height);
        let is_on_earth = knows_north(model);
        let pieces: Vec<_> = legs.iter().map(|leg| leg.label(is_on_earth)).collect();
        let (total, view) = (ruler::total(&legs), &self.camera);
        let words = (&*pieces, total.as_deref());
        ruler::paint_ruler(painter, &points_m, words, view, labels, ink, paper);
        (!legs.is_empty()).then(|| {
            let words = pieces.into_iter().chain(total);
            words.collect::<Vec<_>>().join("; ")
        })
    }

    fn rests_on(&self, point_m: [f64; 2], place: Pos2) -> bool {
        let drawn = self.camera.to_screen(point_m);
        drawn.distance(place) <= ruler::POINT_RADIUS
    }

    fn shore_marks(&self, model: &ConsoleModel) -> ShoreMarks {
        let Some(shores) = model.shores() else {
            return ShoreMarks::default();
        };
        let inputs = (shores, model.shore_outlines().outlines());
        let marked = self.shore_selection.shown();
        let vehicle = self.vehicle_mark(model).map(|vehicle| vehicle.bounds());
        let taken: Vec<_> = self.fixed_cards().chain(vehicle).collect();
        let marked = (&*marked, self.settings.has_labels);
        ShoreMarks::new(inputs, &self.camera, marked, vehicle_m(model), &taken)
    }

    fn mark_color(&self, mark: Mark, is_old: bool) -> Color32 {
        match mark {
            Mark::Vehicle | Mark::Path if is_old => theme::VEHICLE_STALE,
            Mark::Vehicle => self.robot_overlay.color.unwrap_or(mark.color()),
            _ => mark.color(),
        }
    }

    fn paint_sensors(&self, painter: &Painter, model: &ConsoleModel) {
        let Some(position_m) = vehicle_m(model).filter(|_| self.settings.has(Overlay::Sensors))
        else {
            return;
        };
        let view = &self.camera;
        let heading_rad = model.vehicle().heading_rad().unwrap_or_default();
        let fields = self.robot_overlay.sensors.iter().map(|field| {
            let outline_m = vehicle::field_m(field, position_m, heading_rad);
            (view.line(&outline_m), true)
        });
        let in_sight = |(points, _): &(Vec<Pos2>, bool)| {
            Rect::from_points(points).intersects(view.screen)
        };
        let fields: Vec<_> = fields.filter(in_sight).collect();
        let mark = Mark::FieldOfView;
        mark.paint_lines(painter, &fields, 1.0, mark.color());
        if let Some(scan) = &self.robot_overlay.scan {
            let age = scan.age.as_secs_f32() / SCAN_LIFETIME.as_secs_f32();
            let stride = scan.points_m.len() / MAX_SCAN_POINTS + 1;
            let points = scan.points_m.iter().step_by(stride);
            let points = points.map(|point_m| view.to_screen(*point_m));
            let in_sight = points.filter(|at| view.screen.contains(*at));
            Mark::Scan.paint_points(painter, in_sight, (1.0 - 0.7 * age).max(0.0));
        }
    }

    fn paint_vehicle(&self, painter: &Painter, model: &ConsoleModel, is_old: bool) {
        let lines = vehicle::trail_lines(model.vehicle().trail(), &self.camera);
        let lines: Vec<_> = lines.into_iter().map(|line| (line, false)).collect();
        // Thinner on small scales, so that narrow passages stay visible.
        let width = (0.06 * self.camera.points_per_m as f32).clamp(1.0, 2.2);
        let color = self.mark_color(Mark::Path, is_old);
        Mark::Path.paint_lines(painter, &lines, width, color);
        let Some((pose, _)) = model.vehicle().pose() else {
            return;
        };
        let view = &self.camera;
        let [x_m, y_m, _] = pose.position_m;
        let heading_rad = model.vehicle().heading_rad().unwrap_or_default();
        if let (Some(stopping), Some(info), false) =
            (self.robot_overlay.stopping, model.info(), is_old)
        {
            let motion = Motion {
                position_m: [x_m, y_m],
                heading_rad,
                speed_mps: f64::from(pose.speed_mps),
                turn_rate_radps: f64::from(pose.turn_rate_radps),
                footprint_m: info.footprint_m.map(f64::from),
                footprint_offset_m: f64::from(info.footprint_offset_m),
            };
            let swept = vehicle::swept_m(&motion, stopping);
            let swept = swept.iter().map(|edges| edges.map(|edge_m| view.to_screen(edge_m)));
            Mark::StoppingDistance.paint_area(painter, &swept.collect::<Vec<_>>());
        }
        if let Some(vehicle) = self.vehicle_mark(model) {
            vehicle.paint(painter, self.mark_color(Mark::Vehicle, is_old));
        }
        if let Some(barrier) = model.barrier().filter(|_| !is_old) {
            let at = view.to_screen(barrier.position_m.map(f64::from));
            if view.screen.expand(RING_RADIUS).contains(at) {
                Mark::LimitingObstacle.paint_ring(painter, at, RING_RADIUS);
            }
        }
    }

    fn vehicle_mark(&self, model: &ConsoleModel) -> Option<VehicleMark> {
        let heading_rad = model.vehicle().heading_rad()?;
        let footprint_m = model.info().map(|info| info.footprint_m);
        let offset_m = model.info().map_or(0.0, |info| info.footprint_offset_m);
        Some(VehicleMark::new(
            self.camera.to_screen(vehicle_m(model)?),
            self.camera.direction(heading_rad),
            (footprint_m, offset_m),
            self.camera.points_per_m,
        ))
    }

    /// Marks that are on the map of this robot, now or when it moves: the legend keeps its size.
    fn marks(&self, model: &ConsoleModel) -> Vec<Mark> {
        let overlay = &self.robot_overlay;
        let has_pose = model.vehicle().pose().is_some();
        let draws_sensors = has_pose && self.settings.has(Overlay::Sensors);
        let teleop = model
            .status()
            .and_then(|(status, _)| status.teleop.as_ref());
        let is_monitored = teleop.is_some_and(|teleop| {
            !matches!(teleop.collision_monitor, CollisionMonitorState::Off)
        });
        let marks = [
            (Mark::Vehicle, has_pose),
            (Mark::Path, has_pose),
            (Mark::Scan, draws_sensors && (overlay.scan.is_some() || !overlay.sensors.is_empty())),
            (Mark::FieldOfView, draws_sensors && !overlay.sensors.is_empty()),
            (Mark::StoppingDistance, has_pose && overlay.stopping.is_some()),
            (Mark::LimitingObstacle, is_monitored || model.barrier().is_some()),
            (Mark::Selection, self.shore_selection.selected.is_some()),
        ];
        let drawn = marks.into_iter().filter(|(_, is_drawn)| *is_drawn);
        drawn.map(|(mark, _)| mark).collect()
    }

    fn probe_ui(
        &mut self,
        ui: &Ui,
        probed_place: Option<Pos2>,
        model: &ConsoleModel,
        now: Monotonic,
    ) {
        let probed_m = probed_place.map(|at| self.camera.to_odom(at));
        let Some(point_m) = self.pinned_m.or(probed_m) else {
            return;
        };
        let data = ProbeData::new(model, self.stack(), point_m, now);
        let is_pinned = self.pinned_m.is_some();
        let point = self.camera.to_screen(point_m);
        let (corner, align, width) = self.probe_card_anchor(point);
        let card = Area::new(Id::unique("map probe"))
            .fixed_pos(corner)
            .pivot(align)
            .constrain_to(self.camera.screen)
            .order(Order::Background)
            .interactable(is_pinned)
            .show(ui.ctx(), |ui| {
                let is_narrow = self.camera.screen.width() < NARROW;
                probe::probe_card_ui(ui, &data, is_pinned, (width, is_narrow))
            });
        self.occluders.push(card.response.rect);
        if card.inner {
            self.pinned_m = None;
        }
    }

    /// Corner, alignment and greatest width of the probe card: lower left, or upper left if the point is in the lower
    /// half of the map. The legends and the compass are to its right if there is enough width.
    fn probe_card_anchor(&self, point: Pos2) -> (Pos2, Align2, f32) {
        let screen = self.camera.screen;
        let left = screen.left() + CARD_MARGIN;
        if point.y > screen.center().y {
            let top = self.buttons.bottom().max(self.map_top) + CARD_MARGIN;
            let right = screen.right() - 2.0 * CARD_MARGIN - COMPASS_SIZE;
            let width = (right - left).max(0.0);
            return (pos2(left, top), Align2::LEFT_TOP, width);
        }
        let bottom = screen.bottom() - OVER_SCALE_BAR;
        let legends = self.legends_place();
        let right = legends.map_or(screen.right(), |legends| legends.left()) - CARD_MARGIN;
        match legends {
            Some(legends) if right - left < MIN_CARD_WIDTH => {
                let bottom = bottom.min(legends.top() - CARD_MARGIN);
                let width = screen.width() - 2.0 * CARD_MARGIN;
                (pos2(left, bottom), Align2::LEFT_BOTTOM, width)
            }
            _ => (pos2(left, bottom), Align2::LEFT_BOTTOM, right - left),
        }
    }

    pub(super) fn has_room_for_cards(&self) -> bool {
        let [width, height] = MIN_MAP_FOR_CARDS;
        self.camera.screen.width() >= width && self.camera.screen.height() >= height
    }

    pub(super) fn legends_place(&self) -> Option<Rect> {
        let place = self.legends.place;
        place.filter(|_| self.settings.has(Overlay::Legend))
    }

    fn compass_below(&self, buttons: f32) -> Option<Rect> {
        let right = self.camera.screen.right() - CARD_MARGIN;
        let at = pos2(right - COMPASS_SIZE, buttons + CARD_MARGIN);
        let place = Rect::from_min_size(at, vec2(COMPASS_SIZE, COMPASS_SIZE));
        self.settings.has(Overlay::Compass).then_some(place)
    }

    /// Buttons, compass and legends.
    pub(super) fn fixed_cards(&self) -> impl Iterator<Item = Rect> {
        let cards = [
            Some(self.buttons),
            self.compass_below(self.buttons.bottom()),
            self.legends_place(),
        ];
        cards.into_iter().flatten()
    }

    pub(super) fn is_occluded(&self, place: Pos2) -> bool {
        self.fixed_cards().any(|card| card.contains(place))
    }

    pub fn notice_room(&self) -> Option<NoticeRoom> {
        if !self.has_room_for_cards() {
            return None;
        }
        let legends = self.legends_place();
        let [width, height] = SCALE_BAR;
        let corner = self.camera.screen.left_bottom();
        let scale_bar = Rect::from_two_pos(corner, corner + vec2(width, -height));
        let occluders = self.occluders.iter().copied().chain(legends);
        let whole = self.camera.screen.shrink(CARD_MARGIN);
        // Beside the legends: above them the notice would be near the vehicle.
        let beside = legends.map(|legends| whole.with_max_x(legends.left() - CARD_MARGIN));
        let beside = beside.filter(|beside| beside.width() >= MIN_CARD_WIDTH);
        Some(NoticeRoom {
            place: beside.unwrap_or(whole),
            taken: occluders.chain([scale_bar]).collect(),
        })
    }

    /// Banner of a silent robot. The map does not move below the pointer, but the buttons do.
    pub(super) fn banner_ui(&mut self, ui: &mut Ui, stale: Option<&StaleData>) {
        let before = std::mem::replace(&mut self.map_top, self.camera.screen.top());
        if let Some(stale) = stale {
            let whole = UiBuilder::new()
                .max_rect(self.camera.screen)
                .layout(Layout::top_down(Align::Min));
            let [ground, _] = stale.colors(ui.visuals());
            let banner = ui.scope_builder(whole, |ui| {
                let frame = Frame::new().fill(ground).inner_margin(PADDING);
                frame.show(ui, |ui| {
                    ui.set_width(ui.available_width());
                    stale_ui(ui, stale);
                });
            });
            let banner = banner.response.rect;
            // Blocks clicks on the map below.
            let id = ui.scope_id().with("banner");
            ui.interact(banner, id, Sense::CLICK | Sense::DRAG);
            self.occluders.push(banner);
            // On a very low map the buttons are over the banner.
            let lowest =
                (self.camera.screen.bottom() - 2.0 * CARD_MARGIN).max(self.camera.screen.top());
            self.map_top = banner.bottom().min(lowest);
        }
        if (self.map_top - before).abs() > 0.5 {
            // The cards follow the buttons.
            ui.ctx().request_repaint();
        }
    }

    pub(super) fn buttons_ui(&mut self, ui: &mut Ui) -> Option<Look> {
        let top_right = UiBuilder::new()
            .max_rect(
                self.camera
                    .screen
                    .with_min_y(self.map_top)
                    .shrink(CARD_MARGIN),
            )
            .layout(Layout::top_down(Align::Max));
        let data = ToolbarData {
            camera_mode: self.settings.camera_mode,
            orientation: self.settings.orientation,
            has_grid: self.settings.has(Overlay::Grid),
            is_measuring: self.ruler.is_some(),
        };
        let buttons = ui.scope_builder(top_right, |ui| toolbar::toolbar_ui(ui, data));
        self.buttons = buttons.response.rect;
        self.occluders.push(self.buttons);
        buttons.inner
    }

    pub(super) fn compass_ui(&mut self, ui: &Ui, model: &ConsoleModel) -> Option<Look> {
        let rect = self.compass_below(self.buttons.bottom())?;
        let data = CompassData {
            north: self.camera.direction(FRAC_PI_2),
            is_on_earth: knows_north(model),
            orientation: self.settings.orientation,
        };
        self.occluders.push(rect);
        grid::compass_ui(ui, rect, data).then(|| Look::Up(self.settings.orientation.other()))
    }

    pub(super) fn legend_ui(&mut self, ui: &Ui, model: &ConsoleModel, is_old: bool) {
        let shown = MapLayers::shown(self.stack(), model.map().store());
        let palettes = shown.iter().rev();
        let palettes: Vec<_> = palettes
            .map(|(held, is_over)| (self.layers.palette(held.layer), *is_over))
            .collect();
        // The buttons are drawn later, and are not lower than this.
        let buttons = self.map_top + CARD_MARGIN + toolbar::HEIGHT;
        let map = LegendPlace {
            screen: self.camera.screen,
            buttons,
            compass: self.compass_below(buttons),
        };
        let before = self.legends.place;
        let marks = self.marks(model).into_iter();
        let marks: Vec<_> = marks.map(|mark| (mark, self.mark_color(mark, is_old))).collect();
        self.legends.show(ui, &map, Drawn { palettes: &palettes, marks: &marks });
        let is_other = match (before, self.legends.place) {
            (Some(before), Some(now)) => (now.size() - before.size()).length() > 0.5,
            (before, now) => before.is_some() != now.is_some(),
        };
        if self.settings.camera_mode == CameraMode::FitMap && is_other {
            // The whole map is fitted beside the legends.
            ui.ctx().request_repaint();
        }
    }
}

pub(super) fn knows_north(model: &ConsoleModel) -> bool {
    model.shores().is_some_and(|shores| shores.datum.is_some())
}

pub(super) fn vehicle_m(model: &ConsoleModel) -> Option<[f64; 2]> {
    let (pose, _) = model.vehicle().pose()?;
    let [x_m, y_m, _] = pose.position_m;
    Some([x_m, y_m])
}
