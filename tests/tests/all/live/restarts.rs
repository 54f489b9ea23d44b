//! The edge is killed while it drives and restarted at once, while its motor guard still sends zero.

use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::operator::Operator;
use measurement::time::Monotonic;
use robot_edge::clock::{self, sleep_until};
use rustix::process::{Pid, Signal, kill_process};

use super::emulator::Output;
use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig, TIMEOUT};
use super::service_manager::{guard_of, is_motor_guard};
use crate::rng::SeededRng;

/// From a kill of the edge until both motors stand.
pub(super) const ZERO_WITHIN: Duration = Duration::from_millis(200);

/// Longest time from the first motion to the kill.
const LONGEST_DRIVE_MS: u64 = 700;

/// Sends a signal to a process that must exist.
pub(super) fn signal(pid: u32, signal: Signal) {
    assert!(try_signal(pid, signal), "there is no process {pid}");
}

/// Sends a signal; returns whether the process exists.
pub(super) fn try_signal(pid: u32, signal: Signal) -> bool {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap()).unwrap();
    kill_process(pid, signal).is_ok()
}

/// Drives on and kills `edge` at a random time, which is returned.
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

/// Time from `killed` until both motors stand, by the time of the line.
pub(super) fn zero_after(controller: &EmulatorOnTerminal, killed: Monotonic) -> Duration {
    let started = clock::now();
    loop {
        let outputs = controller.outputs();
        let turning = outputs.iter().rposition(|output| !output.is_zero());
        let stands = outputs.get(turning.map_or(0, |turning| turning + 1));
        // Long enough to see that they stay at zero.
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

/// Prints least, median and greatest time.
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
        // It drives, without a fault before.
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
fn a_killed_edge_is_restarted_and_drives_5_times() {
    restarts_in_a_row(5);
}

#[test]
#[ignore = "100 restarts take some 5 minutes"]
fn a_killed_edge_is_restarted_and_drives_100_times() {
    restarts_in_a_row(100);
}

#[test]
fn a_stopped_guard_stops_both_motors_when_its_edge_is_killed() {
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
fn the_next_motor_guard_ends_one_that_hangs() {
    let (live_rig, controller) = LiveRig::on_a_real_line();
    // The guard ends soon after its edge: it may be gone before it is stopped.
    for _ in 0..5 {
        let edge = live_rig.start_edge(|_| ());
        let _anna = live_rig.start_driving(&controller);
        let guard = guard_of(edge.id());
        drop(edge);
        if try_signal(guard, Signal::STOP) {
            let _next = live_rig.start_edge(|_| ());
            live_rig.start_driving(&controller);
            assert!(!is_motor_guard(guard), "it still exists");
            return;
        }
    }
    panic!("every guard was gone before it could be stopped");
}
