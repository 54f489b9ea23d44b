//! A list of operators that changed while the vehicle runs.

use super::driver::Driver;
use crate::clock::Monotonic;
use crate::teleop::Event;

impl Driver {
    /// Obeys the newer list, if one was left: whoever is off it holds no lease from now on.
    pub(super) fn take_newer_list(&mut self, now: Monotonic) {
        let Some(revoked) = self.operators.take_newer() else {
            return;
        };
        self.board.show_names(self.operators.names());
        for operator in revoked {
            self.step(now, Event::Revoked(operator));
        }
    }
}
