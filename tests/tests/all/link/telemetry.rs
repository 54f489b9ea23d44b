//! Somebody who hears what a robot says of its driving, besides the console that drives it.

use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use protocol::keys::{RobotId, Topic};
use protocol::message::{Pose, Status, TeleopState, TeleopStatus};
use protocol::wire;
use robot_edge::clock;
use serde::de::DeserializeOwned;
use zenoh::{Config, Session, Wait as _};

/// How long a robot may take to do what it is told; nothing is measured here.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(20);

/// What the robot says of its driving, heard by somebody else than the console.
pub(crate) struct Telemetry {
    status: Arc<Mutex<Option<TeleopStatus>>>,
    pose: Arc<Mutex<Option<Pose>>>,
    _session: Session,
}

impl Telemetry {
    pub(crate) fn of(robot: &str, endpoint: &str) -> Self {
        let robot: RobotId = robot.parse().unwrap();
        let session = connected(endpoint);
        let status = subscribe_latest(&session, Topic::Status.key(&robot), |status: Status| {
            status.teleop
        });
        let pose = subscribe_latest(&session, Topic::Pose.key(&robot), Some::<Pose>);
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
    pub(crate) fn wait_for_status(
        &self,
        what: &str,
        is_so: impl Fn(&TeleopStatus) -> bool,
    ) -> TeleopStatus {
        let started = clock::now();
        loop {
            let status = self.now();
            if let Some(status) = status.as_ref().filter(|status| is_so(status)) {
                return status.clone();
            }
            assert!(clock::elapsed(started) < TIMEOUT, "not {what}: {status:?}");
            sleep(Duration::from_millis(10));
        }
    }

    /// Where it is: x and y in `odom`, metres, and its heading, radians.
    pub(crate) fn pose(&self) -> ([f64; 2], f64) {
        let pose = self.pose.lock().unwrap().expect("a pose");
        let [x, y, _] = pose.position_m;
        let [qx, qy, qz, qw] = pose.quaternion_xyzw.map(f64::from);
        let [sine, cosine] = [2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)];
        let yaw = nalgebra::UnitComplex::from_cos_sin_unchecked(cosine, sine).angle();
        ([x, y], yaw)
    }

    /// Waits until the newest pose is that of a vehicle without speed.
    pub(crate) fn wait_until_stopped(&self) {
        let started = clock::now();
        let speed_mps = || self.pose.lock().unwrap().expect("a pose").speed_mps.abs();
        while speed_mps() > 0.001 {
            assert!(clock::elapsed(started) < TIMEOUT, "{} m/s", speed_mps());
            sleep(Duration::from_millis(10));
        }
    }

    pub(crate) fn assert_stopped(&self, what: &str) {
        let status = self.wait_for_status("told", |_| true);
        assert_ne!(status.state, TeleopState::Driving, "{what}: {status:?}");
        let applied = status.applied;
        assert!(
            applied.linear_mps.abs() < 1e-6 && applied.angular_radps.abs() < 1e-6,
            "{what}: {status:?}"
        );
    }
}

/// What is made of the newest message with this key.
fn subscribe_latest<T, U>(
    session: &Session,
    key: String,
    of: impl Fn(T) -> Option<U> + Send + Sync + 'static,
) -> Arc<Mutex<Option<U>>>
where
    T: DeserializeOwned,
    U: Send + 'static,
{
    let newest = Arc::new(Mutex::new(None));
    let written = Arc::clone(&newest);
    session
        .declare_subscriber(key)
        .callback(move |sample| {
            let (_, message) = wire::decode(&sample.payload().to_bytes()).unwrap();
            *written.lock().unwrap() = of(message);
        })
        .background()
        .wait()
        .unwrap();
    newest
}

fn connected(endpoint: &str) -> Session {
    let started = clock::now();
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
            Err(why) => assert!(clock::elapsed(started) < TIMEOUT, "{why}"),
        }
        sleep(Duration::from_millis(50));
    }
}
