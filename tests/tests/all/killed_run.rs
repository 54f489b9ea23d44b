//! Files that a killed run leaves behind, and the next run.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use foreshore_tests::drive_log::DriveLog;
use network::clock;
use recording::{Selection, open};
use tempfile::tempdir;

use crate::processes::{Running, free_port, program, start, tcp, wait_until};
use crate::skip::skip;

/// Duration of a run after its first write.
const RUN: Duration = Duration::from_secs(4);
/// Data that a kill may lose.
const LOSS: Duration = Duration::from_secs(1);

/// The same command for each run, as systemd restarts it.
fn start_edge(folder: &Path, port: u16) -> Running {
    let folder = folder.display();
    start(&format!(
        "robot-edge simulate rooms --rate 1 --keep-serving --listen {} --record {folder}/f.mcap --drive-log {folder}/d.csv",
        tcp(port)
    ))
}

fn is_written(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|file| file.len() > 0)
}

/// Time from the first to the last readable stamp.
fn recorded(path: &Path) -> Duration {
    let mut reader = open(path, Selection::All).unwrap();
    let mut stamps = Vec::new();
    while let Some(measurement) = reader.next_measurement().unwrap() {
        // The stamp of a static transform is arbitrary.
        if !measurement.is_static_transform() {
            stamps.push(measurement.stamp.as_nanos());
        }
    }
    let [first, last] = [stamps.iter().min(), stamps.iter().max()].map(|stamp| *stamp.unwrap());
    Duration::from_nanos(u64::try_from(last - first).unwrap())
}

#[test]
fn files_of_killed_runs_stay_whole_after_three_restarts() {
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
        let edge = start_edge(folder.path(), port);
        wait_until(recording, || is_written(&at(recording)));
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
        // The file exists before the first measurement.
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
    let edge = start_edge(folder.path(), port);
    wait_until("f-4.mcap", || is_written(&at("f-4.mcap")));
    // Time to make a map.
    sleep(LOSS);
    let printed = edge.interrupt();
    for [option, asked, name] in [
        ["--record", "f.mcap", "f-4.mcap"],
        ["--drive-log", "d.csv", "d-4.csv"],
    ] {
        let [asked, name] = [asked, name].map(|name| at(name).display().to_string());
        let says = format!(
            "setup: {option}: {asked} exists and is not written over: this run writes {name}\n"
        );
        assert!(printed.contains(&says), "{printed}");
    }
    for (name, bytes) in kept {
        assert!(
            fs::read(at(name)).unwrap() == bytes,
            "{name} was overwritten"
        );
    }
}

/// What a power cut leaves is only what was synced.
#[test]
fn recordings_and_their_folder_are_synced_each_second() {
    if Command::new("strace").arg("-V").output().is_err() {
        return skip("there is no strace", "the package strace");
    }
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = Command::new("strace")
        .args(["-f", "-y", "-e", "trace=fsync,fdatasync", "-o"])
        .arg(at("calls"))
        .args(["timeout", "--signal", "INT", "4"])
        .arg(program("robot-edge"))
        .args(["simulate", "rooms", "--rate", "1"])
        .args([OsStr::new("--record"), at("f.mcap").as_ref()])
        .args([OsStr::new("--drive-log"), at("d.csv").as_ref()])
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(124), "{run:?}");
    let calls = fs::read_to_string(at("calls")).unwrap();
    for (path, at_least) in [(at("f.mcap"), 3), (at("d.csv"), 3), (at(""), 2)] {
        let path = path.display().to_string();
        let target = format!("<{}>", path.trim_end_matches('/'));
        let synced = calls.lines().filter(|line| line.contains(&target)).count();
        assert!(synced >= at_least, "{target}: {synced}\n{calls}");
    }
}
