//! A helm on its link: what the window's loop and a script's loop both run.

use std::time::Duration;

use measurement::time::Monotonic;
use robot_edge::link::random_id;

use crate::identity::Identity;
use crate::link::DrivingLink;
use crate::teleop_client::{Intent, TeleopClient, TeleopClientState, TeleopNotification};
use crate::teleop_input::InputEvent;
use protocol::keys::RobotId;
use protocol::message::Info;

/// How long a window that closes waits for its last words to leave.
const SHUTDOWN_FLUSH: Duration = Duration::from_millis(150);

/// One operator, one robot, and the link between them.
pub struct TeleopSession {
    teleop_client: TeleopClient,
    link: DrivingLink,
}

impl TeleopSession {
    /// A helm that nobody has touched.
    ///
    /// # Errors
    /// Where the system has no random numbers.
    pub fn new(robot: RobotId, identity: Identity, link: DrivingLink) -> anyhow::Result<Self> {
        let [random, _] = halves(random_id()?);
        Ok(Self {
            teleop_client: TeleopClient::new(robot, identity, random),
            link,
        })
    }

    /// Before the queue of events is drained.
    pub fn begin(&mut self, now: Monotonic) {
        self.teleop_client.begin(self.link.newest(), now);
    }

    /// Something that was in the queue.
    pub fn apply(&mut self, event: InputEvent) {
        self.teleop_client.apply(event);
    }

    /// The queue is drained: sends what is to be sent.
    pub fn end(&mut self, now: Monotonic) {
        for message in self.link.messages() {
            self.teleop_client.receive(message, now);
        }
        for message in self.teleop_client.end(now) {
            self.link.send(message);
        }
    }

    /// When the next iteration is due without any event.
    pub fn due(&self, now: Monotonic) -> Option<Monotonic> {
        self.teleop_client.due(now)
    }

    /// What the operator wants besides moving.
    pub fn submit(&mut self, intent: Intent, now: Monotonic) {
        self.teleop_client.submit(intent, now);
    }

    /// The robot tells what it can do.
    pub fn set_robot_info(&mut self, info: &Info) {
        self.teleop_client.set_robot_info(info);
    }

    /// Whether this console has the lease.
    pub const fn is_driving(&self) -> bool {
        self.teleop_client.is_driving()
    }

    /// What the operator is to see.
    pub fn state(&self, now: Monotonic) -> TeleopClientState {
        self.teleop_client.state(now)
    }

    /// What happened since the last call, oldest first.
    pub fn take_notifications(&mut self) -> impl Iterator<Item = (Monotonic, TeleopNotification)> {
        self.teleop_client.take_notifications().into_iter()
    }

    /// The last words: zero, and the lease back. The robot stops without them too, but later.
    pub fn shut_down(&mut self) {
        let messages = self.teleop_client.shutdown_messages();
        if messages.is_empty() {
            return;
        }
        for message in messages {
            self.link.send(message);
        }
        self.link.flush(SHUTDOWN_FLUSH);
    }
}

impl Drop for TeleopSession {
    fn drop(&mut self) {
        self.shut_down();
    }
}

fn halves(id: [u8; 16]) -> [u64; 2] {
    let id = u128::from_le_bytes(id);
    [id as u64, (id >> 64) as u64]
}
