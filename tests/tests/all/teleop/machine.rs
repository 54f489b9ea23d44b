//! The vehicle's computer: its wall clock jumps, its disk is full.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::operator::Operator;
use protocol::message::{Answer, EStop, TeleopState};
use tempfile::{TempDir, tempdir};

use super::drive::{drove, while_driving};
use super::robot::{CIRCLE, NAME, Robot};
use crate::link::processes::{free_port, program};
use crate::skip::skip;

const MEANWHILE: Duration = Duration::from_secs(2);

/// Path on Debian.
const LIBFAKETIME: &str = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";

/// Loads `libfaketime`: the file sets the wall clock; other clocks are not changed.
fn with_wall_clock(command: &mut Command, file: &Path) {
    command
        .env("LD_PRELOAD", LIBFAKETIME)
        .env("FAKETIME_TIMESTAMP_FILE", file)
        .env("FAKETIME_NO_CACHE", "1")
        .env("FAKETIME_DONT_FAKE_MONOTONIC", "1");
}

fn set_wall_clock(file: &Path, offset: &str) {
    // Atomic: the file is read all the time.
    let next = file.with_extension("next");
    fs::write(&next, offset).unwrap();
    fs::rename(next, file).unwrap();
    let mut date = Command::new("date");
    with_wall_clock(&mut date, file);
    let printed = |date: &mut Command| {
        let printed = date.arg("+%s").output().unwrap();
        let text = String::from_utf8(printed.stdout).unwrap();
        text.trim().parse::<i64>().unwrap()
    };
    let (faked, real) = (printed(&mut date), printed(&mut Command::new("date")));
    let off_s: i64 = offset.trim_end_matches('s').parse().unwrap();
    assert!(
        (faked - real - off_s).abs() <= 5,
        "{faked} and {real}: the clock did not step"
    );
}

#[test]
fn setting_the_wall_clock_changes_nothing() {
    if !Path::new(LIBFAKETIME).exists() {
        skip(&format!("there is no {LIBFAKETIME}"), "package libfaketime");
        return;
    }
    let folder = tempdir().unwrap();
    let clock = folder.path().join("clock");
    set_wall_clock(&clock, "+0s");
    let port = free_port();
    let file = clock.clone();
    let robot = Robot::launch(program("robot-edge"), port, "rooms", move |command| {
        command.args(["--listen", &format!("tcp/127.0.0.1:{port}")]);
        with_wall_clock(command, &file);
    });
    let mut anna = Operator::ready(&robot.endpoint(), NAME, "anna");
    let drive = while_driving(&mut anna, || {
        for offset in ["+3600s", "-3600s", "+0s"] {
            set_wall_clock(&clock, offset);
            sleep(MEANWHILE);
        }
    });
    assert!(robot.edge.has_loaded("libfaketime"), "it has another clock");
    let share = drove("a wall clock that jumps", &robot.log(), drive);
    assert!(share > 0.5, "{share}");
    robot.verdict(&[&anna.journal]);
}

/// A small disk.
pub(super) struct Disk {
    folder: TempDir,
}

impl Disk {
    /// `None`, and a skipped test, without the right to mount.
    pub(super) fn mounted() -> Option<Self> {
        let folder = tempdir().unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=2m", "tmpfs"])
            .arg(folder.path())
            .status()
            .unwrap();
        if !mounted.success() {
            skip("no small disk can be mounted", "root");
            return None;
        }
        Some(Self { folder })
    }

    pub(super) fn resize(&self, size: &str) {
        let resized = Command::new("mount")
            .args(["-o", &format!("remount,size={size}")])
            .arg(self.folder.path())
            .status()
            .unwrap();
        assert!(resized.success());
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn fill(&self) {
        let mut file = File::create(self.path("ballast")).unwrap();
        loop {
            match file.write_all(&[7; 512]) {
                Ok(()) => {}
                Err(err) if err.kind() == ErrorKind::StorageFull => return,
                Err(err) => panic!("{err}"),
            }
        }
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let mut umount = Command::new("umount");
        drop(umount.arg("--lazy").arg(self.folder.path()).status());
    }
}

#[test]
fn a_full_disk_stops_neither_driving_nor_an_emergency_stop() {
    let Some(disk) = Disk::mounted() else { return };
    let port = free_port();
    let listen = format!("tcp/127.0.0.1:{port}");
    let [state, recording] = ["state", "recording.mcap"].map(|name| disk.path(name));
    let [state, recording] = [&state, &recording].map(|path| path.to_str().unwrap());
    let options = ["--listen", &listen, "--state-dir", state];
    let mut robot = Robot::start_with(port, &[&options[..], &["--record", recording]].concat());
    let mut anna = Operator::ready(&robot.endpoint(), NAME, "anna");
    let drive = while_driving(&mut anna, || {
        disk.fill();
        sleep(3 * MEANWHILE);
        disk.fill();
    });
    let share = drove("a full disk", &robot.log(), drive);
    assert!(share > 0.5, "{share}");
    assert!(robot.edge.is_running());

    let answer = anna.ask(&EStop { press: 5 });
    let Answer::EStopped(number) = answer else {
        panic!("{answer:?}")
    };
    anna.hold(CIRCLE, MEANWHILE);
    assert!(robot.log().rounds.last().unwrap().is_stopped());
    robot.verdict(&[&anna.journal]);
    robot.edge.signal("KILL");
    drop(robot);

    let robot = Robot::start_with(port, &options);
    let bert = Operator::ready(&robot.endpoint(), NAME, "bert");
    let found = bert.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert_eq!(found.estop.map(|estop| estop.number), Some(number));
}
