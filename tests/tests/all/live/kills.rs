//! Kills of the edge at random times while it drives and records, under the shipped unit and a real systemd, which
//! restarts it.

use std::fs;
use std::path::Path;
use std::thread::scope;
use std::time::Duration;

use tempfile::tempdir;

use super::restarts::{ZERO_WITHIN, kill_while_driving, table, zero_after};
use super::service::Service;
use crate::link::processes::{Running, program};
use crate::rng::SeededRng;

/// Scans of 0.1 s that a recording may lose: the last second, and scans under way.
const SCANS_LOST: u64 = 12;

/// Concurrent vehicles, each with a systemd of its own.
const VEHICLES: usize = 3;

/// Numbers of the scans that `robot-edge recover` finds.
fn scans_in(recording: &Path) -> Vec<u64> {
    let folder = tempdir().unwrap();
    let whole = folder.path().join("whole.mcap");
    let mut command = program("robot-edge");
    command.arg("recover").arg(recording).arg(&whole);
    Running::start(&mut command, "recover").ends_well();
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
