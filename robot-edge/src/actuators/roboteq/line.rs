//! A controller and its driver at the two ends of a port that may come and go.

use std::os::fd::{AsFd as _, BorrowedFd};
use std::time::Duration;

use super::config::RoboteqConfig;
use super::driver::{Driver, State, Status};
use super::port::{Port, PortError, Sharing};
use crate::actuators::report::{ControllerFault, ControllerFlags, ControllerWatchdog};
use crate::clock::Monotonic;
use crate::teleop::Velocity;

/// Between two attempts to open the port.
const REOPEN: Duration = Duration::from_millis(200);

/// Most reads in one step: more than a line of 960 characters a second can bring, and a bound for one that never ends.
const READS: usize = 16;

/// The way to the motors, whether it is there or not.
#[derive(Debug)]
pub struct Line {
    config: RoboteqConfig,
    sharing: Sharing,
    end: End,
    /// Times that a port was lost that was open, and what its drivers lost before.
    reconnects: u32,
}

#[derive(Debug)]
enum End {
    Closed { retry: Monotonic, errno: u8 },
    Open { port: Port, driver: Box<Driver> },
}

impl Line {
    /// Not open yet; the first [`Self::step`] tries it.
    pub const fn new(config: RoboteqConfig, sharing: Sharing, now: Monotonic) -> Self {
        Self {
            config,
            sharing,
            end: End::Closed {
                retry: now,
                errno: 0,
            },
            reconnects: 0,
        }
    }

    /// Does what is due: opens the port, takes what came in, and tells the motors `velocity`. Call it when the port has
    /// something to read, when `velocity` has changed, and at [`Self::deadline`]. It does not wait.
    pub fn step(&mut self, velocity: Velocity, now: Monotonic) {
        if let Err(lost) = self.try_step(velocity, now) {
            if let End::Open { driver, .. } = &self.end {
                let before = driver.status(now).reconnects;
                self.reconnects = self.reconnects.saturating_add(before).saturating_add(1);
            }
            self.end = End::Closed {
                retry: now + REOPEN,
                errno: lost.errno(),
            };
        }
    }

    fn try_step(&mut self, velocity: Velocity, now: Monotonic) -> Result<(), PortError> {
        if let End::Closed { retry, .. } = self.end {
            if now < retry {
                return Ok(());
            }
            let port = Port::open(&self.config.port, self.sharing)?;
            let has_encoders = self.config.encoder_full_speed_mps.is_some();
            let driver = Driver::new(has_encoders, self.config.require_watchdog, now);
            self.end = End::Open {
                port,
                driver: Box::new(driver),
            };
        }
        let End::Open { port, driver } = &mut self.end else {
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

    /// When to step at the latest.
    pub fn deadline(&self) -> Monotonic {
        match &self.end {
            End::Closed { retry, .. } => *retry,
            End::Open { driver, .. } => driver.deadline(),
        }
    }

    /// The port, to wait for it; absent while it is closed.
    pub fn fd(&self) -> Option<BorrowedFd<'_>> {
        match &self.end {
            End::Closed { .. } => None,
            End::Open { port, .. } => Some(port.as_fd()),
        }
    }

    /// What is known of the controller.
    pub fn status(&self, now: Monotonic) -> Status {
        match &self.end {
            End::Closed { errno, .. } => Status {
                state: match errno {
                    0 => State::Starting,
                    _ => State::Faulty(ControllerFault::Port(*errno)),
                },
                acknowledged: None,
                encoders: None,
                battery_v: None,
                flags: ControllerFlags::default(),
                watchdog: ControllerWatchdog::Unknown,
                reconnects: self.reconnects,
            },
            End::Open { driver, .. } => {
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
        match &self.end {
            End::Closed { .. } => false,
            End::Open { driver, .. } => driver.has_stopped_since(since),
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
