//! What an actuator says back: plain data for the teleop loop.

use std::fmt;

use measurement::time::Monotonic;
use teleop::Velocity;

/// What is known of the motors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Whether they obey.
    pub readiness: Readiness,
    /// What they were last told and have acknowledged, after saturation and rounding; absent before that.
    pub applied: Option<Velocity>,
    /// How fast the wheels turn, as their encoders say; absent without encoders, and when they have not answered lately.
    pub measured: Option<Velocity>,
    /// The battery's voltage; absent where it is not known.
    pub battery_v: Option<f64>,
    /// What the controller says of itself.
    pub controller: ControllerFlags,
    /// Whether the controller stops the motors by itself when nobody speaks to it.
    pub watchdog: ControllerWatchdog,
    /// What went wrong on the way so far.
    pub counters: Counters,
    /// When this was so.
    pub at: Monotonic,
}

impl Report {
    /// Before anything is known.
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

/// Whether the motors obey.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Readiness {
    /// The controller is being found and checked; the motors are told to stand.
    Starting,
    /// The motors are told to stand, until a velocity of zero has been asked for: a key that was held all the time
    /// must not set a vehicle going again by itself.
    Holding(Hold),
    /// What is asked for is done.
    Active,
}

/// Why the motors stand, whatever is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hold {
    /// Nothing has been asked for since the start.
    Start,
    /// For too long nothing was asked for.
    Silence,
    /// What arrived made no sense.
    Garbage,
    /// The controller was not ready, or has switched its power stage off.
    Controller,
}

/// Whether the controller stops the motors by itself when nobody speaks to it. It is the last line of defence: it
/// alone acts when this computer, or the cable, is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ControllerWatchdog {
    /// Not tried yet, or not known.
    Unknown,
    /// It was left alone on purpose, and has stopped.
    Proven,
    /// It was left alone on purpose, and has not stopped.
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

    /// Whether the power stage is off.
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

/// What went wrong on the way, since the start. They stop at their greatest value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub struct Counters {
    /// Times the motors were stopped because nothing valid came.
    pub dropouts: u32,
    /// Velocities refused as too old, as older than another, or as of the future.
    pub stale: u32,
    /// Bytes between valid messages of the edge.
    pub garbage: u32,
    /// Times that the controller had to be found anew.
    pub reconnects: u32,
}

impl Counters {
    /// Nothing yet.
    pub const NONE: Self = Self {
        dropouts: 0,
        stale: 0,
        garbage: 0,
        reconnects: 0,
    };
}

/// Why the motors cannot be driven. They have been told to stand, where that was possible at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Fault {
    /// A velocity that is not a number; zero was passed on.
    #[error("the velocity asked for is not a number: the motors were told to stand")]
    NotANumber,
    /// The controller cannot be driven.
    #[error("motor controller: {0}")]
    Controller(ControllerFault),
    /// The process that owns the motors is gone, or no longer answers.
    #[error("the motor guard is gone: {0}")]
    GuardGone(FallbackStop),
    /// The thread that speaks to the motor guard is gone, or no longer answers.
    #[error("nobody speaks to the motor guard any more: it stops the motors by itself")]
    SupervisorGone,
}

/// What became of the motors when their owner was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FallbackStop {
    /// The port is being opened, or zero has been sent and not been acknowledged yet.
    Trying,
    /// They have acknowledged zero, and are told so again and again.
    Stopped,
    /// The port cannot be opened: what the motors do is up to their controller's watchdog.
    Unreachable,
}

impl fmt::Display for FallbackStop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Trying => "the motors are being told to stand",
            Self::Stopped => "the motors have been told to stand, and have acknowledged",
            Self::Unreachable => {
                "the motors' port cannot be opened, so it is up to the controller's own watchdog"
            }
        })
    }
}

/// What is wrong with the motor controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum ControllerFault {
    /// Its port cannot be opened.
    #[error("its port cannot be opened ({what})", what = std::io::Error::from_raw_os_error(i32::from(*.0)))]
    Port(u8),
    /// Its port is locked by this process; 0 where that is not known.
    #[error("its port is held by {}: end that, or give another port", process(*.0))]
    Held(u32),
    /// It does not answer.
    #[error("it does not answer: check power, cable, and that nothing else uses the port")]
    Silent,
    /// What it echoes is not what was sent.
    #[error("the line garbles what is sent: check cable and grounding")]
    GarbledLine,
    /// It refuses motor commands.
    #[error("it refuses motor commands")]
    Refusing,
    /// A parameter on which safety depends could not be read.
    #[error("its motor control mode cannot be read, so what it would do is unknown")]
    Unreadable,
    /// Its channels are not two independent speeds.
    #[error(
        "its motor control mode (parameter 01) is {0:02X}: set \"A and B separate speed\", open or closed loop"
    )]
    MotorMode(u8),
    /// It does not stop the motors by itself.
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
