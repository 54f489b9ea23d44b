//! Drives a robot by keys on a window and checks its status.

use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use protocol::message::{TeleopState, TeleopStatus};
use robot_edge::clock;

use super::screen::{Key, Screen};
use super::telemetry::Telemetry;

/// The robot accepts a press after 200 ms of neutral; the console adds the jitter of a link.
pub(crate) const NEUTRAL: Duration = Duration::from_millis(400);

pub(crate) fn pictures(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("foreshore_{name}"))
}

/// Requests the lease for `anna` until it is granted: the window may not have connected yet.
pub(crate) fn take_lease(screen: &Screen, telemetry: &Telemetry) {
    for _attempt in 0..30 {
        let started = clock::now();
        while clock::elapsed(started) < Duration::from_millis(1500) {
            let holder = telemetry.now().and_then(|status| status.lease.holder);
            if holder.is_some_and(|holder| holder.as_str() == "anna") {
                return;
            }
            sleep(Duration::from_millis(10));
        }
        // The same key releases a lease that is held.
        screen.tap_with(Key::Control, Key::G);
    }
    let picture = pictures("no_lease.png");
    screen.picture(&picture);
    panic!("the robot grants no lease; see {}", picture.display());
}

/// Holds a key until the vehicle drives and `is_so`. A busy machine may hang during a press, which then does not
/// count, so the press is repeated.
pub(crate) fn hold_until(
    screen: &Screen,
    telemetry: &Telemetry,
    key: Key,
    is_so: impl Fn(&TeleopStatus) -> bool,
) -> TeleopStatus {
    for _attempt in 0..10 {
        sleep(NEUTRAL);
        screen.press(key);
        let started = clock::now();
        while clock::elapsed(started) < Duration::from_secs(2) {
            let status = telemetry.now();
            let driving =
                status.filter(|status| status.state == TeleopState::Driving && is_so(status));
            if let Some(driving) = driving {
                return driving;
            }
            sleep(Duration::from_millis(5));
        }
        screen.release(key);
    }
    panic!("it does not drive: {:?}", telemetry.now());
}
