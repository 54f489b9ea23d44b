//! A live vehicle that an autopilot drives: one emulated by pymavlink, which is not ours.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use emulators::Emulator;
use emulators::lms111::Lms111;
use foreshore_tests::operator::{Input, NEUTRAL, Operator, PERIOD};
use network::clock;
use protocol::keys::Topic;
use protocol::message::{Arming, DeviceState, Event, MotorHold, Status, StopReason, TeleopState};
use protocol::wire;
use tempfile::{TempDir, tempdir};
use zenoh::Wait as _;

use super::live_rig::{AHEAD, TIMEOUT};
use super::wait_for_status;
use crate::processes::{Running, free_port, start, tcp};
use crate::python::{client_folder, python};

/// From the death of the edge until the autopilot has zero.
const LIMIT_MS: u64 = 200;

/// The emulated autopilot: what it prints, with the milliseconds of `CLOCK_BOOTTIME` at which it did.
struct Autopilot {
    child: Child,
    stdin: ChildStdin,
    lines: Arc<Mutex<Vec<(u64, String)>>>,
}

impl Autopilot {
    /// At an address as pymavlink writes it; `None`, and a skipped test, without pymavlink.
    fn start(address: &str) -> Option<Self> {
        let python = python("mavlink_requirements.txt", "pymavlink.mavutil")?;
        let mut child = Command::new(python)
            .arg("-B")
            .arg(client_folder().join("mavlink_autopilot.py"))
            .arg(address)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (stdin, stdout) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let lines = Arc::new(Mutex::new(Vec::new()));
        std::thread::spawn({
            let lines = Arc::clone(&lines);
            move || {
                for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                    let (at, words) = line.split_once(' ').unwrap();
                    let line = (at.parse().unwrap(), words.to_owned());
                    lines.lock().unwrap().push(line);
                }
            }
        });
        Some(Self {
            child,
            stdin,
            lines,
        })
    }

    fn printed(&self) -> Vec<(u64, String)> {
        self.lines.lock().unwrap().clone()
    }

    /// When it first printed `words` after the first `known` lines.
    fn wait_for(&self, words: &str, known: usize) -> u64 {
        let started = clock::now();
        loop {
            let printed = self.printed();
            let found = printed.iter().skip(known).find(|(_, line)| line == words);
            if let Some((at, _)) = found {
                return *at;
            }
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "no {words:?}: {printed:#?}"
            );
            sleep(Duration::from_millis(2));
        }
    }

    fn does(&mut self, words: &str) {
        let known = self.printed().len();
        writeln!(self.stdin, "{words}").unwrap();
        self.wait_for(&format!("done {words}"), known);
    }

    /// Which velocities it obeyed, but zero, after the first `known` lines.
    fn obeyed(&self, known: usize) -> Vec<String> {
        let printed = self.printed().into_iter().skip(known).map(|(_, line)| line);
        let obeyed = printed.filter(|line| line.starts_with("drives") && line != STANDS);
        obeyed.collect()
    }
}

const DRIVES: &str = "drives 0.3 0.0";
const STANDS: &str = "drives 0.0 0.0";

impl Drop for Autopilot {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// An edge with a laser and the autopilot.
struct Vehicle {
    edge: Running,
    port: u16,
    _laser: Emulator<Lms111>,
    _folder: TempDir,
}

impl Vehicle {
    /// With this source of poses; `mavlink`: keys of its motors, and tables behind them.
    fn start(localization: &str, has_collision_monitor: bool, mavlink: &str) -> Self {
        let laser = Emulator::on_tcp(Lms111::default());
        let folder = tempdir().unwrap();
        let configuration = folder.path().join("rover.toml");
        let text = format!(
            "preset = \"generic2d\"\n[localization]\nsource = \"{localization}\"\n\
             [teleop.collision_monitor]\nenabled = {has_collision_monitor}\n\
             [devices.laser]\nkind = \"sick_cola\"\ntcp = \"{}\"\n\
             [motors.mavlink]\n{mavlink}\n",
            laser.address
        );
        fs::write(&configuration, text).unwrap();
        let port = free_port();
        let edge = start(&format!(
            "robot-edge run --robot rover --quiet --vehicle {} --state-dir {} --listen {}",
            configuration.display(),
            folder.path().join("state").display(),
            tcp(port)
        ));
        Self {
            edge,
            port,
            _laser: laser,
            _folder: folder,
        }
    }

    fn operator(&self) -> Operator {
        let anna = Operator::ready(&tcp(self.port), "rover", "anna");
        anna.wait_for_status("ready", |teleop| teleop.state == TeleopState::Idle);
        anna
    }
}

fn wait_for_hold(anna: &Operator, hold: Option<MotorHold>) {
    anna.wait_for_status(&format!("{hold:?}"), |teleop| teleop.motor_hold == hold);
}

/// Ahead, until the autopilot drives.
fn drive(anna: &mut Operator, autopilot: &Autopilot) {
    let known = autopilot.printed().len();
    anna.start_driving(AHEAD);
    let started = clock::now();
    anna.hold_until(AHEAD, || {
        autopilot.obeyed(known).iter().any(|line| line == DRIVES)
            || clock::elapsed(started) >= TIMEOUT
    });
    autopilot.wait_for(DRIVES, known);
}

/// With the keys held: the vehicle stops, says why, and does not go on by itself after `again`.
fn stops_while_held(
    anna: &mut Operator,
    autopilot: &mut Autopilot,
    [cause, again]: [&str; 2],
    hold: MotorHold,
) {
    drive(anna, autopilot);
    autopilot.does(cause);
    let started = clock::now();
    let held = |anna: &Operator| {
        anna.teleop().is_some_and(|teleop| {
            teleop.motor_hold == Some(hold) && teleop.state == TeleopState::Held
        })
    };
    while !held(anna) {
        assert!(
            clock::elapsed(started) < TIMEOUT,
            "{cause}: {:?}",
            anna.teleop()
        );
        anna.hold(AHEAD, PERIOD);
    }
    let teleop = anna.teleop().unwrap();
    assert_eq!(teleop.last_stop, Some(StopReason::MotorsHeld), "{cause}");
    assert!(
        teleop.applied.linear_mps.abs() < 1e-6,
        "{cause}: {teleop:?}"
    );
    let known = autopilot.printed().len();
    autopilot.does(again);
    while anna
        .teleop()
        .is_none_or(|teleop| teleop.motor_hold.is_some())
    {
        assert!(
            clock::elapsed(started) < TIMEOUT,
            "{again}: {:?}",
            anna.teleop()
        );
        anna.hold(AHEAD, PERIOD);
    }
    // The key is still pressed.
    anna.hold(AHEAD, Duration::from_millis(600));
    assert_eq!(autopilot.obeyed(known), [""; 0], "{cause}");
    assert_eq!(anna.teleop().unwrap().arming, Arming::Locked, "{cause}");
    anna.hold(Input::NEUTRAL, NEUTRAL);
}

#[test]
fn an_autopilot_drives_while_it_obeys_and_its_states_are_shown() {
    let port = free_port();
    let Some(mut autopilot) = Autopilot::start(&format!("udpout:127.0.0.1:{port}")) else {
        return;
    };
    let vehicle = Vehicle::start(
        "static",
        false,
        &format!("udp_listen = \"127.0.0.1:{port}\""),
    );
    let mut anna = vehicle.operator();
    let events = anna
        .session()
        .declare_subscriber(Topic::Event.key(anna.robot()));
    let events = events.wait().unwrap();

    // A ground station beside it may not arm it.
    wait_for_hold(&anna, Some(MotorHold::Mode(0)));
    autopilot.does("arm");
    autopilot.does("mode 15");
    wait_for_hold(&anna, Some(MotorHold::Disarmed));
    anna.take_lease();
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(AHEAD, Duration::from_millis(600));
    let refused = anna.wait_for_new_status();
    assert_eq!(
        (refused.state, refused.arming),
        (TeleopState::Held, Arming::Locked)
    );
    assert_eq!(autopilot.obeyed(0), [""; 0]);
    autopilot.does("can_arm");
    autopilot.does("arm");
    wait_for_hold(&anna, None);

    // The operator of another ground station changes the mode; a failsafe; a lost link.
    let mode = ["mode 4", "mode 15"];
    stops_while_held(&mut anna, &mut autopilot, mode, MotorHold::Mode(4));
    let failsafe = ["state CRITICAL", "state ACTIVE"];
    stops_while_held(&mut anna, &mut autopilot, failsafe, MotorHold::Failsafe);
    let silence = ["silent 1", "silent 0"];
    stops_while_held(&mut anna, &mut autopilot, silence, MotorHold::NoHeartbeat);

    // Others on the link, in other states, and bytes that are none of MAVLink change nothing.
    drive(&mut anna, &autopilot);
    let known = autopilot.printed().len();
    for _ in 0..20 {
        autopilot.does("others");
        autopilot.does("garbage");
        anna.hold(AHEAD, PERIOD * 5);
    }
    let teleop = anna.teleop().unwrap();
    assert_eq!(
        (teleop.state, teleop.motor_hold),
        (TeleopState::Driving, None)
    );
    assert!(
        autopilot.printed()[known..]
            .iter()
            .all(|(_, line)| line.starts_with("done"))
    );
    autopilot.does("silent 1");
    autopilot.does("others");
    let others = clock::now();
    while clock::elapsed(others) < Duration::from_secs(5) {
        autopilot.does("others");
        anna.hold(AHEAD, PERIOD * 10);
    }
    assert_eq!(
        anna.teleop().unwrap().motor_hold,
        Some(MotorHold::NoHeartbeat)
    );
    autopilot.does("silent 0");
    wait_for_hold(&anna, None);

    let texts = std::iter::from_fn(|| events.try_recv().ok().flatten()).map(|sample| {
        let (_, event): (_, Event) = wire::decode(&sample.payload().to_bytes()).unwrap();
        event.message
    });
    let texts: Vec<_> = texts.collect();
    for text in [
        "Arm: RC not found",
        "the autopilot is disarmed",
        "the autopilot is in mode HOLD, not GUIDED",
        "the autopilot has a failsafe in force",
        "the autopilot sends no heartbeat",
        "the autopilot obeys velocities",
    ] {
        assert!(
            texts.iter().any(|shown| shown == text),
            "{text}: {texts:#?}"
        );
    }
    assert!(!texts.iter().any(|text| text == "of another"), "{texts:#?}");

    drop(anna);
    let mut anna = vehicle.operator();
    drive(&mut anna, &autopilot);
    let known = autopilot.printed().len();
    let killed_ms = clock::now().nanos() / 1_000_000;
    vehicle.edge.signal("KILL");
    let stopped_ms = autopilot.wait_for(STANDS, known);
    let after_ms = stopped_ms.saturating_sub(killed_ms as u64);
    println!("zero {after_ms} ms after SIGKILL");
    assert!(after_ms <= LIMIT_MS, "{after_ms} ms");
    let printed = autopilot.printed();
    assert!(
        printed
            .iter()
            .any(|(_, line)| line == "heartbeat 1 191 18 8"),
        "{printed:#?}"
    );
    for unwanted in [
        "wrong",
        "arming requested",
        "mode requested",
        "bad data",
        "timeout",
    ] {
        // While it was silent it also said so: the edge went on with zero.
        let found = printed.iter().find(|(_, line)| line.starts_with(unwanted));
        assert_eq!(found, None);
    }
}

#[test]
fn an_autopilot_is_a_source_and_an_edge_that_hangs_stops_it() {
    let port = free_port();
    let Some(mut autopilot) = Autopilot::start(&format!("tcpin:127.0.0.1:{port}")) else {
        return;
    };
    let mavlink = format!(
        "tcp = \"127.0.0.1:{port}\"\nrequest_guided = true\n\
         [sensors.attitude]\nkind = \"imu\"\ntopic = \"/autopilot/attitude\"\n\
         [sensors.position]\nkind = \"gps\"\ntopic = \"/autopilot/position\"\n\
         [sensors.depth]\nkind = \"sonar\"\ntopic = \"/autopilot/depth\"\nmount = {{ pitch_deg = 90.0 }}"
    );
    let vehicle = Vehicle::start("gps", false, &mavlink);
    let mut anna = vehicle.operator();
    autopilot.does("can_arm");
    autopilot.does("arm");
    wait_for_hold(&anna, Some(MotorHold::Mode(0)));
    anna.take_lease();
    autopilot.wait_for("mode requested 15", 0);
    wait_for_hold(&anna, None);
    // Once: another mode stays until the lease is taken again.
    autopilot.does("mode 5");
    wait_for_hold(&anna, Some(MotorHold::Mode(5)));
    autopilot.does("mode 15");
    wait_for_hold(&anna, None);
    let requests = |autopilot: &Autopilot| {
        let printed = autopilot.printed();
        printed
            .iter()
            .filter(|(_, line)| line.starts_with("mode requested"))
            .count()
    };
    assert_eq!(requests(&autopilot), 1);

    let statuses = anna
        .session()
        .declare_subscriber(Topic::Status.key(anna.robot()));
    let statuses = statuses.wait().unwrap();
    let status = wait_for_status(&statuses, "measures", &|status: &Status| {
        let measures = |name: &str, rate_hz: f32| {
            let found = status.sensors.iter().find(|sensor| sensor.name == name);
            found.is_some_and(|sensor| sensor.rate_hz > rate_hz)
        };
        measures("attitude", 10.0) && measures("depth", 5.0) && measures("position", 2.0)
    });
    let device = status
        .devices
        .iter()
        .find(|device| device.name == "autopilot")
        .unwrap();
    assert_eq!(device.state, DeviceState::Measuring);
    assert_eq!(device.identity, "ArduPilot, rover, system 1");
    let volts = status.teleop.unwrap().battery_v.unwrap();
    assert!((volts - 12.6).abs() < 1e-3, "{volts}");

    drive(&mut anna, &autopilot);
    let known = autopilot.printed().len();
    vehicle.edge.signal("STOP");
    autopilot.wait_for(STANDS, known);
    let printed = autopilot.printed();
    assert!(
        !printed.iter().any(|(_, line)| line == "timeout"),
        "{printed:#?}"
    );
    vehicle.edge.signal("KILL");
}

/// The emulated laser's ranges grow by 1 cm a beam of half a degree, from 1 m behind to the right, over 270 degrees, and begin anew after
/// 500 beams.
#[test]
fn an_autopilot_is_told_of_obstacles_around_the_vehicle() {
    let port = free_port();
    let Some(autopilot) = Autopilot::start(&format!("udpout:127.0.0.1:{port}")) else {
        return;
    };
    let mavlink = format!("udp_listen = \"127.0.0.1:{port}\"\nobstacle_distance = true");
    let _vehicle = Vehicle::start("static", true, &mavlink);
    // Least and greatest distance; ahead, and each 45 degrees clockwise, centimetres.
    autopilot.wait_for("obstacles 1 5000 366 276 186 100 65535 136 546 456", 0);
}
