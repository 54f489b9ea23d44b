//! Driving: the thread that moves the vehicle, and what it shares with the rest of the program.
//!
//! The rules are [`crate::teleop`], pure. Here they get a clock, motors, a network and a disk. The loop has a thread of
//! its own, wakes when a command comes or after 20 ms, waits for nobody, and shares no lock with mapping; with the link it
//! shares a [`board::Board`] which it never waits for. Whatever else of the program hangs, it tells the motors zero;
//! where it hangs itself, the motors' own guard does, and `loop_watch` ends the process.

pub mod board;
pub mod drive_log;
pub mod estop_file;
pub mod inbox;
pub mod keeper;
pub mod list_watch;
pub mod local;
pub mod lookout;
pub mod motors;
pub mod operators;
pub mod speedometer;

mod arrivals;
mod driver;
mod loop_watch;
mod newer_list;
mod presses;
mod rate;
mod requests;
mod thread;
mod witness;
mod words;

pub use board::Board;
pub use drive_log::DriveLog;
pub use estop_file::EStopFile;
pub use inbox::{Inbox, Incoming, Reply};
pub use keeper::Keeper;
pub use list_watch::ListWatch;
pub use local::LocalWishes;
pub use lookout::{Lookout, MapLookout, Sight, lookout};
pub use motors::Motors;
pub use operators::Operators;
pub use thread::{Driving, DrivingSettings};
