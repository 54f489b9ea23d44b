//! Whether a vehicle goes where it is told to.

use std::time::Duration;

use protocol::message::{Pose, Status, TeleopState};
use robot_edge::clock::Monotonic;

use super::ConsoleModel;

/// Slower than that, friction and waves explain a lot, m/s.
const TOLD_MPS: f32 = 0.3;
/// What goes by less than this share of what it is told does not go.
const SHARE: f32 = 0.1;
/// What floats or is heavy needs its time to get under way.
const PATIENCE: Duration = Duration::from_secs(3);

/// Since when a vehicle is told to go and does not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Following {
    stands_since: Option<Monotonic>,
}

impl Following {
    /// The robot tells what its motors are told; `pose` is the newest.
    pub(super) fn hear(&mut self, status: &Status, pose: Option<&Pose>, now: Monotonic) {
        let driven = status.teleop.as_ref();
        let driven = driven.filter(|teleop| teleop.state == TeleopState::Driving);
        let stands = driven.zip(pose).is_some_and(|(teleop, pose)| {
            let told_mps = teleop.applied.linear_mps;
            told_mps.abs() >= TOLD_MPS
                && pose.speed_mps * told_mps.signum() < SHARE * told_mps.abs()
        });
        self.stands_since = stands.then(|| self.stands_since.unwrap_or(now));
    }

    fn is_stuck(self, now: Monotonic) -> bool {
        let since = self.stands_since;
        since.is_some_and(|since| now.since(since) >= PATIENCE)
    }
}

impl ConsoleModel {
    /// Whether the vehicle is told to go, by who drives, and has not for seconds.
    pub fn is_stuck(&self, now: Monotonic) -> bool {
        self.following.is_stuck(now)
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::Velocity;

    use super::*;
    use crate::pretend::{at, resting, standing};

    fn told(state: TeleopState, linear_mps: f32) -> Status {
        let mut teleop = standing();
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
            ..resting()
        }
    }

    #[test]
    fn what_is_told_to_go_and_does_not_for_seconds_is_stuck() {
        let stuck_after = |status: &Status, speed_mps: f32| {
            let mut following = Following::default();
            (0..20_u64).find(|half_s| {
                let now = at(500 * half_s);
                following.hear(status, Some(&pose(speed_mps)), now);
                following.is_stuck(now)
            })
        };
        let driving = TeleopState::Driving;
        assert_eq!(stuck_after(&told(driving, 1.68), -0.05), Some(6), "aground");
        assert_eq!(stuck_after(&told(driving, -1.68), 0.1), Some(6), "astern");
        assert_eq!(stuck_after(&told(driving, 1.68), 0.2), None, "it goes");
        assert_eq!(stuck_after(&told(driving, -1.68), -0.2), None);
        assert_eq!(stuck_after(&told(driving, 0.2), 0.0), None, "it creeps");
        assert_eq!(stuck_after(&told(TeleopState::Held, 1.68), 0.0), None);
    }

    #[test]
    fn whoever_goes_in_between_is_not_stuck() {
        let status = told(TeleopState::Driving, 1.0);
        let mut following = Following::default();
        for (ms, speed_mps, is_stuck) in [
            (0, 0.0, false),
            (2_500, 0.0, false),
            (2_900, 0.5, false),
            (3_400, 0.0, false),
            (6_300, 0.0, false),
            (6_400, 0.0, true),
        ] {
            following.hear(&status, Some(&pose(speed_mps)), at(ms));
            assert_eq!(following.is_stuck(at(ms)), is_stuck, "{ms}");
        }
        // Nothing was heard of its speed.
        following.hear(&status, None, at(7_000));
        assert!(!following.is_stuck(at(7_000)));
    }
}
