//! The path of a simulated vehicle: its exact pose at any time.

mod corner;
mod planar_pose;

use nalgebra::{Point2, Vector2};

pub use planar_pose::PlanarPose;

use crate::path::corner::{Corner, shortest_turn_rad};
use crate::velocity::PlanarVelocity;
use measurement::pose::Pose;

/// A point to drive to, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Metres, in the world.
    pub position_m: Point2<f64>,
    /// Speed on the way there, m/s; above 0.
    pub speed_mps: f64,
    /// Radius of the arc that rounds the corner here, metres; 0 turns on the spot.
    pub corner_radius_m: f64,
}

/// Legs of constant speed and turn rate, one after the other.
///
/// The vehicle turns on the spot to face the first waypoint, drives straight legs, and turns at each
/// waypoint on the spot or along an arc. Speeds change at once: poses are continuous, velocities not.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    legs: Vec<Leg>,
    end: PlanarPose,
    duration_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    start_s: f64,
    start: PlanarPose,
    speed_mps: f64,
    turn_rate_radps: f64,
}

/// Why waypoints make no path. `waypoint` counts from 0.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PathError {
    /// No waypoints.
    #[error("a path needs at least one waypoint")]
    Empty,
    /// A waypoint on top of the one before.
    #[error("waypoint {waypoint} is where the one before it is: no direction leads there")]
    NoDistance {
        /// Which.
        waypoint: usize,
    },
    /// The arc at a waypoint is longer than its legs.
    #[error(
        "waypoint {waypoint}: an arc of `corner_radius_m` = {radius_m} needs {needed_m:.3} m of the \
         leg {which} it, which has {free_m:.3} m: make it smaller"
    )]
    ArcTooLong {
        /// Which.
        waypoint: usize,
        /// `before` or `after`.
        which: &'static str,
        /// Of the arc.
        radius_m: f64,
        /// From the corner to where the arc begins.
        needed_m: f64,
        /// What other arcs leave of the leg.
        free_m: f64,
    },
    /// The arc at a waypoint would turn the vehicle faster than its path allows.
    #[error(
        "waypoint {waypoint}: {speed_mps} m/s on an arc of `corner_radius_m` = {radius_m} turns at \
         {needed_radps:.3} rad/s, more than the path's turn rate of {allowed_radps:.3}: drive slower \
         or make it larger"
    )]
    ArcTooTight {
        /// Which.
        waypoint: usize,
        /// Of the leg before.
        speed_mps: f64,
        /// Of the arc.
        radius_m: f64,
        /// What the arc needs.
        needed_radps: f64,
        /// What the path allows.
        allowed_radps: f64,
    },
}

impl PathError {
    /// The waypoint at fault, where it is one.
    pub fn waypoint(&self) -> Option<usize> {
        match *self {
            Self::Empty => None,
            Self::NoDistance { waypoint }
            | Self::ArcTooLong { waypoint, .. }
            | Self::ArcTooTight { waypoint, .. } => Some(waypoint),
        }
    }
}

/// Shortest distance between waypoints that gives a direction, metres.
const MIN_LEG_M: f64 = 1e-6;

impl Path {
    /// The path from `start` through `waypoints`, turning at `turn_rate_radps` (above 0) on the spot.
    pub fn new(
        start: PlanarPose,
        turn_rate_radps: f64,
        waypoints: &[Waypoint],
    ) -> Result<Self, PathError> {
        if waypoints.is_empty() {
            return Err(PathError::Empty);
        }
        let mut path = Self {
            legs: Vec::new(),
            end: start,
            duration_s: 0.0,
        };
        // Metres of the leg to the next waypoint that the arc at its beginning has used.
        let mut used_m = 0.0;
        let mut from_m = start.position_m;
        for (index, waypoint) in waypoints.iter().enumerate() {
            let along = waypoint.position_m - from_m;
            let length_m = along.norm();
            if length_m < MIN_LEG_M {
                return Err(PathError::NoDistance { waypoint: index });
            }
            let heading_rad = libm::atan2(along.y, along.x);
            path.turn_on_the_spot(heading_rad, turn_rate_radps);

            let corner = waypoints.get(index + 1).and_then(|next| {
                Corner::new(
                    waypoint,
                    along / length_m,
                    next.position_m - waypoint.position_m,
                )
            });
            let cut_m = corner.map_or(0.0, |corner| corner.cut_m);
            let arc_too_long = |which, free_m| PathError::ArcTooLong {
                waypoint: index,
                which,
                radius_m: waypoint.corner_radius_m,
                needed_m: cut_m,
                free_m,
            };
            if cut_m > length_m - used_m {
                return Err(arc_too_long("before", length_m - used_m));
            }
            let straight_m = length_m - used_m - cut_m;
            let arc_start_m = waypoint.position_m - along / length_m * cut_m;
            path.drive_straight(arc_start_m, straight_m, waypoint.speed_mps);
            if let Some(corner) = corner {
                let rate_radps = waypoint.speed_mps / waypoint.corner_radius_m;
                // A part in 10⁹ lets a radius be written as the quotient of its speed and rate.
                if rate_radps > turn_rate_radps * (1.0 + 1e-9) {
                    return Err(PathError::ArcTooTight {
                        waypoint: index,
                        speed_mps: waypoint.speed_mps,
                        radius_m: waypoint.corner_radius_m,
                        needed_radps: rate_radps,
                        allowed_radps: turn_rate_radps,
                    });
                }
                if cut_m > corner.next_length_m {
                    return Err(arc_too_long("after", corner.next_length_m));
                }
                path.drive_arc(&corner, waypoint.speed_mps, rate_radps);
            }
            used_m = cut_m;
            from_m = waypoint.position_m;
        }
        Ok(path)
    }

    /// How long it takes, seconds.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Where `base_link` is at `time_s`, on the ground; before the beginning the start, after the end the
    /// end.
    pub fn world_from_base(&self, time_s: f64) -> Pose {
        self.planar_pose(time_s).level()
    }

    /// The same as [`Path::world_from_base`], in the plane; yaw may be beyond ±π.
    pub fn planar_pose(&self, time_s: f64) -> PlanarPose {
        match self.leg(time_s) {
            Some(leg) => leg.after(time_s.max(0.0) - leg.start_s),
            None => self.end,
        }
    }

    /// How fast it drives at `time_s`; not at all before the beginning and from the end on.
    pub fn velocity(&self, time_s: f64) -> PlanarVelocity {
        match self.leg(time_s) {
            Some(leg) if time_s >= 0.0 => PlanarVelocity {
                forward_mps: leg.speed_mps,
                left_mps: 0.0,
                turn_rate_radps: leg.turn_rate_radps,
            },
            Some(_) | None => PlanarVelocity::default(),
        }
    }

    /// The leg that it drives at `time_s`, before the beginning the first; `None` from the end on.
    fn leg(&self, time_s: f64) -> Option<&Leg> {
        if time_s >= self.duration_s {
            return None;
        }
        let begun = self.legs.partition_point(|leg| leg.start_s <= time_s);
        self.legs.get(begun.saturating_sub(1))
    }

    fn turn_on_the_spot(&mut self, heading_rad: f64, rate_radps: f64) {
        let turn_rad = shortest_turn_rad(self.end.yaw_rad, heading_rad);
        let end = PlanarPose {
            yaw_rad: heading_rad,
            ..self.end
        };
        let rate_radps = libm::copysign(rate_radps, turn_rad);
        self.push(0.0, rate_radps, turn_rad / rate_radps, end);
    }

    fn drive_straight(&mut self, to_m: Point2<f64>, length_m: f64, speed_mps: f64) {
        let end = PlanarPose {
            position_m: to_m,
            ..self.end
        };
        self.push(speed_mps, 0.0, length_m / speed_mps, end);
    }

    fn drive_arc(&mut self, corner: &Corner, speed_mps: f64, rate_radps: f64) {
        let rate_radps = libm::copysign(rate_radps, corner.turn_rad);
        let end = PlanarPose {
            position_m: corner.arc_end_m,
            yaw_rad: corner.next_heading_rad,
        };
        self.push(speed_mps, rate_radps, corner.turn_rad / rate_radps, end);
    }

    /// Appends a leg that ends at `end`, which is given rather than computed so that nothing accumulates.
    fn push(&mut self, speed_mps: f64, turn_rate_radps: f64, duration_s: f64, end: PlanarPose) {
        if duration_s > 0.0 {
            self.legs.push(Leg {
                start_s: self.duration_s,
                start: self.end,
                speed_mps,
                turn_rate_radps,
            });
            self.duration_s += duration_s;
        }
        self.end = end;
    }
}

impl Leg {
    fn after(&self, time_s: f64) -> PlanarPose {
        let turn_rad = self.turn_rate_radps * time_s;
        let yaw_rad = self.start.yaw_rad + turn_rad;
        let chord_m = if self.turn_rate_radps == 0.0 {
            self.speed_mps * time_s
        } else {
            2.0 * self.speed_mps / self.turn_rate_radps * libm::sin(0.5 * turn_rad)
        };
        let chord_heading_rad = self.start.yaw_rad + 0.5 * turn_rad;
        PlanarPose {
            position_m: self.start.position_m
                + Vector2::new(libm::cos(chord_heading_rad), libm::sin(chord_heading_rad))
                    * chord_m,
            yaw_rad,
        }
    }
}

#[cfg(test)]
mod tests;
