//! What somebody who drives has heard of the robot.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use protocol::keys::{RobotId, Topic};
use protocol::message::{AgeToken, Pose, Status};
use protocol::tile::BootId;
use protocol::wire;
use robot_edge::clock::Monotonic;
use zenoh::{Session, Wait as _};

/// What was heard of the robot last.
#[derive(Default)]
pub(super) struct Heard {
    pub(super) pose: Option<(BootId, Pose)>,
    pub(super) token: Option<Token>,
    pub(super) status: Option<Status>,
}

/// The newest token, and when it came.
#[derive(Clone, Copy)]
pub(super) struct Token {
    pub(super) boot: BootId,
    pub(super) given: AgeToken,
    pub(super) heard: Monotonic,
}

impl Heard {
    /// What comes on this session from now on.
    pub(super) fn listen(session: &Session, robot: &RobotId) -> Arc<Mutex<Self>> {
        let heard = Arc::new(Mutex::new(Self::default()));
        for topic in [Topic::Pose, Topic::Status] {
            let heard = Arc::clone(&heard);
            session
                .declare_subscriber(topic.key(robot))
                .callback(move |sample| {
                    let bytes = sample.payload().to_bytes();
                    let mut heard = lock(&heard);
                    // What others send on these keys is not for this one to judge.
                    if topic != Topic::Pose {
                        heard.status = wire::decode(&bytes).ok().map(|(_, status)| status);
                    } else if let Ok((header, pose)) = wire::decode(&bytes) {
                        heard.pose(header.boot, pose);
                    }
                })
                .background()
                .wait()
                .unwrap();
        }
        heard
    }

    fn pose(&mut self, boot: BootId, pose: Pose) {
        self.pose = Some((boot, pose));
        let Some(token) = pose.token else { return };
        let is_news = self
            .token
            .is_none_or(|last| last.boot != boot || last.given.n < token.n);
        if is_news {
            self.token = Some(Token {
                boot,
                given: token,
                heard: Monotonic::now(),
            });
        }
    }
}

pub(super) fn lock(heard: &Mutex<Heard>) -> MutexGuard<'_, Heard> {
    heard.lock().unwrap_or_else(PoisonError::into_inner)
}
