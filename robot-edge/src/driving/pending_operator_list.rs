//! A list of operators that changed while the vehicle runs.

use super::drive_loop::DriveLoop;
use measurement::time::Monotonic;
use teleop::ArbiterInput;

impl DriveLoop {
    /// Obeys the newer list, if one was left: whoever is off it holds no lease from now on.
    pub(super) fn apply_pending_operators(&mut self, now: Monotonic) {
        let Some(revoked) = self.operators.take_pending() else {
            return;
        };
        self.drive_state.publish_names(self.operators.names());
        for operator in revoked {
            self.step(now, ArbiterInput::Revoked(operator));
        }
    }
}
