//! `robot-edge run` with a ROS 2 system over Zenoh, played by these tests, and a motor controller at a terminal.

mod devices;
mod driven;
mod lidars;
mod live_rig;
mod mapped;
mod notified;
mod restarts;
mod ros_system;
mod service;
mod simulated_devices;

/// From the edge's own tests: an emulator is no part of the program.
#[path = "../../../../robot-edge/edge/src/actuators/roboteq/emulator.rs"]
#[allow(dead_code, reason = "the edge's own tests use all of it")]
mod emulator;
