//! The footprint, the direction of motion, and the distance that the footprint can move along an arc before it touches
//! a point: exact, in closed form.
//!
//! In the vehicle's frame the point moves on a circle about the centre of the arc. It touches the vehicle where this
//! circle enters the rectangle, on one of its four edges. The first such place along the circle is found by comparing
//! chords, without angles.

/// The vehicle seen from above, in its base frame: from `rear_m` to `front_m` along x, and `half_width_m` to
/// either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Footprint {
    /// Metres.
    pub(crate) front_m: f64,
    /// Metres, less than `front_m`: negative where the base frame is within the footprint.
    pub(crate) rear_m: f64,
    /// Metres.
    pub(crate) half_width_m: f64,
}

/// Space around the footprint that is to stay free, metres, not negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Margins {
    /// Ahead of the end or side that leads, where the vehicle only goes; where it only turns, none.
    pub(crate) ahead_m: f64,
    /// On every side, ahead included.
    pub(crate) side_m: f64,
}

/// Arcs wider than this are straight: over 100 m they are off by half a millimetre, and rounding not yet by a
/// micrometre.
const STRAIGHT_RADIUS_M: f64 = 1e7;

/// A point that is nearer than this touches, metres: which way it lies along the circle is then decided by rounding.
const TOUCH_M: f64 = 1e-6;

impl Footprint {
    pub(crate) const fn centred(length_m: f64, width_m: f64) -> Self {
        Self {
            front_m: 0.5 * length_m,
            rear_m: -0.5 * length_m,
            half_width_m: 0.5 * width_m,
        }
    }

    #[must_use]
    pub(crate) const fn moved_ahead(self, by_m: f64) -> Self {
        Self {
            front_m: self.front_m + by_m,
            rear_m: self.rear_m + by_m,
            half_width_m: self.half_width_m,
        }
    }

    /// Distance of its farthest corner from the origin, metres.
    pub(crate) fn radius_m(&self) -> f64 {
        let along = self.front_m.max(-self.rear_m);
        (along * along + self.half_width_m * self.half_width_m).sqrt()
    }

    /// Whether a point lies inside, its edge excluded.
    pub(crate) fn contains(&self, [x, y]: [f64; 2]) -> bool {
        x < self.front_m && x > self.rear_m && y.abs() < self.half_width_m
    }

    /// Grown by the margins as they are on a heading.
    fn with_margins(&self, margins: Margins, direction: MotionDirection) -> Self {
        let [ahead, beside] = [direction.along, direction.across]
            .map(|share| margins.side_m.max(margins.ahead_m * share.abs()));
        let (front, rear) = if direction.along >= 0.0 {
            (ahead, margins.side_m)
        } else {
            (margins.side_m, ahead)
        };
        Self {
            front_m: self.front_m + front,
            rear_m: self.rear_m - rear,
            half_width_m: self.half_width_m + beside,
        }
    }

    pub(super) fn grown(&self, by_m: f64) -> Self {
        Self {
            front_m: self.front_m + by_m,
            rear_m: self.rear_m - by_m,
            half_width_m: self.half_width_m + by_m,
        }
    }

    /// Travel until the footprint with its margins touches the first of `points` (metres, base frame), metres; infinite
    /// where it touches none. Points that are not finite are not there.
    ///
    /// A point that lies within the margins already does not hold the vehicle: it may move as long as it does not come
    /// nearer, and then until the bare footprint touches the point.
    pub(crate) fn free_travel_m(
        &self,
        margins: Margins,
        direction: MotionDirection,
        points: &[[f64; 2]],
    ) -> f64 {
        let grown = self.with_margins(margins, direction);
        let swept = SweptFootprint {
            bare: *self,
            grown,
            near: grown.grown(TOUCH_M),
            direction,
        };
        // A vehicle that goes sideways does not turn.
        if direction.along.abs().max(direction.across.abs())
            >= STRAIGHT_RADIUS_M * direction.turn_per_m.abs()
        {
            let nearest = points.iter().map(|&point| swept.straight_m(point));
            return nearest.fold(f64::INFINITY, f64::min);
        }
        swept.first_on_arc_m(points)
    }
}

struct SweptFootprint {
    bare: Footprint,
    grown: Footprint,
    /// What touches, up to rounding.
    near: Footprint,
    direction: MotionDirection,
}

impl SweptFootprint {
    fn straight_m(&self, [x, y]: [f64; 2]) -> f64 {
        let point = [x, y];
        let footprint = if self.near.contains(point) {
            if self.is_approached(point) {
                return 0.0;
            }
            &self.bare
        } else {
            &self.grown
        };
        // Travel between which the point is within the rectangle, along each axis.
        let within = |at: f64, share: f64, [least, greatest]: [f64; 2]| {
            if share.abs() > 0.0 {
                let ends = [(at - greatest) / share, (at - least) / share];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            } else if at > least && at < greatest {
                [f64::NEG_INFINITY, f64::INFINITY]
            } else {
                [f64::INFINITY; 2]
            }
        };
        let along = within(
            x,
            self.direction.along,
            [footprint.rear_m, footprint.front_m],
        );
        let half_width_m = footprint.half_width_m;
        let across = within(y, self.direction.across, [-half_width_m, half_width_m]);
        let enters_m = along[0].max(across[0]);
        if enters_m >= 0.0 && enters_m < along[1].min(across[1]) {
            enters_m
        } else {
            f64::INFINITY
        }
    }

    fn first_on_arc_m(&self, points: &[[f64; 2]]) -> f64 {
        let grown = Circles::about(self.direction, self.grown);
        let bare = Circles::about(self.direction, self.bare);
        let mut first = f64::INFINITY;
        for &point in points {
            if self.near.contains(point) {
                if self.is_approached(point) {
                    return 0.0;
                }
                // Inside the bare footprint it would be found where it leaves.
                if !self.bare.contains(point) {
                    first = first.min(bare.entry(point));
                }
            } else {
                first = first.min(grown.entry(point));
            }
        }
        angle_of(first) / self.direction.turn_per_m.abs()
    }

    /// Whether a point within the margins comes nearer to the footprint.
    ///
    /// Outside of the bare footprint there are one or two edges that keep it apart, and as long as one of them still
    /// does, it does not. Inside, its nearest edge is the way out.
    fn is_approached(&self, [x, y]: [f64; 2]) -> bool {
        let Footprint {
            front_m,
            rear_m,
            half_width_m,
        } = self.bare;
        // The point as seen from the vehicle.
        let velocity_x = self.direction.turn_per_m * y - self.direction.along;
        let velocity_y = -self.direction.turn_per_m * x - self.direction.across;
        let ends = if x - front_m >= rear_m - x {
            (x - front_m, velocity_x)
        } else {
            (rear_m - x, -velocity_x)
        };
        let sides = (y.abs() - half_width_m, velocity_y * y.signum());
        // How far outside, and how fast farther.
        match (ends.0 >= 0.0, sides.0 >= 0.0) {
            (true, true) => ends.1 < 0.0 && sides.1 < 0.0,
            (true, false) => ends.1 < 0.0,
            (false, false) if ends.0 >= sides.0 => ends.1 < 0.0,
            (false, _) => sides.1 < 0.0,
        }
    }
}

struct Circles {
    edges: Footprint,
    centre_y_m: f64,
    /// Which way the points turn: 1 to the left, −1 to the right.
    turn: f64,
    /// Squares of the radii between which circles meet the rectangle.
    nearest_m2: f64,
    farthest_m2: f64,
}

impl Circles {
    fn about(direction: MotionDirection, edges: Footprint) -> Self {
        let centre_y_m = direction.along / direction.turn_per_m;
        let beside_m = (centre_y_m.abs() - edges.half_width_m).max(0.0);
        let reach_m = centre_y_m.abs() + edges.half_width_m;
        let along_m = edges.front_m.max(-edges.rear_m);
        Self {
            edges,
            centre_y_m,
            turn: -direction.turn_per_m.signum(),
            nearest_m2: beside_m * beside_m,
            farthest_m2: reach_m * reach_m + along_m * along_m,
        }
    }

    /// Where the circle of a point outside first enters the rectangle, as an angle that is compared and not yet known:
    /// 0 to 8 for 0 to a full turn, infinite where it does not.
    fn entry(&self, [x, y]: [f64; 2]) -> f64 {
        let p = [x, y - self.centre_y_m];
        let radius_m2 = p[0] * p[0] + p[1] * p[1];
        // Also where it is not a number.
        if !(radius_m2 > self.nearest_m2 && radius_m2 < self.farthest_m2) {
            return f64::INFINITY;
        }
        let Footprint {
            front_m,
            rear_m,
            half_width_m,
        } = self.edges;
        let mut first = f64::INFINITY;
        let mut meet = |q: [f64; 2]| {
            let chord = [q[0] - p[0], q[1] - p[1]];
            let chord_m2 = chord[0] * chord[0] + chord[1] * chord[1];
            let is_ahead = (p[0] * q[1] - p[1] * q[0]) * self.turn >= 0.0;
            let angle_m2 = if is_ahead {
                chord_m2
            } else {
                8.0 * radius_m2 - chord_m2
            };
            first = first.min(angle_m2);
        };
        for x_m in [front_m, rear_m] {
            let square_m2 = radius_m2 - x_m * x_m;
            if square_m2 >= 0.0 {
                let y_m = square_m2.sqrt();
                for y_m in [y_m, -y_m] {
                    if (y_m + self.centre_y_m).abs() <= half_width_m {
                        meet([x_m, y_m]);
                    }
                }
            }
        }
        for y_m in [
            half_width_m - self.centre_y_m,
            -half_width_m - self.centre_y_m,
        ] {
            let square_m2 = radius_m2 - y_m * y_m;
            if square_m2 >= 0.0 {
                let x_m = square_m2.sqrt();
                for x_m in [x_m, -x_m] {
                    if (rear_m..=front_m).contains(&x_m) {
                        meet([x_m, y_m]);
                    }
                }
            }
        }
        first / radius_m2
    }
}

/// The angle, radians, that [`Circles::entry`] stands for: the square of the chord of the unit circle, and beyond half
/// a turn eight less that.
fn angle_of(entry: f64) -> f64 {
    if entry.is_infinite() {
        f64::INFINITY
    } else if entry <= 4.0 {
        2.0 * libm::asin(0.5 * entry.sqrt())
    } else {
        let back = (8.0 - entry).max(0.0);
        2.0 * (std::f64::consts::PI - libm::asin(0.5 * back.sqrt()))
    }
}

/// A direction of motion of a vehicle that goes along its x axis and turns about its origin, or goes along its x and y
/// axes and does not turn.
///
/// Keeping it, the vehicle drives an arc or a straight line. How far it has moved along is its *travel*, metres: it has
/// then gone `travel · along` and `travel · across`, and turned by `travel · turn_per_m`. No point of the body moves
/// farther than √2 times that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MotionDirection {
    /// Metres gone per metre of travel, −1 to 1.
    pub(crate) along: f64,
    /// Metres gone to the left per metre of travel, −1 to 1; zero where it turns.
    pub(crate) across: f64,
    /// Radians turned per metre of travel, positive to the left.
    pub(crate) turn_per_m: f64,
    /// Metres that the outermost point of the body moves sideways per metre of travel, 0 to 1.
    pub(crate) swing: f64,
}

/// The two axes of a motion: x, and this one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum MotionPlane {
    /// Turning: how far the outermost point of the body swings, which is `radius_m` (above 0) from the origin.
    Turning { radius_m: f64 },
    /// y.
    Sideways,
}

/// How hard a vehicle brakes, and when it begins to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Braking {
    /// How long it keeps its speed before it brakes, seconds.
    pub(crate) reaction_s: f64,
    /// Metres per second squared.
    pub(crate) decel_mps2: f64,
    /// Radians per second squared.
    pub(crate) decel_radps2: f64,
}

impl MotionDirection {
    /// The direction of a motion that goes `first_m` along x and `second_m` along the second axis of `plane`; and the
    /// length of both. `None` where it does not move, or a number is not finite.
    pub(crate) fn of(first_m: f64, second_m: f64, plane: MotionPlane) -> Option<(Self, f64)> {
        let length = (first_m * first_m + second_m * second_m).sqrt();
        let moves = length > 0.0 && length.is_finite();
        moves.then(|| {
            let direction = Self::in_plane(first_m / length, second_m / length, plane);
            (direction, length)
        })
    }

    /// The direction with these shares, whose squares sum up to 1.
    pub(crate) fn in_plane(first: f64, second: f64, plane: MotionPlane) -> Self {
        let (across, swing, radius_m) = match plane {
            MotionPlane::Turning { radius_m } => (0.0, second, radius_m),
            MotionPlane::Sideways => (second, 0.0, 1.0),
        };
        Self {
            along: first,
            across,
            turn_per_m: swing / radius_m,
            swing: swing.abs(),
        }
    }

    /// The share of the second axis of its plane, 0 to 1.
    pub(crate) const fn second_share(self) -> f64 {
        self.swing + self.across.abs()
    }

    /// The greatest speed of travel, metres per second, from which it stands within a travel: `v·t + v²/2a`
    /// (docs/safety.md) solved for the speed `v`.
    pub(crate) fn speed_for_mps(self, travel_m: f64, braking: &Braking) -> f64 {
        if travel_m <= 0.0 {
            return 0.0;
        }
        if travel_m.is_infinite() {
            return f64::INFINITY;
        }
        let (t, k) = (braking.reaction_s, self.seconds_per_speed(braking));
        // Not `(√(t² + 4k·s) − t) / 2k`, whose difference is that of two nearly equal numbers.
        2.0 * travel_m / (t + (t * t + 4.0 * k * travel_m).sqrt())
    }

    /// `k` of `v²·k`, the travel while it brakes.
    fn seconds_per_speed(self, braking: &Braking) -> f64 {
        let going = self.along.abs().max(self.across.abs()) / braking.decel_mps2;
        let turning = self.turn_per_m.abs() / braking.decel_radps2;
        0.5 * going.max(turning)
    }
}

#[cfg(test)]
mod tests;
