//! The vehicle's half of Foreshore.
//!
//! Data flows one way: a source ([`recording`], `simulation`, [`ros2`]) yields [`measurement::Measurement`]s;
//! [`localization`] registers scans in `odom`; [`mapping`] integrates them into layers; [`publishing`] turns changed cells
//! into tiles, which [`server`] sends. [`runtime`] owns the threads and channels. [`teleop`] decides which commands move
//! the vehicle, [`driving`] executes them on [`actuators`].

pub mod pacer;

pub mod actuators;
pub mod cli;
pub mod config;
mod device_commands;
pub mod driving;
mod evaluate;
pub mod events;
pub mod exit;
pub mod export;
#[cfg(feature = "foxglove")]
pub mod foxglove;
pub mod overload;
pub mod progress;
pub mod publishing;
pub mod replay_control;
pub mod ros2;
pub mod runtime;
pub mod sensor_monitor;
pub mod server;
pub mod service_manager;
pub mod setup;
pub mod summary;
pub mod survey;
mod thread_priority;
pub mod vehicle_commands;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// A poisoned lock is taken: each value is replaced as a whole, so that it is valid after a panic elsewhere.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;

#[cfg(test)]
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
