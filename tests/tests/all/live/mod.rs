//! `robot-edge run` with a ROS 2 system over Zenoh, played by these tests, and a motor controller at a terminal.

use std::time::Duration;

use network::clock;
use protocol::message::Status;
use protocol::wire;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;

mod autopilot;
mod devices;
mod driven;
mod goals;
mod lidars;
mod live_rig;
mod mapped;
mod notified;
mod published;
mod restarts;
mod ros_system;
mod service;
mod simulated_devices;

/// From the edge's own tests: an emulator is no part of the program.
#[path = "../../../../robot-edge/edge/src/actuators/roboteq/emulator.rs"]
#[allow(dead_code, reason = "the edge's own tests use all of it")]
mod emulator;

/// Longer than any step takes.
const STATUS_TIMEOUT: Duration = Duration::from_mins(1);

/// The first status of which `is_so` is true.
fn wait_for_status(
    statuses: &Subscriber<FifoChannelHandler<Sample>>,
    what: &str,
    is_so: &dyn Fn(&Status) -> bool,
) -> Status {
    let started = clock::now();
    let mut last = None;
    loop {
        assert!(
            clock::elapsed(started) < STATUS_TIMEOUT,
            "{what} in vain: {last:?}"
        );
        let Ok(Some(sample)) = statuses.recv_timeout(Duration::from_secs(1)) else {
            continue;
        };
        let (_, status): (_, Status) = wire::decode(&sample.payload().to_bytes()).unwrap();
        if is_so(&status) {
            return status;
        }
        last = Some(status);
    }
}
