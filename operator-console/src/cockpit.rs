//! A helm on its link: what the window's loop and a script's loop both run.

use std::time::Duration;

use robot_edge::clock::Monotonic;
use robot_edge::link::random_id;

use crate::helm::{Helm, HelmSight, Intent, Note};
use crate::identity::Identity;
use crate::link::DrivingLink;
use crate::teleop_input::InputEvent;
use protocol::keys::RobotId;
use protocol::message::Info;

/// How long a window that closes waits for its last words to leave.
const FAREWELL: Duration = Duration::from_millis(150);

/// One operator, one robot, and the link between them.
pub struct Cockpit {
    helm: Helm,
    link: DrivingLink,
}

impl Cockpit {
    /// A helm that nobody has touched.
    ///
    /// # Errors
    /// Where the system has no random numbers.
    pub fn new(robot: RobotId, identity: Identity, link: DrivingLink) -> anyhow::Result<Self> {
        let [random, _] = halves(random_id()?);
        Ok(Self {
            helm: Helm::new(robot, identity, random),
            link,
        })
    }

    /// Before the queue of events is drained.
    pub fn begin(&mut self, now: Monotonic) {
        self.helm.begin(self.link.newest(), now);
    }

    /// Something that was in the queue.
    pub fn apply(&mut self, event: InputEvent) {
        self.helm.apply(event);
    }

    /// The queue is drained: sends what is to be sent.
    pub fn end(&mut self, now: Monotonic) {
        for heard in self.link.heard() {
            self.helm.hear(heard, now);
        }
        for message in self.helm.end(now) {
            self.link.send(message);
        }
    }

    /// When the next iteration is due without any event.
    pub fn due(&self, now: Monotonic) -> Option<Monotonic> {
        self.helm.due(now)
    }

    /// What the operator wants besides moving.
    pub fn want(&mut self, intent: Intent, now: Monotonic) {
        self.helm.want(intent, now);
    }

    /// The robot tells what it can do.
    pub fn hear_of(&mut self, info: &Info) {
        self.helm.hear_of(info);
    }

    /// Whether this console has the lease.
    pub const fn is_driving(&self) -> bool {
        self.helm.is_driving()
    }

    /// What the operator is to see.
    pub fn sight(&self, now: Monotonic) -> HelmSight {
        self.helm.sight(now)
    }

    /// What happened since the last call, oldest first.
    pub fn take_notes(&mut self) -> impl Iterator<Item = (Monotonic, Note)> {
        self.helm.take_notes().into_iter()
    }

    /// The last words: zero, and the lease back. The robot stops without them too, but later.
    pub fn leave(&mut self) {
        let messages = self.helm.farewell();
        if messages.is_empty() {
            return;
        }
        for message in messages {
            self.link.send(message);
        }
        self.link.flush(FAREWELL);
    }
}

impl Drop for Cockpit {
    fn drop(&mut self) {
        self.leave();
    }
}

fn halves(id: [u8; 16]) -> [u64; 2] {
    let id = u128::from_le_bytes(id);
    [id as u64, (id >> 64) as u64]
}
