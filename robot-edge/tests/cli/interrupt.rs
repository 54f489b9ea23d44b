//! Ctrl-C ends a run cleanly and soon; a second one ends it at once.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use network::clock;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::process::{Ended, digest, events, read_json, robot_edge, rooms, run, summary_of};

/// A recording that is longer holds more than its beginning, which is written at once.
const BEGINNING_BYTES: u64 = 4096;

/// What a machine with other work may take.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Between two questions: so that asking takes no time from the process that is waited for.
const NAP: Duration = Duration::from_millis(2);

/// A process that ends with the test, whatever comes.
struct Running(Option<Child>);

impl Running {
    fn start(command: &mut Command) -> Self {
        let command = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        Self(Some(command.spawn().unwrap()))
    }

    fn child(&mut self) -> &mut Child {
        self.0.as_mut().unwrap()
    }

    /// Returns when `condition` holds; fails when the process ends before, or patience does.
    #[track_caller]
    fn wait_until(&mut self, what: &str, condition: impl Fn() -> bool) {
        let started = clock::now();
        while !condition() {
            let has_ended = self.child().try_wait().unwrap().is_some();
            assert!(!has_ended, "it ended before {what}: {:#?}", self.end());
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "waited too long until {what}"
            );
            std::thread::sleep(NAP);
        }
    }

    fn send(&mut self, signal: Signal) {
        let pid = i32::try_from(self.child().id()).unwrap();
        kill_process(Pid::from_raw(pid).unwrap(), signal).unwrap();
    }

    /// Waits for the end; fails when patience ends before.
    #[track_caller]
    fn end(&mut self) -> Ended {
        let started = clock::now();
        while self.child().try_wait().unwrap().is_none() {
            assert!(
                clock::elapsed(started) < TIMEOUT,
                "waited too long for its end"
            );
            std::thread::sleep(NAP);
        }
        self.0.take().unwrap().wait_with_output().unwrap().into()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            drop(child.kill());
            drop(child.wait());
        }
    }
}

fn size(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// Runs `command` until its recording holds more than `bytes`, stops it, and checks all that it leaves behind.
fn interrupted(command: &mut Command, bytes: u64, signal: Signal) -> (Value, Ended) {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let mut running = Running::start(
        command
            .arg("--export")
            .arg(place("maps"))
            .arg("--record")
            .arg(place("r.mcap"))
            .arg("--summary")
            .arg(place("s.json")),
    );
    running.wait_until("its recording has grown", || size(&place("r.mcap")) > bytes);
    let stopped = clock::now();
    running.send(signal);
    let ended = running.end();
    let took = clock::elapsed(stopped);
    let complaints: Vec<_> = ended
        .stderr
        .lines()
        .filter(|line| !line.starts_with("setup: "))
        .collect();
    assert_eq!(
        (ended.code, &complaints[..]),
        (Some(130), &[""; 0][..]),
        "{ended:#?}"
    );
    assert!(took < Duration::from_secs(2), "{took:?}");
    assert!(
        ended
            .stdout
            .contains("interrupted: stopped before the end\n"),
        "{}",
        ended.stdout
    );

    for name in [
        "occupancy.tif",
        "occupancy.png",
        "occupancy.pgm",
        "occupancy.yaml",
        "trajectory.tum",
    ] {
        assert!(size(&place("maps").join(name)) > 0, "{name}");
        assert!(ended.stdout.contains(name), "{}", ended.stdout);
    }
    let summary = read_json(&place("s.json"));
    assert!(events(&summary).contains(&"interrupted: stopped before the end".to_owned()));
    assert!(summary["scans"]["mapped"].as_u64().unwrap() > 0);

    // The recording is whole: nothing is missing at its end, and it gives the same map.
    let recover = run(robot_edge("recover")
        .arg(place("r.mcap"))
        .arg(place("again.mcap")))
    .succeeds();
    assert!(
        recover.stdout.ends_with("lost: nothing\n"),
        "{}",
        recover.stdout
    );
    let info = run(robot_edge("info").arg(place("r.mcap")))
        .succeeds()
        .stdout;
    let again = summary_of(robot_edge("replay").arg(place("r.mcap")));
    assert!(info.contains("  vehicle: pioneer\n"), "{info}");
    assert_eq!(again["scans"], summary["scans"]);
    assert_eq!(digest(&again), digest(&summary));
    (summary, ended)
}

#[test]
fn a_simulation_in_real_time_stops_soon_and_leaves_everything_whole() {
    for signal in [Signal::INT, Signal::TERM] {
        let (summary, ended) = interrupted(
            &mut robot_edge("simulate rooms --rate 1"),
            BEGINNING_BYTES,
            signal,
        );
        let mapped = summary["scans"]["mapped"].as_u64().unwrap();
        assert!(mapped < 1159, "{mapped}");
        assert!(
            ended
                .stdout
                .contains(&format!("{mapped} of {mapped} scans mapped")),
            "{}",
            ended.stdout
        );
    }
}

#[test]
fn a_replay_without_end_stops_soon_and_leaves_everything_whole() {
    for threads in [1, 2] {
        let mut command = robot_edge("replay --loop --rate max");
        command
            .arg(rooms())
            .arg("--set")
            .arg(format!("mapping.threads={threads}"));
        // A round is 2.7 MB.
        let (summary, _) = interrupted(&mut command, 6_000_000, Signal::INT);
        assert!(summary["scans"]["mapped"].as_u64().unwrap() > 2 * 1159);
        assert_eq!(summary["scans"]["dropped"], serde_json::json!({}));
        assert!(summary["duration_s"].as_f64().unwrap() > 2.0 * 115.0);
        let pauses: Vec<_> = events(&summary)
            .into_iter()
            .filter(|event| event.starts_with("pause"))
            .collect();
        assert_eq!(pauses, [""; 0], "beginning again is no fault of the data");
    }
}

/// Every round, the first included, is paced: what lies before the part is passed over at once.
#[test]
fn a_short_part_in_a_loop_keeps_its_rate() {
    let mut command = robot_edge("replay --loop --start 40 --duration 0.5 --rate 2");
    // More than the transforms before the part, less than ten rounds.
    let (summary, _) = interrupted(command.arg(rooms()), 300_000, Signal::INT);
    let (data, wall) = (
        summary["duration_s"].as_f64().unwrap(),
        summary["wall_s"].as_f64().unwrap(),
    );
    assert!(
        wall < 20.0,
        "{wall} s: what lies before the part was waited for"
    );
    assert!(data > 0.5, "{data} s are not even one round");
    assert!(
        data <= 2.1 * wall + 0.5,
        "{data} s of data in {wall} s at twice real time"
    );
}

#[test]
fn the_second_interrupt_ends_the_process_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    // Nobody reads this pipe, so that the process waits for ever where it writes its summary.
    let pipe = place("s.json");
    let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, mode, 0).unwrap();
    let mut running = Running::start(
        robot_edge("simulate rooms --rate 1 --quiet")
            .arg("--export")
            .arg(place("maps"))
            .arg("--record")
            .arg(place("r.mcap"))
            .arg("--summary")
            .arg(&pipe),
    );
    running.wait_until("it records", || size(&place("r.mcap")) > BEGINNING_BYTES);
    running.send(Signal::INT);
    running.wait_until("its maps are written", || {
        size(&place("maps/trajectory.tum")) > 0
    });
    let stopped = clock::now();
    running.send(Signal::INT);
    let ended = running.end();
    assert_eq!(
        (ended.code, ended.stdout.as_str(), ended.stderr.as_str()),
        (Some(130), "", "")
    );
    assert!(clock::elapsed(stopped) < Duration::from_secs(2));
}
