//! How a solid moves.

use nalgebra::Vector2;

/// A motion along straight lines, without turning.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    keyframes: Vec<Keyframe>,
    appears_s: f64,
    leaves_s: f64,
}

/// Where a moving solid is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframe {
    /// Seconds since the beginning of the run.
    pub time_s: f64,
    /// From where its world file puts it, metres.
    pub offset_m: Vector2<f64>,
}

/// Why keyframes make no motion.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    /// A keyframe that is not after the one before.
    #[error("keyframe {keyframe} is not later than the one before it")]
    NotLater {
        /// Counted from 0.
        keyframe: usize,
    },
    /// It is never there.
    #[error("`leaves_s` is not later than `appears_s`: it is never there")]
    NeverThere,
}

impl Motion {
    /// The motion through `keyframes`, in between at constant speed, before the first and after the last
    /// at rest; no keyframes are no offset. It is there from `appears_s` until before `leaves_s`.
    pub fn new(
        keyframes: Vec<Keyframe>,
        appears_s: f64,
        leaves_s: f64,
    ) -> Result<Self, MotionError> {
        let late = |pair: &[Keyframe]| pair[0].time_s < pair[1].time_s;
        if let Some(before) = keyframes.windows(2).position(|pair| !late(pair)) {
            return Err(MotionError::NotLater {
                keyframe: before + 1,
            });
        }
        if appears_s < leaves_s {
            Ok(Self {
                keyframes,
                appears_s,
                leaves_s,
            })
        } else {
            Err(MotionError::NeverThere)
        }
    }

    /// The offset at a time; `None` where the solid is not there.
    pub fn offset_m(&self, time_s: f64) -> Option<Vector2<f64>> {
        if !(self.appears_s..self.leaves_s).contains(&time_s) {
            return None;
        }
        let next = self
            .keyframes
            .partition_point(|keyframe| keyframe.time_s <= time_s);
        let before = next.checked_sub(1).and_then(|n| self.keyframes.get(n));
        Some(match (before, self.keyframes.get(next)) {
            (Some(from), Some(to)) => {
                let share = (time_s - from.time_s) / (to.time_s - from.time_s);
                from.offset_m + (to.offset_m - from.offset_m) * share
            }
            (Some(only), None) | (None, Some(only)) => only.offset_m,
            (None, None) => Vector2::zeros(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keyframe(time_s: f64, x: f64, y: f64) -> Keyframe {
        Keyframe {
            time_s,
            offset_m: Vector2::new(x, y),
        }
    }

    #[test]
    fn moves_in_straight_lines_and_rests_before_and_after() {
        let frames = vec![
            keyframe(2.0, 1.0, 0.0),
            keyframe(4.0, 1.0, 3.0),
            keyframe(5.0, -1.0, 3.0),
        ];
        let motion = Motion::new(frames, f64::NEG_INFINITY, f64::INFINITY).unwrap();
        for (time_s, expected) in [
            (-1.0, [1.0, 0.0]),
            (2.0, [1.0, 0.0]),
            (3.5, [1.0, 2.25]),
            (4.25, [0.5, 3.0]),
            (5.0, [-1.0, 3.0]),
            (1e9, [-1.0, 3.0]),
        ] {
            let offset_m = motion.offset_m(time_s).unwrap();
            assert!(
                (offset_m - Vector2::from(expected)).norm() < 1e-12,
                "{time_s} s: {offset_m}"
            );
        }
    }

    #[test]
    fn is_there_between_appearing_and_leaving_only() {
        let motion = Motion::new(vec![keyframe(0.0, 1.0, 0.0)], 1.0, 3.0).unwrap();
        let there = [0.999, 1.0, 2.999, 3.0].map(|time_s| motion.offset_m(time_s).is_some());
        assert_eq!(there, [false, true, true, false]);
        let standing = Motion::new(Vec::new(), f64::NEG_INFINITY, 3.0).unwrap();
        assert_eq!(standing.offset_m(2.0), Some(Vector2::zeros()));
        assert_eq!(standing.offset_m(4.0), None);
    }

    #[test]
    fn senseless_motions_are_refused() {
        let twice = vec![keyframe(1.0, 0.0, 0.0), keyframe(1.0, 1.0, 0.0)];
        assert_eq!(
            Motion::new(twice, 0.0, 9.0),
            Err(MotionError::NotLater { keyframe: 1 })
        );
        assert_eq!(
            Motion::new(Vec::new(), 3.0, 3.0),
            Err(MotionError::NeverThere)
        );
    }
}
