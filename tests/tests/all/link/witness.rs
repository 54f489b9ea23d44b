//! Somebody who hears what a robot says of its driving, besides the console that drives it.

use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use protocol::keys::{RobotId, Topic};
use protocol::message::{Pose, Status, TeleopState, TeleopStatus};
use protocol::wire;
use robot_edge::clock::Monotonic;
use zenoh::{Config, Session, Wait as _};

/// How long a robot may take to do what it is told; nothing is measured here.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

/// What the robot says of its driving, heard by somebody else than the console.
pub(crate) struct Witness {
    status: Arc<Mutex<Option<TeleopStatus>>>,
    pose: Arc<Mutex<Option<Pose>>>,
    _session: Session,
}

impl Witness {
    pub(crate) fn of(robot: &str, endpoint: &str) -> Self {
        let robot: RobotId = robot.parse().unwrap();
        let session = connected(endpoint);
        let status = Arc::new(Mutex::new(None));
        let heard = Arc::clone(&status);
        session
            .declare_subscriber(Topic::Status.key(&robot))
            .callback(move |sample| {
                let bytes = sample.payload().to_bytes();
                let (_, status) = wire::decode::<Status>(&bytes).unwrap();
                *heard.lock().unwrap() = status.teleop;
            })
            .background()
            .wait()
            .unwrap();
        let pose = Arc::new(Mutex::new(None));
        let heard = Arc::clone(&pose);
        session
            .declare_subscriber(Topic::Pose.key(&robot))
            .callback(move |sample| {
                let bytes = sample.payload().to_bytes();
                let (_, pose) = wire::decode::<Pose>(&bytes).unwrap();
                *heard.lock().unwrap() = Some(pose);
            })
            .background()
            .wait()
            .unwrap();
        Self {
            status,
            pose,
            _session: session,
        }
    }

    /// What the robot says now; `None` before it has said anything.
    pub(crate) fn now(&self) -> Option<TeleopStatus> {
        self.status.lock().unwrap().clone()
    }

    /// Waits until the robot is as wanted.
    pub(crate) fn sees(&self, what: &str, is_so: impl Fn(&TeleopStatus) -> bool) -> TeleopStatus {
        let started = Monotonic::now();
        loop {
            let status = self.now();
            if let Some(status) = status.as_ref().filter(|status| is_so(status)) {
                return status.clone();
            }
            assert!(started.elapsed() < PATIENCE, "not {what}: {status:?}");
            sleep(Duration::from_millis(10));
        }
    }

    /// Where it is: x and y in `odom`, metres, and its heading, radians.
    pub(crate) fn place(&self) -> ([f64; 2], f64) {
        let pose = self.pose.lock().unwrap().expect("a pose");
        let [x, y, _] = pose.position_m;
        let [qx, qy, qz, qw] = pose.quaternion_xyzw.map(f64::from);
        let [sine, cosine] = [2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)];
        let yaw = nalgebra::UnitComplex::from_cos_sin_unchecked(cosine, sine).angle();
        ([x, y], yaw)
    }

    pub(crate) fn is_still(&self, what: &str) {
        let status = self.sees("told", |_| true);
        assert_ne!(status.state, TeleopState::Driving, "{what}: {status:?}");
        let applied = status.applied;
        assert!(
            applied.linear_mps.abs() < 1e-6 && applied.angular_radps.abs() < 1e-6,
            "{what}: {status:?}"
        );
    }
}

fn connected(endpoint: &str) -> Session {
    let started = Monotonic::now();
    loop {
        let mut config = Config::default();
        for (key, value) in [
            ("mode", "\"client\"".to_owned()),
            ("connect/endpoints", format!("[{endpoint:?}]")),
            ("scouting/multicast/enabled", "false".to_owned()),
        ] {
            config.insert_json5(key, &value).unwrap();
        }
        match zenoh::open(config).wait() {
            Ok(session) => return session,
            Err(why) => assert!(started.elapsed() < PATIENCE, "{why}"),
        }
        sleep(Duration::from_millis(50));
    }
}
