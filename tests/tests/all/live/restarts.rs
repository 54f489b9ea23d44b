//! The edge is killed while it drives and restarted at once, while its motor guard still sends zero: by these tests, and under
//! the shipped unit and a real systemd, at random times while it records.

use std::fs;
use std::path::Path;
use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::operator::Operator;
use measurement::time::Monotonic;
use network::clock::{self, sleep_until};
use rustix::process::Signal;
use tempfile::tempdir;

use super::emulator::Output;
use super::emulator::on_terminal::EmulatorOnTerminal;
use super::live_rig::{AHEAD, LiveRig, TIMEOUT, guard_of, is_motor_guard, signal, try_signal};
use super::service::Service;
use crate::processes::start;
use crate::rng::SeededRng;

/// From a kill of the edge until both motors stand.
pub(super) const ZERO_WITHIN: Duration = Duration::from_millis(200);

/// Longest time from the first motion to the kill.
const LONGEST_DRIVE_MS: u64 = 700;

/// Drives on and kills `edge` at a random time, which is returned.
fn kill_while_driving(edge: u32, anna: &mut Operator, rng: &mut SeededRng) -> Monotonic {
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
fn table(what: &str, times: &mut [Duration]) {
    times.sort();
    println!(
        "{what}: {} times, least {:?}, median {:?}, greatest {:?}",
        times.len(),
        times[0],
        times[times.len() / 2],
        times[times.len() - 1]
    );
}

/// Returns how often counts of encoders were asked for.
fn restarts_in_a_row(count: usize, (live_rig, controller): (LiveRig, EmulatorOnTerminal)) -> usize {
    let mut rng = SeededRng::new(count as u64);
    let mut edge = live_rig.start_edge(|_| ());
    let mut times = Vec::new();
    for _ in 0..count {
        // It drives, without a fault before.
        let mut anna = live_rig.start_driving(&controller);
        let killed = kill_while_driving(edge.id(), &mut anna, &mut rng);
        // A dying process still has its port.
        drop(edge);
        edge = live_rig.start_edge(|_| ());
        times.push(zero_after(&controller, killed));
    }
    live_rig.start_driving(&controller);
    table("both motors at zero after a kill", &mut times);
    assert!(times.iter().all(|time| *time < ZERO_WITHIN), "{times:?}");
    controller.with(|emulator| emulator.counts_asked)
}

#[test]
fn a_killed_edge_is_restarted_and_drives_5_times() {
    assert_eq!(restarts_in_a_row(5, LiveRig::on_a_real_line()), 0);
}

#[test]
fn a_killed_edge_that_asks_encoders_is_restarted_and_drives_5_times() {
    let asked = restarts_in_a_row(5, LiveRig::with_devices());
    assert!(asked > 0);
}

#[test]
#[ignore = "100 restarts take some 5 minutes"]
fn a_killed_edge_is_restarted_and_drives_100_times() {
    assert_eq!(restarts_in_a_row(100, LiveRig::on_a_real_line()), 0);
}

#[test]
#[ignore = "100 restarts take some 5 minutes"]
fn a_killed_edge_that_asks_encoders_is_restarted_and_drives_100_times() {
    let asked = restarts_in_a_row(100, LiveRig::with_devices());
    assert!(asked > 0);
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

/// Scans of 0.1 s that a recording may lose: the last second, and scans under way.
const SCANS_LOST: u64 = 12;

/// Concurrent vehicles, each with a systemd of its own.
const VEHICLES: usize = 3;

/// Numbers of the scans that `robot-edge recover` finds.
fn scans_in(recording: &Path) -> Vec<u64> {
    let folder = tempdir().unwrap();
    let whole = folder.path().join("whole.mcap");
    let [recording, to] = [recording, &whole].map(Path::display);
    start(&format!("robot-edge recover {recording} {to}")).ends_well();
    let bytes = fs::read(whole).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap();
    let numbers = messages.map(|message| {
        let message = message.unwrap();
        (message.channel.topic == "/scan")
            .then(|| (message.log_time - 1_790_000_000_000_000_000) / 100_000_000)
    });
    numbers.flatten().collect()
}

fn kill_one_vehicle(count: usize, seed: u64) -> Vec<Duration> {
    let recording = |number: usize| format!("/var/lib/foreshore/{number}.mcap");
    let service = Service::new(&format!("--record {}", recording(0)));
    let mut rng = SeededRng::new(seed);
    let mut times = Vec::new();
    for number in 0..count {
        let mut anna = service.live_rig.start_driving(&service.controller);
        let edge = service.manager.edge().unwrap();
        // Each run has its own file, which is checked after the kill.
        service.call_with(&format!("--record {}", recording(number + 1)));
        let killed = kill_while_driving(edge, &mut anna, &mut rng);
        let published = u64::from(service.live_rig.scans());
        drop(anna);
        times.push(zero_after(&service.controller, killed));

        let path = service.manager.path(&recording(number));
        let scans = scans_in(&path);
        assert!(scans.is_sorted_by(|a, b| a + 1 == *b), "{scans:?}");
        let last = scans.last().copied().unwrap_or(0);
        assert!(
            last + SCANS_LOST >= published,
            "{last} of {published} scans, kill {number}"
        );
        fs::remove_file(path).unwrap();
    }
    times
}

fn kills(count: usize, seed: u64) {
    let mut times: Vec<Duration> = scope(|scope| {
        let vehicles: Vec<_> = (0..VEHICLES)
            .map(|vehicle| {
                let share = count / VEHICLES + usize::from(vehicle < count % VEHICLES);
                scope.spawn(move || kill_one_vehicle(share, seed + vehicle as u64))
            })
            .collect();
        let times = vehicles
            .into_iter()
            .flat_map(|vehicle| vehicle.join().unwrap());
        times.collect()
    });
    assert_eq!(times.len(), count);
    table("both motors at zero after a kill", &mut times);
    assert!(times.iter().all(|time| *time < ZERO_WITHIN), "{times:?}");
}

#[test]
#[ignore = "ten kills take a minute, and need root and systemd"]
fn ten_kills_stop_both_motors_and_keep_recordings() {
    kills(10, 1);
}

#[test]
#[ignore = "250 of 1,000 kills take some ten minutes, and need root and systemd"]
fn kills_1_to_250() {
    kills(250, 100);
}

#[test]
#[ignore = "250 of 1,000 kills take some ten minutes, and need root and systemd"]
fn kills_251_to_500() {
    kills(250, 200);
}

#[test]
#[ignore = "250 of 1,000 kills take some ten minutes, and need root and systemd"]
fn kills_501_to_750() {
    kills(250, 300);
}

#[test]
#[ignore = "250 of 1,000 kills take some ten minutes, and need root and systemd"]
fn kills_751_to_1000() {
    kills(250, 400);
}
