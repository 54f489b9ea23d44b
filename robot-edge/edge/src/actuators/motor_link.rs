//! What the motor guard, and the edge in its place, need of a link with motors.

use std::os::fd::BorrowedFd;

use serde::{Deserialize, Serialize};

use super::forward_pipe::ForwardPipe;
use super::mavlink::{MavlinkConfig, MavlinkLink};
use super::report::{ControllerFault, ControllerFlags, ControllerWatchdog};
use super::roboteq::RoboteqConfig;
use super::roboteq::serial_link::{Port, SerialLink};
use measurement::time::Monotonic;
use teleop::Velocity;

/// Where motors are; the guard's process gets it in JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum MotorLinkConfig {
    Roboteq(RoboteqConfig),
    Mavlink(MavlinkConfig),
}

impl From<RoboteqConfig> for MotorLinkConfig {
    fn from(config: RoboteqConfig) -> Self {
        Self::Roboteq(config)
    }
}

impl MotorLinkConfig {
    /// Not open yet; the first step tries it. `forward_pipe` gets what is received.
    pub fn link(
        &self,
        sharing: Sharing,
        forward_pipe: Option<ForwardPipe>,
        now: Monotonic,
    ) -> Box<dyn MotorLink> {
        match self {
            Self::Roboteq(config) => {
                Box::new(SerialLink::new(config.clone(), sharing, forward_pipe, now))
            }
            Self::Mavlink(config) => Box::new(MavlinkLink::new(config, sharing, forward_pipe, now)),
        }
    }

    /// Sends zero once to the motors, also if another process holds the link, without waiting for a reply. If this
    /// fails, zero is sent once the link is open.
    pub fn stop_without_reply(&self, now: Monotonic) {
        match self {
            Self::Roboteq(config) => drop(Port::stop_without_reply(&config.port)),
            // Where it can be opened twice: a serial port, or a datagram's destination.
            Self::Mavlink(config) => {
                MavlinkLink::new(config, Sharing::Shared, None, now).step(Velocity::ZERO, now);
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sharing {
    /// An exclusive lock (`flock`): two owners would send commands in turn.
    Exclusive,
    /// Anybody: to stop motors whose owner is lost, and may still hold the port.
    Shared,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    Starting,
    Ready,
    /// It does not obey; zero is sent.
    Faulty(ControllerFault),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkStatus {
    pub state: State,
    pub applied: Option<Velocity>,
    pub measured: Option<Velocity>,
    pub battery_v: Option<f64>,
    pub flags: ControllerFlags,
    pub watchdog: ControllerWatchdog,
    pub reconnects: u32,
    /// Of those that were to be forwarded.
    pub lost_bytes: u32,
}

impl LinkStatus {
    pub const STARTING: Self = Self {
        state: State::Starting,
        applied: None,
        measured: None,
        battery_v: None,
        flags: ControllerFlags(0),
        watchdog: ControllerWatchdog::Unknown,
        reconnects: 0,
        lost_bytes: 0,
    };
}

pub trait MotorLink {
    /// Opens the link, reads input and sends `velocity`, as due. Call it when the link has something to read, when
    /// `velocity` has changed, and at [`Self::deadline`]. It does not wait.
    fn step(&mut self, velocity: Velocity, now: Monotonic);

    fn deadline(&self) -> Monotonic;

    fn fd(&self) -> Option<BorrowedFd<'_>>;

    fn status(&self, now: Monotonic) -> LinkStatus;

    /// Whether the motors got zero after `since`, as far as can be known.
    fn has_stopped_since(&self, since: Monotonic) -> bool;

    /// Requests once that the controller goes to the mode in which it obeys, if it has modes.
    fn request_mode(&mut self) {}
}
