//! Corners of a path that an arc rounds.

use nalgebra::{Point2, Vector2};

use super::{MIN_LEG_M, Waypoint};

/// A corner rounded by an arc that is tangent to both legs.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    pub(super) turn_rad: f64,
    /// From the waypoint to either end of the arc.
    pub(super) cut_m: f64,
    pub(super) next_length_m: f64,
    pub(super) next_heading_rad: f64,
    pub(super) arc_end_m: Point2<f64>,
}

impl Corner {
    /// `None` where the vehicle turns on the spot, or has nothing to turn.
    pub(super) fn new(
        waypoint: &Waypoint,
        direction: Vector2<f64>,
        to_next: Vector2<f64>,
    ) -> Option<Self> {
        let next_length_m = to_next.norm();
        if waypoint.corner_radius_m <= 0.0 || next_length_m < MIN_LEG_M {
            return None;
        }
        let next_heading_rad = libm::atan2(to_next.y, to_next.x);
        let turn_rad = shortest_turn_rad(libm::atan2(direction.y, direction.x), next_heading_rad);
        if turn_rad == 0.0 {
            return None;
        }
        let cut_m = waypoint.corner_radius_m * libm::tan(0.5 * turn_rad.abs());
        Some(Self {
            turn_rad,
            cut_m,
            next_length_m,
            next_heading_rad,
            arc_end_m: waypoint.position_m + to_next / next_length_m * cut_m,
        })
    }
}

/// Radians in (−π, π] from one heading to another.
pub(super) fn shortest_turn_rad(from_rad: f64, to_rad: f64) -> f64 {
    let turn_rad = libm::remainder(to_rad - from_rad, std::f64::consts::TAU);
    if turn_rad <= -std::f64::consts::PI {
        std::f64::consts::PI
    } else {
        turn_rad
    }
}
