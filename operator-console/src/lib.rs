//! The operator console: shows one robot's maps over a bad link and drives it.
//!
//! The link delivers bytes, the [model] keeps the robot's state, and the window or the headless command reads it.
//! `main.rs` only starts the program.

pub mod alerts;
pub mod app;
pub mod cli;
#[cfg(test)]
mod color_vision;
pub mod command;
pub mod demo;
pub mod event_log;
pub mod export;
pub mod gamepad;
pub mod headless;
pub mod identity;
pub mod input_loop;
pub mod link;
pub mod map_view;
pub mod model;
pub mod panels;
pub mod playback;
pub mod run;
pub mod script;
pub mod settings;
pub mod shortcuts;
mod target;
pub mod teleop_client;
pub mod teleop_handle;
pub mod teleop_input;
#[cfg(test)]
mod test_support;
pub mod theme;
pub mod window;
pub mod workspace;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex, also after a panic of another thread: the data behind each lock is consistent after every statement.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
