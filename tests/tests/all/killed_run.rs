//! What a run that is killed leaves behind, and what the next one makes of it.

use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use recording::{Selection, open};
use robot_edge::clock;
use tempfile::tempdir;

use crate::link::processes::{Running, free_port, program};

const TIMEOUT: Duration = Duration::from_mins(1);
/// How long a run lasts, after it has begun to write.
const RUN: Duration = Duration::from_secs(4);
/// What a kill may lose.
const LOSS: Duration = Duration::from_secs(1);

/// As a unit of systemd does after a crash: the same command, again and again.
fn start(folder: &Path, port: u16) -> Running {
    let mut command = program("robot-edge");
    command
        .args(["simulate", "rooms", "--rate", "1", "--keep-serving"])
        .args(["--listen", &format!("tcp/127.0.0.1:{port}"), "--record"])
        .arg(folder.join("f.mcap"))
        .arg("--drive-log")
        .arg(folder.join("d.csv"));
    Running::start(&mut command, "edge")
}

/// Time from the first to the last stamp of all that can be read of a recording.
fn recorded(path: &Path) -> Duration {
    let mut reader = open(path, Selection::All).unwrap();
    let mut stamps = Vec::new();
    while let Some(measurement) = reader.next_measurement().unwrap() {
        // Transforms that always hold have a stamp of their own.
        if !measurement.is_static_transform() {
            stamps.push(measurement.stamp.as_nanos());
        }
    }
    let [first, last] = [stamps.iter().min(), stamps.iter().max()].map(|stamp| *stamp.unwrap());
    Duration::from_nanos(u64::try_from(last - first).unwrap())
}

#[test]
fn what_killed_runs_have_written_is_whole_after_three_restarts() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let port = free_port();
    let mut kept = Vec::new();
    let names = [
        ["f.mcap", "d.csv"],
        ["f-2.mcap", "d-2.csv"],
        ["f-3.mcap", "d-3.csv"],
    ];
    for [recording, log] in names {
        let edge = start(folder.path(), port);
        let started = clock::now();
        while fs::metadata(at(recording)).map_or(0, |file| file.len()) == 0 {
            assert!(clock::elapsed(started) < TIMEOUT, "{recording} never came");
            sleep(Duration::from_millis(5));
        }
        // What is there now is of the first second.
        let written = clock::now();
        sleep(RUN);
        edge.signal("KILL");
        let killed = clock::now();
        let (code, _) = edge.end();
        assert_eq!(code, None, "it was killed");

        let length = recorded(&at(recording));
        println!(
            "{recording}: {length:?}, killed {:?} after its first flush",
            killed.since(written)
        );
        // The file is there before the first measurement.
        let slack = Duration::from_millis(500);
        assert!(
            length + LOSS + slack > killed.since(written),
            "{recording}: {length:?}"
        );
        let rounds = DriveLog::parse(&fs::read_to_string(at(log)).unwrap())
            .unwrap()
            .rounds;
        assert!(rounds.len() > 100, "{log}: {}", rounds.len());
        assert!(rounds.last().unwrap().at + LOSS > killed, "{log}");
        for name in [recording, log] {
            kept.push((name, fs::read(at(name)).unwrap()));
        }
    }
    let edge = start(folder.path(), port);
    let started = clock::now();
    while fs::metadata(at("f-4.mcap")).map_or(0, |file| file.len()) == 0 {
        assert!(clock::elapsed(started) < TIMEOUT, "f-4.mcap never came");
        sleep(Duration::from_millis(5));
    }
    // Until there is a map.
    sleep(LOSS);
    edge.signal("INT");
    let said = edge.ends_well();
    for [option, asked, name] in [
        ["--record", "f.mcap", "f-4.mcap"],
        ["--drive-log", "d.csv", "d-4.csv"],
    ] {
        let [asked, name] = [asked, name].map(|name| at(name).display().to_string());
        let says = format!(
            "setup: {option}: {asked} exists and is not written over: this run writes {name}\n"
        );
        assert!(said.contains(&says), "{said}");
    }
    for (name, bytes) in kept {
        assert!(
            fs::read(at(name)).unwrap() == bytes,
            "{name} was written over"
        );
    }
}
