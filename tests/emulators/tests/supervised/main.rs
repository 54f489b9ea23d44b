//! Supervisors against emulated devices.

#![cfg(target_os = "linux")]

mod endurance;
mod lms111;
mod others;
mod outages;
mod rig;
