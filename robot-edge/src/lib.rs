//! The vehicle's half of Foreshore.
//!
//! Data flows one way: a source ([`recording`], [`simulation`], [`network::ros2`]) yields
//! [`measurement::Measurement`]s; [`localization`] registers scans in `odom`; [`mapping`] integrates them into layers;
//! [`publishing`] turns changed cells into tiles, which [`network`] sends. [`runtime`] owns the threads and channels.
//! [`credentials`] define who may connect and drive. [`teleop`] decides which commands move the vehicle, [`driving`]
//! executes them on [`actuators`]. [`experiments`] compares maps of simulated worlds with the ground truth.

pub mod clock;
pub mod pacer;

pub mod actuators;
pub mod audit;
pub mod cli;
pub mod config;
pub mod credentials;
pub mod driving;
pub mod events;
pub mod exit;
pub mod experiments;
pub mod export;
pub mod network;
pub mod overload;
pub mod progress;
pub mod publishing;
pub mod replay_control;
pub mod runtime;
pub mod sensor_monitor;
pub mod service_manager;
pub mod summary;
pub mod survey;
pub mod vehicle_commands;

#[cfg(test)]
#[path = "../../tests/tests/all/skip.rs"]
mod skip;

#[cfg(test)]
#[path = "../recording/src/shared_data.rs"]
mod shared_data;
