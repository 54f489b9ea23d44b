//! The path of a simulated vehicle: its exact pose at any time.

use measurement::pose::{self, Pose};
use nalgebra::{Point2, Vector2};

use crate::velocity::PlanarVelocity;
use crate::world::values::ItemError;

/// A point to drive to, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Waypoint {
    pub position_m: Point2<f64>,
    /// Speed on the way there, m/s; above 0.
    pub(crate) speed_mps: f64,
    /// Radius of the arc that rounds the corner here, metres; 0 turns on the spot.
    pub(crate) corner_radius_m: f64,
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

/// Shortest distance between waypoints that gives a direction, metres.
const MIN_LEG_M: f64 = 1e-6;

impl Path {
    /// The path from `start` through `waypoints`, turning at `turn_rate_radps` (above 0) on the spot.
    pub(crate) fn new(
        start: PlanarPose,
        turn_rate_radps: f64,
        waypoints: &[Waypoint],
    ) -> Result<Self, ItemError> {
        if waypoints.is_empty() {
            return Err(ItemError::whole("a path needs at least one waypoint"));
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
            let refused = |message: String| ItemError {
                item: Some(index),
                message: format!("waypoint {index}{message}"),
            };
            let along = waypoint.position_m - from_m;
            let length_m = along.norm();
            if length_m < MIN_LEG_M {
                return Err(refused(
                    " is where the one before it is: no direction leads there".to_owned(),
                ));
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
            let radius_m = waypoint.corner_radius_m;
            let arc_too_long = |which, free_m: f64| {
                refused(format!(
                    ": an arc of `corner_radius_m` = {radius_m} needs {cut_m:.3} m of the leg {which} it, \
                     which has {free_m:.3} m: make it smaller"
                ))
            };
            if cut_m > length_m - used_m {
                return Err(arc_too_long("before", length_m - used_m));
            }
            let straight_m = length_m - used_m - cut_m;
            let arc_start_m = waypoint.position_m - along / length_m * cut_m;
            path.drive_straight(arc_start_m, straight_m, waypoint.speed_mps);
            if let Some(corner) = corner {
                let speed_mps = waypoint.speed_mps;
                let rate_radps = speed_mps / radius_m;
                // A part in 10⁹ lets a radius be written as the quotient of its speed and rate.
                if rate_radps > turn_rate_radps * (1.0 + 1e-9) {
                    return Err(refused(format!(
                        ": {speed_mps} m/s on an arc of `corner_radius_m` = {radius_m} turns at \
                         {rate_radps:.3} rad/s, more than the path's turn rate of {turn_rate_radps:.3}: \
                         drive slower or make it larger"
                    )));
                }
                if cut_m > corner.next_length_m {
                    return Err(arc_too_long("after", corner.next_length_m));
                }
                path.drive_arc(&corner, speed_mps, rate_radps);
            }
            used_m = cut_m;
            from_m = waypoint.position_m;
        }
        Ok(path)
    }

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
    pub(crate) fn velocity(&self, time_s: f64) -> PlanarVelocity {
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

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanarPose {
    pub position_m: Point2<f64>,
    /// Radians, counter-clockwise from x.
    pub yaw_rad: f64,
}

impl PlanarPose {
    /// The same pose in space, level at z = 0.
    pub(crate) fn level(&self) -> Pose {
        pose::planar(self.position_m.x, self.position_m.y, self.yaw_rad)
    }

    #[must_use]
    pub(crate) fn towards(&self, next: &Self, share: f64) -> Self {
        Self {
            position_m: self.position_m + (next.position_m - self.position_m) * share,
            yaw_rad: self.yaw_rad + (next.yaw_rad - self.yaw_rad) * share,
        }
    }
}

/// A corner rounded by an arc that is tangent to both legs.
#[derive(Clone, Copy)]
struct Corner {
    turn_rad: f64,
    /// From the waypoint to either end of the arc.
    cut_m: f64,
    next_length_m: f64,
    next_heading_rad: f64,
    arc_end_m: Point2<f64>,
}

impl Corner {
    /// `None` where the vehicle turns on the spot, or has nothing to turn.
    fn new(waypoint: &Waypoint, direction: Vector2<f64>, to_next: Vector2<f64>) -> Option<Self> {
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
fn shortest_turn_rad(from_rad: f64, to_rad: f64) -> f64 {
    let turn_rad = libm::remainder(to_rad - from_rad, std::f64::consts::TAU);
    if turn_rad <= -std::f64::consts::PI {
        std::f64::consts::PI
    } else {
        turn_rad
    }
}

#[cfg(test)]
mod tests;
