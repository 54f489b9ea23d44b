//! The operator's side: one robot's maps as they grow, over a link that may be bad.
//!
//! The link brings bytes, the [model] makes a robot of them, and the window or the headless command
//! reads that. Everything the program does is here; `main.rs` only starts it.

pub mod alerts;
pub mod app;
pub mod cli;
pub mod command;
pub mod controls;
pub mod demo;
pub mod event_log;
pub mod export;
pub mod gamepad;
pub mod headless;
pub mod identity;
pub mod input_loop;
mod join_timing;
pub mod link;
mod locks;
pub mod map_view;
pub mod model;
pub mod panels;
pub mod playback;
pub mod role;
pub mod run;
pub mod script;
pub mod settings;
pub mod shortcuts;
mod target;
pub mod teleop_client;
pub mod teleop_handle;
pub mod teleop_input;
pub mod teleop_session;
#[cfg(test)]
mod test_support;
pub mod theme;
mod typed_path;
pub mod window;
pub mod workspace;
