//! What is known from before: the robot was heard before this link began, or has begun to run anew since.

use protocol::tile::BootId;

use super::{ConsoleModel, LastContact};

impl ConsoleModel {
    /// The robot was heard before this link to it began.
    pub const fn set_last_contact(&mut self, before: LastContact) {
        self.connection.set_last_contact(before);
    }

    /// Which run of the robot is heard, once it has announced its map.
    pub fn run(&self) -> Option<BootId> {
        self.map.boot()
    }

    /// Whether the robot has begun to run anew and not said since how it is: what is known of that is of an earlier
    /// run.
    pub fn awaits_status(&self) -> bool {
        let run = self.run();
        self.status.is_some() && run.is_some() && self.status_run != run
    }
}
