//! What the sensors see, and what they saw last.

use std::f64::consts::TAU;
use std::time::Duration;

use eframe::egui::{Color32, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2};

use super::super::camera::Camera;
use super::super::robot_overlay::{LastScan, SensorField};

/// Points of a scan that are drawn at most; of more, every second, third … one.
const MAX_POINTS: usize = 4_000;
/// A scan fades out until it is this old: what is seen there now, nobody knows.
const LIFETIME: Duration = Duration::from_secs(2);
const POINT: f32 = 2.5;
const STEP_RAD: f64 = 0.06;

/// The outline of what a sensor sees, closed: metres in `odom`. `heading_rad` is the vehicle's.
pub(in crate::map_view) fn field_m(
    field: &SensorField,
    [x, y]: [f64; 2],
    heading_rad: f64,
) -> Vec<[f64; 2]> {
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

/// Draws the outline with a halo, thin: it is seldom what one looks for.
pub(in crate::map_view) fn paint_field(
    painter: &Painter,
    field_m: &[[f64; 2]],
    (camera, screen): (&Camera, Rect),
    color: Color32,
) {
    let points: Vec<Pos2> = field_m
        .iter()
        .map(|point_m| camera.to_screen(screen, *point_m))
        .collect();
    if Rect::from_points(&points).intersects(screen) {
        let halo = Stroke::new(2.4, Color32::from_white_alpha(90));
        painter.add(Shape::closed_line(points.clone(), halo));
        painter.add(Shape::closed_line(points, Stroke::new(1.0, color)));
    }
}

/// Draws the points of a scan, the fainter the older it is.
pub(in crate::map_view) fn paint_scan(
    painter: &Painter,
    scan: &LastScan,
    (camera, screen): (&Camera, Rect),
    color: Color32,
) {
    let age = scan.age.as_secs_f32() / LIFETIME.as_secs_f32();
    if age >= 1.0 {
        return;
    }
    let color = color.gamma_multiply(1.0 - 0.7 * age);
    let stride = scan.points_m.len() / MAX_POINTS + 1;
    let mut mesh = Mesh::default();
    for point_m in scan.points_m.iter().step_by(stride) {
        let at = camera.to_screen(screen, *point_m);
        if screen.contains(at) {
            mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(POINT)), color);
        }
    }
    painter.add(mesh);
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    #[test]
    fn a_field_is_where_the_sensor_looks() {
        // Half a metre ahead of a vehicle that heads north, looking ahead.
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
