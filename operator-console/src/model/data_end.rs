//! That nothing new will come of a robot: its data has ended.

use measurement::time::Monotonic;

use super::{ConsoleModel, LinkState};

impl ConsoleModel {
    /// Whether the robot says that its data has ended.
    pub fn reports_ended(&self) -> bool {
        self.status().is_some_and(|(status, _)| status.has_ended)
    }

    /// Whether the robot's data has ended and its last announcement is known, so that nothing new will come.
    pub fn has_ended(&self) -> bool {
        self.ended_seq.is_some_and(|ended| self.head_seq > ended)
    }

    /// Whether it has taken its leave: where it falls silent after its data has ended, no link is lost.
    pub fn is_silence_expected(&self) -> bool {
        self.status().map_or_else(
            || self.connection.had_ended_before(),
            |(status, _)| status.has_ended,
        )
    }

    /// Whether it can be driven: what it does is news even when its data has ended.
    pub fn is_vehicle(&self) -> bool {
        self.teleop().is_some()
    }

    /// Share of the poses of the last 2 s that should have come and did not, 0 … 1; none where nobody knows whether any
    /// were sent: the robot is not heard, or its data has ended.
    pub fn poses_missing(&self, now: Monotonic) -> Option<f32> {
        let is_live = self.connection.state(now) == LinkState::Live;
        let is_sending = is_live && !self.reports_ended();
        self.quality.missing(now).filter(|_| is_sending)
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::Status;

    use crate::model::{ConsoleModel, LastContact};
    use crate::test_support::{at, idle_teleop_status, inject, pose_at_rest, scout};

    fn model(status: &Status) -> ConsoleModel {
        let mut model = scout();
        inject(&mut model, Topic::Status, status, at(0));
        model
    }

    #[test]
    fn who_said_that_its_data_has_ended_may_fall_silent() {
        let running = Status::default();
        let ended = Status {
            has_ended: true,
            ..Status::default()
        };
        let vehicle = Status {
            teleop: Some(idle_teleop_status()),
            ..ended.clone()
        };
        let may = [running, ended, vehicle].map(|status| model(&status).is_silence_expected());
        assert_eq!(may, [false, true, true]);
        assert!(!scout().is_silence_expected());
        // What was heard before counts until it says more itself.
        let mut left = scout();
        left.set_last_contact(LastContact {
            last: at(0),
            expected_from: at(0),
            had_ended: true,
        });
        assert!(left.is_silence_expected());
        inject(&mut left, Topic::Status, &Status::default(), at(0));
        assert!(!left.is_silence_expected());
    }

    #[test]
    fn nobody_knows_what_is_lost_while_nothing_is_heard_or_nothing_is_sent() {
        let mut live = model(&Status::default());
        // 10 a second of 20.
        for ms in (0..=3_000).step_by(100) {
            inject(&mut live, Topic::Pose, &pose_at_rest(), at(ms));
        }
        assert_eq!(live.poses_missing(at(3_050)), Some(0.5));
        assert_eq!(live.poses_missing(at(9_000)), None, "it is silent");
        let ended = Status {
            has_ended: true,
            ..Status::default()
        };
        inject(&mut live, Topic::Status, &ended, at(3_050));
        assert_eq!(live.poses_missing(at(3_050)), None, "it has ended");
    }
}
