//! A grid of round metres over the map, with its numbers at the edges of the screen.

use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2};
use protocol::export::round_length_m;

use super::super::camera::Camera;
use crate::panels::formatting::signed;

/// Lines are about this far apart, points.
const SPACING: f64 = 160.0;
/// What covers no more than this of a number leaves it as it reads, points: above its figures there is as much.
const EDGE: f32 = 4.0;
/// Between two numbers at least, points.
const GAP: f32 = 3.0;
/// No screen has more lines in one direction.
const MAX_LINES: i64 = 200;

/// A line of the grid on the screen.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::map_view) struct GridLine {
    pub(in crate::map_view) ends: [Pos2; 2],
    pub(in crate::map_view) label: String,
    /// Through the origin of `odom`.
    pub(in crate::map_view) is_axis: bool,
}

impl GridLine {
    /// Its lower end, or the left one of a line that lies rather than stands.
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

/// The lines that cross `screen`: those of equal x, then those of equal y.
pub(in crate::map_view) fn lines(camera: &Camera, screen: Rect) -> [Vec<GridLine>; 2] {
    let step_m = round_length_m(SPACING / camera.points_per_m());
    let decimals = if step_m < 0.1 {
        2
    } else {
        usize::from(step_m < 1.0)
    };
    let [low_x, low_y, high_x, high_y] = camera.visible_m(screen);
    let along = |low: f64, high: f64| {
        let first = (low / step_m).ceil() as i64;
        let last = (high / step_m).floor() as i64;
        first..=last.min(first + MAX_LINES)
    };
    let line = |index: i64, name: &str, from_m: [f64; 2], to_m: [f64; 2]| {
        let ends = clipped(
            camera.to_screen(screen, from_m),
            camera.to_screen(screen, to_m),
            screen,
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

/// The part of a line that is in a rectangle (Liang and Barsky).
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

/// Draws the grid; the numbers stand where lines leave the screen below or on the left. One that would be `covered`,
/// even half of it, is left out: half a number is another number. So is one that would lie on another, as those of x
/// and y do where both leave a turned map on one side.
pub(in crate::map_view) fn paint(
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

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;

    use super::*;

    #[test]
    fn lines_are_at_round_metres_and_numbered() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 300.0));
        // 40 points a metre: 10 × 7.5 m, a line every 2 m.
        let camera = Camera::default();
        let [of_x, of_y] = lines(&camera, screen);
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
    fn lines_of_a_turned_map_end_at_the_screen() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 300.0));
        let mut camera = Camera::default();
        camera.turn_up(0.5);
        let [of_x, of_y] = lines(&camera, screen);
        assert!(of_x.len() >= 4 && of_y.len() >= 4);
        for line in of_x.iter().chain(&of_y) {
            for end in line.ends {
                assert!(screen.expand(1e-2).contains(end), "{end:?}");
            }
        }
    }
}
