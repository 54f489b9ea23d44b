//! Edge and console as processes, over real Zenoh sessions.

pub(crate) mod processes;

mod cost;
mod drive_script;
#[cfg(target_os = "linux")]
mod drive_window;
mod driving;
mod garbage;
mod link_loss;
mod live_map;
mod python_client;
mod router;
#[cfg(target_os = "linux")]
mod screen;
mod sensors;
mod shaped;
mod window;
