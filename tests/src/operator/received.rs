//! What somebody who drives has heard of the robot.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use measurement::time::Monotonic;
use protocol::keys::{RobotId, Topic};
use protocol::message::{AgeToken, Pose, Status};
use protocol::tile::BootId;
use protocol::wire;
use robot_edge::clock;
use zenoh::{Session, Wait as _};

/// What was heard of the robot last.
#[derive(Default)]
pub(super) struct Received {
    pub(super) pose: Option<(BootId, Pose)>,
    pub(super) token: Option<Token>,
    pub(super) status: Option<Status>,
}

/// The newest token, and when it came.
#[derive(Clone, Copy)]
pub(super) struct Token {
    pub(super) boot: BootId,
    pub(super) token: AgeToken,
    pub(super) received: Monotonic,
}

impl Received {
    /// What comes on this session from now on.
    pub(super) fn subscribe(session: &Session, robot: &RobotId) -> Arc<Mutex<Self>> {
        let received = Arc::new(Mutex::new(Self::default()));
        for topic in [Topic::Pose, Topic::Status] {
            let received = Arc::clone(&received);
            session
                .declare_subscriber(topic.key(robot))
                .callback(move |sample| {
                    let bytes = sample.payload().to_bytes();
                    let mut received = lock(&received);
                    // What others send on these keys is not for this one to judge.
                    if topic != Topic::Pose {
                        received.status = wire::decode(&bytes).ok().map(|(_, status)| status);
                    } else if let Ok((header, pose)) = wire::decode(&bytes) {
                        received.pose(header.boot, pose);
                    }
                })
                .background()
                .wait()
                .unwrap();
        }
        received
    }

    fn pose(&mut self, boot: BootId, pose: Pose) {
        self.pose = Some((boot, pose));
        let Some(token) = pose.token else { return };
        let is_news = self
            .token
            .is_none_or(|last| last.boot != boot || last.token.n < token.n);
        if is_news {
            self.token = Some(Token {
                boot,
                token,
                received: clock::now(),
            });
        }
    }
}

pub(super) fn lock(received: &Mutex<Received>) -> MutexGuard<'_, Received> {
    received.lock().unwrap_or_else(PoisonError::into_inner)
}
