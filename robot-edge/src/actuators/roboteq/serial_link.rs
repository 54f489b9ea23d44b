//! A controller and its driver at the two ends of a port that may come and go.

use std::os::fd::{AsFd as _, BorrowedFd};
use std::time::Duration;

use super::config::RoboteqConfig;
use super::driver::{Driver, State, Status};
use super::lock_holder::LockHolder;
use super::port::{Port, PortError, Sharing};
use crate::actuators::report::{ControllerFault, ControllerFlags, ControllerWatchdog};
use measurement::time::Monotonic;
use teleop::Velocity;

/// Between two attempts to open the port.
const REOPEN: Duration = Duration::from_millis(200);

/// Between two attempts to open a port that another process has locked.
const LOCKED_RETRY: Duration = Duration::from_millis(50);

/// A guard whose edge has gone ends by itself within 600 ms. After this it never does, and is ended: it was stopped.
const TAKE_OVER_AFTER: Duration = Duration::from_secs(2);

/// Well before that the motors that it has left behind are told zero.
const STOP_AFTER: Duration = Duration::from_millis(150);

/// Most reads in one step: more than a line of 960 characters a second can bring, and a bound for one that never ends.
const READS: usize = 16;

/// The way to the motors, whether it is there or not.
#[derive(Debug)]
pub struct SerialLink {
    config: RoboteqConfig,
    sharing: Sharing,
    connection: Connection,
    /// Times that a port was lost that was open, and what its drivers lost before.
    reconnects: u32,
    locked: Option<Locked>,
}

/// Another process has locked the port.
#[derive(Clone, Copy, Debug)]
struct Locked {
    since: Monotonic,
    /// The motors that it has left behind were told zero.
    was_stopped: bool,
}

#[derive(Debug)]
enum Connection {
    Closed {
        retry: Monotonic,
        /// Absent where it was not tried yet, or may be open soon.
        fault: Option<ControllerFault>,
    },
    Open {
        port: Port,
        driver: Box<Driver>,
    },
}

impl SerialLink {
    /// Not open yet; the first [`Self::step`] tries it.
    pub const fn new(config: RoboteqConfig, sharing: Sharing, now: Monotonic) -> Self {
        Self {
            config,
            sharing,
            connection: Connection::Closed {
                retry: now,
                fault: None,
            },
            reconnects: 0,
            locked: None,
        }
    }

    /// Does what is due: opens the port, takes what came in, and tells the motors `velocity`. Call it when the port has
    /// something to read, when `velocity` has changed, and at [`Self::deadline`]. It does not wait.
    pub fn step(&mut self, velocity: Velocity, now: Monotonic) {
        if let Err(lost) = self.try_step(velocity, now) {
            if let Connection::Open { driver, .. } = &self.connection {
                let before = driver.status(now).reconnects;
                self.reconnects = self.reconnects.saturating_add(before).saturating_add(1);
            }
            self.connection = Connection::Closed {
                retry: now + REOPEN,
                fault: Some(lost.fault()),
            };
        }
    }

    fn try_step(&mut self, velocity: Velocity, now: Monotonic) -> Result<(), PortError> {
        if let Connection::Closed { retry, .. } = self.connection {
            if now < retry {
                return Ok(());
            }
            let opened = Port::open(&self.config.port, self.sharing);
            if opened.as_ref().is_err_and(PortError::is_locked) {
                self.wait_for_holder(now);
                return Ok(());
            }
            self.locked = None;
            let port = opened?;
            let has_encoders = self.config.encoder_full_speed_mps.is_some();
            let driver = Driver::new(has_encoders, self.config.require_watchdog, now);
            self.connection = Connection::Open {
                port,
                driver: Box::new(driver),
            };
        }
        let Connection::Open { port, driver } = &mut self.connection else {
            return Ok(());
        };
        let lost = |source| PortError::Io {
            path: self.config.port.clone(),
            source,
        };
        let mut buffer = [0; 256];
        for _ in 0..READS {
            let bytes = port.read(&mut buffer).map_err(lost)?;
            if bytes.is_empty() {
                break;
            }
            driver.receive(bytes, now);
        }
        driver.command(self.config.powers(velocity));
        while let Some(transmission) = driver.transmit(now) {
            port.send(&transmission).map_err(lost)?;
        }
        Ok(())
    }

    /// The port is locked: by the guard of an edge that was killed just now, as a rule.
    fn wait_for_holder(&mut self, now: Monotonic) {
        let new = Locked {
            since: now,
            was_stopped: false,
        };
        let locked = self.locked.get_or_insert(new);
        let waited = now.since(locked.since);
        let holder = LockHolder::of(&self.config.port);
        let orphan = holder.filter(|holder| holder.is_orphaned_guard());
        if orphan.is_some() && waited >= STOP_AFTER && !locked.was_stopped {
            locked.was_stopped = true;
            // What cannot be told now is told as soon as the port is open.
            drop(Port::stop_without_reply(&self.config.port));
        }
        let is_ended =
            |orphan: LockHolder| waited < 2 * TAKE_OVER_AFTER && orphan.kill_orphaned_guard();
        let (retry, fault) = if waited < TAKE_OVER_AFTER || orphan.is_some_and(is_ended) {
            (LOCKED_RETRY, None)
        } else {
            let pid = holder.map_or(0, |holder| holder.pid);
            (REOPEN, Some(ControllerFault::Held(pid)))
        };
        self.connection = Connection::Closed {
            retry: now + retry,
            fault,
        };
    }

    /// When to step at the latest.
    pub fn deadline(&self) -> Monotonic {
        match &self.connection {
            Connection::Closed { retry, .. } => *retry,
            Connection::Open { driver, .. } => driver.deadline(),
        }
    }

    /// The port, to wait for it; absent while it is closed.
    pub fn fd(&self) -> Option<BorrowedFd<'_>> {
        match &self.connection {
            Connection::Closed { .. } => None,
            Connection::Open { port, .. } => Some(port.as_fd()),
        }
    }

    /// What is known of the controller.
    pub fn status(&self, now: Monotonic) -> Status {
        match &self.connection {
            Connection::Closed { fault, .. } => Status {
                state: fault.map_or(State::Starting, State::Faulty),
                acknowledged: None,
                encoders: None,
                battery_v: None,
                flags: ControllerFlags::default(),
                watchdog: ControllerWatchdog::Unknown,
                reconnects: self.reconnects,
            },
            Connection::Open { driver, .. } => {
                let status = driver.status(now);
                Status {
                    reconnects: self.reconnects.saturating_add(status.reconnects),
                    ..status
                }
            }
        }
    }

    /// Whether both motors have acknowledged a zero that was sent at `since` or later, and nothing else after it.
    pub fn has_stopped_since(&self, since: Monotonic) -> bool {
        match &self.connection {
            Connection::Closed { .. } => false,
            Connection::Open { driver, .. } => driver.has_stopped_since(since),
        }
    }

    /// What the vehicle does where the channels do what they have acknowledged.
    pub fn applied(&self, status: &Status) -> Option<Velocity> {
        Some(self.config.velocity_of_powers(status.acknowledged?))
    }

    /// What the vehicle does as its encoders say.
    pub fn measured(&self, status: &Status) -> Option<Velocity> {
        self.config.velocity_of_encoders(status.encoders?)
    }
}
