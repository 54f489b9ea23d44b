//! One robot over the network, and the model that it feeds.
//!
//! Zenoh's threads put what arrives into a bounded queue; one thread of ours empties it into the model, sends
//! what the model wants, and wakes whoever draws, but only when there is something new to see. So a frozen
//! window holds up neither, and a robot that stands still costs no frames.

mod address_state;
mod connect;
mod discovery;
mod driving;
mod fleet_state;
mod known_robots;
mod lost_link;
mod opening;
mod transport;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use std::{io, mem};

use measurement::time::Monotonic;
use robot_edge::clock;
use robot_edge::link::sessions::Endpoints;

use crate::locks::lock;
use crate::model::{ConsoleModel, Incoming, ModelSettings};
use connect::Connections;

pub use address_state::{AddressState, place};
pub use discovery::{Discovery, SEEN_RECENTLY};
pub use driving::DrivingLink;
pub use fleet_state::FleetState;
pub use known_robots::{DiscoveredRobot, FoundRobot};
pub use transport::Transport;

/// What of Zenoh's own log is for operators, in the syntax of `tracing_subscriber::EnvFilter`: errors, not
/// warnings of settings that are meant; and nothing of what still comes for a session that is being closed, of
/// which it complains to whoever quits.
pub const LOG_FILTER: &str = "zenoh=error,zenoh::api::session=off";

/// Messages that wait for the model at most; what comes beyond is dropped and counted, and what of it mattered
/// is asked for again.
const MAX_WAITING: usize = 4096;
/// Messages taken into the model before somebody else may look at it.
const BATCH: usize = 64;
/// What the model wants to send is asked for this often.
const TICK: Duration = Duration::from_millis(20);
/// By what way messages come is looked at this often.
const LINK_PERIOD: Duration = Duration::from_secs(1);
/// Between two calls of `wake`.
const WAKE_PERIOD: Duration = Duration::from_millis(33);
/// A robot of which nothing was new for so long is calm: the tiles and sweeps that it pushes all the time are
/// seen with the next frame that ages ask for.
const CALM_AFTER: Duration = Duration::from_secs(2);

/// A robot that is watched. Dropping it ends that.
pub struct RobotSession {
    model: Arc<Mutex<ConsoleModel>>,
    connections: Arc<Connections>,
    driving: Option<DrivingLink>,
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// A robot as it is known, for whoever has to look at it from another thread.
#[derive(Clone)]
pub struct ModelHandle {
    model: Arc<Mutex<ConsoleModel>>,
    is_left: Arc<AtomicBool>,
}

impl ModelHandle {
    /// A robot that no link feeds.
    #[cfg(test)]
    pub(crate) fn of(model: ConsoleModel) -> Self {
        Self {
            model: Arc::new(Mutex::new(model)),
            is_left: Arc::default(),
        }
    }

    /// The robot; the link and the window wait while the guard is held.
    pub fn lock(&self) -> MutexGuard<'_, ConsoleModel> {
        lock(&self.model)
    }

    /// Whether its link was left: nothing more will come by it.
    pub fn is_left(&self) -> bool {
        self.is_left.load(Ordering::Relaxed)
    }

    /// As if its link had been left.
    #[cfg(test)]
    pub(crate) fn leave(&self) {
        self.is_left.store(true, Ordering::Relaxed);
    }
}

impl RobotSession {
    /// Begins to connect to the robot, again and again until it answers, and returns at once. `wake` is called
    /// when there is something new to draw.
    ///
    /// # Errors
    /// Where zstd cannot be set up.
    pub fn open(
        settings: ModelSettings,
        endpoints: &Endpoints,
        wake: impl Fn() + Send + 'static,
    ) -> io::Result<Self> {
        let (sender, received) = sync_channel(MAX_WAITING);
        let robot = settings.robot.clone();
        let model = Arc::new(Mutex::new(ConsoleModel::new(settings)?));
        let (connections, driving) = Connections::start(robot, endpoints, sender);
        let connections = Arc::new(connections);
        let is_closing = Arc::new(AtomicBool::new(false));
        let thread = thread::spawn({
            let (model, connections, is_closing) = (
                Arc::clone(&model),
                Arc::clone(&connections),
                Arc::clone(&is_closing),
            );
            move || run(&model, &connections, &received, &is_closing, wake)
        });
        Ok(Self {
            model,
            connections,
            driving: Some(driving),
            is_closing,
            thread: Some(thread),
        })
    }

    /// The robot as it is known; the link waits while the guard is held.
    pub fn model(&self) -> MutexGuard<'_, ConsoleModel> {
        lock(&self.model)
    }

    /// The robot, for a thread that looks at it now and then.
    pub fn handle(&self) -> ModelHandle {
        ModelHandle {
            model: Arc::clone(&self.model),
            is_left: Arc::clone(&self.is_closing),
        }
    }

    /// The way to drive it, for one helm: the first that asks.
    pub const fn take_driving(&mut self) -> Option<DrivingLink> {
        self.driving.take()
    }

    /// Whether the session for control is open. It reconnects by itself when the link is cut; one that could go by
    /// another way too is opened anew where that takes long.
    pub fn is_connected(&self) -> bool {
        self.connections.open_sessions().control
    }

    /// By what way messages about driving go; none while that is not known.
    pub fn transport(&self) -> Option<Transport> {
        self.connections.transport()
    }

    /// Why there is no connection, in words.
    pub fn problem(&self) -> Option<String> {
        self.connections.problem()
    }
}

impl Drop for RobotSession {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        // Sessions that close wait for the network; a window does not wait for them.
        self.connections.close();
        if let Some(thread) = mem::take(&mut self.thread)
            && thread.join().is_err()
        {
            tracing::error!("the link's thread failed");
        }
    }
}

fn run(
    model: &Mutex<ConsoleModel>,
    connections: &Connections,
    received: &Receiver<Incoming>,
    is_closing: &AtomicBool,
    wake: impl Fn(),
) {
    let (mut seen, mut seen_sensor_updates) = (None, 0);
    let (mut woken, mut stirred) = (Monotonic::default(), Monotonic::default());
    let mut next_tick = clock::now();
    let mut looked_at_links = Monotonic::default();
    while !is_closing.load(Ordering::Relaxed) {
        let first = match received.recv_timeout(next_tick.since(clock::now())) {
            Ok(first) => Some(first),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let now = clock::now();
        let mut guard = lock(model);
        for incoming in first.into_iter().chain(received.try_iter().take(BATCH)) {
            guard.apply(incoming, now);
        }
        if let Some(lost) = connections.take_lost() {
            guard.apply(lost, now);
        }
        let sessions = connections.open_sessions();
        let outgoing = guard.outgoing(sessions, now);
        let changes = Some((
            guard.changes(),
            connections.teleop_answers(),
            sessions,
            connections.problem(),
            // Silence comes without a message, and is to be seen at once.
            guard.connection().state(now),
        ));
        let sensor_updates = guard.sensor_updates();
        drop(guard);
        for outgoing in outgoing {
            connections.send(outgoing);
        }
        if now.since(looked_at_links) >= LINK_PERIOD {
            looked_at_links = now;
            connections.update_transport();
        }
        if changes != seen {
            stirred = now;
        }
        let is_calm = now.since(stirred) >= CALM_AFTER;
        let is_new = changes != seen || (!is_calm && sensor_updates != seen_sensor_updates);
        if is_new && now.since(woken) >= WAKE_PERIOD {
            (seen, seen_sensor_updates, woken) = (changes, sensor_updates, now);
            wake();
        }
        next_tick = now + TICK;
    }
}
