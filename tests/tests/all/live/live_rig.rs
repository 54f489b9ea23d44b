//! All of a live vehicle but its program: a laser in a ROS 2 system, motors, a configuration, and who drives it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use foreshore_tests::operator::{Input, Operator};
use protocol::message::TeleopState;
use robot_edge::clock;
use tempfile::{TempDir, tempdir};

use super::emulator::Emulator;
use super::emulator::on_terminal::EmulatorOnTerminal;
use super::ros_system::{RosMiddleware, RosSystem};
use crate::link::processes::{Running, free_port, program};

const NAME: &str = "rover";

/// Straight ahead.
pub(super) const AHEAD: Input = Input::of(0.3, 0.0);

/// Nothing that is waited for takes longer.
pub(super) const TIMEOUT: Duration = Duration::from_mins(1);

/// Nothing says where it is, so that the collision monitor would see it stand still while it drives.
const VEHICLE: &str = "preset = \"generic2d\"\n[localization]\nsource = \"static\"\n\
                       [teleop.collision_monitor]\nenabled = false\n";

/// What is around an edge, and outlives it.
pub(super) struct LiveRig {
    port: u16,
    ros: String,
    folder: TempDir,
    configuration: String,
    scans: Arc<AtomicU32>,
    is_over: Arc<AtomicBool>,
    laser: Option<JoinHandle<()>>,
}

impl LiveRig {
    /// With the motors that this table of its configuration says, in this ROS 2 system.
    pub(super) fn new(motors: &str, mut system: RosSystem) -> Self {
        let (scans, is_over) = (
            Arc::new(AtomicU32::new(0)),
            Arc::new(AtomicBool::new(false)),
        );
        system.announce("/scan", "sensor_msgs/msg/LaserScan");
        let ros = system.endpoint();
        let laser = std::thread::spawn({
            let (scans, is_over) = (Arc::clone(&scans), Arc::clone(&is_over));
            move || {
                system.sweep_until(0, || {
                    scans.fetch_add(1, Ordering::Relaxed);
                    is_over.load(Ordering::Relaxed)
                });
            }
        });
        Self {
            port: free_port(),
            ros,
            folder: tempdir().unwrap(),
            configuration: format!("{VEHICLE}{motors}"),
            scans,
            is_over,
            laser: Some(laser),
        }
    }

    /// With the emulated controller.
    pub(super) fn with_roboteq(set_up: impl FnOnce(&mut Emulator)) -> (Self, EmulatorOnTerminal) {
        let controller = EmulatorOnTerminal::start(set_up);
        let motors = format!(
            "[motors.roboteq]\nport = \"{}\"\nleft_channel = \"one\"\n\
             drive = {{ track_width_m = 0.5, full_speed_mps = 1.0 }}\n",
            controller.path().display()
        );
        let system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 0 });
        (Self::new(&motors, system), controller)
    }

    /// The same on a real line, whose controller's watchdog acts at the start alone: what stops these motors is not the
    /// watchdog.
    pub(super) fn on_a_real_line() -> (Self, EmulatorOnTerminal) {
        Self::with_roboteq(|emulator| {
            emulator.has_line_timing = true;
            emulator.watchdog_after = Duration::from_hours(1);
            emulator.watchdog_trial_after = Some(Duration::from_millis(100));
        })
    }

    /// A vehicle's configuration.
    pub(super) fn configuration(&self) -> &str {
        &self.configuration
    }

    /// What an edge is called with.
    pub(super) fn arguments(&self, configuration: &Path) -> String {
        let (ros, port) = (&self.ros, self.port);
        format!(
            "run --ros {ros} --ros-domain 0 --wait 60 --robot {NAME} --quiet --vehicle {} --listen tcp/127.0.0.1:{port}",
            configuration.display()
        )
    }

    /// Starts an edge.
    pub(super) fn start_edge(&self, set_up: impl FnOnce(&mut Command)) -> Running {
        let configuration = self.folder().join("rover.toml");
        fs::write(&configuration, &self.configuration).unwrap();
        let mut command = program("robot-edge");
        command.args(self.arguments(&configuration).split(' '));
        command.env("STATE_DIRECTORY", self.state());
        set_up(&mut command);
        Running::start(&mut command, "edge")
    }

    /// Files of the vehicle.
    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Where it keeps an emergency stop.
    pub(super) fn state(&self) -> PathBuf {
        self.folder().join("state")
    }

    /// Scans that were published so far, or are just being.
    pub(super) fn scans(&self) -> u32 {
        self.scans.load(Ordering::Relaxed)
    }

    /// Somebody who may drive, as soon as the motors are found.
    pub(super) fn operator(&self) -> Operator {
        let operator = Operator::ready(&format!("tcp/127.0.0.1:{}", self.port), NAME, "anna");
        operator.wait_for_status("ready", |teleop| teleop.state == TeleopState::Idle);
        operator
    }

    /// Somebody who drives: the motors of `controller` turn.
    pub(super) fn start_driving(&self, controller: &EmulatorOnTerminal) -> Operator {
        let mut anna = self.operator();
        anna.start_driving(AHEAD);
        let started = clock::now();
        anna.hold_until(AHEAD, || {
            assert!(clock::elapsed(started) < TIMEOUT, "the motors never turn");
            controller.with(|emulator| emulator.motors().iter().all(|&power| power > 0))
        });
        anna
    }
}

impl Drop for LiveRig {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(laser) = self.laser.take() {
            // What failed there fails the test elsewhere.
            drop(laser.join());
        }
    }
}
