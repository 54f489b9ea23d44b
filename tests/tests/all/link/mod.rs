//! Edge and console as processes, over real Zenoh sessions.

pub(crate) mod processes;

#[cfg(target_os = "linux")]
mod address_change;
#[cfg(target_os = "linux")]
mod controls;
mod cost;
#[cfg(target_os = "linux")]
mod day;
#[cfg(target_os = "linux")]
mod drag_source;
mod drive_script;
#[cfg(target_os = "linux")]
mod drive_window;
#[cfg(target_os = "linux")]
mod driver;
mod driving;
#[cfg(target_os = "linux")]
mod drop_file;
mod garbage;
#[cfg(target_os = "linux")]
mod idle;
mod late_joiner;
mod link_loss;
mod live_map;
mod python_client;
mod router;
#[cfg(target_os = "linux")]
mod screen;
mod sensors;
mod shaped;
#[cfg(target_os = "linux")]
mod telemetry;
mod window;
