//! Whether a vehicle lies still, by where it is: a speed is told forwards only, so that it knows of no drift to the
//! side, and it is noisy where it comes from satellites.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::Pose;

use super::ConsoleModel;
use super::motion::MOVING;
use super::time_window::TimeWindow;

/// For so long it must have been where it is.
const MIN_TIME: Duration = Duration::from_secs(3);
/// What is no farther away is where it is, metres: 0.05 m/s for that time. Positions that are good to 2 cm differ by
/// less; where they are worse, nothing lies still.
const MAX_DRIFT_M: f64 = 0.15;

/// Where a vehicle was lately.
#[derive(Clone, Debug, Default)]
pub(super) struct StandstillDetector {
    /// In `odom`, metres.
    places_m: TimeWindow<[f64; 2]>,
    is_still: bool,
}

impl StandstillDetector {
    /// A status comes; `pose` is the newest.
    pub(super) fn update(&mut self, pose: Option<&Pose>, now: Monotonic) {
        let Some(pose) = pose else {
            *self = Self::default();
            return;
        };
        let [x_m, y_m, _] = pose.position_m;
        self.places_m.add([x_m, y_m], MIN_TIME, now);
        let mut places_m = self.places_m.iter();
        let has_stayed = places_m.all(|[was_x_m, was_y_m]| {
            let (dx_m, dy_m) = (x_m - was_x_m, y_m - was_y_m);
            dx_m * dx_m + dy_m * dy_m < MAX_DRIFT_M * MAX_DRIFT_M
        });
        // Who has just joined knows no places, and takes its speed for it.
        let is_slow = pose.speed_mps.abs() < MOVING || self.places_m.spans(MIN_TIME);
        self.is_still = has_stayed && is_slow && pose.turn_rate_radps.abs() < MOVING;
    }
}

impl ConsoleModel {
    /// Whether the vehicle neither goes nor turns, nor drifts as far as can be told.
    pub const fn is_still(&self) -> bool {
        self.motion.standstill.is_still
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{at, pose_at_rest};

    /// Whether it lies still that was at these places, metres ahead and to the left, at 2 Hz, and measures this, m/s.
    fn is_still(places_m: &[[f64; 2]], speed_mps: f32) -> bool {
        let mut detector = StandstillDetector::default();
        for (half_s, [x_m, y_m]) in (0_u64..).zip(places_m) {
            let pose = Pose {
                position_m: [*x_m, *y_m, 0.0],
                speed_mps,
                ..pose_at_rest()
            };
            detector.update(Some(&pose), at(500 * half_s));
        }
        detector.is_still
    }

    #[test]
    fn what_stays_in_its_place_lies_still_whatever_speed_is_measured() {
        let noisy: Vec<_> = (0..8).map(|n| [0.03 * f64::from(n % 2), 0.0]).collect();
        assert!(is_still(&noisy, 0.12));
        let drifts_aside: Vec<_> = (0..8).map(|n| [0.0, 0.04 * f64::from(n)]).collect();
        assert!(
            !is_still(&drifts_aside, 0.0),
            "0.08 m/s, none of it forwards"
        );
        let mut came: Vec<_> = vec![[1.0, 0.0]; 3];
        came.extend([[0.0; 2]; 6]);
        assert!(!is_still(&came, 0.0), "not for long enough");
        came.push([0.0; 2]);
        assert!(is_still(&came, 0.0));
    }

    #[test]
    fn who_has_just_joined_goes_by_the_speed() {
        assert!(is_still(&[[0.0; 2]], 0.04));
        assert!(!is_still(&[[0.0; 2]], -0.2));
        let mut detector = StandstillDetector::default();
        detector.update(Some(&pose_at_rest()), at(0));
        detector.update(None, at(500));
        assert!(!detector.is_still, "nothing is known of another run");
        let swings = Pose {
            turn_rate_radps: 0.1,
            ..pose_at_rest()
        };
        detector.update(Some(&swings), at(1_000));
        assert!(!detector.is_still);
    }
}
