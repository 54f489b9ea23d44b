//! Processes die, hang and restart while a key is held.

use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, Round};
use foreshore_tests::operator::{Journal, NEUTRAL, Operator};
use measurement::time::Monotonic;
use network::clock;
use protocol::message::{StopReason, TeleopState};
use tempfile::tempdir;

use super::robot::{CIRCLE, LIMITS, NAME, Robot, while_driving, while_holding};
use crate::processes::{Running, free_endpoint, start};

/// Duration of a hang: longer than the greatest command age, shorter than the lease.
const HANG: Duration = Duration::from_millis(1200);

/// An operator as a process, which holds [`CIRCLE`].
struct OperatorProcess {
    running: Running,
    journal: PathBuf,
}

impl OperatorProcess {
    fn start(endpoint: &str, name: &str, journal: &Path) -> Self {
        let (linear_mps, angular_radps) = (CIRCLE.linear_mps, CIRCLE.angular_radps);
        let mut running = start(&format!(
            "drive-by-wire operate {endpoint} {NAME} {name} {} 0,0,0.4 {linear_mps},{angular_radps},600",
            journal.display()
        ));
        running.wait_for_output("holds the lease");
        Self {
            running,
            journal: journal.to_owned(),
        }
    }

    fn journal(&self) -> Journal {
        Journal::parse(&std::fs::read_to_string(&self.journal).unwrap()).unwrap()
    }
}

/// When the vehicle must stand after the failure `at`: a generous deadline for a busy machine.
fn stands_by(at: Monotonic) -> Monotonic {
    at + LIMITS.max_age + NEUTRAL
}

/// The rounds between these times, whose outputs must all be zero.
fn stood(log: &DriveLog, from: Monotonic, to: Monotonic) -> &[Round] {
    let rounds = log.during(from, to);
    assert!(!rounds.is_empty());
    assert_eq!(rounds.iter().find(|round| !round.is_stopped()), None);
    rounds
}

fn drives(observer: &Operator) {
    observer.wait_for_status("driving", |teleop| {
        teleop.state == TeleopState::Driving && teleop.applied.angular_radps > 0.8
    });
}

#[test]
fn a_killed_operator_process_stops_and_frees_the_vehicle() {
    let (robot, folder) = (Robot::start(), tempdir().unwrap());
    let anna = OperatorProcess::start(&robot.endpoint, "anna", &folder.path().join("a.csv"));
    let mut bert = robot.operator("bert");
    drives(&bert);
    anna.running.signal("KILL");
    let killed = clock::now();
    let idle = bert.wait_for_status("idle", |teleop| teleop.state == TeleopState::Idle);
    assert_eq!(idle.last_stop, Some(StopReason::Age));
    assert_eq!(idle.lease.holder, None);
    stood(&robot.log(), stands_by(killed), clock::now());
    bert.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal(), &bert.journal]);
}

#[test]
fn a_hanging_operator_process_stops_the_vehicle() {
    let (robot, folder) = (Robot::start(), tempdir().unwrap());
    let anna = OperatorProcess::start(&robot.endpoint, "anna", &folder.path().join("a.csv"));
    let observer = robot.operator("observer");
    drives(&observer);
    anna.running.signal("STOP");
    let stopped = clock::now();
    sleep(HANG);
    anna.running.signal("CONT");
    let woken = clock::now();
    // It continues with the lease and with the key down.
    sleep(HANG);
    let log = robot.log();
    let rounds = stood(&log, stands_by(stopped), clock::now());
    let last = rounds.last().unwrap();
    assert_eq!(
        (last.mode.as_str(), last.requested),
        ("held", [0.15, 0.0, 1.0])
    );
    let journal = anna.journal();
    let taken = journal.find(last.seq.unwrap()).unwrap();
    assert!(taken.at > woken, "commands are accepted and move nothing");
    let verdict = robot.verdict(&[&journal]);
    assert_eq!(verdict.stops.len(), 1);
}

#[test]
fn an_edge_that_hung_stays_stopped_when_it_continues() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    anna.start_driving(CIRCLE);
    let (mut stopped, mut woken) = (clock::now(), clock::now());
    while_holding(&mut anna, || {
        sleep(HANG);
        robot.edge.signal("STOP");
        stopped = clock::now();
        sleep(HANG);
        woken = clock::now();
        robot.edge.signal("CONT");
        sleep(HANG);
    });
    let log = robot.log();
    assert!(log.during(stopped + NEUTRAL, woken).is_empty(), "it hangs");
    assert!(!log.since(stopped + NEUTRAL).is_empty(), "it continues");
    // The first round too: waiting commands are too old, and the ramp is over.
    let from = woken + Duration::from_nanos(1);
    stood(&log, from, clock::now());
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
}

#[test]
fn a_restarted_edge_grants_no_old_lease() {
    let mut robot = Robot::start();
    let mut anna = robot.operator("anna");
    anna.start_driving(CIRCLE);
    anna.hold(CIRCLE, NEUTRAL);
    robot.edge.signal("KILL");
    anna.hold(CIRCLE, NEUTRAL);
    robot.verdict(&[&anna.journal]);
    let last = robot.log().rounds.pop().unwrap();
    assert!(!last.is_stopped(), "it was killed while it drove: {last:?}");

    robot.restart();
    anna.hold(CIRCLE, Duration::from_secs(4));
    let log = robot.log();
    let rounds = stood(&log, last.at, clock::now());
    assert!(rounds.len() > 50 && rounds.iter().all(|round| round.seq.is_none()));
    let teleop = anna.wait_for_new_status();
    assert_eq!(teleop.lease.holder, None);
    assert!(
        !teleop.counters.refused.is_empty(),
        "it received her commands"
    );
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
}

fn router(endpoint: &str) -> Running {
    let mut router = start(&format!("drive-by-wire route {endpoint}"));
    router.wait_for_output("routes");
    router
}

#[test]
fn a_router_that_hangs_or_dies_stops_the_vehicle() {
    let endpoint = free_endpoint();
    let mut between = router(&endpoint);
    let options = format!("--connect {endpoint}");
    let robot = Robot::start_with("rooms", &endpoint, &options, |_| ());
    let mut anna = robot.operator("anna");
    for does_die in [false, true] {
        let mut broken = clock::now();
        while_driving(&mut anna, || {
            sleep(NEUTRAL);
            broken = clock::now();
            if does_die {
                between.signal("KILL");
                sleep(HANG);
                between = router(&endpoint);
            } else {
                between.signal("STOP");
                sleep(HANG);
                between.signal("CONT");
            }
            sleep(HANG);
        });
        stood(&robot.log(), stands_by(broken), clock::now());
    }
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
}
