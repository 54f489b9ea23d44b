//! State and faults of the motors: plain data for the teleop loop.

use std::fmt;

use measurement::time::Monotonic;
use teleop::Velocity;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    pub readiness: Readiness,
    /// The last acknowledged velocity, after saturation and rounding; absent before the first.
    pub applied: Option<Velocity>,
    /// The velocity measured by the encoders; absent without encoders or without a recent answer.
    pub measured: Option<Velocity>,
    pub battery_v: Option<f64>,
    pub controller: ControllerFlags,
    /// Whether the controller stops the motors by itself without communication.
    pub watchdog: ControllerWatchdog,
    pub counters: Counters,
    pub at: Monotonic,
}

impl Report {
    pub const fn unknown(at: Monotonic) -> Self {
        Self {
            readiness: Readiness::Starting,
            applied: None,
            measured: None,
            battery_v: None,
            controller: ControllerFlags(0),
            watchdog: ControllerWatchdog::Unknown,
            counters: Counters::NONE,
            at,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Readiness {
    /// The controller is being found and checked; the command is zero.
    Starting,
    /// The command is zero until a velocity of zero is requested: a key held all the time must not start the vehicle
    /// again.
    Holding(Hold),
    Active,
}

/// Why the motors are held at zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hold {
    /// No velocity was requested since the start.
    Start,
    /// No velocity was requested for too long.
    Silence,
    /// Invalid data arrived.
    Garbage,
    /// The controller was not ready, or has switched its power stage off.
    Controller,
}

/// The watchdog of the controller: it stops the motors without communication. Only it acts when this computer or the
/// cable fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ControllerWatchdog {
    Unknown,
    /// Tested by a pause in communication: it stopped the motors.
    Proven,
    /// Tested by a pause in communication: it did not stop the motors.
    Absent,
}

/// Conditions in which a Roboteq AX controller switches its power stage off: its status register, bit by bit
/// (AX3500 user's manual 1.9b, p. 157, table 28).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct ControllerFlags(pub u8);

impl ControllerFlags {
    const LABELS: [(u8, &'static str); 7] = [
        (0x01, "overvoltage"),
        (0x02, "overtemperature"),
        (0x04, "undervoltage"),
        (0x08, "power stage switched off by hand"),
        (0x20, "short circuit"),
        (0x40, "encoder error"),
        (0x80, "emergency stop pressed"),
    ];
    /// Bit 4 is unused.
    const KNOWN: u8 = 0xEF;

    pub const fn is_off(self) -> bool {
        self.0 & Self::KNOWN != 0
    }
}

impl fmt::Display for ControllerFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let set = Self::LABELS.iter().filter(|(bit, _)| self.0 & bit != 0);
        for (nth, (_, words)) in set.enumerate() {
            write!(f, "{}{words}", if nth == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

/// Errors since the start. The counters saturate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Counters {
    /// Stops because no valid command arrived.
    pub dropouts: u32,
    /// Velocities refused as too old, out of order or from the future.
    pub stale: u32,
    /// Bytes that belong to no valid frame.
    pub garbage: u32,
    pub reconnects: u32,
    /// Bytes of the controller that their reader did not take in time.
    pub lost_bytes: u32,
}

impl Counters {
    pub const NONE: Self = Self {
        dropouts: 0,
        stale: 0,
        garbage: 0,
        reconnects: 0,
        lost_bytes: 0,
    };
}

/// Why the motors cannot be driven. Zero was sent to them if possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Fault {
    /// A velocity that is not a number; zero was passed on.
    #[error("the velocity asked for is not a number: the motors were commanded to stop")]
    NotANumber,
    #[error("motor controller: {0}")]
    Controller(ControllerFault),
    /// The process that owns the motors is gone, or no longer answers.
    #[error("the motor guard is gone: {0}")]
    GuardGone(FallbackStop),
    /// The thread that speaks to the motor guard is gone, or no longer answers.
    #[error("nobody speaks to the motor guard any more: it stops the motors by itself")]
    SupervisorGone,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FallbackStop {
    /// The port is being opened, or zero has been sent and not been acknowledged yet.
    Trying,
    /// They have acknowledged zero, which is repeated.
    Stopped,
    /// The port cannot be opened: what the motors do is up to their controller's watchdog.
    Unreachable,
}

impl fmt::Display for FallbackStop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Trying => "the motors are being commanded to stop",
            Self::Stopped => "the motors have been commanded to stop, and have acknowledged if their controller does so",
            Self::Unreachable => {
                "the motors' port cannot be opened, so it is up to the controller's own watchdog"
            }
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum ControllerFault {
    #[error("its port cannot be opened ({what})", what = std::io::Error::from_raw_os_error(i32::from(*.0)))]
    Port(u8),
    /// Its port is locked by this process; 0 where that is not known.
    #[error("its port is held by {}: end that, or give another port", process(*.0))]
    Held(u32),
    #[error("it does not answer: check power, cable, and that nothing else uses the port")]
    Silent,
    /// What it echoes is not what was sent.
    #[error("the line garbles what is sent: check cable and grounding")]
    GarbledLine,
    #[error("it refuses motor commands")]
    Refusing,
    /// A parameter on which safety depends could not be read.
    #[error("its motor control mode cannot be read, so what it would do is unknown")]
    Unreadable,
    #[error(
        "its motor control mode (parameter 01) is {0:02X}: set \"A and B separate speed\", open or closed loop"
    )]
    MotorMode(u8),
    #[error(
        "its watchdog is off (input control mode, parameter 00, is {0:02X}): set \"RS232 with watchdog\" (02), \
             or `require_watchdog = false`"
    )]
    NoWatchdog(u8),
}

/// A process by its number and command, as far as the system still says it.
fn process(pid: u32) -> String {
    let command = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let command = String::from_utf8_lossy(&command).replace('\0', " ");
    match (pid, command.trim_end()) {
        (0, _) => "another process".to_owned(),
        (pid, "") => format!("process {pid}"),
        (pid, command) => format!("process {pid} ({command})"),
    }
}
