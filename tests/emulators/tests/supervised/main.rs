//! Supervisors against emulated devices.

#![cfg(test)]
#![cfg(target_os = "linux")]

mod endurance;
mod fed;
mod lms111;
mod others;
mod outages;
mod rig;
