//! Whether a vehicle goes where it is told to.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::{Pose, Status, TeleopState};

use super::ConsoleModel;
use super::time_window::TimeWindow;

/// Slower than that, friction and waves explain a lot, m/s.
const MIN_COMMAND_MPS: f32 = 0.3;
/// What goes by less than this share of what it is told does not go.
const SHARE: f32 = 0.1;
/// What lies still may measure so much, m/s: positions that are good to 2 cm, half a second apart, give 0.06 m/s as a
/// standard deviation. One such measurement is no motion; the mean of some seconds is.
const NOISE_MPS: f32 = 0.25;
/// What is faster by so much in the newer half of that time than in the older one speeds up as it is told, m/s: a boat that
/// still coasted the other way has to come to rest first. Noise makes half of it seldom.
const ACCELERATING_MPS: f32 = 0.125;
/// What floats or is heavy needs its time to get under way.
const PATIENCE: Duration = Duration::from_secs(3);

/// How a vehicle follows that is told to go.
#[derive(Clone, Debug, Default)]
pub(super) struct StuckDetector {
    /// How much faster it went than what does not go, m/s, at each status since it was told to go and was not seen to.
    speed_excess: TimeWindow<f32>,
}

impl StuckDetector {
    /// The robot tells what its motors are told; `pose` is the newest.
    pub(super) fn update(&mut self, status: &Status, pose: Option<&Pose>, now: Monotonic) {
        let driven = status.teleop.as_ref();
        let driven = driven.filter(|teleop| teleop.state == TeleopState::Driving);
        let commanded = driven.map(|teleop| teleop.applied.linear_mps);
        let commanded = commanded.filter(|commanded_mps| commanded_mps.abs() >= MIN_COMMAND_MPS);
        let Some((commanded_mps, pose)) = commanded.zip(pose) else {
            return self.speed_excess.clear();
        };
        let goes_mps = pose.speed_mps * commanded_mps.signum();
        let least_mps = SHARE * commanded_mps.abs();
        // What goes the other way is not where it is stuck, and has to turn about.
        if goes_mps >= least_mps.max(NOISE_MPS) || goes_mps <= -NOISE_MPS {
            return self.speed_excess.clear();
        }
        self.speed_excess.add(goes_mps - least_mps, PATIENCE, now);
    }

    /// As heard last: a link that is lost makes nobody stuck.
    fn is_stuck(&self) -> bool {
        self.speed_excess.spans(PATIENCE)
            && self.speed_excess.iter().sum::<f32>() < 0.0
            && !self.is_accelerating()
    }

    fn is_accelerating(&self) -> bool {
        let half = self.speed_excess.iter().count() / 2;
        let newer: f32 = self.speed_excess.iter().rev().take(half).sum();
        let older: f32 = self.speed_excess.iter().take(half).sum();
        newer - older >= ACCELERATING_MPS * half as f32
    }
}

impl ConsoleModel {
    /// Whether the vehicle is told to go, by who drives, and has not for seconds.
    pub fn is_stuck(&self) -> bool {
        self.motion.stuck_detector.is_stuck()
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::Velocity;

    use super::*;
    use crate::test_support::{at, idle_teleop_status, pose_at_rest};

    fn commanded(state: TeleopState, linear_mps: f32) -> Status {
        let mut teleop = idle_teleop_status();
        teleop.state = state;
        teleop.applied = Velocity {
            linear_mps,
            angular_radps: 0.0,
        };
        Status {
            teleop: Some(teleop),
            ..Status::default()
        }
    }

    fn pose(speed_mps: f32) -> Pose {
        Pose {
            speed_mps,
            ..pose_at_rest()
        }
    }

    #[test]
    fn what_is_told_to_go_and_does_not_for_seconds_is_stuck() {
        let stuck_after = |status: &Status, speed_mps: f32| {
            let mut detector = StuckDetector::default();
            (0..20_u64).find(|half_s| {
                let now = at(500 * half_s);
                detector.update(status, Some(&pose(speed_mps)), now);
                detector.is_stuck()
            })
        };
        let driving = TeleopState::Driving;
        assert_eq!(
            stuck_after(&commanded(driving, 1.68), -0.05),
            Some(6),
            "aground"
        );
        assert_eq!(
            stuck_after(&commanded(driving, -1.68), 0.1),
            Some(6),
            "astern"
        );
        assert_eq!(stuck_after(&commanded(driving, 1.68), 0.2), None, "it goes");
        assert_eq!(stuck_after(&commanded(driving, -1.68), -0.2), None);
        assert_eq!(
            stuck_after(&commanded(driving, 0.2), 0.0),
            None,
            "it creeps"
        );
        assert_eq!(stuck_after(&commanded(TeleopState::Held, 1.68), 0.0), None);
    }

    #[test]
    fn whoever_goes_in_between_is_not_stuck() {
        let status = commanded(TeleopState::Driving, 1.0);
        let mut detector = StuckDetector::default();
        for (ms, speed_mps, is_stuck) in [
            (0, 0.0, false),
            (2_500, 0.0, false),
            (2_900, 0.5, false),
            (3_400, 0.0, false),
            (6_300, 0.0, false),
            (6_400, 0.0, true),
        ] {
            detector.update(&status, Some(&pose(speed_mps)), at(ms));
            assert_eq!(detector.is_stuck(), is_stuck, "{ms}");
        }
        // Nothing was heard of its speed.
        detector.update(&status, None, at(7_000));
        assert!(!detector.is_stuck());
    }

    #[test]
    fn noise_of_the_measurement_frees_nobody_and_what_creeps_goes() {
        // Told to go at 0.6 m/s, twice a second: which of these statuses tell that it is stuck?
        let stuck_at = |speeds_mps: &[f32]| -> Vec<usize> {
            let mut detector = StuckDetector::default();
            let heard = (0_u64..).zip(speeds_mps).map(|(half_s, speed_mps)| {
                let status = commanded(TeleopState::Driving, 0.6);
                detector.update(&status, Some(&pose(*speed_mps)), at(500 * half_s));
                detector.is_stuck()
            });
            let heard: Vec<_> = heard.collect();
            (0..heard.len()).filter(|status| heard[*status]).collect()
        };
        let aground = [0.0, 0.11, -0.12, 0.08, -0.07, 0.02, -0.05, 0.15, -0.13, 0.3];
        assert_eq!(stuck_at(&aground), [6, 7, 8], "then it is free");
        assert_eq!(stuck_at(&[0.1; 10]), [0; 0], "of 0.6 that is going");
    }

    #[test]
    fn a_boat_that_changes_its_direction_is_not_stuck_while_it_speeds_up() {
        let is_ever_stuck = |commanded_mps: f32, speeds_mps: &[f32]| {
            let mut detector = StuckDetector::default();
            (0_u64..).zip(speeds_mps).any(|(half_s, speed_mps)| {
                let status = commanded(TeleopState::Driving, commanded_mps);
                detector.update(&status, Some(&pose(*speed_mps)), at(500 * half_s));
                detector.is_stuck()
            })
        };
        // From ahead to 0.3 m/s astern, at the pace of the simulated boat.
        let turns_about = [
            1.2, 0.9, 0.65, 0.45, 0.3, 0.2, 0.1, 0.02, -0.05, -0.11, -0.15, -0.19, -0.22, -0.24,
        ];
        assert!(!is_ever_stuck(-0.3, &turns_about));
        let mirrored = turns_about.map(|speed_mps| -speed_mps);
        assert!(!is_ever_stuck(0.3, &mirrored));
        // One that is carried the other way, by a strong current, does not go as it is told either: but is not stuck.
        assert!(!is_ever_stuck(0.5, &[-0.4; 12]));
        let run_aground = [-1.0, -0.3, 0.0, 0.02, -0.03, 0.0, 0.01, 0.0, -0.02, 0.0];
        assert!(is_ever_stuck(0.5, &run_aground));
    }

    #[test]
    fn a_link_that_is_lost_makes_nobody_stuck() {
        let mut detector = StuckDetector::default();
        for ms in [0, 500] {
            detector.update(
                &commanded(TeleopState::Driving, 1.0),
                Some(&pose(0.0)),
                at(ms),
            );
        }
        assert!(!detector.is_stuck(), "whatever the time is now");
    }
}
