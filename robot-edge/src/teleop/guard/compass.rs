//! Headings all around, and a motion's two parts along their axes.

use super::config::GuardRules;
use super::heading::Heading;
use crate::teleop::velocity::Velocity;

/// From one axis to the next, the first of them included: 15 degrees apart.
pub(super) const STEPS: usize = 6;

/// Headings all around.
pub(super) const ALL_AROUND: usize = 4 * STEPS;

/// A way to move that is either going or turning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    Forward,
    Left,
    Back,
    Right,
}

/// Headings from forward over left, each by its number.
#[derive(Clone, Debug)]
pub(super) struct Compass {
    headings: [Heading; ALL_AROUND],
}

/// A motion in metres per second of travel: how fast it goes, and how fast its outermost point swings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Travel {
    pub(super) going: Part,
    pub(super) turning: Part,
}

/// One part of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) axis: Axis,
    /// Metres of travel per second, not negative.
    pub(super) speed_mps: f64,
}

impl Axis {
    pub(super) const ALL: [Self; 4] = [Self::Forward, Self::Left, Self::Back, Self::Right];

    /// Number of a heading some steps from this axis towards one beside it.
    pub(super) const fn towards(self, beside: Self, step: usize) -> usize {
        let (from, to) = (self as usize * STEPS, beside as usize * STEPS);
        let is_next = (from + STEPS) % ALL_AROUND == to;
        let back = if is_next { step } else { ALL_AROUND - step };
        (from + back) % ALL_AROUND
    }
}

impl Compass {
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
            Heading {
                along,
                turn_per_m: swing / radius_m,
                swing: swing.abs(),
            }
        });
        Self { headings }
    }

    pub(super) const fn heading(&self, number: usize) -> Heading {
        self.headings[number]
    }
}

impl Travel {
    /// A motion, at most as fast as the vehicle can be.
    pub(super) fn of(velocity: Velocity, rules: &GuardRules) -> Self {
        let Velocity {
            linear_mps,
            angular_radps,
        } = velocity;
        let turning_radps = angular_radps.abs().min(rules.max_turn_rate_radps);
        Self {
            going: Part {
                axis: if linear_mps < 0.0 {
                    Axis::Back
                } else {
                    Axis::Forward
                },
                speed_mps: linear_mps.abs().min(rules.max_speed_mps),
            },
            turning: Part {
                axis: if angular_radps < 0.0 {
                    Axis::Right
                } else {
                    Axis::Left
                },
                speed_mps: turning_radps * rules.footprint.radius_m(),
            },
        }
    }

    /// Its heading and speed of travel; nothing where it does not move.
    pub(super) fn heading(&self, radius_m: f64) -> Option<(Heading, f64)> {
        let signed = |part: Part, negative: Axis| {
            if part.axis == negative {
                -part.speed_mps
            } else {
                part.speed_mps
            }
        };
        let (along_m, swing_m) = (
            signed(self.going, Axis::Back),
            signed(self.turning, Axis::Right),
        );
        Heading::of(along_m, swing_m, radius_m)
    }

    /// The greatest speed on a heading between its axes that is a mixture of at most its going and its turning.
    pub(super) fn mixed_mps(&self, heading: Heading) -> f64 {
        let most = |part: Part, share: f64| {
            if share > 0.0 {
                part.speed_mps / share
            } else {
                f64::INFINITY
            }
        };
        most(self.going, heading.along.abs()).min(most(self.turning, heading.swing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_lie_between_their_axes() {
        let compass = Compass::new(0.5);
        for (axis, along, turn) in [
            (Axis::Forward, 1.0, 0.0),
            (Axis::Left, 0.0, 2.0),
            (Axis::Back, -1.0, 0.0),
            (Axis::Right, 0.0, -2.0),
        ] {
            for beside in Axis::ALL {
                let heading = compass.heading(axis.towards(beside, 0));
                assert_eq!(
                    (heading.along, heading.turn_per_m),
                    (along, turn),
                    "{axis:?}"
                );
            }
        }
        for going in [Axis::Forward, Axis::Back] {
            for turning in [Axis::Left, Axis::Right] {
                for step in 1..STEPS {
                    let heading = compass.heading(going.towards(turning, step));
                    let again = compass.heading(turning.towards(going, STEPS - step));
                    assert_eq!(heading, again);
                    assert_eq!(heading.along > 0.0, going == Axis::Forward);
                    assert_eq!(heading.turn_per_m > 0.0, turning == Axis::Left);
                    let angle = libm::atan2(heading.swing, heading.along.abs()).to_degrees();
                    assert!((angle - 15.0 * step as f64).abs() < 1e-9);
                }
            }
        }
    }
}
