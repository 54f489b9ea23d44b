//! Supervisors against emulated devices.

#![cfg(test)]
#![cfg(target_os = "linux")]

mod endurance;
mod fed;
mod lidars;
mod lms111;
mod others;
mod outages;
mod recorded;
mod rig;
#[path = "../../../../robot-edge/recording/src/shared_data.rs"]
mod shared_data;
#[path = "../../../tests/all/skip.rs"]
mod skip;
