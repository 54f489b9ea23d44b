//! The vehicle's half of Foreshore.
//!
//! Data flows one way: a source ([`recording`], [`simulation`]) yields [`measurement::Measurement`]s;
//! [`localization`] places every beam of a scan in `odom`; [`mapping`] turns posed scans into cells;
//! [`streaming`] turns changed cells into tiles. [`app`] owns the threads and channels between them.
//! [`credentials`] say who may connect, and who may drive.
//! [`teleop`] decides which commands of an operator move the vehicle, [`driving`] carries that out on [`actuators`].
//! [`experiments`] holds the maps of simulated worlds against their truth.

pub mod clock;
pub mod pacer;

pub mod actuators;
pub mod app;
pub mod audit;
pub mod cli;
pub mod config;
pub mod credentials;
pub mod driving;
pub mod events;
pub mod exit;
pub mod experiments;
pub mod export;
pub mod link;
pub mod overload;
pub mod pipeline;
pub mod progress;
pub mod replay_control;
pub mod sensor_monitor;
pub mod service_manager;
pub mod streaming;
pub mod summary;
pub mod survey;
pub mod vehicle_commands;

#[cfg(test)]
#[path = "../../tests/tests/all/skip.rs"]
mod skip;

#[cfg(test)]
#[path = "../recording/src/shared_data.rs"]
mod shared_data;
