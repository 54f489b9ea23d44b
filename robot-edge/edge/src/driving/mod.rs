//! Driving: the thread that moves the vehicle, and what it shares with the rest of the program.
//!
//! The rules are those of the crate [`teleop`]. This module connects them to a clock, motors, a network and a disk. The
//! loop runs on its own thread, wakes when a command arrives or after 20 ms, and never blocks. It shares no lock with
//! mapping; with the link it shares a [`SharedDriveState`], for which it never waits. If another part of the program
//! hangs, the loop sends zero to the motors. If the loop itself hangs, the motor guard does, and the loop's watchdog
//! ends the process.

#[cfg(target_os = "linux")]
pub mod autopilot;
pub mod inbox;
pub mod monitor_input;
pub mod motors;
pub mod operators;
pub mod planner;
pub mod velocity_estimator;

mod audit_recorder;
mod drive_log;
mod drive_loop;
mod estop_store;
mod shared_drive_state;
mod status_message;
mod thread;

pub use drive_log::DriveLog;
pub use estop_store::{EStopFile, EStopStore};
pub use inbox::{Inbox, Incoming, LocalCommands, Reply};
pub use monitor_input::{MonitorMapInput, MonitorRunner, MonitorSensorInput, monitor_input};
pub use motors::Motors;
pub use operators::{OperatorListWatcher, Operators};
pub use shared_drive_state::{MapRequest, SharedDriveState};
pub use thread::{Driving, DrivingSettings};
