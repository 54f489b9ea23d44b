//! Headings all around, and a motion's two parts along their axes.

use super::config::CollisionMonitorRules;
use super::motion_direction::MotionDirection;
use crate::velocity::Velocity;

/// From one axis to the next, the first of them included: 15 degrees apart.
pub(super) const STEPS: usize = 6;

/// Headings all around.
pub(super) const ALL_DIRECTIONS: usize = 4 * STEPS;

/// A way to move that is either going or turning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DriveAxis {
    Forward,
    Left,
    Back,
    Right,
}

/// Headings from forward over left, each by its number.
#[derive(Clone, Debug)]
pub(super) struct DirectionTable {
    headings: [MotionDirection; ALL_DIRECTIONS],
}

/// A motion in metres per second of travel: how fast it goes, and how fast its outermost point swings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AxisSpeeds {
    pub(super) going: AxisSpeed,
    pub(super) turning: AxisSpeed,
}

/// One part of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AxisSpeed {
    pub(super) axis: DriveAxis,
    /// Metres of travel per second, not negative.
    pub(super) speed_mps: f64,
}

impl DriveAxis {
    pub(super) const ALL: [Self; 4] = [Self::Forward, Self::Left, Self::Back, Self::Right];

    /// Number of a heading some steps from this axis towards one beside it.
    pub(super) const fn towards(self, beside: Self, step: usize) -> usize {
        let (from, to) = (self as usize * STEPS, beside as usize * STEPS);
        let is_next = (from + STEPS) % ALL_DIRECTIONS == to;
        let back = if is_next { step } else { ALL_DIRECTIONS - step };
        (from + back) % ALL_DIRECTIONS
    }
}

impl DirectionTable {
    pub(super) fn new(radius_m: f64) -> Self {
        let headings = std::array::from_fn(|number| {
            let angle = std::f64::consts::FRAC_PI_2 * (number % STEPS) as f64 / STEPS as f64;
            let (cos, sin) = (libm::cos(angle), libm::sin(angle));
            // Axes are exact: their headings neither drift to a side nor along.
            let (along, swing) = match number / STEPS {
                0 => (cos, sin),
                1 => (-sin, cos),
                2 => (-cos, -sin),
                _ => (sin, -cos),
            };
            MotionDirection {
                along,
                turn_per_m: swing / radius_m,
                swing: swing.abs(),
            }
        });
        Self { headings }
    }

    pub(super) const fn direction(&self, number: usize) -> MotionDirection {
        self.headings[number]
    }
}

impl AxisSpeeds {
    /// A motion, at most as fast as the vehicle can be.
    pub(super) fn of(velocity: Velocity, rules: &CollisionMonitorRules) -> Self {
        let Velocity {
            linear_mps,
            angular_radps,
        } = velocity;
        let turning_radps = angular_radps.abs().min(rules.max_turn_rate_radps);
        Self {
            going: AxisSpeed {
                axis: if linear_mps < 0.0 {
                    DriveAxis::Back
                } else {
                    DriveAxis::Forward
                },
                speed_mps: linear_mps.abs().min(rules.max_speed_mps),
            },
            turning: AxisSpeed {
                axis: if angular_radps < 0.0 {
                    DriveAxis::Right
                } else {
                    DriveAxis::Left
                },
                speed_mps: turning_radps * rules.footprint.radius_m(),
            },
        }
    }

    /// Its heading and speed of travel; nothing where it does not move.
    pub(super) fn direction(&self, radius_m: f64) -> Option<(MotionDirection, f64)> {
        let signed = |part: AxisSpeed, negative: DriveAxis| {
            if part.axis == negative {
                -part.speed_mps
            } else {
                part.speed_mps
            }
        };
        let (along_m, swing_m) = (
            signed(self.going, DriveAxis::Back),
            signed(self.turning, DriveAxis::Right),
        );
        MotionDirection::of(along_m, swing_m, radius_m)
    }

    /// The greatest speed on a heading between its axes that is a mixture of at most its going and its turning.
    pub(super) fn mixed_mps(&self, direction: MotionDirection) -> f64 {
        let most = |part: AxisSpeed, share: f64| {
            if share > 0.0 {
                part.speed_mps / share
            } else {
                f64::INFINITY
            }
        };
        most(self.going, direction.along.abs()).min(most(self.turning, direction.swing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_lie_between_their_axes() {
        let directions = DirectionTable::new(0.5);
        for (axis, along, turn) in [
            (DriveAxis::Forward, 1.0, 0.0),
            (DriveAxis::Left, 0.0, 2.0),
            (DriveAxis::Back, -1.0, 0.0),
            (DriveAxis::Right, 0.0, -2.0),
        ] {
            for beside in DriveAxis::ALL {
                let direction = directions.direction(axis.towards(beside, 0));
                assert_eq!(
                    (direction.along, direction.turn_per_m),
                    (along, turn),
                    "{axis:?}"
                );
            }
        }
        for going in [DriveAxis::Forward, DriveAxis::Back] {
            for turning in [DriveAxis::Left, DriveAxis::Right] {
                for step in 1..STEPS {
                    let direction = directions.direction(going.towards(turning, step));
                    let again = directions.direction(turning.towards(going, STEPS - step));
                    assert_eq!(direction, again);
                    assert_eq!(direction.along > 0.0, going == DriveAxis::Forward);
                    assert_eq!(direction.turn_per_m > 0.0, turning == DriveAxis::Left);
                    let angle = libm::atan2(direction.swing, direction.along.abs()).to_degrees();
                    assert!((angle - 15.0 * step as f64).abs() < 1e-9);
                }
            }
        }
    }
}
