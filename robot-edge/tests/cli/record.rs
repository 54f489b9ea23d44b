//! `--record`: what comes out maps like what went in.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::exported_map::OccupancyTiff;
use crate::process::{digest, events, robot_edge, rooms, run, summary_of};

/// A CARMEN log of a robot that drives 2 m along a corridor 3 m wide and 50 m long: walls to both sides,
/// nothing ahead. `stamp` gives the stamp of each of its 41 scans.
fn corridor_log(path: &Path, stamp: impl Fn(usize) -> f64) {
    let mut log = String::new();
    for step in 0..=40 {
        write!(log, "FLASER 180").unwrap();
        for beam in 0..180 {
            let angle = (f64::from(beam) - 90.0).to_radians();
            let across = libm::sin(angle).abs();
            let range = if across > 0.15 { 1.5 / across } else { 50.0 };
            write!(log, " {range:.2}").unwrap();
        }
        let (x, stamp) = (0.05 * step as f64, stamp(step));
        writeln!(log, " {x:.3} 0 0 {x:.3} 0 0 {stamp:.6} host {stamp:.6}").unwrap();
    }
    fs::write(path, log).unwrap();
}

/// Records the log, and returns the events of that and the maps of the log and of its recording.
fn recorded(stamp: impl Fn(usize) -> f64) -> (Vec<String>, OccupancyTiff, OccupancyTiff) {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    corridor_log(&place("corridor.log"), stamp);
    let replay = |from: &str, maps: &str| {
        let mut command = robot_edge("replay");
        command.arg(place(from)).arg("--export").arg(place(maps));
        command
    };
    let summary = summary_of(
        replay("corridor.log", "of_log")
            .arg("--record")
            .arg(place("recorded.mcap")),
    );
    assert_eq!(summary["scans"]["mapped"], 41);
    assert!(summary["beams"]["misses"].as_u64().unwrap() > 41 * 10);
    let again = summary_of(&mut replay("recorded.mcap", "of_mcap"));
    assert_eq!(again["scans"], summary["scans"]);
    assert_eq!(again["beams"], summary["beams"]);
    let info = run(robot_edge("info").arg(place("recorded.mcap")))
        .succeeds()
        .stdout;
    assert!(
        info.contains("ranges 0 to 50 m"),
        "the recording does not say what a miss is:\n{info}"
    );
    assert!(info.contains("\nfaults\n  none\n"), "{info}");
    let maps = (
        OccupancyTiff::read(&place("of_log")),
        OccupancyTiff::read(&place("of_mcap")),
    );
    (events(&summary), maps.0, maps.1)
}

#[track_caller]
fn check_same_map(stamp: impl Fn(usize) -> f64) -> Vec<String> {
    let (events, of_log, of_mcap) = recorded(stamp);
    let comparison = of_log.compare(&of_mcap);
    assert!(comparison.cells > 2000, "{comparison:?}");
    assert!(comparison.share() >= 0.999, "{comparison:?}");
    events
}

#[test]
fn a_log_with_good_stamps_is_recorded_as_it_is() {
    let events = check_same_map(|step| 1000.0 + 0.1 * step as f64);
    assert!(
        events.iter().all(|event| !event.contains("stamp")),
        "{events:?}"
    );
}

#[test]
fn scans_of_one_stamp_keep_their_own_poses() {
    check_same_map(|_| 1_018_930_000.0);
    check_same_map(|step| 1000.0 + 0.5 * (step / 5) as f64);
}

#[test]
fn stamps_before_1970_are_moved_and_that_is_said() {
    let events = check_same_map(|step| -1.55 + 0.1 * step as f64);
    assert!(
        events.contains(
            &"record: all stamps are 2 s later in the recording: MCAP has no times before 1970"
                .to_owned()
        ),
        "{events:?}"
    );
}

#[test]
fn a_recording_of_a_recording_maps_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let first = summary_of(
        robot_edge("replay")
            .arg(rooms())
            .arg("--record")
            .arg(place("1.mcap")),
    );
    let second = summary_of(
        robot_edge("replay")
            .arg(place("1.mcap"))
            .arg("--record")
            .arg(place("2.mcap")),
    );
    assert_eq!(digest(&first), digest(&second));
    assert_eq!(first["vehicle"], second["vehicle"]);
    assert!(fs::read(place("1.mcap")).unwrap() == fs::read(place("2.mcap")).unwrap());
}

#[test]
fn a_recording_of_a_part_holds_that_part_of_everything() {
    let folder = tempfile::tempdir().unwrap();
    let part = folder.path().join("part.mcap");
    let mut replay = robot_edge("replay --start 10 --duration 5 --record");
    summary_of(replay.arg(&part).arg(rooms()));
    let page = run(robot_edge("info").arg(&part)).succeeds().stdout;
    let messages = |topic: &str| -> u64 {
        let line = page
            .lines()
            .find(|line| line.trim_start().starts_with(topic))
            .unwrap();
        line.split_whitespace().nth(2).unwrap().parse().unwrap()
    };
    assert_eq!(messages("/scan"), 51);
    // 50 a second, not mapped; transforms from before the part place its first scans.
    assert!((250..=252).contains(&messages("/odom")), "{page}");
    assert_eq!(messages("/tf "), 751);
}
