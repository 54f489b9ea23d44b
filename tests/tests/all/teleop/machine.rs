//! The vehicle's computer: an emergency stop survives the program, signals stop and release, the wall clock jumps, the disk is
//! full or nearly full.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use foreshore_tests::operator::{Input, Operator};
use protocol::keys::Topic;
use protocol::message::{Answer, EStop, Event, Refusal, Reset, Severity, TeleopState};
use protocol::wire;
use tempfile::{TempDir, tempdir};
use zenoh::Wait as _;

use super::robot::{CIRCLE, NAME, Robot, drove, while_driving};
use crate::link::send_view;
use crate::processes::{free_endpoint, measurements_in, simulate, start, wait_until};
use crate::skip::skip;

#[test]
fn an_emergency_stop_survives_a_kill() {
    let state = tempdir().unwrap();
    let (endpoint, folder) = (free_endpoint(), state.path().display());
    let options = format!("--listen {endpoint} --state-dir {folder}");
    let mut robot = Robot::start_with("rooms", &endpoint, &options, |_| ());
    let mut anna = robot.operator("anna");
    anna.start_driving(CIRCLE);
    let answer = anna.ask(&EStop { press: 1 });
    let Answer::EStopped(number) = answer else {
        panic!("{answer:?}")
    };
    robot.edge.signal("KILL");
    robot.restart();

    let mut bert = robot.operator("bert");
    let found = bert.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert_eq!(found.estop.map(|estop| estop.number), Some(number));
    bert.take_lease();
    bert.hold(Input::NEUTRAL, Duration::from_millis(400));
    bert.hold(CIRCLE, Duration::from_millis(400));
    let still = bert.wait_for_new_status();
    assert_eq!(still.state, TeleopState::EStop);
    assert!(still.applied.angular_radps.abs() < 1e-9, "{still:?}");
    assert_eq!(bert.ask(&Reset { estop: number }), Answer::Done);
    bert.start_driving(CIRCLE);

    // A reset one is not restored.
    robot.edge.signal("KILL");
    robot.restart();
    let mut carla = robot.operator("carla");
    carla.start_driving(CIRCLE);
}

#[test]
fn signals_at_the_vehicle_stop_and_release_it() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    anna.start_driving(CIRCLE);
    robot.edge.signal("USR2");
    anna.hold(CIRCLE, Duration::from_millis(600));
    let stopped = anna.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert!(stopped.applied.angular_radps.abs() < 1e-9, "{stopped:?}");
    let number = stopped.estop.unwrap().number;
    robot.edge.signal("USR1");
    anna.wait_for_status("let go", |teleop| teleop.state == TeleopState::Idle);
    assert_eq!(
        anna.ask(&Reset { estop: number }),
        Answer::Refused(Refusal::NoEStop)
    );
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
}

const MEANWHILE: Duration = Duration::from_secs(2);

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
    let (endpoint, file) = (free_endpoint(), clock.clone());
    let options = format!("--listen {endpoint}");
    let robot = Robot::start_with("rooms", &endpoint, &options, move |command| {
        with_wall_clock(command, &file);
    });
    let mut anna = robot.operator("anna");
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

struct Disk {
    folder: TempDir,
}

impl Disk {
    /// `None`, and a skipped test, without the right to mount.
    fn mounted() -> Option<Self> {
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

    fn resize(&self, size: &str) {
        let resized = Command::new("mount")
            .args(["-o", &format!("remount,size={size}")])
            .arg(self.folder.path())
            .status()
            .unwrap();
        assert!(resized.success());
    }

    fn path(&self, name: &str) -> PathBuf {
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
    let endpoint = free_endpoint();
    let [state, recording] = ["state", "recording.mcap"].map(|name| disk.path(name));
    let options = format!("--listen {endpoint} --state-dir {}", state.display());
    let recorded = format!("{options} --record {}", recording.display());
    let mut robot = Robot::start_with("rooms", &endpoint, &recorded, |_| ());
    let mut anna = robot.operator("anna");
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

    let robot = Robot::start_with("rooms", &endpoint, &options, |_| ());
    let bert = robot.operator("bert");
    let found = bert.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert_eq!(found.estop.map(|estop| estop.number), Some(number));
}

/// A console that receives events as long as it sends its view.
struct Console {
    operator: Operator,
    received: Arc<Mutex<Vec<Event>>>,
}

impl Console {
    fn at(endpoint: &str) -> Self {
        let operator = Operator::ready(endpoint, NAME, "observer");
        let received: Arc<Mutex<Vec<Event>>> = Arc::default();
        let takes = Arc::clone(&received);
        operator
            .session()
            .declare_subscriber(Topic::Event.key(operator.robot()))
            .callback(move |sample| {
                let (_, event) = wire::decode(&sample.payload().to_bytes()).unwrap();
                takes.lock().unwrap().push(event);
            })
            .background()
            .wait()
            .unwrap();
        Self { operator, received }
    }

    fn events(&self, kind: &str) -> Vec<Event> {
        let received = self.received.lock().unwrap();
        let of_kind = received.iter().filter(|event| event.kind == kind);
        of_kind.cloned().collect()
    }

    fn wait_for_event(&self, kind: &str) {
        wait_until(kind, || {
            send_view(self.operator.session(), "observer", false);
            sleep(Duration::from_millis(100));
            !self.events(kind).is_empty()
        });
    }
}

#[test]
#[ignore = "needs root"]
fn driving_continues_when_the_disk_is_nearly_full() {
    let disk = Disk::mounted().unwrap();
    disk.resize("3g");
    let [recording, log] = ["r.mcap", "d.csv"].map(|name| disk.path(name));
    let endpoint = free_endpoint();
    let start_edge = || {
        let (recording, log) = (recording.display(), log.display());
        simulate(&format!(
            "--listen {endpoint} --record {recording} --drive-log {log}"
        ))
    };
    let edge = start_edge();
    let mut anna = Operator::ready(&endpoint, NAME, "anna");
    let console = Console::at(&endpoint);
    while_driving(&mut anna, || {
        sleep(Duration::from_secs(2));
        disk.resize("32m");
        console.wait_for_event("recording_stopped");
        console.wait_for_event("drive_log_stopped");
        let sizes = [&recording, &log].map(|path| fs::metadata(path).unwrap().len());
        sleep(Duration::from_secs(3));
        console
            .operator
            .wait_for_status("driving", |teleop| teleop.state == TeleopState::Driving);
        let later = [&recording, &log].map(|path| fs::metadata(path).unwrap().len());
        assert_eq!(sizes, later, "it has ended");
    });
    for (kind, severity, says) in [
        (
            "recording_stopped",
            Severity::Alarm,
            "r.mcap: recording ends: the disk is nearly full: 0.0 of 0.0 GB are free",
        ),
        (
            "drive_log_stopped",
            Severity::Warning,
            "driving goes on: the disk is nearly full: 0.0 of 0.0 GB are free",
        ),
    ] {
        let received = console.events(kind);
        assert_eq!(received.len(), 1, "{received:?}");
        assert!(received[0].message.ends_with(says), "{received:?}");
        assert_eq!(received[0].severity, severity);
    }
    edge.signal("INT");
    // The recording is incomplete.
    let printed = edge.ends_with(1);
    assert!(
        printed.contains("recording ends: the disk is nearly full"),
        "{printed}"
    );
    let measurements = measurements_in(&recording);
    assert!(measurements > 100, "{measurements}");
    let rounds = DriveLog::parse(&fs::read_to_string(&log).unwrap())
        .unwrap()
        .rounds;
    assert!(rounds.len() > 100, "{}", rounds.len());
    drop((anna, console));

    // A run that starts with a full disk tells the first console.
    let _edge = start_edge();
    let mut anna = Operator::ready(&endpoint, NAME, "anna");
    let console = Console::at(&endpoint);
    console.wait_for_event("recording_stopped");
    console.wait_for_event("drive_log_stopped");
    while_driving(&mut anna, || sleep(Duration::from_secs(1)));
    assert!(!disk.path("r-2.mcap").exists(), "it would be empty");

    // Without driving, a recording that ends is an error.
    let printed = start(&format!(
        "robot-edge simulate rooms --rate 1 --duration 3 --no-network --quiet --record {}",
        recording.display()
    ))
    .ends_with(1);
    assert!(
        printed.contains("r-2.mcap: recording ends: the disk is nearly full"),
        "{printed}"
    );
}
