//! Driving: the thread that moves the vehicle, and what it shares with the rest of the program.
//!
//! The rules are [`teleop`], pure. Here they get a clock, motors, a network and a disk. The loop has a thread of
//! its own, wakes when a command comes or after 20 ms, waits for nobody, and shares no lock with mapping; with the link it
//! shares a [`shared_drive_state::SharedDriveState`] which it never waits for. Whatever else of the program hangs, it tells the motors zero;
//! where it hangs itself, the motors' own guard does, and `loop_watch` ends the process.

pub mod drive_log;
pub mod estop_file;
pub mod estop_store;
pub mod inbox;
pub mod local_commands;
pub mod monitor_input;
pub mod motors;
pub mod operator_list_watcher;
pub mod operators;
pub mod shared_drive_state;
pub mod velocity_estimator;

mod audit_recorder;
mod drive_loop;
mod estop_deduplicator;
mod loop_watchdog;
mod pending_operator_list;
mod rate_limiter;
mod receive_times;
mod requests;
mod status_message;
mod thread;

pub use drive_log::DriveLog;
pub use estop_file::EStopFile;
pub use estop_store::EStopStore;
pub use inbox::{Inbox, Incoming, Reply};
pub use local_commands::LocalCommands;
pub use monitor_input::{MonitorMapInput, MonitorRunner, MonitorSensorInput, monitor_input};
pub use motors::Motors;
pub use operator_list_watcher::OperatorListWatcher;
pub use operators::Operators;
pub use shared_drive_state::SharedDriveState;
pub use thread::{Driving, DrivingSettings};
