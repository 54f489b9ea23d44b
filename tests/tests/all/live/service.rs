//! The shipped unit, unchanged, under a real systemd in namespaces of its own, installed as in docs/deployment.md. It needs
//! root, `unshare` and `nsenter` (package util-linux), `useradd` (package passwd) and systemd.

use std::fs;
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::PERIOD;
use network::clock;
use protocol::message::TeleopState;
use rustix::process::Signal;
use tempfile::{TempDir, tempdir};

use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig, TIMEOUT, children, is_motor_guard, signal};
use super::restarts::{ZERO_WITHIN, zero_after};
use crate::processes::{program, wait_until};

const UNIT: &str = "robot-edge.service";

/// Replaces mounts, devices and the rate limit, which would affect this machine.
const UNITS: [(&str, &str); 3] = [
    ("foreshore-test.target", "[Unit]\nDefaultDependencies=no\n"),
    (
        "foreshore-nft.service",
        "[Unit]\nDefaultDependencies=no\n[Service]\nType=oneshot\nRemainAfterExit=yes\nExecStart=/bin/true\n",
    ),
    (
        "robot-edge.service.d/test.conf",
        "[Unit]\nDefaultDependencies=no\n[Service]\nStandardOutput=append:/run/edge.log\nStandardError=append:/run/edge.log\n",
    ),
];

static NUMBER: AtomicU32 = AtomicU32::new(0);

fn shipped_unit() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../robot-edge/deploy")
        .join(UNIT);
    fs::read_to_string(path).unwrap()
}

/// A systemd with the vehicle's service installed.
pub(super) struct ServiceManager {
    /// `unshare`; its end ends everything inside.
    outside: Child,
    systemd: u32,
    group: PathBuf,
    _files: TempDir,
}

impl ServiceManager {
    /// With these files in `/etc/foreshore`.
    fn start(files: &[(&str, &str)]) -> Self {
        let folder = tempdir().unwrap();
        for (name, text) in files {
            fs::write(folder.path().join(name), text).unwrap();
        }
        let units = folder.path().join("units");
        fs::create_dir_all(units.join("robot-edge.service.d")).unwrap();
        for (name, text) in UNITS {
            fs::write(units.join(name), text).unwrap();
        }
        fs::write(units.join(UNIT), shipped_unit()).unwrap();

        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let group = control_group().join(format!("foreshore-test-{}-{number}", std::process::id()));
        let script =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/all/live/service_manager.sh");
        let outside = Command::new("sh")
            .arg(script)
            .env("GROUP", &group)
            .env("FILES", folder.path())
            .env("PROGRAM", program("robot-edge"))
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        let mut manager = Self {
            outside,
            systemd: 0,
            group,
            _files: folder,
        };
        manager.wait_for_systemd();
        manager
    }

    fn wait_for_systemd(&mut self) {
        let started = clock::now();
        loop {
            let ended = self.outside.try_wait().unwrap();
            assert_eq!(
                ended, None,
                "no systemd: see the output of service_manager.sh above; it needs root"
            );
            self.systemd = children(self.outside.id()).first().copied().unwrap_or(0);
            let name =
                fs::read_to_string(format!("/proc/{}/comm", self.systemd)).unwrap_or_default();
            if name.trim_end() == "systemd" {
                let printed = self.try_control(&["is-system-running"]).stdout;
                if matches!(printed.trim_ascii(), b"running" | b"degraded") {
                    return;
                }
            }
            assert!(clock::elapsed(started) < TIMEOUT, "systemd does not start");
            sleep(Duration::from_millis(20));
        }
    }

    fn try_control(&self, arguments: &[&str]) -> Output {
        Command::new("nsenter")
            .args(["--target", &self.systemd.to_string()])
            .args([
                "--mount",
                "--pid",
                "--cgroup",
                "--uts",
                "--ipc",
                "systemctl",
            ])
            .args(arguments)
            .output()
            .unwrap()
    }

    fn control(&self, arguments: &[&str]) -> String {
        let output = self.try_control(arguments);
        let [printed, failed] =
            [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(output.status.success(), "{arguments:?}: {printed}{failed}");
        printed
    }

    fn property(&self, name: &str) -> String {
        let printed = self.control(&["show", UNIT, "--value", "--property", name]);
        printed.trim_end().to_owned()
    }

    fn start_service(&self) {
        self.control(&["start", "--no-block", UNIT]);
    }

    /// Path of a file inside, seen from outside.
    pub(super) fn path(&self, inside: &str) -> PathBuf {
        PathBuf::from(format!("/proc/{}/root{inside}", self.systemd))
    }

    fn processes(&self) -> Vec<u32> {
        let namespace =
            |pid: u32| fs::metadata(format!("/proc/{pid}/ns/pid")).map(|file| file.ino());
        let inside = namespace(self.systemd).unwrap();
        let all = fs::read_dir("/proc")
            .unwrap()
            .filter_map(|entry| entry.unwrap().file_name().to_str()?.parse().ok());
        let is_edge = |pid: &u32| {
            namespace(*pid).is_ok_and(|of| of == inside)
                && fs::read(format!("/proc/{pid}/cmdline"))
                    .is_ok_and(|command| command.starts_with(b"/usr/bin/robot-edge\0"))
        };
        all.filter(is_edge).collect()
    }

    /// Process id of the edge, outside, if it runs.
    pub(super) fn edge(&self) -> Option<u32> {
        let mut edges = self
            .processes()
            .into_iter()
            .filter(|pid| !is_motor_guard(*pid));
        edges.next()
    }

    /// The motor guards of this edge and earlier ones.
    fn motor_guards(&self) -> Vec<u32> {
        self.processes()
            .into_iter()
            .filter(|pid| is_motor_guard(*pid))
            .collect()
    }

    fn log(&self) -> String {
        fs::read_to_string(self.path("/run/edge.log")).unwrap_or_default()
    }
}

impl Drop for ServiceManager {
    fn drop(&mut self) {
        if std::thread::panicking() && self.systemd != 0 {
            println!("output of the edge: {}", self.log());
        }
        // It may have ended already.
        drop(self.outside.kill());
        drop(self.outside.wait());
        let started = clock::now();
        // Groups with ending processes cannot be removed yet.
        while self.group.exists() && remove_groups(&self.group).is_err() {
            if clock::elapsed(started) > Duration::from_secs(5) {
                println!("{} is left behind", self.group.display());
                break;
            }
            sleep(Duration::from_millis(20));
        }
    }
}

/// The control group (version 2) of this process.
fn control_group() -> PathBuf {
    let mounts = fs::read_to_string("/proc/self/mounts").unwrap();
    let is_version_2 = |fields: &Vec<&str>| fields[2] == "cgroup2";
    let mount = mounts
        .lines()
        .map(|line| line.split(' ').collect())
        .find(is_version_2)
        .expect("control groups of version 2 are not mounted");
    let groups = fs::read_to_string("/proc/self/cgroup").unwrap();
    let own = groups
        .lines()
        .find_map(|line| line.strip_prefix("0::/"))
        .unwrap();
    Path::new(mount[1]).join(own)
}

fn remove_groups(group: &Path) -> io::Result<()> {
    for entry in fs::read_dir(group)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            remove_groups(&entry.path())?;
        }
    }
    fs::remove_dir(group)
}

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
