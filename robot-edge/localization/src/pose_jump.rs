//! Poses that no driving connects: odometry that was reset, a localisation that found its mistake.

use measurement::pose::Pose;
use measurement::time::RobotTime;

/// How far apart two consecutive poses may be: `slack_m` plus what `speed_mps` does in the time between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JumpLimit {
    /// Allowed however short the time is, metres.
    pub slack_m: f64,
    /// Faster than the vehicle could be by any error of its stamps, metres per second.
    pub speed_mps: f64,
}

/// The poses jumped: what was mapped before is somewhere else than what comes now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseJump {
    /// Stamp of the first pose behind it.
    pub stamp: RobotTime,
    /// How far, metres.
    pub distance_m: f64,
}

impl JumpLimit {
    /// The jump from one pose to the next, if it is one.
    pub fn between(
        &self,
        before: &(RobotTime, Pose),
        after: &(RobotTime, Pose),
    ) -> Option<PoseJump> {
        let way = after.1.translation.vector - before.1.translation.vector;
        let distance_m = way.norm();
        let time_s = after.0.since(before.0).as_secs_f64().abs();
        (distance_m > self.slack_m + self.speed_mps * time_s).then_some(PoseJump {
            stamp: after.0,
            distance_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use measurement::pose::planar;

    #[test]
    fn a_jump_is_farther_than_slack_and_driving_explain() {
        let limit = JumpLimit {
            slack_m: 1.0,
            speed_mps: 3.0,
        };
        let at = |secs, x_m, y_m| {
            let stamp = RobotTime::from_secs_f64(secs).unwrap();
            (stamp, planar(x_m, y_m, 0.0))
        };
        let jump = |after| limit.between(&at(10.0, 1.0, 1.0), &after);
        assert_eq!(jump(at(10.0, 2.0, 1.0)), None);
        assert_eq!(jump(at(10.5, 1.0, 3.5)), None);
        let far = PoseJump {
            stamp: RobotTime::from_secs_f64(10.5).unwrap(),
            distance_m: 5.0,
        };
        assert_eq!(jump(at(10.5, 4.0, 5.0)), Some(far));
        // After a long silence it may be anywhere that it could have driven to.
        assert_eq!(jump(at(12.0, 4.0, 5.0)), None);
        // Stamps that go back do not make it a jump.
        assert_eq!(jump(at(8.0, 4.0, 5.0)), None);
    }
}
