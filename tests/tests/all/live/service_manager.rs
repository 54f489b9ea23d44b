//! The shipped systemd unit, unchanged, under a real systemd in namespaces of its own. It needs root, `unshare` and
//! `nsenter` (package util-linux), `useradd` (package passwd) and systemd.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;
use tempfile::{TempDir, tempdir};

use crate::link::processes::program;

/// Longer than any step takes.
const TIMEOUT: Duration = Duration::from_mins(1);

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

/// The shipped unit's text.
pub(super) fn shipped_unit() -> String {
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
    pub(super) fn start(files: &[(&str, &str)]) -> Self {
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
            .env("PROGRAM", program("robot-edge").get_program())
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

    /// Runs `systemctl`; returns its output.
    pub(super) fn control(&self, arguments: &[&str]) -> String {
        let output = self.try_control(arguments);
        let [printed, failed] =
            [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(output.status.success(), "{arguments:?}: {printed}{failed}");
        printed
    }

    /// A property of the service.
    pub(super) fn property(&self, name: &str) -> String {
        let printed = self.control(&["show", UNIT, "--value", "--property", name]);
        printed.trim_end().to_owned()
    }

    /// Begins to start the service.
    pub(super) fn start_service(&self) {
        self.control(&["start", "--no-block", UNIT]);
    }

    /// Path of a file inside, seen from outside.
    pub(super) fn path(&self, inside: &str) -> PathBuf {
        PathBuf::from(format!("/proc/{}/root{inside}", self.systemd))
    }

    /// The service's processes.
    pub(super) fn processes(&self) -> Vec<u32> {
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
    pub(super) fn motor_guards(&self) -> Vec<u32> {
        self.processes()
            .into_iter()
            .filter(|pid| is_motor_guard(*pid))
            .collect()
    }

    /// The output of the edge.
    pub(super) fn log(&self) -> String {
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

/// Child processes of a process.
fn children(of: u32) -> Vec<u32> {
    let Ok(tasks) = fs::read_dir(format!("/proc/{of}/task")) else {
        return Vec::new();
    };
    let lists =
        tasks.filter_map(|task| fs::read_to_string(task.ok()?.path().join("children")).ok());
    let lists: Vec<_> = lists.collect();
    let pids = lists.iter().flat_map(|list| list.split_whitespace());
    pids.map(|pid| pid.parse().unwrap()).collect()
}

/// Whether this process is a motor guard.
pub(super) fn is_motor_guard(pid: u32) -> bool {
    let words = fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    words.split('\0').any(|word| word == "motor-guard")
}

/// The motor guard of `edge`.
pub(super) fn guard_of(edge: u32) -> u32 {
    let guard = children(edge).into_iter().find(|pid| is_motor_guard(*pid));
    guard.expect("a motor guard")
}
