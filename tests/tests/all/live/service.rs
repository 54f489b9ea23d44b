//! The shipped unit under a real systemd, installed as in docs/deployment.md.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::PERIOD;
use protocol::message::TeleopState;
use robot_edge::clock;
use rustix::process::Signal;

use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig};
use super::restarts::{ZERO_WITHIN, signal, try_signal, zero_after};
use super::service_manager::{ServiceManager, shipped_unit};
use crate::link::processes::wait_until;

const ENVIRONMENT: &str = "robot-edge.env";

/// A vehicle whose edge is a service of systemd.
pub(super) struct Service {
    // Dropped first: it needs the others.
    pub(super) manager: ServiceManager,
    pub(super) live_rig: LiveRig,
    pub(super) controller: EmulatorOnTerminal,
}

impl Service {
    /// Starts the edge with more options.
    pub(super) fn new(options: &str) -> Self {
        let (live_rig, controller) = LiveRig::on_a_real_line();
        // A serial port belongs to a group that the unit is in; a pseudo-terminal does not.
        fs::set_permissions(controller.path(), fs::Permissions::from_mode(0o666)).unwrap();
        let manager = ServiceManager::start(&[
            ("rover.toml", live_rig.configuration()),
            (ENVIRONMENT, &environment(&live_rig, options)),
        ]);
        manager.start_service();
        Self {
            manager,
            live_rig,
            controller,
        }
    }

    /// Changes the options of its next start.
    pub(super) fn call_with(&self, options: &str) {
        let path = self.manager.path("/etc/foreshore").join(ENVIRONMENT);
        fs::write(path, environment(&self.live_rig, options)).unwrap();
    }

    fn sole_guard(&self) -> u32 {
        let guards = self.manager.motor_guards();
        assert_eq!(guards.len(), 1, "{guards:?}");
        guards[0]
    }
}

fn environment(live_rig: &LiveRig, options: &str) -> String {
    let arguments = live_rig.arguments(Path::new("/etc/foreshore/rover.toml"));
    format!("ROBOT_EDGE=\"{arguments} {options}\"\n")
}

#[test]
fn the_shipped_unit_has_the_required_settings() {
    let unit = shipped_unit();
    for setting in [
        "KillMode=process",
        "Restart=always",
        "Type=notify",
        "NotifyAccess=main",
        "TimeoutStartSec=infinity",
        "WatchdogSec=2",
        "WatchdogSignal=SIGKILL",
    ] {
        let (key, _) = setting.split_once('=').unwrap();
        let set: Vec<_> = unit
            .lines()
            .filter(|line| line.starts_with(&format!("{key}=")))
            .collect();
        assert_eq!(set, [setting]);
    }
}

#[test]
#[ignore = "needs root and systemd"]
fn systemd_restarts_a_killed_edge_after_both_motors_stop() {
    let service = Service::new("");
    let _anna = service.live_rig.start_driving(&service.controller);
    let (edge, guard) = (service.manager.edge().unwrap(), service.sole_guard());
    let killed = clock::now();
    signal(edge, Signal::KILL);
    let zero = zero_after(&service.controller, killed);
    println!("both motors at zero after {zero:?}");
    assert!(zero < ZERO_WITHIN, "{zero:?}");
    // It restarts, gets the port and drives.
    let _anna = service.live_rig.start_driving(&service.controller);
    assert_eq!(service.manager.property("NRestarts"), "1");
    assert_ne!(service.sole_guard(), guard);

    let stopped = clock::now();
    service.manager.control(&["stop", "robot-edge"]);
    let zero = zero_after(&service.controller, stopped);
    println!("both motors at zero after {zero:?} of a stop");
    assert_eq!(service.manager.processes(), [0; 0]);
    assert_eq!(service.manager.property("ActiveState"), "inactive");
}

#[test]
#[ignore = "needs root and systemd"]
fn systemd_ends_and_restarts_an_edge_that_hangs() {
    let service = Service::new("");
    let _anna = service.live_rig.start_driving(&service.controller);
    let edge = service.manager.edge().unwrap();
    let hangs = clock::now();
    signal(edge, Signal::STOP);
    let zero = zero_after(&service.controller, hangs);
    assert!(zero < Duration::from_millis(500), "{zero:?}");
    wait_until("it is killed", || {
        !Path::new(&format!("/proc/{edge}")).exists()
    });
    println!(
        "both motors at zero after {zero:?}, ended after {:?}",
        clock::elapsed(hangs)
    );
    assert!(clock::elapsed(hangs) < Duration::from_secs(5));
    service.live_rig.start_driving(&service.controller);
    assert_eq!(service.manager.property("NRestarts"), "1");
}

#[test]
#[ignore = "needs root and systemd"]
fn a_stop_signal_to_all_processes_leaves_the_motor_guard() {
    let service = Service::new("");
    let mut anna = service.live_rig.start_driving(&service.controller);
    let guard = service.sole_guard();
    service
        .manager
        .control(&["kill", "--kill-whom=main", "--signal=SIGUSR2", "robot-edge"]);
    service.controller.assert_stops_for_good();
    anna.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    service
        .manager
        .control(&["kill", "--kill-whom=main", "--signal=SIGUSR1", "robot-edge"]);
    anna.wait_for_status("reset", |teleop| teleop.state != TeleopState::EStop);
    anna.start_driving(AHEAD);
    for meant_for_the_edge in ["SIGUSR2", "SIGUSR1"] {
        service
            .manager
            .control(&["kill", "--signal", meant_for_the_edge, "robot-edge"]);
        sleep(PERIOD * 10);
    }
    anna.wait_for_status("reset", |teleop| teleop.state != TeleopState::EStop);
    anna.start_driving(AHEAD);
    assert_eq!(service.sole_guard(), guard);
}

#[test]
#[ignore = "needs root and systemd"]
fn the_next_motor_guard_ends_one_that_hangs() {
    let service = Service::new("");
    // The guard ends soon after its edge: it may be gone before it is stopped.
    for _ in 0..5 {
        let _anna = service.live_rig.start_driving(&service.controller);
        let (edge, guard) = (service.manager.edge().unwrap(), service.sole_guard());
        signal(edge, Signal::KILL);
        while Path::new(&format!("/proc/{edge}")).exists() {
            std::hint::spin_loop();
        }
        if try_signal(guard, Signal::STOP) {
            service.live_rig.start_driving(&service.controller);
            assert_ne!(service.sole_guard(), guard);
            return;
        }
    }
    panic!("every guard was gone before it could be stopped");
}
