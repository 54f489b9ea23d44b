//! `--record`: what comes out maps like what went in. `recover`: what a cut-off recording still holds goes into a whole one.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::process::{OccupancyTiff, digest, events, robot_edge, rooms, run, summary_of};

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

#[test]
fn a_cut_recording_is_salvaged_and_maps_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (cut, saved) = (
        folder.path().join("cut.mcap"),
        folder.path().join("saved.mcap"),
    );
    let whole = fs::read(rooms()).unwrap();
    fs::write(&cut, &whole[..1_500_000]).unwrap();

    let of_cut = summary_of(robot_edge("replay").arg(&cut));
    assert_eq!(of_cut["scans"]["mapped"], 542);
    assert!(
        events(&of_cut).contains(&"loss: the recording lost 1 × cut_off".to_owned()),
        "{:?}",
        events(&of_cut)
    );

    let recovered = run(robot_edge("recover").arg(&cut).arg(&saved)).succeeds();
    assert_eq!(
        recovered
            .stdout
            .replace(&folder.path().display().to_string(), ""),
        "byte 1302902: the file ends in the middle of a record\n\
         /saved.mcap: 5963 messages saved, lost: 1 × cut_off\n"
    );
    assert!(
        fs::read(&cut).unwrap() == whole[..1_500_000],
        "the damaged file was changed"
    );

    let of_saved = summary_of(robot_edge("replay").arg(&saved));
    assert_eq!(digest(&of_saved), digest(&of_cut));
    assert_eq!(of_saved["vehicle"], "pioneer");
    assert!(
        events(&of_saved)
            .iter()
            .all(|event| event.starts_with("setup: "))
    );
}

#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let precious = folder.path().join("precious.mcap");
    fs::write(&precious, "precious").unwrap();
    run(robot_edge("recover").arg(rooms()).arg(&precious))
        .refuses(2, &["precious.mcap", "exists already", "another name"]);
    assert_eq!(fs::read(&precious).unwrap(), b"precious");

    let same = folder.path().join("same.mcap");
    fs::copy(rooms(), &same).unwrap();
    run(robot_edge("recover").arg(&same).arg(&same)).refuses(2, &["exists already"]);
    assert!(fs::read(&same).unwrap() == fs::read(rooms()).unwrap());
}

#[test]
fn what_cannot_be_salvaged_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let recover = |from: &str| {
        let ended = run(robot_edge("recover")
            .arg(place(from))
            .arg(place("out.mcap")));
        assert!(!place("out.mcap").exists(), "{ended:?}");
        ended
    };
    recover("missing.mcap").refuses(3, &["missing.mcap", "there is no such file"]);
    fs::write(place("text.mcap"), "no recording at all").unwrap();
    recover("text.mcap").refuses(3, &["not a recording this program reads"]);
    fs::write(place("empty.mcap"), "").unwrap();
    recover("empty.mcap").refuses(3, &["it is empty"]);
    fs::write(place("a.bag"), "#ROSBAG V2.0\n").unwrap();
    recover("a.bag").refuses(
        2,
        &[
            "ROS 1 bag",
            "recover writes MCAP from MCAP",
            "replay",
            "--record",
            "--set localization.source=static",
        ],
    );
    // What it proposes to write is MCAP by its name too.
    let as_mcap = format!("--record {} writes", place("saved.mcap").display());
    run(robot_edge("recover")
        .arg(place("a.bag"))
        .arg(place("saved.bag")))
    .refuses(2, &[as_mcap.as_str()]);
    run(robot_edge("recover")
        .arg(rooms())
        .arg(place("no/such/out.mcap")))
    .refuses(
        1,
        &["out.mcap", "cannot write what was saved", "No such file"],
    );
}
