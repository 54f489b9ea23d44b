//! How much faster a boat is than the guard allows.

use super::config::CollisionMonitorRules;
use crate::speed_limits::SpeedLimits;
use crate::velocity::Velocity;

/// A limit that is less than the greatest speed by a smaller share is that speed: it is divided by a radius on its way.
const ROUNDING: f64 = 1e-9;

/// A boat at its greatest speed measures more and less in turn, by less than this share: positions that are good to 2 cm,
/// half a second apart, make 0.06 m/s of 3.0. What is so much faster needs 0.6 m more to come to rest, less than its margin of 1 m.
const NOISE: f64 = 0.03;

/// What is measured beyond the limits, with its sign; zero along an axis that keeps to them.
///
/// Where the guard allows the greatest speed, noise does not count: no command asks for more, and without thrust at every
/// second measurement the boat would never get there.
pub(super) fn overspeed(
    limits: &SpeedLimits,
    measured: Velocity,
    rules: &CollisionMonitorRules,
) -> Velocity {
    Velocity {
        linear_mps: beyond(
            (limits.forward_mps, limits.reverse_mps),
            measured.linear_mps,
            rules.max_speed_mps,
        ),
        angular_radps: beyond(
            (limits.left_radps, limits.right_radps),
            measured.angular_radps,
            rules.max_turn_rate_radps,
        ),
    }
}

fn beyond((positive, negative): (f64, f64), measured: f64, greatest: f64) -> f64 {
    let limit = if measured < 0.0 { negative } else { positive };
    let tolerated = if limit < greatest * (1.0 - ROUNDING) {
        limit
    } else {
        greatest * (1.0 + NOISE)
    };
    if measured.abs() > tolerated {
        measured - limit.copysign(measured)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_at_the_greatest_speed_is_no_excess_and_more_than_a_lower_limit_is() {
        for (limit, measured, expected) in [
            (3.0, 3.08, 0.0),
            (3.0 * (1.0 - 1e-12), -3.08, 0.0),
            (3.0, 3.1, 0.1),
            (2.9, 2.9, 0.0),
            (2.9, 2.95, 0.05),
            (0.0, -0.25, -0.25),
        ] {
            // What holds the other way does not matter.
            for other in [0.0, 3.0] {
                let limits = if measured < 0.0 {
                    (other, limit)
                } else {
                    (limit, other)
                };
                let is = beyond(limits, measured, 3.0);
                assert!((is - expected).abs() < 1e-9, "{limit} {measured}: {is}");
            }
        }
    }
}
