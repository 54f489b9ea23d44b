//! `robot-edge run`: a ROS 2 system that speaks Zenoh, played by these tests, and a motor controller on a terminal.

mod driven;
mod kills;
mod live_rig;
mod mapped;
mod missing;
mod notified;
mod restarts;
mod room;
mod ros_system;
mod service;
mod service_manager;

/// Loaded from the edge's own tests: an emulator is no part of a program that drives.
#[path = "../../../../robot-edge/src/actuators/roboteq/emulator.rs"]
#[allow(
    dead_code,
    reason = "the edge's own tests put everything that can be wrong with it to use"
)]
mod emulator;
