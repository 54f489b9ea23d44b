//! Hands that drive a robot from a window, and look at whether it obeys.

use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use protocol::message::{TeleopState, TeleopStatus};
use robot_edge::clock;

use super::screen::{Key, Screen};
use super::telemetry::Telemetry;

/// The robot takes a press after 200 ms of nothing; the console adds what a link may shift.
pub(crate) const NEUTRAL: Duration = Duration::from_millis(400);

/// Pictures are kept for people to look at.
pub(crate) fn pictures(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("foreshore_{name}"))
}

/// Asks for `anna` until the robot grants the lease: the window may not have heard of the robot yet.
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
        // Where the lease is held already, it is given back.
        screen.tap_with(Key::Control, Key::G);
    }
    let picture = pictures("no_lease.png");
    screen.picture(&picture);
    panic!("the robot grants no lease; see {}", picture.display());
}

/// Holds a key until the vehicle drives as wanted. A machine that is busy with other tests may hang in the middle of a
/// press, which then does not count: so it is let go and pressed anew, as anybody would.
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
