//! A nearly full disk, while driving and while standing.

use std::fs;
use std::sync::{Arc, Mutex};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use foreshore_tests::operator::Operator;
use protocol::keys::{RobotId, Topic, view_of};
use protocol::message::{Event, Severity, TeleopState, View};
use protocol::tile::BootId;
use protocol::wire::{self, Header};
use recording::{Selection, open};
use robot_edge::clock;
use zenoh::Wait as _;

use super::drive::while_driving;
use super::machine::Disk;
use super::robot::NAME;
use crate::link::processes::{Running, free_port, program, simulate};

const TIMEOUT: Duration = Duration::from_secs(30);

/// A console that receives events as long as it sends its view.
struct Console {
    operator: Operator,
    robot: RobotId,
    received: Arc<Mutex<Vec<Event>>>,
}

impl Console {
    fn at(endpoint: &str) -> Self {
        let operator = Operator::ready(endpoint, NAME, "observer");
        let robot: RobotId = NAME.parse().unwrap();
        let received: Arc<Mutex<Vec<Event>>> = Arc::default();
        let takes = Arc::clone(&received);
        operator
            .session()
            .declare_subscriber(Topic::Event.key(&robot))
            .callback(move |sample| {
                let (_, event) = wire::decode(&sample.payload().to_bytes()).unwrap();
                takes.lock().unwrap().push(event);
            })
            .background()
            .wait()
            .unwrap();
        Self {
            operator,
            robot,
            received,
        }
    }

    fn subscribe(&self) {
        let header = Header {
            boot: BootId([9; 16]),
            seq: 0,
            robot_time_ns: 0,
        };
        let view = View {
            rectangle_m: [-1.0, -1.0, 1.0, 1.0],
            layers: 1,
            revision: u64::MAX,
            is_synchronized: true,
            wants_scan: false,
        };
        let key = view_of(&self.robot, &"observer".parse().unwrap());
        let view = wire::encode(&header, &view).unwrap();
        self.operator.session().put(key, view).wait().unwrap();
    }

    fn events(&self, kind: &str) -> Vec<Event> {
        let received = self.received.lock().unwrap();
        let of_kind = received.iter().filter(|event| event.kind == kind);
        of_kind.cloned().collect()
    }

    fn wait_for_event(&self, kind: &str) {
        let started = clock::now();
        while self.events(kind).is_empty() {
            assert!(clock::elapsed(started) < TIMEOUT, "no event: {kind}");
            self.subscribe();
            sleep(Duration::from_millis(100));
        }
    }
}

#[test]
#[ignore = "needs root"]
fn driving_continues_when_the_disk_is_nearly_full() {
    let disk = Disk::mounted().unwrap();
    disk.resize("3g");
    let [recording, log] = ["r.mcap", "d.csv"].map(|name| disk.path(name));
    let port = free_port();
    let start = || {
        let listen = format!("tcp/127.0.0.1:{port}");
        let mut command = simulate(&["--robot", NAME, "--listen", &listen]);
        command.arg("--record").arg(&recording);
        command.arg("--drive-log").arg(&log);
        Running::start(&mut command, "edge")
    };
    let edge = start();
    let endpoint = format!("tcp/127.0.0.1:{port}");
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
    let (code, printed) = edge.end();
    assert_eq!(code, Some(1), "the recording is incomplete: {printed}");
    assert!(
        printed.contains("recording ends: the disk is nearly full"),
        "{printed}"
    );
    let mut reader = open(&recording, Selection::All).unwrap();
    let mut measurements = 0;
    while reader.next_measurement().unwrap().is_some() {
        measurements += 1;
    }
    assert!(measurements > 100, "{measurements}");
    let rounds = DriveLog::parse(&fs::read_to_string(&log).unwrap())
        .unwrap()
        .rounds;
    assert!(rounds.len() > 100, "{}", rounds.len());
    drop((anna, console));

    // A run that starts with a full disk tells the first console.
    let _edge = start();
    let mut anna = Operator::ready(&endpoint, NAME, "anna");
    let console = Console::at(&endpoint);
    console.wait_for_event("recording_stopped");
    console.wait_for_event("drive_log_stopped");
    while_driving(&mut anna, || sleep(Duration::from_secs(1)));
    assert!(!disk.path("r-2.mcap").exists(), "it would be empty");

    // Without driving, a recording that ends is an error.
    let mut command = program("robot-edge");
    command.args([
        "simulate",
        "rooms",
        "--rate",
        "1",
        "--duration",
        "3",
        "--no-network",
        "--quiet",
    ]);
    let (code, printed) = Running::start(command.arg("--record").arg(&recording), "recorder").end();
    assert_eq!(code, Some(1), "{printed}");
    assert!(
        printed.contains("r-2.mcap: recording ends: the disk is nearly full"),
        "{printed}"
    );
}
