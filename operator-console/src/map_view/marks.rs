//! The marks on the layers: one table of names, shapes and colours, for the map and its legend. Each mark has a rim, for
//! contrast on every layer. Labels, ruler, grid and pin are not in the table, because they explain themselves.

use eframe::egui::{Color32, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2, vec2};

use super::vehicle::VehicleMark;
use crate::theme;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    Vehicle,
    Path,
    Uncertainty,
    Closure,
    Scan,
    FieldOfView,
    StoppingDistance,
    LimitingObstacle,
    FirstObstacle,
    Selection,
}

/// Marks of the same shape differ in brightness, so that they are distinct without colours.
#[derive(Clone, Copy, Debug)]
enum MarkShape {
    Arrow,
    /// Corners of its sample in the legend, from 0 to 1 to the right and down.
    Line(&'static [[f32; 2]]),
    Ellipse,
    Dashes,
    Points,
    Area,
    Ring,
    Cross,
}

struct Style {
    name: &'static str,
    shape: MarkShape,
    color: Color32,
    rim: Color32,
}

const fn style(name: &'static str, shape: MarkShape, color: Color32, rim: Color32) -> Style {
    Style {
        name,
        shape,
        color,
        rim,
    }
}

const WAY: MarkShape = MarkShape::Line(&[[0.0, 0.9], [0.35, 0.3], [0.6, 0.75], [1.0, 0.1]]);
const FAN: MarkShape = MarkShape::Line(&[
    [0.9, 0.0],
    [0.0, 0.5],
    [0.9, 1.0],
    [1.0, 0.7],
    [1.0, 0.3],
    [0.9, 0.0],
]);
const OUTLINE: MarkShape =
    MarkShape::Line(&[[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9], [0.1, 0.1]]);

impl Mark {
    const fn style(self) -> Style {
        let [light, dark] = theme::RIMS;
        match self {
            Self::Vehicle => style("Vehicle", MarkShape::Arrow, theme::VEHICLE, light),
            Self::Path => style("Path", WAY, theme::PATH, light),
            Self::Uncertainty => style("Position, 95 %", MarkShape::Ellipse, theme::VEHICLE, light),
            Self::Closure => style("Loop closure", MarkShape::Dashes, theme::CLOSURE, light),
            Self::Scan => style(
                "Last scan: hits on any surface",
                MarkShape::Points,
                theme::SCAN,
                dark,
            ),
            Self::FieldOfView => style("Field of view", FAN, theme::FIELD_OF_VIEW, light),
            Self::StoppingDistance => {
                style("Stopping distance", MarkShape::Area, theme::MONITOR, dark)
            }
            Self::LimitingObstacle => {
                style("Limiting obstacle", MarkShape::Ring, theme::MONITOR, dark)
            }
            Self::FirstObstacle => style(
                "First obstacle ahead",
                MarkShape::Cross,
                theme::DANGER[0],
                light,
            ),
            Self::Selection => style("Selected", OUTLINE, theme::SELECTION, dark),
        }
    }

    pub const fn name(self) -> &'static str {
        self.style().name
    }

    pub const fn color(self) -> Color32 {
        self.style().color
    }

    /// Draws lines, each with whether it is closed. Rims first, so that none covers a line.
    pub(super) fn paint_lines(
        self,
        painter: &Painter,
        lines: &[(Vec<Pos2>, bool)],
        width: f32,
        color: Color32,
    ) {
        let rim = Stroke::new(width + width.max(1.5), self.style().rim);
        for stroke in [rim, Stroke::new(width, color)] {
            for (points, is_closed) in lines {
                let points = points.clone();
                painter.add(if *is_closed {
                    Shape::closed_line(points, stroke)
                } else {
                    Shape::line(points, stroke)
                });
            }
        }
    }

    /// Draws an ellipse with these half axes as vectors on the screen.
    pub(super) fn paint_ellipse(
        self,
        painter: &Painter,
        at: Pos2,
        axes: [Vec2; 2],
        color: Color32,
    ) {
        let points = (0..ELLIPSE_CORNERS).map(|corner| {
            let angle_rad = std::f32::consts::TAU * corner as f32 / ELLIPSE_CORNERS as f32;
            at + axes[0] * angle_rad.cos() + axes[1] * angle_rad.sin()
        });
        self.paint_lines(painter, &[(points.collect(), true)], 1.5, color);
    }

    /// Draws dashed lines between two points each.
    pub(super) fn paint_dashes(self, painter: &Painter, lines: impl Iterator<Item = [Pos2; 2]>) {
        let Style { color, rim, .. } = self.style();
        for line in lines {
            painter.line_segment(line, (2.5, rim));
            painter.extend(Shape::dashed_line(&line, (1.5, color), DASH, DASH));
        }
    }

    /// Draws points of this size, which fade with `strength` from 1 to 0.
    pub(super) fn paint_points(
        self,
        painter: &Painter,
        points: &(impl Iterator<Item = Pos2> + Clone),
        size: f32,
        strength: f32,
    ) {
        let Style { color, rim, .. } = self.style();
        let mut mesh = Mesh::default();
        for (size, color) in [(1.8 * size, rim), (size, color)] {
            let color = color.gamma_multiply(strength);
            for at in points.clone() {
                mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(size)), color);
            }
        }
        painter.add(mesh);
    }

    /// Draws the area between pairs of left and right points, with a bar at its end.
    pub(super) fn paint_area(self, painter: &Painter, edges: &[[Pos2; 2]]) {
        let color = self.color();
        let mut mesh = Mesh::default();
        for at in edges.iter().flatten() {
            mesh.colored_vertex(*at, color.gamma_multiply(0.38));
        }
        for pair in 1..edges.len() as u32 {
            let first = 2 * (pair - 1);
            mesh.add_triangle(first, first + 1, first + 2);
            mesh.add_triangle(first + 1, first + 3, first + 2);
        }
        painter.add(mesh);
        let side = |side: usize| edges.iter().map(|edge| edge[side]).collect::<Vec<_>>();
        let sides = [0, 1].map(|index| (side(index), false));
        self.paint_lines(painter, &sides, 1.0, color);
        let end = edges.last().map(|end| (end.to_vec(), false));
        self.paint_lines(painter, end.as_slice(), 3.0, color);
    }

    pub(super) fn paint_ring(self, painter: &Painter, at: Pos2, radius: f32) {
        let Style { color, rim, .. } = self.style();
        painter.circle_stroke(at, radius, (2.0 * RING_LINE, rim));
        painter.circle_stroke(at, radius, (RING_LINE, color));
    }

    pub(super) fn paint_cross(self, painter: &Painter, at: Pos2, radius: f32) {
        let line = |y: f32| vec![at - vec2(radius, y), at + vec2(radius, y)];
        let lines = [radius, -radius].map(|y| (line(y), false));
        self.paint_lines(painter, &lines, RING_LINE, self.color());
    }

    /// Draws a sample for the legend.
    pub fn paint_sample(self, painter: &Painter, place: Rect, color: Color32) {
        let at = |[x, y]: [f32; 2]| place.lerp_inside(vec2(x, y));
        match self.style().shape {
            MarkShape::Arrow => {
                let middle = place.center();
                let mut vehicle = VehicleMark::new(middle, Vec2::X, (None, 0.0), 1.0);
                vehicle.arrow = vehicle.arrow.map(|corner| middle.lerp(corner, 0.6));
                vehicle.paint(painter, color);
            }
            MarkShape::Line(corners) => {
                let corners = corners.iter().copied().map(at).collect();
                self.paint_lines(painter, &[(corners, false)], 1.2, color);
            }
            MarkShape::Ellipse => {
                let half = 0.5 * place.size();
                let axes = [vec2(half.x, 0.0), vec2(0.0, 0.6 * half.y)];
                self.paint_ellipse(painter, place.center(), axes, color);
            }
            MarkShape::Dashes => {
                self.paint_dashes(painter, std::iter::once([[0.0, 0.8], [1.0, 0.2]].map(at)));
            }
            MarkShape::Points => {
                let points = [[0.1, 0.6], [0.4, 0.3], [0.7, 0.4], [0.9, 0.8]];
                self.paint_points(painter, &points.into_iter().map(at), POINT, 1.0);
            }
            MarkShape::Area => {
                let edges = [0.0, 0.9].map(|x| [at([x, 0.15]), at([x, 0.85])]);
                self.paint_area(painter, &edges);
            }
            MarkShape::Ring => self.paint_ring(painter, place.center(), 0.4 * place.height()),
            MarkShape::Cross => self.paint_cross(painter, place.center(), 0.35 * place.height()),
        }
    }
}

const ELLIPSE_CORNERS: usize = 48;
/// Points.
const DASH: f32 = 3.0;
/// Side of a point, points.
const POINT: f32 = 2.5;
/// A smaller one on scales below 10 points per metre: many points side by side would look like a barrier.
const POINT_M: f32 = 0.25;
const MIN_POINT: f32 = 1.0;

pub(super) fn point_size(points_per_m: f64) -> f32 {
    (POINT_M * points_per_m as f32).clamp(MIN_POINT, POINT)
}
const RING_LINE: f32 = 2.5;

#[cfg(test)]
mod tests {
    use std::mem::discriminant;

    use protocol::layer::{LayerId, Palette};
    use protocol::message::ShoreClass;

    use super::*;
    use crate::color_vision::ColorVision;

    const ALL: [Mark; 10] = [
        Mark::Vehicle,
        Mark::Path,
        Mark::Uncertainty,
        Mark::Closure,
        Mark::Scan,
        Mark::FieldOfView,
        Mark::StoppingDistance,
        Mark::LimitingObstacle,
        Mark::FirstObstacle,
        Mark::Selection,
    ];

    const LEAST_CONTRAST: f64 = 3.0;

    fn color_of(palette: Palette, code: u16) -> Color32 {
        let [red, green, blue, _] = palette.color(code);
        Color32::from_rgb(red, green, blue)
    }

    #[test]
    fn marks_differ_in_shape_or_brightness_to_everyone() {
        for vision in ColorVision::ALL {
            for (index, mark) in ALL.into_iter().enumerate() {
                let own = mark.style();
                for other in ALL[index + 1..].iter().map(|other| other.style()) {
                    let ratio = vision.contrast(own.color, other.color);
                    let is_other_shape = discriminant(&own.shape) != discriminant(&other.shape);
                    assert!(
                        is_other_shape || ratio >= LEAST_CONTRAST,
                        "{} and {}, {vision:?}: {ratio}",
                        own.name,
                        other.name
                    );
                }
                let ratio = vision.contrast(own.color, own.rim);
                assert!(
                    ratio >= LEAST_CONTRAST,
                    "rim of {}, {vision:?}: {ratio}",
                    own.name
                );
            }
        }
    }

    /// Points on obstacles: both are small squares.
    #[test]
    fn scan_stands_out_from_obstacles_and_walls() {
        let obstacle = color_of(LayerId::Obstacle.default_palette(), 2);
        let scan = Mark::Scan.style();
        for vision in ColorVision::ALL {
            for cell in [obstacle, Color32::BLACK, Color32::WHITE] {
                let ratios = [scan.color, scan.rim].map(|part| vision.contrast(part, cell));
                let ratio = ratios[0].max(ratios[1]);
                assert!(ratio >= LEAST_CONTRAST, "{cell:?}, {vision:?}: {ratios:?}");
            }
        }
    }

    #[test]
    fn a_scan_is_thin_on_small_scales() {
        for (points_per_m, size) in [(0.5, 1.0), (2.7, 1.0), (6.0, 1.5), (10.0, 2.5), (80.0, 2.5)] {
            let error = (point_size(points_per_m) - size).abs();
            assert!(error < 1e-6, "{points_per_m}: {error}");
        }
    }

    #[test]
    fn only_danger_is_red() {
        let is_red = |color: Color32| color.r() / 2 > color.g().max(color.b());
        assert!(is_red(theme::DANGER[0]));
        for mark in ALL {
            let is_danger = mark == Mark::FirstObstacle;
            assert_eq!(is_red(mark.color()), is_danger, "{mark:?}");
        }
    }

    #[test]
    fn sparse_shores_are_visible_on_slope_cost_0() {
        let shores = LayerId::Shore.default_palette();
        let flat = color_of(LayerId::Cost.default_palette(), 1);
        let sparse = color_of(shores, ShoreClass::Sparse.code());
        for vision in ColorVision::ALL {
            let ratio = vision.contrast(sparse, flat);
            assert!(ratio >= LEAST_CONTRAST, "{vision:?}: {ratio}");
        }
    }
}
