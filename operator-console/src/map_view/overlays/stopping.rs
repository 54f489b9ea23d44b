//! The ground that the vehicle still covers if it is told to stop now.

use eframe::egui::{Color32, Mesh, Painter, Rect};

use super::super::camera::Camera;
use super::super::robot_overlay::Stopping;

/// From a command's arrival until the motors do it: a round of the vehicle's loop.
const REACTION_S: f64 = 0.02;
/// Slower is standing.
const MIN_SPEED_MPS: f64 = 0.02;
/// Longer ways are nonsense of the data, not of a vehicle.
const MAX_WAY_M: f64 = 500.0;
const STEPS: usize = 24;

/// Where the vehicle is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::map_view) struct Motion {
    /// Metres in `odom`, and radians, counter-clockwise from x.
    pub(in crate::map_view) position_m: [f64; 2],
    pub(in crate::map_view) heading_rad: f64,
    /// Along the vehicle's x, and about its z.
    pub(in crate::map_view) speed_mps: f64,
    pub(in crate::map_view) turn_rate_radps: f64,
    /// Extent along and across, and how far ahead of the position its middle is.
    pub(in crate::map_view) footprint_m: [f64; 2],
    pub(in crate::map_view) footprint_offset_m: f64,
}

/// How far it still goes, metres: on as commanded while the stop is on its way, then braking.
pub(in crate::map_view) fn stopping_distance_m(speed_mps: f64, stopping: Stopping) -> Option<f64> {
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

/// The left and right edge of what the footprint's leading end sweeps, from where it is to where it stops, metres in
/// `odom`; empty where the vehicle stands.
pub(in crate::map_view) fn swept_m(motion: &Motion, stopping: Stopping) -> Vec<[[f64; 2]; 2]> {
    let Some(way_m) = stopping_distance_m(motion.speed_mps, stopping) else {
        return Vec::new();
    };
    let [length_m, width_m] = motion.footprint_m;
    let towards = motion.speed_mps.signum();
    // It keeps to its circle while it slows down.
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

/// Draws it.
pub(in crate::map_view) fn paint(
    painter: &Painter,
    swept_m: &[[[f64; 2]; 2]],
    (camera, screen): (&Camera, Rect),
    color: Color32,
) {
    let mut mesh = Mesh::default();
    let fill = color.gamma_multiply(0.38);
    for edges_m in swept_m {
        for edge_m in edges_m {
            mesh.colored_vertex(camera.to_screen(screen, *edge_m), fill);
        }
    }
    for pair in 1..swept_m.len() as u32 {
        let first = 2 * (pair - 1);
        mesh.add_triangle(first, first + 1, first + 2);
        mesh.add_triangle(first + 1, first + 3, first + 2);
    }
    painter.add(mesh);
    if let Some([left_m, right_m]) = swept_m.last() {
        let ends = [left_m, right_m].map(|edge_m| camera.to_screen(screen, *edge_m));
        painter.line_segment(ends, (3.0, color));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOPPING: Stopping = Stopping {
        decel_mps2: 0.5,
        command_age_s: 0.18,
    };

    fn motion(speed_mps: f64, turn_rate_radps: f64) -> Motion {
        Motion {
            position_m: [10.0, 0.0],
            heading_rad: 0.0,
            speed_mps,
            turn_rate_radps,
            footprint_m: [2.0, 1.0],
            footprint_offset_m: 0.0,
        }
    }

    #[test]
    fn the_way_is_reaction_and_braking() {
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
    fn what_is_swept_begins_at_the_leading_end_and_is_as_wide_as_the_vehicle() {
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
    fn what_is_swept_begins_at_the_end_of_a_footprint_that_is_not_centred() {
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
    fn who_turns_keeps_to_his_circle() {
        // A radius of 1 m about (10, 1), 1.2 m along it.
        let swept = swept_m(&motion(1.0, 1.0), STOPPING);
        let [[lx, ly], [rx, ry]] = *swept.last().unwrap();
        let (sin, cos) = libm::sincos(1.2);
        let middle = [0.5 * (lx + rx) - cos, 0.5 * (ly + ry) - sin];
        assert!((middle[0] - (10.0 + sin)).abs() < 2e-3, "{middle:?}");
        assert!((middle[1] - (1.0 - cos)).abs() < 2e-3, "{middle:?}");
    }
}
