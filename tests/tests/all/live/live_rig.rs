//! The environment of a live edge: a laser in a ROS 2 system, motors, a configuration and an operator.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use emulators::lms111::Lms111;
use foreshore_tests::operator::{Input, Operator};
use network::clock;
use protocol::message::TeleopState;
use rustix::process::{Pid, Signal, kill_process};
use tempfile::{TempDir, tempdir};

use super::emulator::Emulator;
use super::emulator::on_terminal::EmulatorOnTerminal;
use super::ros_system::{RosMiddleware, RosSystem};
use crate::processes::{Running, command, free_port, tcp};

const NAME: &str = "rover";

/// Straight ahead.
pub(super) const AHEAD: Input = Input::of(0.3, 0.0);

/// Longer than any step takes.
pub(super) const TIMEOUT: Duration = Duration::from_mins(1);

/// The shipped preset, with its collision monitor.
pub(super) const VEHICLE: &str = "preset = \"generic2d\"\n";

/// Without localization, the collision monitor would see a standing vehicle, so it is off.
const BLIND_VEHICLE: &str = "preset = \"generic2d\"\n[localization]\nsource = \"static\"\n\
                             [teleop.collision_monitor]\nenabled = false\n";

/// The environment of an edge; it outlives the edge.
pub(super) struct LiveRig {
    port: u16,
    /// What says where measurements come from, on the command line.
    source: String,
    folder: TempDir,
    configuration: String,
    scans: Arc<AtomicU32>,
    is_over: Arc<AtomicBool>,
    sensors: Option<JoinHandle<()>>,
    _laser: Option<emulators::Emulator<Lms111>>,
}

impl LiveRig {
    /// `play` publishes the sensors' messages until its second argument, asked once for each scan, returns true.
    pub(super) fn new(
        configuration: String,
        mut system: RosSystem,
        play: impl FnOnce(&mut RosSystem, &dyn Fn() -> bool) + Send + 'static,
    ) -> Self {
        let (scans, is_over) = (
            Arc::new(AtomicU32::new(0)),
            Arc::new(AtomicBool::new(false)),
        );
        system.announce("/scan", "sensor_msgs/msg/LaserScan");
        let source = format!("--ros {} --ros-domain 0 --wait 60", system.endpoint());
        let sensors = std::thread::spawn({
            let (scans, is_over) = (Arc::clone(&scans), Arc::clone(&is_over));
            move || {
                play(&mut system, &|| {
                    scans.fetch_add(1, Ordering::Relaxed);
                    is_over.load(Ordering::Relaxed)
                });
            }
        });
        Self {
            port: free_port(),
            source,
            folder: tempdir().unwrap(),
            configuration,
            scans,
            is_over,
            sensors: Some(sensors),
            _laser: None,
        }
    }

    /// With the emulated controller.
    pub(super) fn with_roboteq(set_up: impl FnOnce(&mut Emulator)) -> (Self, EmulatorOnTerminal) {
        let controller = controller(set_up);
        let configuration = format!("{BLIND_VEHICLE}{}", roboteq(&controller));
        let system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 0 });
        let laser = |system: &mut RosSystem, is_over: &dyn Fn() -> bool| {
            system.sweep_until(0, is_over);
        };
        (Self::new(configuration, system, laser), controller)
    }

    /// With the timing of a real line and a controller whose watchdog acts at the start only: it does not stop
    /// these motors.
    pub(super) fn on_a_real_line() -> (Self, EmulatorOnTerminal) {
        Self::with_roboteq(time_as_a_real_line)
    }

    /// The same without ROS 2: the edge reads a laser itself, and the encoders through the motor guard.
    pub(super) fn with_devices() -> (Self, EmulatorOnTerminal) {
        let controller = controller(time_as_a_real_line);
        let laser = emulators::Emulator::on_tcp(Lms111::default());
        let configuration = format!(
            "{BLIND_VEHICLE}{}[devices.laser]\nkind = \"sick_cola\"\ntcp = \"{}\"\n",
            roboteq(&controller),
            laser.address
        );
        let live_rig = Self {
            port: free_port(),
            source: String::new(),
            folder: tempdir().unwrap(),
            configuration,
            scans: Arc::default(),
            is_over: Arc::default(),
            sensors: None,
            _laser: Some(laser),
        };
        (live_rig, controller)
    }

    pub(super) fn configuration(&self) -> &str {
        &self.configuration
    }

    pub(super) fn arguments(&self, configuration: &Path) -> String {
        let (source, port) = (&self.source, self.port);
        format!(
            "run {source} --robot {NAME} --quiet --vehicle {} --listen tcp/127.0.0.1:{port}",
            configuration.display()
        )
    }

    pub(super) fn start_edge(&self, set_up: impl FnOnce(&mut Command)) -> Running {
        let configuration = self.folder().join("rover.toml");
        fs::write(&configuration, &self.configuration).unwrap();
        let mut edge = command(&format!("robot-edge {}", self.arguments(&configuration)));
        edge.env("STATE_DIRECTORY", self.state());
        set_up(&mut edge);
        Running::start(&mut edge, "edge")
    }

    pub(super) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The folder of a stored emergency stop.
    pub(super) fn state(&self) -> PathBuf {
        self.folder().join("state")
    }

    /// Number of scans published so far.
    pub(super) fn scans(&self) -> u32 {
        self.scans.load(Ordering::Relaxed)
    }

    /// An operator, once the motors are ready.
    pub(super) fn operator(&self) -> Operator {
        let operator = Operator::ready(&tcp(self.port), NAME, "anna");
        operator.wait_for_status("ready", |teleop| teleop.state == TeleopState::Idle);
        operator
    }

    /// An operator who drives: the motors of `controller` turn.
    pub(super) fn start_driving(&self, controller: &EmulatorOnTerminal) -> Operator {
        let mut anna = self.operator();
        anna.start_driving(AHEAD);
        let started = clock::now();
        anna.hold_until(AHEAD, || {
            controller.with(|emulator| emulator.motors().iter().all(|&power| power > 0))
                || clock::elapsed(started) >= TIMEOUT
        });
        assert!(
            clock::elapsed(started) < TIMEOUT,
            "the motors never turn: {:?}",
            anna.teleop()
        );
        anna
    }
}

impl Drop for LiveRig {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(sensors) = self.sensors.take() {
            // Its failures fail the test elsewhere.
            drop(sensors.join());
        }
    }
}

fn controller(set_up: impl FnOnce(&mut Emulator)) -> EmulatorOnTerminal {
    EmulatorOnTerminal::start(|emulator| {
        emulator.full_speed_counts = Some([1000.0; 2]);
        set_up(emulator);
    })
}

const fn time_as_a_real_line(emulator: &mut Emulator) {
    emulator.has_line_timing = true;
    emulator.watchdog_after = Duration::from_hours(1);
    emulator.watchdog_trial_after = Some(Duration::from_millis(100));
}

/// The configuration of motors at the emulated controller.
pub(super) fn roboteq(controller: &EmulatorOnTerminal) -> String {
    format!(
        "[motors.roboteq]\nport = \"{}\"\nleft_channel = \"one\"\n\
         drive = {{ track_width_m = 0.5, full_speed_mps = 1.0 }}\n\
         encoders = {{ left_pulses_per_turn = 250.0, right_pulses_per_turn = 250.0 }}\n",
        controller.path().display()
    )
}

/// Sends a signal to a process that must exist.
pub(super) fn signal(pid: u32, signal: Signal) {
    assert!(try_signal(pid, signal), "there is no process {pid}");
}

/// Sends a signal; returns whether the process exists.
pub(super) fn try_signal(pid: u32, signal: Signal) -> bool {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    kill_process(pid, signal).is_ok()
}

pub(super) fn children(of: u32) -> Vec<u32> {
    let Ok(tasks) = fs::read_dir(format!("/proc/{of}/task")) else {
        return Vec::new();
    };
    let lists =
        tasks.filter_map(|task| fs::read_to_string(task.ok()?.path().join("children")).ok());
    let lists: Vec<_> = lists.collect();
    let pids = lists.iter().flat_map(|list| list.split_whitespace());
    pids.map(|pid| pid.parse().unwrap()).collect()
}

pub(super) fn is_motor_guard(pid: u32) -> bool {
    let words = fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    words.split('\0').any(|word| word == "motor-guard")
}

pub(super) fn guard_of(edge: u32) -> u32 {
    let guard = children(edge).into_iter().find(|pid| is_motor_guard(*pid));
    guard.expect("a motor guard")
}
