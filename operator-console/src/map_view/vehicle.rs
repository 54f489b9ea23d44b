//! The vehicle on the map: footprint, stopping distance, trajectory and fields of view.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use eframe::egui::{Color32, Painter, Pos2, Rect, Shape, Stroke, Vec2, vec2};

use super::camera::Camera;
use super::{SensorField, Stopping};
use crate::theme;

/// A shorter footprint is drawn as an arrow of [`ARROW`] points.
const MIN_LENGTH: f32 = 16.0;
const ARROW: f32 = 20.0;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct VehicleMark {
    /// Corners of the footprint, clockwise from the front left; empty if it is too small or unknown.
    pub(super) footprint: Vec<Pos2>,
    pub(super) arrow: [Pos2; 4],
}

impl VehicleMark {
    /// `footprint_m`: length and width, its middle `offset_m` ahead of `at`; `ahead`: heading, unit vector.
    pub(super) fn new(
        at: Pos2,
        ahead: Vec2,
        (footprint_m, offset_m): (Option<[f32; 2]>, f32),
        points_per_m: f64,
    ) -> Self {
        let right = vec2(-ahead.y, ahead.x);
        let middle = at + ahead * (offset_m * points_per_m as f32);
        let place = |offset: Vec2| middle + ahead * offset.x + right * offset.y;
        let extent = footprint_m
            .map(|extent_m| extent_m.map(|side_m| side_m * points_per_m as f32))
            .filter(|extent| extent.iter().all(|side| side.is_finite() && *side > 0.0))
            .filter(|[length, width]| length.max(*width) >= MIN_LENGTH);
        let footprint = extent.map_or_else(Vec::new, |[length, width]| {
            let (half, side) = (0.5 * length, 0.5 * width);
            [(half, -side), (half, side), (-half, side), (-half, -side)]
                .map(|(x, y)| place(vec2(x, y)))
                .to_vec()
        });
        let length = extent.map_or(ARROW, |[length, width]| 0.62 * length.min(1.6 * width));
        let corners = [(0.5, 0.0), (-0.5, 0.38), (-0.26, 0.0), (-0.5, -0.38)];
        Self {
            footprint,
            arrow: corners.map(|(x, y)| place(vec2(x, y) * length)),
        }
    }

    pub(super) fn bounds(&self) -> Rect {
        let corners: Vec<_> = self.footprint.iter().chain(&self.arrow).copied().collect();
        Rect::from_points(&corners)
    }

    /// With a light rim inside a dark one, because a robot's own colour may be dark or light.
    pub(super) fn paint(&self, painter: &Painter, color: Color32) {
        let [light, dark] = theme::RIMS;
        let (edge, halo) = (Stroke::new(5.0, dark), Stroke::new(3.5, light));
        let line = Stroke::new(1.8, color);
        if !self.footprint.is_empty() {
            let paper = Color32::from_white_alpha(150);
            painter.add(Shape::closed_line(self.footprint.clone(), edge));
            painter.add(Shape::convex_polygon(self.footprint.clone(), paper, halo));
            painter.add(Shape::closed_line(self.footprint.clone(), line));
        }
        let [tip, rear_right, notch, rear_left] = self.arrow;
        painter.add(Shape::closed_line(self.arrow.to_vec(), edge));
        painter.add(Shape::closed_line(self.arrow.to_vec(), halo));
        // The arrow is not convex, its halves are.
        for half in [[tip, rear_right, notch], [tip, notch, rear_left]] {
            painter.add(Shape::convex_polygon(half.to_vec(), color, Stroke::NONE));
        }
    }
}

/// Reaction time of the vehicle, s: one round of its loop.
const REACTION_S: f64 = 0.02;
const MIN_SPEED_MPS: f64 = 0.02;
/// Longer distances come from invalid data.
const MAX_WAY_M: f64 = 500.0;
const STEPS: usize = 24;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    /// m in `odom`, and radians counter-clockwise from x.
    pub(super) position_m: [f64; 2],
    pub(super) heading_rad: f64,
    /// Along x and y and about z of `base`.
    pub(super) speed_mps: f64,
    pub(super) lateral_mps: f64,
    pub(super) turn_rate_radps: f64,
    /// Length and width, and offset of the middle ahead of the position, m.
    pub(super) footprint_m: [f64; 2],
    pub(super) footprint_offset_m: f64,
}

impl Motion {
    /// The same motion straight ahead, of a vehicle with axes along its way: its footprint is the rectangle around the
    /// turned one.
    fn along_its_way(&self) -> Self {
        let way_rad = libm::atan2(self.lateral_mps, self.speed_mps);
        let (sin, cos) = libm::sincos(way_rad);
        let [length_m, width_m] = self.footprint_m;
        let extent = |along: f64, across: f64| length_m * along.abs() + width_m * across.abs();
        let heading_rad = self.heading_rad + way_rad;
        let aside_m = -self.footprint_offset_m * sin;
        let (heading_sin, heading_cos) = libm::sincos(heading_rad);
        let [x_m, y_m] = self.position_m;
        Self {
            position_m: [x_m - aside_m * heading_sin, y_m + aside_m * heading_cos],
            heading_rad,
            speed_mps: libm::hypot(self.speed_mps, self.lateral_mps),
            lateral_mps: 0.0,
            turn_rate_radps: self.turn_rate_radps,
            footprint_m: [extent(cos, sin), extent(sin, cos)],
            footprint_offset_m: self.footprint_offset_m * cos,
        }
    }
}

/// Stopping distance, m: the commanded speed for the reaction time, then braking.
pub(super) fn stopping_distance_m(speed_mps: f64, stopping: Stopping) -> Option<f64> {
    let speed_mps = speed_mps.abs();
    let Stopping {
        decel_mps2,
        command_age_s,
    } = stopping;
    let is_known = decel_mps2 > 0.0 && command_age_s >= 0.0 && speed_mps.is_finite();
    let way_m =
        speed_mps * (command_age_s + REACTION_S) + speed_mps * speed_mps / (2.0 * decel_mps2);
    (is_known && speed_mps >= MIN_SPEED_MPS && way_m.is_finite()).then(|| way_m.min(MAX_WAY_M))
}

/// Left and right edges of the area swept until it stops, m in `odom`; empty if the vehicle stands.
pub(super) fn swept_m(motion: &Motion, stopping: Stopping) -> Vec<[[f64; 2]; 2]> {
    if motion.lateral_mps.abs() > 0.0 {
        return swept_m(&motion.along_its_way(), stopping);
    }
    let Some(way_m) = stopping_distance_m(motion.speed_mps, stopping) else {
        return Vec::new();
    };
    let [length_m, width_m] = motion.footprint_m;
    let towards = motion.speed_mps.signum();
    // The curvature stays constant while braking.
    let curvature_radpm = motion.turn_rate_radps / motion.speed_mps;
    let curvature_radpm = if curvature_radpm.is_finite() {
        curvature_radpm
    } else {
        0.0
    };
    let [mut x, mut y] = motion.position_m;
    let step_m = towards * way_m / STEPS as f64;
    let edges = |x: f64, y: f64, heading_rad: f64| {
        let (sin, cos) = libm::sincos(heading_rad);
        let ahead = motion.footprint_offset_m + towards * 0.5 * length_m;
        let side = 0.5 * width_m;
        let (front_x, front_y) = (x + ahead * cos, y + ahead * sin);
        [
            [front_x - side * sin, front_y + side * cos],
            [front_x + side * sin, front_y - side * cos],
        ]
    };
    let mut swept = vec![edges(x, y, motion.heading_rad)];
    for step in 0..STEPS {
        let heading_rad = motion.heading_rad + curvature_radpm * step_m * (step as f64 + 0.5);
        let (sin, cos) = libm::sincos(heading_rad);
        x += step_m * cos;
        y += step_m * sin;
        let turned_rad = motion.heading_rad + curvature_radpm * step_m * (step as f64 + 1.0);
        swept.push(edges(x, y, turned_rad));
    }
    swept
}

const STEP: f32 = 2.0;

/// Visible parts of the trajectory, at screen resolution.
pub(super) fn trail_lines(trail_m: &VecDeque<[f64; 2]>, camera: &Camera) -> Vec<Vec<Pos2>> {
    let near = camera.screen.expand(20.0);
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
        let point = camera.to_screen(*point_m);
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

const STEP_RAD: f64 = 0.06;

/// Closed outline of a sensor's field of view, m in `odom`. `heading_rad` is the vehicle's.
pub(super) fn field_m(field: &SensorField, [x, y]: [f64; 2], heading_rad: f64) -> Vec<[f64; 2]> {
    let [near_m, far_m] = field.range_m;
    let is_sound = far_m.is_finite() && far_m > 0.0 && field.field_rad > 0.0;
    if !is_sound {
        return Vec::new();
    }
    let (sin, cos) = libm::sincos(heading_rad);
    let [along, across] = field.mount_m;
    let at = [
        x + along * cos - across * sin,
        y + along * sin + across * cos,
    ];
    let is_circle = field.field_rad >= TAU - 1e-6;
    let field_rad = field.field_rad.min(TAU);
    let steps = (field_rad / STEP_RAD).ceil().max(1.0);
    let first_rad = heading_rad + field.mount_rad - 0.5 * field_rad;
    let arc = |range_m: f64| {
        let point = move |step: f64| {
            let (sin, cos) = libm::sincos(first_rad + field_rad * step / steps);
            [at[0] + range_m * cos, at[1] + range_m * sin]
        };
        (0..=steps as u32).map(move |step| point(f64::from(step)))
    };
    if is_circle {
        arc(far_m).collect()
    } else if near_m > 0.0 {
        let near: Vec<_> = arc(near_m).collect();
        arc(far_m).chain(near.into_iter().rev()).collect()
    } else {
        arc(far_m).chain([at]).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use eframe::egui::{pos2, vec2};

    fn assert_near(a: Pos2, b: Pos2) {
        assert!(a.distance(b) < 1e-3, "{a:?} is not {b:?}");
    }

    #[test]
    fn the_footprint_is_to_scale_and_rotated() {
        let at = pos2(100.0, 200.0);
        let east = VehicleMark::new(at, vec2(1.0, 0.0), (Some([1.0, 0.5]), 0.0), 100.0);
        assert_near(east.footprint[0], pos2(150.0, 175.0));
        assert_near(east.footprint[2], pos2(50.0, 225.0));
        let north = VehicleMark::new(at, vec2(0.0, -1.0), (Some([1.0, 0.5]), 0.0), 100.0);
        assert_near(north.footprint[0], pos2(75.0, 150.0));
        assert_near(north.footprint[1], pos2(125.0, 150.0));
        assert!(north.arrow[0].y < north.arrow[2].y, "the tip is ahead");
        // The origin is at the rear axle: the front is 0.8 m ahead, the rear 0.2 m behind.
        let rear_axle = VehicleMark::new(at, vec2(0.0, -1.0), (Some([1.0, 0.5]), 0.3), 100.0);
        assert_near(rear_axle.footprint[0], pos2(75.0, 120.0));
        assert_near(rear_axle.footprint[2], pos2(125.0, 220.0));
    }

    #[test]
    fn a_small_vehicle_is_an_arrow() {
        for footprint_m in [
            None,
            Some([0.5, 0.3]),
            Some([0.0, 0.0]),
            Some([f32::NAN, 1.0]),
        ] {
            let mark = VehicleMark::new(pos2(0.0, 0.0), vec2(1.0, 0.0), (footprint_m, 0.0), 10.0);
            assert_eq!(mark.footprint, []);
            assert_near(mark.arrow[0], pos2(0.5 * ARROW, 0.0));
        }
    }

    const STOPPING: Stopping = Stopping {
        decel_mps2: 0.5,
        command_age_s: 0.18,
    };

    fn motion(speed_mps: f64, turn_rate_radps: f64) -> Motion {
        Motion {
            position_m: [10.0, 0.0],
            heading_rad: 0.0,
            speed_mps,
            lateral_mps: 0.0,
            turn_rate_radps,
            footprint_m: [2.0, 1.0],
            footprint_offset_m: 0.0,
        }
    }

    #[test]
    fn stopping_distance_is_reaction_plus_braking() {
        let way_m = stopping_distance_m(1.5, STOPPING).unwrap();
        assert!((way_m - (1.5 * 0.2 + 2.25)).abs() < 1e-12);
        assert_eq!(
            stopping_distance_m(-1.5, STOPPING),
            stopping_distance_m(1.5, STOPPING)
        );
        assert_eq!(stopping_distance_m(0.0, STOPPING), None);
        for decel_mps2 in [0.0, -1.0, f64::NAN] {
            let stopping = Stopping {
                decel_mps2,
                ..STOPPING
            };
            assert_eq!(stopping_distance_m(1.0, stopping), None);
        }
    }

    #[test]
    fn swept_area_starts_at_the_leading_end() {
        let swept = swept_m(&motion(1.0, 0.0), STOPPING);
        assert_eq!(swept[0], [[11.0, 0.5], [11.0, -0.5]]);
        let [[left_x, left_y], [right_x, right_y]] = *swept.last().unwrap();
        assert!((left_x - 12.2).abs() < 1e-9 && (right_x - 12.2).abs() < 1e-9);
        assert!((left_y - 0.5).abs() < 1e-9 && (right_y + 0.5).abs() < 1e-9);
        let back = swept_m(&motion(-1.0, 0.0), STOPPING);
        assert!((back.last().unwrap()[0][0] - 7.8).abs() < 1e-9);
        assert!(swept_m(&motion(0.001, 1.0), STOPPING).is_empty());
    }

    #[test]
    fn swept_area_beside_a_vehicle_that_goes_sideways() {
        let sideways = Motion {
            lateral_mps: -1.0,
            footprint_offset_m: 0.75,
            ..motion(0.0, 0.0)
        };
        let swept = swept_m(&sideways, STOPPING);
        // From its right side, 0.5 m from the middle, 1.2 m on; from its front to its rear.
        for (edges, y_m) in [(swept[0], -0.5), (*swept.last().unwrap(), -1.7)] {
            let expected = [[11.75, y_m], [9.75, y_m]];
            let off = edges.as_flattened().iter().zip(expected.as_flattened());
            assert!(
                off.clone().all(|(one, other)| (one - other).abs() < 1e-9),
                "{edges:?}"
            );
        }
    }

    #[test]
    fn swept_area_of_an_offset_footprint() {
        for (speed_mps, end_m) in [(1.0, 11.75), (-1.0, 9.75)] {
            let rear_axle = Motion {
                footprint_offset_m: 0.75,
                ..motion(speed_mps, 0.0)
            };
            let swept = swept_m(&rear_axle, STOPPING);
            assert_eq!(swept[0], [[end_m, 0.5], [end_m, -0.5]]);
        }
    }

    #[test]
    fn swept_area_of_a_turning_vehicle() {
        // Radius 1 m about (10, 1), 1.2 m along it.
        let swept = swept_m(&motion(1.0, 1.0), STOPPING);
        let [[lx, ly], [rx, ry]] = *swept.last().unwrap();
        let (sin, cos) = libm::sincos(1.2);
        let middle = [0.5 * (lx + rx) - cos, 0.5 * (ly + ry) - sin];
        assert!((middle[0] - (10.0 + sin)).abs() < 2e-3, "{middle:?}");
        assert!((middle[1] - (1.0 - cos)).abs() < 2e-3, "{middle:?}");
    }

    #[test]
    fn only_visible_parts_of_the_trail_are_drawn() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
        let camera = Camera::on(screen);
        // To the right beyond the screen and back 1 m higher, a point every centimetre.
        let out = (0..2000).map(|cm| [f64::from(cm) * 0.01, 0.0]);
        let back = (0..2000).rev().map(|cm| [f64::from(cm) * 0.01, 1.0]);
        let trail: VecDeque<_> = out.chain(back).collect();
        let lines = trail_lines(&trail, &camera);
        assert_eq!(lines.len(), 2);
        let points: usize = lines.iter().map(Vec::len).sum();
        assert!((200..240).contains(&points), "{points}");
        assert_eq!(lines[0][0], screen.center());
        assert_eq!(*lines[1].last().unwrap(), screen.center() - vec2(0.0, 40.0));
        assert!(lines[0].last().unwrap().x > screen.right());
    }

    #[test]
    fn a_standing_vehicle_has_no_trail() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
        let trail = VecDeque::from([[0.0, 0.0]]);
        assert!(trail_lines(&trail, &Camera::on(screen)).is_empty());
    }

    #[test]
    fn sensor_field_outline() {
        // Half a metre ahead of a vehicle that faces north.
        let field = SensorField {
            mount_m: [0.5, 0.0],
            mount_rad: 0.0,
            field_rad: PI,
            range_m: [0.0, 10.0],
        };
        let outline_m = field_m(&field, [1.0, 2.0], FRAC_PI_2);
        let near = |[x, y]: [f64; 2], [ex, ey]: [f64; 2]| {
            assert!(
                (x - ex).abs() < 1e-9 && (y - ey).abs() < 1e-9,
                "{x} {y} is not {ex} {ey}"
            );
        };
        near(outline_m[0], [11.0, 2.5]);
        near(outline_m[outline_m.len() - 2], [-9.0, 2.5]);
        near(*outline_m.last().unwrap(), [1.0, 2.5]);
        let blind = SensorField {
            range_m: [0.0, f64::NAN],
            ..field
        };
        assert_eq!(field_m(&blind, [0.0; 2], 0.0), Vec::<[f64; 2]>::new());
    }
}
