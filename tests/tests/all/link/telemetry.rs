//! The state of driving and the pose that a robot publishes, received beside the console that drives it.

use std::time::Duration;

use foreshore_tests::operator::Operator;
use protocol::message::{TeleopState, TeleopStatus};

use super::processes::wait_until;

pub(crate) const TIMEOUT: Duration = Duration::from_secs(20);

/// An operator who only watches.
pub(crate) struct Telemetry(Operator);

impl Telemetry {
    pub(crate) fn of(robot: &str, endpoint: &str) -> Self {
        Self(Operator::connect(endpoint, robot, "watcher"))
    }

    /// The last state of driving.
    pub(crate) fn now(&self) -> Option<TeleopStatus> {
        self.0.teleop()
    }

    pub(crate) fn wait_for_status(
        &self,
        what: &str,
        is_so: impl Fn(&TeleopStatus) -> bool,
    ) -> TeleopStatus {
        self.0.wait_for_status(what, is_so)
    }

    /// Position in `odom`, metres, and heading, radians.
    pub(crate) fn pose(&self) -> ([f64; 2], f64) {
        let pose = self.0.pose();
        let [x, y, _] = pose.position_m;
        let [qx, qy, qz, qw] = pose.quaternion_xyzw.map(f64::from);
        let [sine, cosine] = [2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)];
        let yaw = nalgebra::UnitComplex::from_cos_sin_unchecked(cosine, sine).angle();
        ([x, y], yaw)
    }

    pub(crate) fn wait_until_stopped(&self) {
        wait_until("the vehicle stops", || {
            self.0.pose().speed_mps.abs() <= 0.001
        });
    }

    pub(crate) fn assert_stopped(&self, what: &str) {
        let status = self.wait_for_status("a status", |_| true);
        assert_ne!(status.state, TeleopState::Driving, "{what}: {status:?}");
        let applied = status.applied;
        assert!(
            applied.linear_mps.abs() < 1e-6 && applied.angular_radps.abs() < 1e-6,
            "{what}: {status:?}"
        );
    }
}
