//! Which way a vehicle moves: the share of going and of turning in its motion.

/// A direction of motion of a vehicle that goes along its x axis and turns about its origin.
///
/// Keeping it, the vehicle drives an arc: straight on at 0, to the left on the spot at π/2, straight back at π. How far it
/// has moved along is its *travel*, metres: it has then gone `travel · along`, and turned by `travel · turn_per_m`. No
/// point of the body moves farther than √2 times that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionDirection {
    /// Metres gone per metre of travel, −1 to 1.
    pub along: f64,
    /// Radians turned per metre of travel, positive to the left.
    pub turn_per_m: f64,
    /// Metres that the outermost point of the body moves sideways per metre of travel, 0 to 1.
    pub swing: f64,
}

/// How hard a vehicle brakes, and when it begins to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Braking {
    /// How long it keeps its speed before it brakes, seconds.
    pub reaction_s: f64,
    /// Metres per second squared.
    pub decel_mps2: f64,
    /// Radians per second squared.
    pub decel_radps2: f64,
}

impl MotionDirection {
    /// The heading of a motion that goes `along_m` while its outermost point, `radius_m` from the origin, swings
    /// `swing_m` to the left; and the length of both. Nothing where it does not move, or a number is not finite.
    pub fn of(along_m: f64, swing_m: f64, radius_m: f64) -> Option<(Self, f64)> {
        let length = (along_m * along_m + swing_m * swing_m).sqrt();
        let moves = length > 0.0 && length.is_finite() && radius_m > 0.0;
        moves.then(|| {
            let swing = swing_m / length;
            let direction = Self {
                along: along_m / length,
                turn_per_m: swing / radius_m,
                swing: swing.abs(),
            };
            (direction, length)
        })
    }

    /// Travel until it stands, metres, from a speed of travel in metres per second.
    ///
    /// `v·t + v²/2a` ("Collision monitor"), of the slower to stop of going and turning.
    pub fn stopping_travel_m(self, speed_mps: f64, braking: &Braking) -> f64 {
        speed_mps * (braking.reaction_s + speed_mps * self.seconds_per_speed(braking))
    }

    /// The greatest speed of travel, metres per second, from which it stands within a travel: the solution of
    /// [`MotionDirection::stopping_travel_m`] for the speed.
    pub fn speed_for_mps(self, travel_m: f64, braking: &Braking) -> f64 {
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
        let going = self.along.abs() / braking.decel_mps2;
        let turning = self.turn_per_m.abs() / braking.decel_radps2;
        0.5 * going.max(turning)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BRAKING: Braking = Braking {
        reaction_s: 0.12,
        decel_mps2: 1.0,
        decel_radps2: 4.0,
    };

    #[test]
    fn straight_on_it_is_the_formula_of_the_design() {
        let (ahead, _) = MotionDirection::of(2.0, 0.0, 0.8).unwrap();
        assert!((ahead.stopping_travel_m(1.0, &BRAKING) - (0.12 + 0.5)).abs() < 1e-12);
        let (left, _) = MotionDirection::of(0.0, 1.0, 0.5).unwrap();
        // 2 rad/s: the outermost point at 1 m/s.
        let turned_rad = left.stopping_travel_m(1.0, &BRAKING) * left.turn_per_m;
        assert!((turned_rad - (2.0 * 0.12 + 4.0 / 8.0)).abs() < 1e-12);
    }

    #[test]
    fn what_does_not_move_has_no_heading() {
        for (along_m, swing_m) in [(0.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
            assert_eq!(MotionDirection::of(along_m, swing_m, 0.5), None);
        }
        assert_eq!(MotionDirection::of(1.0, 1.0, 0.0), None);
    }

    proptest! {
        #[test]
        fn the_speed_is_the_one_that_needs_the_travel(
            along in -1.0..1.0, swing in -1.0..1.0, travel_m in 1e-6..50.0
        ) {
            let (direction, _) = MotionDirection::of(along, swing, 0.7).unwrap();
            let speed = direction.speed_for_mps(travel_m, &BRAKING);
            let needed = direction.stopping_travel_m(speed, &BRAKING);
            prop_assert!((needed - travel_m).abs() < 1e-9 * (1.0 + travel_m));
        }
    }
}
