//! Reference marks on the map: grid, scale bar and compass.

use std::sync::Arc;

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Sense, Shape, Stroke, StrokeKind, Ui,
    Vec2, WidgetInfo, pos2, vec2,
};
use protocol::export::{length_label, round_length_m};

use super::camera::Camera;
use super::view_settings::Orientation;
use crate::panels::formatting::signed;
use crate::theme;

/// Approximate distance of grid lines, points.
const SPACING: f64 = 160.0;
/// Numbers may be covered by this margin, points.
const EDGE: f32 = 4.0;
const GAP: f32 = 3.0;
const MAX_LINES: i64 = 200;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct GridLine {
    pub(super) ends: [Pos2; 2],
    pub(super) label: String,
    pub(super) is_axis: bool,
}

impl GridLine {
    fn label_at(&self) -> Pos2 {
        let [a, b] = self.ends;
        let way = b - a;
        let is_first = if way.x.abs() > way.y.abs() {
            a.x < b.x
        } else {
            a.y > b.y
        };
        if is_first { a } else { b }
    }
}

pub(super) fn grid_lines(camera: &Camera) -> [Vec<GridLine>; 2] {
    let step_m = round_length_m(SPACING / camera.points_per_m);
    let decimals = if step_m < 0.1 {
        2
    } else {
        usize::from(step_m < 1.0)
    };
    let [low_x, low_y, high_x, high_y] = camera.visible_m();
    let along = |low: f64, high: f64| {
        let first = (low / step_m).ceil() as i64;
        let last = (high / step_m).floor() as i64;
        first..=last.min(first + MAX_LINES)
    };
    let line = |index: i64, name: &str, from_m: [f64; 2], to_m: [f64; 2]| {
        let ends = clipped(
            camera.to_screen(from_m),
            camera.to_screen(to_m),
            camera.screen,
        )?;
        Some(GridLine {
            ends,
            label: format!("{name} {}", signed(index as f64 * step_m, decimals)),
            is_axis: index == 0,
        })
    };
    let of_x = along(low_x, high_x).filter_map(|index| {
        let x = index as f64 * step_m;
        line(index, "x", [x, low_y], [x, high_y])
    });
    let of_y = along(low_y, high_y).filter_map(|index| {
        let y = index as f64 * step_m;
        line(index, "y", [low_x, y], [high_x, y])
    });
    [of_x.collect(), of_y.collect()]
}

/// Part of a line inside a rectangle (Liang and Barsky).
fn clipped(from: Pos2, to: Pos2, rect: Rect) -> Option<[Pos2; 2]> {
    let way = to - from;
    let (mut enters, mut leaves) = (0.0_f32, 1.0_f32);
    for (step, room) in [
        (-way.x, from.x - rect.left()),
        (way.x, rect.right() - from.x),
        (-way.y, from.y - rect.top()),
        (way.y, rect.bottom() - from.y),
    ] {
        if step == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if step < 0.0 {
            enters = enters.max(room / step);
        } else {
            leaves = leaves.min(room / step);
        }
    }
    (enters < leaves).then(|| [from + enters * way, from + leaves * way])
}

/// Draws the grid. Numbers are at the lower or left end of lines. A number that would be `covered` or overlap another
/// is omitted, because a partly covered number reads as another number.
pub(super) fn paint_grid(
    painter: &Painter,
    [of_x, of_y]: &[Vec<GridLine>; 2],
    (screen, covered): (Rect, &[Rect]),
    ink: Color32,
    paper: Color32,
) {
    for line in of_x.iter().chain(of_y) {
        let strength = if line.is_axis { 0.55 } else { 0.22 };
        painter.line_segment(line.ends, Stroke::new(1.0, ink.gamma_multiply(strength)));
    }
    let mut taken: Vec<Rect> = Vec::new();
    let mut label = |line: &GridLine, at: Pos2, align: Align2| {
        let font = FontId::proportional(11.0);
        let text = painter.layout_no_wrap(line.label.clone(), font, ink);
        let place = align.anchor_size(at, text.size());
        let hides = |other: &Rect| other.shrink(EDGE).intersects(place);
        let around = place.expand(GAP);
        let is_covered =
            covered.iter().any(hides) || taken.iter().any(|other| other.intersects(around));
        if screen.contains_rect(place) && !is_covered {
            painter.rect_filled(place.expand(1.0), 2.0, paper);
            painter.galley(place.min, text, ink);
            taken.push(place);
        }
    };
    for line in of_x.iter().chain(of_y) {
        let at = line.label_at();
        label(line, pos2(at.x + 2.0, at.y - 2.0), Align2::LEFT_BOTTOM);
    }
}

const MAX_BAR: f32 = 160.0;
const MIN_BAR: f32 = 48.0;
const BAR_HEIGHT: f32 = 6.0;
const BAR_PADDING: f32 = 8.0;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct ScaleBar {
    pub(super) label: String,
    pub(super) length: f32,
}

impl ScaleBar {
    /// The longest bar of 1, 2 or 5 × 10ⁿ m whose card fits into `room` points.
    pub(super) fn new(points_per_m: f64, room: f32) -> Self {
        let longest = (room - 2.0 * BAR_PADDING).clamp(MIN_BAR, MAX_BAR);
        let length_m = round_length_m(f64::from(longest) / points_per_m);
        Self {
            label: length_label(length_m),
            length: (length_m * points_per_m) as f32,
        }
    }
}

/// Card and text of a bar with its lower left corner at `at`.
pub(super) fn scale_bar_card(
    painter: &Painter,
    at: Pos2,
    bar: &ScaleBar,
    ink: Color32,
) -> (Rect, Arc<Galley>) {
    let text = painter.layout_no_wrap(bar.label.clone(), FontId::proportional(14.0), ink);
    let width = bar.length.max(text.size().x) + 2.0 * BAR_PADDING;
    let height = text.size().y + BAR_HEIGHT + 3.0 + 1.5 * BAR_PADDING;
    let card = Rect::from_min_size(at - vec2(0.0, height), vec2(width, height));
    (card, text)
}

pub(super) fn paint_scale_bar(
    painter: &Painter,
    bar: &ScaleBar,
    (card, text): (Rect, Arc<Galley>),
    ink: Color32,
    paper: Color32,
) {
    painter.rect_filled(card, 4.0, paper);
    let left = card.center().x - 0.5 * bar.length;
    let bottom = card.bottom() - BAR_PADDING;
    let whole = Rect::from_min_max(
        pos2(left, bottom - BAR_HEIGHT),
        pos2(left + bar.length, bottom),
    );
    // One half is hollow, so that half of the length can be read.
    let half = whole.with_max_x(left + 0.5 * bar.length);
    painter.rect_filled(half, 0.0, ink);
    painter.rect_stroke(whole, 0.0, Stroke::new(1.0, ink), StrokeKind::Inside);
    let text_at = pos2(card.center().x, whole.top() - 3.0);
    let text_rect = Align2::CENTER_BOTTOM.anchor_size(text_at, text.size());
    painter.galley(text_rect.min, text, ink);
}

pub(super) const COMPASS_SIZE: f32 = 44.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CompassData {
    /// Direction of y of `odom` on the screen.
    pub(super) north: Vec2,
    /// Whether y of `odom` is north.
    pub(super) is_on_earth: bool,
    pub(super) orientation: Orientation,
}

impl CompassData {
    fn hint(self) -> String {
        let turn = match self.orientation {
            Orientation::NorthUp => "Turn the map with the robot (N)",
            Orientation::RobotUp => "North up (N)",
        };
        let note = if self.is_on_earth {
            ""
        } else {
            ". The robot does not know where north is: the compass shows y of its map"
        };
        format!("{turn}{note}")
    }
}

pub(super) fn compass_ui(ui: &Ui, rect: Rect, data: CompassData) -> bool {
    let response = ui.interact(rect, ui.scope_id().with("compass"), Sense::click());
    let label = match (data.orientation, data.is_on_earth) {
        (Orientation::NorthUp, true) => "Compass: north up",
        (Orientation::NorthUp, false) => "Compass: y up",
        (Orientation::RobotUp, _) => "Compass: robot up",
    };
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, label));
    let painter = ui.painter();
    let ink = ui.visuals().text_color();
    let (middle, radius) = (rect.center(), 0.5 * COMPASS_SIZE - 1.0);
    painter.circle_filled(middle, radius, theme::card(ui.visuals()));
    let rim = if response.hovered() || response.has_focus() {
        Stroke::new(2.0, ink)
    } else {
        Stroke::new(1.0, ui.visuals().weak_text_color())
    };
    painter.circle_stroke(middle, radius, rim);
    let side = vec2(-data.north.y, data.north.x);
    let (tip, tail) = (data.north * 0.42 * radius, data.north * -0.72 * radius);
    let wing = |factor: f32| middle + side * factor * radius;
    let north_half = vec![middle + tip, wing(0.26), wing(-0.26)];
    let south_half = vec![middle + tail, wing(0.26), wing(-0.26)];
    painter.add(Shape::convex_polygon(north_half, ink, Stroke::NONE));
    painter.add(Shape::convex_polygon(
        south_half,
        ui.visuals().weak_text_color(),
        Stroke::NONE,
    ));
    let letter = if data.is_on_earth { "N" } else { "y" };
    painter.text(
        middle + data.north * 0.72 * radius,
        Align2::CENTER_CENTER,
        letter,
        FontId::proportional(13.0),
        ink,
    );
    response.on_hover_text(data.hint()).clicked()
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::vec2;

    #[test]
    fn grid_lines_are_at_round_metres() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 300.0));
        // 40 points per metre: 10 × 7.5 m, a line every 2 m.
        let camera = Camera::on(screen);
        let [of_x, of_y] = grid_lines(&camera);
        let labels = |lines: &[GridLine]| {
            lines
                .iter()
                .map(|line| line.label.clone())
                .collect::<Vec<_>>()
        };
        assert_eq!(labels(&of_x), ["x −4", "x −2", "x 0", "x 2", "x 4"]);
        assert_eq!(labels(&of_y), ["y −2", "y 0", "y 2"]);
        assert_eq!(of_x[3].ends.map(|end| end.x.round() as i32), [280, 280]);
        assert!(of_x[2].is_axis && !of_x[1].is_axis);
        assert_eq!(of_x[3].label_at(), pos2(280.0, 300.0));
        assert_eq!(of_y[0].label_at(), pos2(0.0, 230.0));
    }

    #[test]
    fn grid_lines_of_a_rotated_map_are_clipped() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 300.0));
        let mut camera = Camera::on(screen);
        camera.turn_up(0.5);
        let [of_x, of_y] = grid_lines(&camera);
        assert!(of_x.len() >= 4 && of_y.len() >= 4);
        for line in of_x.iter().chain(&of_y) {
            for end in line.ends {
                assert!(screen.expand(1e-2).contains(end), "{end:?}");
            }
        }
    }

    #[test]
    fn scale_bars_have_round_lengths_and_fit() {
        for (points_per_m, label, length) in [
            (40.0, "2 m", 80.0),
            (31.0, "5 m", 155.0),
            (160.0, "1 m", 160.0),
            (161.0, "50 cm", 80.5),
            (2000.0, "5 cm", 100.0),
            (0.05, "2 km", 100.0),
            (0.3, "500 m", 150.0),
        ] {
            let bar = ScaleBar::new(points_per_m, 500.0);
            assert_eq!(bar.label, label, "{points_per_m}");
            assert!((bar.length - length).abs() < 1e-3, "{points_per_m}");
        }
        for (room, label) in [(176.0, "2 m"), (95.0, "1 m"), (10.0, "1 m")] {
            assert_eq!(ScaleBar::new(40.0, room).label, label, "{room}");
        }
    }
}
