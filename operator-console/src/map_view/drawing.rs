//! Draws the map: layers, marks, overlays and labels.

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use eframe::egui::accesskit::Role;
use eframe::egui::{Color32, Context, Painter, Pos2, Rect, Sense, Ui, WidgetInfo, vec2};
use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::message::CollisionMonitorState;

use super::cards::knows_north;
use super::chunks::FrameTime;
use super::grid::{self, ScaleBar};
use super::map_layers::MapLayers;
use super::marks::{Mark, point_size};
use super::pose_tool::paint_goal;
use super::shores::ShoreMarks;
use super::vehicle::{self, Motion, VehicleMark};
use super::{Ahead, CARD_MARGIN, CameraMode, MapView, Overlay, Ruler, probe, ruler};
use crate::command::Look;
use crate::model::{ConsoleModel, ellipse_95};
use crate::panels::data_age::{StaleData, is_position_old};
use crate::theme;

/// Maximum number of drawn scan points; more are subsampled.
const MAX_SCAN_POINTS: usize = 4_000;
/// Scan points fade until this age.
const SCAN_LIFETIME: Duration = Duration::from_secs(2);
/// Large enough for the obstacle to be visible inside, points.
const RING_RADIUS: f32 = 10.0;
const CROSS_RADIUS: f32 = 6.0;

impl MapView {
    pub fn show(&mut self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) -> Option<Look> {
        let (screen, response) =
            ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        self.camera.screen = screen;
        let previous_cards = self.cards();
        let previous_occluders = std::mem::take(&mut self.cards.occluders);
        self.handle_pointer(ui, &response, vehicle_m(model));
        self.update_camera(model);
        self.set_vehicle_place(self.vehicle_mark(model).map(|vehicle| vehicle.bounds()));

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
        if let Some(goal) = model.goal().running {
            paint_goal(&painter, &self.camera, goal, model.plan());
        }
        self.paint_vehicle(&painter, model, is_position_old);
        marks.paint_labels(&painter, ink, paper);
        // A draggable map is also hovered through its buttons.
        let pointer = response.hover_pos().filter(|at| !self.is_occluded(*at));
        let probed_place = self.probed_place(pointer);
        let labels = marks.label_places();
        if let Some(pose_tool) = &self.pose_tool {
            pose_tool.paint(&painter, &self.camera);
        }
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
        if legends.is_none_or(|legends| !legends.intersects(bar_place)) && !self.folds(bar_place) {
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
        let from_buttons = self.buttons_ui(ui, model);
        let from_compass = self.compass_ui(ui, model);
        let are_occluders_moved = self.cards.occluders != previous_occluders;
        let is_fitted = self.settings.camera_mode == CameraMode::FitMap;
        if self.settings.has(Overlay::Grid) && are_occluders_moved
            || is_fitted && self.cards() != previous_cards
        {
            // The grid numbers and the whole map avoid cards at their new positions.
            ui.ctx().request_repaint();
        }
        from_compass.or(from_buttons)
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
        if let Some(number) = self.texture_check.next(now) {
            match self.layers.sample(stack, store, number) {
                Some(sample) => drop(painter.add(self.texture_check.request(sample, view.screen))),
                None if self.is_behind => {}
                None => self.texture_check.pass(),
            }
        }
        self.texture_check.round = self.layers.chunks_to_check(stack, store);
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
        let taken: Vec<_> = self.cards().into_iter().chain(vehicle).collect();
        let marked = (&*marked, self.settings.has_labels);
        ShoreMarks::new(inputs, &self.camera, marked, vehicle_m(model), &taken)
    }

    pub(super) fn mark_color(&self, mark: Mark, is_old: bool) -> Color32 {
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
        let in_sight =
            |(points, _): &(Vec<Pos2>, bool)| Rect::from_points(points).intersects(view.screen);
        let fields: Vec<_> = fields.filter(in_sight).collect();
        let mark = Mark::FieldOfView;
        mark.paint_lines(painter, &fields, 1.0, mark.color());
        if let Some(scan) = &self.robot_overlay.scan {
            let age = scan.age.as_secs_f32() / SCAN_LIFETIME.as_secs_f32();
            let stride = scan.points_m.len() / MAX_SCAN_POINTS + 1;
            let points = scan.points_m.iter().step_by(stride);
            let points = points.map(|point_m| view.to_screen(*point_m));
            let in_sight = points.filter(|at| view.screen.contains(*at));
            let size = point_size(view.points_per_m);
            Mark::Scan.paint_points(painter, &in_sight, size, (1.0 - 0.7 * age).max(0.0));
        }
    }

    fn paint_vehicle(&self, painter: &Painter, model: &ConsoleModel, is_old: bool) {
        // Where the vehicle is only supposed to be, its way leads nowhere.
        let newest = model.localization().newest();
        let is_searching = newest.is_some_and(|newest| newest.is_searching);
        let trail = (!is_searching).then(|| model.vehicle().trail());
        let lines = trail.map(|trail| vehicle::trail_lines(trail, &self.camera));
        let lines = lines.into_iter().flatten().map(|line| (line, false));
        let lines: Vec<_> = lines.collect();
        // Thinner on small scales, so that narrow passages stay visible.
        let width = (0.06 * self.camera.points_per_m as f32).clamp(1.0, 2.2);
        let color = self.mark_color(Mark::Path, is_old);
        Mark::Path.paint_lines(painter, &lines, width, color);
        let view = &self.camera;
        let closures = model.localization().closures_m().iter();
        let closures = closures.map(|[a, b, c, d]| {
            [[*a, *b], [*c, *d]].map(|end_m| view.to_screen(end_m.map(f64::from)))
        });
        let in_sight = |ends: &[Pos2; 2]| Rect::from_points(ends).intersects(view.screen);
        Mark::Closure.paint_dashes(painter, closures.filter(in_sight));
        let Some((pose, _)) = model.vehicle().pose() else {
            return;
        };
        let [x_m, y_m, _] = pose.position_m;
        let heading_rad = model.vehicle().heading_rad().unwrap_or_default();
        let localization = model.localization().newest();
        if let Some(([long_m, short_m], angle_rad)) =
            localization.and_then(|newest| ellipse_95(newest.covariance_m2))
        {
            let axes = [(long_m, angle_rad), (short_m, angle_rad + FRAC_PI_2)];
            let axes = axes.map(|(axis_m, angle_rad)| {
                view.direction(angle_rad) * (axis_m * view.points_per_m) as f32
            });
            let (at, color) = (
                view.to_screen([x_m, y_m]),
                self.mark_color(Mark::Vehicle, is_old),
            );
            Mark::Uncertainty.paint_ellipse(painter, at, axes, color);
        }
        if let (Some(stopping), Some(info), false) =
            (self.robot_overlay.stopping, model.info(), is_old)
        {
            let motion = Motion {
                position_m: [x_m, y_m],
                heading_rad,
                speed_mps: f64::from(pose.speed_mps),
                lateral_mps: f64::from(pose.lateral_mps),
                turn_rate_radps: f64::from(pose.turn_rate_radps),
                footprint_m: info.footprint_m.map(f64::from),
                footprint_offset_m: f64::from(info.footprint_offset_m),
            };
            let swept = vehicle::swept_m(&motion, stopping);
            let swept = swept
                .iter()
                .map(|edges| edges.map(|edge_m| view.to_screen(edge_m)));
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
        let ahead = Ahead::new(model).filter(|_| !is_old);
        if let Some((point_m, _)) = ahead.and_then(|ahead| ahead.obstacle) {
            let at = view.to_screen(point_m);
            if view.screen.contains(at) {
                Mark::FirstObstacle.paint_cross(painter, at, CROSS_RADIUS);
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
    pub(super) fn marks(&self, model: &ConsoleModel) -> Vec<Mark> {
        let overlay = &self.robot_overlay;
        let has_pose = model.vehicle().pose().is_some();
        let draws_sensors = has_pose && self.settings.has(Overlay::Sensors);
        let teleop = model
            .status()
            .and_then(|(status, _)| status.teleop.as_ref());
        let is_monitored = teleop
            .is_some_and(|teleop| !matches!(teleop.collision_monitor, CollisionMonitorState::Off));
        let marks = [
            (Mark::Vehicle, has_pose),
            (Mark::Path, has_pose),
            (
                Mark::Uncertainty,
                has_pose && model.localization().newest().is_some(),
            ),
            (Mark::Closure, !model.localization().closures_m().is_empty()),
            (
                Mark::Scan,
                draws_sensors && (overlay.scan.is_some() || !overlay.sensors.is_empty()),
            ),
            (
                Mark::FieldOfView,
                draws_sensors && !overlay.sensors.is_empty(),
            ),
            (
                Mark::StoppingDistance,
                has_pose && overlay.stopping.is_some(),
            ),
            (
                Mark::LimitingObstacle,
                is_monitored || model.barrier().is_some(),
            ),
            (Mark::FirstObstacle, Ahead::new(model).is_some()),
            (Mark::Selection, self.shore_selection.selected.is_some()),
        ];
        let drawn = marks.into_iter().filter(|(_, is_drawn)| *is_drawn);
        drawn.map(|(mark, _)| mark).collect()
    }
}

pub(super) fn vehicle_m(model: &ConsoleModel) -> Option<[f64; 2]> {
    let (pose, _) = model.vehicle().pose()?;
    let [x_m, y_m, _] = pose.position_m;
    Some([x_m, y_m])
}
