//! A vehicle whose devices are read without a middleware: emulated devices on real sockets and terminals.

use std::f64::consts::TAU;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use emulators::Emulator;
use emulators::lms111::Lms111;
use emulators::mti::Mti;
use foreshore_tests::operator::{Input, Operator, connected};
use network::clock;
use protocol::keys::Topic;
use protocol::message::{DeviceState, DeviceStatus, Status, TeleopState};
use tempfile::{TempDir, tempdir};
use zenoh::Wait as _;

use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::roboteq;
use super::wait_for_status;
use crate::processes::{Running, command, free_port, start, tcp};

/// A laser and an attitude sensor, and the configuration of a vehicle that has them.
struct Devices {
    laser: Emulator<Lms111>,
    _imu: Emulator<Mti>,
    folder: TempDir,
}

impl Devices {
    fn new() -> Self {
        let laser = Emulator::on_tcp(Lms111::default());
        let imu = Emulator::on_serial(Mti::default());
        let folder = tempdir().unwrap();
        let text = format!(
            "preset = \"generic2d\"\n[localization]\nsource = \"static\"\n\
             [devices.laser]\nkind = \"sick_cola\"\ntcp = \"{}\"\n\
             [devices.imu]\nkind = \"xsens\"\nserial = \"{}\"\n",
            laser.address, imu.address
        );
        fs::write(folder.path().join("rover.toml"), text).unwrap();
        Self {
            laser,
            _imu: imu,
            folder,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn vehicle(&self) -> String {
        self.path("rover.toml").display().to_string()
    }
}

fn device<'a>(status: &'a Status, name: &str) -> &'a DeviceStatus {
    let found = status.devices.iter().find(|device| device.name == name);
    found.unwrap_or_else(|| panic!("no {name} in {:?}", status.devices))
}

#[test]
fn devices_are_mapped_recorded_and_come_back() {
    let devices = Devices::new();
    let port = free_port();
    let [recording, summary] = ["run.mcap", "run.json"].map(|name| devices.path(name));
    let edge = start(&format!(
        "robot-edge run --vehicle {} --robot rover --quiet --listen {} --record {} --summary {}",
        devices.vehicle(),
        tcp(port),
        recording.display(),
        summary.display()
    ));
    let session = connected(&tcp(port), None);
    let key = Topic::Status.key(&"rover".parse().unwrap());
    let statuses = session.declare_subscriber(key).wait().unwrap();
    let wait_for = |what, is_so: &dyn Fn(&Status) -> bool| wait_for_status(&statuses, what, is_so);
    let measures = |status: &Status| {
        let is_ready =
            |device: &DeviceStatus| device.state == DeviceState::Measuring && device.rate_hz > 0.0;
        status.scans_mapped > 20 && status.devices.iter().all(is_ready)
    };
    let status = wait_for("maps", &measures);
    let laser = device(&status, "laser");
    assert!(laser.identity.contains("1234567"), "{laser:?}");
    assert!((40.0..60.0).contains(&laser.rate_hz), "{laser:?}");
    assert!(
        laser.clock.is_some() && laser.trouble.is_empty(),
        "{laser:?}"
    );
    assert_eq!(laser.reconnects, 0);

    devices.laser.power(false);
    let status = wait_for("loses the laser", &|status| {
        device(status, "laser").state == DeviceState::Connecting
    });
    assert!(!device(&status, "laser").trouble.is_empty());
    assert_eq!(device(&status, "imu").state, DeviceState::Measuring);
    let before = status.scans_mapped;
    devices.laser.power(true);
    let status = wait_for("gets it back", &|status| {
        status.scans_mapped > before + 20 && device(status, "laser").state == DeviceState::Measuring
    });
    assert_eq!(device(&status, "laser").reconnects, 1);

    edge.signal("INT");
    edge.ends_with(130);
    let summary: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(summary).unwrap()).unwrap();
    let replayed = devices.path("replay.json");
    start(&format!(
        "robot-edge replay {} --vehicle {} --no-network --quiet --summary {}",
        recording.display(),
        devices.vehicle(),
        replayed.display()
    ))
    .ends_well();
    let replayed: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(replayed).unwrap()).unwrap();
    assert_eq!(replayed["scans"]["mapped"], summary["scans"]["mapped"]);
    assert_eq!(replayed["layers"], summary["layers"], "digests");
}

#[test]
fn a_check_says_what_each_device_is() {
    let devices = Devices::new();
    let check = |seconds: u32| {
        let vehicle = devices.vehicle();
        start(&format!(
            "robot-edge check {vehicle} --connect --seconds {seconds}"
        ))
        .end()
    };
    let (code, text) = check(3);
    assert_eq!(code, Some(0), "{text}");
    let (_, rate) = text
        .split_once("device laser: sick_cola, measures, ")
        .unwrap();
    let rate_hz: f64 = rate.split(' ').next().unwrap().parse().unwrap();
    assert!((40.0..60.0).contains(&rate_hz), "{text}");
    for said in [
        "serial number 1234567",
        "device imu: xsens, measures",
        "ahead is up",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    devices.laser.power(false);
    let (code, text) = check(2);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("device laser: sick_cola, no: "), "{text}");
    assert!(text.contains("no measurements from laser"), "{text}");
}

/// The wheels of an emulated AX3500 turn as an operator drives, and its counts, which the motor guard forwards, move
/// the vehicle on the map as far as the wheels have turned. The attitude sensor turns all the time.
#[test]
fn counts_of_the_motor_controller_move_the_vehicle_on_the_map() {
    /// Counts of a wheel of 0.125 m with 1000 counts a turn, at 1 m/s.
    const FULL_SPEED: f64 = 1000.0 / (TAU * 0.125);
    let controller = EmulatorOnTerminal::start(|emulator| {
        emulator.full_speed_counts = Some([FULL_SPEED; 2]);
    });
    let devices = Devices::new();
    let text = fs::read_to_string(devices.path("rover.toml")).unwrap();
    let text = text.replace("source = \"static\"", "source = \"wheels\"");
    let text = format!(
        "{text}[sensors.laser]\n[sensors.wheels]\nkind = \"wheel_encoders\"\n[sensors.imu]\nkind = \"imu\"\n\
         [teleop.collision_monitor]\nenabled = false\n{}",
        roboteq(&controller)
    );
    fs::write(devices.path("rover.toml"), text).unwrap();
    let port = free_port();
    let mut edge = command(&format!(
        "robot-edge run --vehicle {} --robot rover --quiet --listen {}",
        devices.vehicle(),
        tcp(port)
    ));
    edge.env("STATE_DIRECTORY", devices.path("state"));
    let _edge = Running::start(&mut edge, "edge");
    let mut anna = Operator::ready(&tcp(port), "rover", "anna");
    anna.wait_for_status("ready", |teleop| teleop.state == TeleopState::Idle);
    let input = Input::of(0.3, 0.0);
    anna.start_driving(input);
    let mut way_m = 0.0;
    let mut before = anna.pose().position_m;
    let mut hold = |input, seconds| {
        let started = clock::now();
        while clock::elapsed(started) < Duration::from_secs(seconds) {
            anna.hold(input, Duration::from_millis(250));
            let now = anna.pose().position_m;
            let (dx_m, dy_m) = (now[0] - before[0], now[1] - before[1]);
            way_m += (dx_m * dx_m + dy_m * dy_m).sqrt();
            before = now;
        }
    };
    hold(input, 6);
    hold(Input::of(0.0, 0.0), 2);
    let counts = controller.with(|emulator| emulator.counts(clock::now()).unwrap());
    let turns = f64::from(counts[0] + counts[1]) / 2000.0;
    let expected_m = turns * TAU * 0.125;
    assert!(expected_m > 0.3, "{expected_m} m");
    let is_near = (0.9 * expected_m..1.1 * expected_m).contains(&way_m);
    assert!(
        is_near,
        "{way_m} m on the map, {expected_m} m by the counts"
    );
}
