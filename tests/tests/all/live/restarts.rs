//! The edge is killed while it drives and started again at once, when its motor guard still tells the motors zero.

use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::operator::Operator;
use measurement::time::Monotonic;
use robot_edge::clock::{self, sleep_until};
use rustix::process::{Pid, Signal, kill_process};

use super::emulator::Output;
use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig, TIMEOUT};
use super::service_manager::{children, is_motor_guard};
use crate::rng::SeededRng;

/// Both motors stand so soon after the edge was killed.
pub(super) const ZERO_WITHIN: Duration = Duration::from_millis(200);

/// Between a press that the motors have obeyed and the kill.
const LONGEST_DRIVE_MS: u64 = 700;

/// Sends a signal to a process that there is.
pub(super) fn signal(pid: u32, signal: Signal) {
    assert!(try_signal(pid, signal), "there is no process {pid}");
}

/// Sends a signal; whether there is such a process.
pub(super) fn try_signal(pid: u32, signal: Signal) -> bool {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    kill_process(pid, signal).is_ok()
}

/// Drives on, and kills `edge` at a moment that nothing else decides; that moment.
pub(super) fn kill_while_driving(edge: u32, anna: &mut Operator, rng: &mut SeededRng) -> Monotonic {
    let due = clock::now() + rng.millis(0, LONGEST_DRIVE_MS);
    scope(|scope| {
        let killer = scope.spawn(|| {
            sleep_until(due, || false);
            let now = clock::now();
            signal(edge, Signal::KILL);
            now
        });
        anna.hold_until(AHEAD, || killer.is_finished());
        killer.join().unwrap()
    })
}

/// How long after `killed` the last of both motors has come to stand, by the line's own time.
pub(super) fn zero_after(controller: &EmulatorOnTerminal, killed: Monotonic) -> Duration {
    let started = clock::now();
    loop {
        let outputs = controller.outputs();
        let turning = outputs.iter().rposition(|output| !output.is_zero());
        let stands = outputs.get(turning.map_or(0, |turning| turning + 1));
        // Long enough to see that they go on standing.
        if let Some(Output { at, .. }) =
            stands.filter(|stands| clock::elapsed(stands.at) > ZERO_WITHIN)
        {
            return at.since(killed);
        }
        assert!(
            clock::elapsed(started) < TIMEOUT,
            "the motors never stand: {:?}",
            outputs.last()
        );
        sleep(Duration::from_millis(2));
    }
}

/// Least, median and greatest of some times.
pub(super) fn table(what: &str, times: &mut [Duration]) {
    times.sort();
    println!(
        "{what}: {} times, least {:?}, median {:?}, greatest {:?}",
        times.len(),
        times[0],
        times[times.len() / 2],
        times[times.len() - 1]
    );
}

fn restarts_in_a_row(count: usize) {
    let (live_rig, controller) = LiveRig::on_a_real_line();
    let mut rng = SeededRng::new(count as u64);
    let mut edge = live_rig.start_edge(|_| ());
    let mut times = Vec::new();
    for _ in 0..count {
        // It gets to drive, and has no fault before.
        let mut anna = live_rig.start_driving(&controller);
        let killed = kill_while_driving(edge.id(), &mut anna, &mut rng);
        let next = live_rig.start_edge(|_| ());
        times.push(zero_after(&controller, killed));
        edge = next;
    }
    live_rig.start_driving(&controller);
    table("both motors at zero after a kill", &mut times);
    assert!(times.iter().all(|time| *time < ZERO_WITHIN), "{times:?}");
}

#[test]
fn an_edge_that_is_started_as_its_predecessor_is_killed_drives_five_times_in_a_row() {
    restarts_in_a_row(5);
}

#[test]
#[ignore = "100 restarts take some 5 minutes"]
fn an_edge_that_is_started_as_its_predecessor_is_killed_drives_a_hundred_times_in_a_row() {
    restarts_in_a_row(100);
}

/// The process that guards the motors of `edge`.
fn guard_of(edge: u32) -> u32 {
    let guard = children(edge).into_iter().find(|pid| is_motor_guard(*pid));
    guard.expect("a process that guards the motors")
}

#[test]
fn a_stopped_guard_whose_edge_is_killed_goes_on_and_stops_both_motors() {
    let (live_rig, controller) = LiveRig::on_a_real_line();
    let edge = live_rig.start_edge(|_| ());
    let _anna = live_rig.start_driving(&controller);
    let guard = guard_of(edge.id());
    signal(guard, Signal::STOP);
    let killed = clock::now();
    signal(edge.id(), Signal::KILL);
    // The kernel sends SIGHUP and SIGCONT to a stopped process group that has lost its last parent.
    let zero = zero_after(&controller, killed);
    println!("both motors at zero after {zero:?}");
    assert!(zero < ZERO_WITHIN, "{zero:?}");
}

#[test]
fn a_guard_that_hangs_and_was_left_behind_is_ended_by_the_next() {
    let (live_rig, controller) = LiveRig::on_a_real_line();
    // It ends soon after its edge: it may be gone before it is stopped.
    for _ in 0..5 {
        let edge = live_rig.start_edge(|_| ());
        let _anna = live_rig.start_driving(&controller);
        let guard = guard_of(edge.id());
        drop(edge);
        if try_signal(guard, Signal::STOP) {
            let _next = live_rig.start_edge(|_| ());
            live_rig.start_driving(&controller);
            assert!(!is_motor_guard(guard), "it is still there");
            return;
        }
    }
    panic!("every guard was gone before it could be stopped");
}
