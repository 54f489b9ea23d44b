//! Where the vehicle was.

use std::collections::VecDeque;

use eframe::egui::{Color32, Painter, Pos2, Rect, Shape, Stroke};

use super::super::camera::Camera;

/// Points of the line that are nearer to each other are one, points (logical pixels).
const STEP: f32 = 2.0;

/// The pieces of the trail that are on the screen, no finer than can be seen.
pub(in crate::map_view) fn lines(
    trail_m: &VecDeque<[f64; 2]>,
    camera: &Camera,
    screen: Rect,
) -> Vec<Vec<Pos2>> {
    let near = screen.expand(20.0);
    let mut lines: Vec<Vec<Pos2>> = Vec::new();
    let mut line: Vec<Pos2> = Vec::new();
    let mut before: Option<Pos2> = None;
    let mut finish = |line: &mut Vec<Pos2>| {
        if line.len() > 1 {
            lines.push(std::mem::take(line));
        } else {
            line.clear();
        }
    };
    let last = trail_m.len().saturating_sub(1);
    for (index, point_m) in trail_m.iter().enumerate() {
        let point = camera.to_screen(screen, *point_m);
        if let Some(from) = before {
            if from.distance(point) < STEP && index != last {
                continue;
            }
            if near.intersects(Rect::from_two_pos(from, point)) {
                if line.is_empty() {
                    line.push(from);
                }
                line.push(point);
            } else {
                finish(&mut line);
            }
        }
        before = Some(point);
    }
    finish(&mut line);
    lines
}

/// Draws them with a halo, the thinner the smaller the map, so that they do not cover narrow passages.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    lines: Vec<Vec<Pos2>>,
    color: Color32,
    points_per_m: f64,
) {
    let width = (0.06 * points_per_m as f32).clamp(1.0, 2.2);
    let halo = Stroke::new(1.9 * width, Color32::from_white_alpha(170));
    for line in &lines {
        painter.add(Shape::line(line.clone(), halo));
    }
    for line in lines {
        painter.add(Shape::line(line, Stroke::new(width, color)));
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::{pos2, vec2};

    use super::*;

    #[test]
    fn only_what_can_be_seen_is_drawn() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
        let camera = Camera::default();
        // Out of the screen to the right and back again 1 m higher, a point every centimetre.
        let out = (0..2000).map(|cm| [f64::from(cm) * 0.01, 0.0]);
        let back = (0..2000).rev().map(|cm| [f64::from(cm) * 0.01, 1.0]);
        let trail: VecDeque<_> = out.chain(back).collect();
        let lines = lines(&trail, &camera, screen);
        assert_eq!(lines.len(), 2);
        let points: usize = lines.iter().map(Vec::len).sum();
        assert!((200..240).contains(&points), "{points}");
        assert_eq!(lines[0][0], screen.center());
        assert_eq!(*lines[1].last().unwrap(), screen.center() - vec2(0.0, 40.0));
        assert!(lines[0].last().unwrap().x > screen.right());
    }

    #[test]
    fn a_vehicle_that_never_moved_has_no_trail() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
        let trail = VecDeque::from([[0.0, 0.0]]);
        assert!(lines(&trail, &Camera::default(), screen).is_empty());
    }
}
