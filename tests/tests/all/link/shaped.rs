//! Benchmarks of synchronization on an emulated link. Needs root; each prints a table row.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::{self, sleep};
use std::time::Duration;

use foreshore_tests::rig::Conditions;
use foreshore_tests::rig::tun::{Namespaces, Side};
use measurement::time::Monotonic;
use network::clock;
use tempfile::tempdir;

use crate::processes::{Running, program, rooms};
use crate::skip::skip;

const PORT: u16 = 7447;

/// An emulated link; `None`, and a skipped test, if this machine or user cannot have one.
pub(crate) fn namespaces(seed: u64) -> Option<Namespaces> {
    let created = Namespaces::create(seed);
    created
        .inspect_err(|lacks| {
            let remedy = "root, the kernel's TUN driver and package iproute2";
            skip(&lacks.to_string(), remedy);
        })
        .ok()
}

/// 2 Mbit/s, 150 ms round trip, `loss`; 32 kB of queue.
pub(crate) fn shaped(loss: f64) -> Conditions {
    Conditions {
        delay: Duration::from_millis(75),
        rate_bytes_per_s: Some(250_000),
        queue_bytes: 32_000,
        loss,
        ..Conditions::default()
    }
}

/// A command line of a program of this workspace, split at blanks, inside a namespace.
pub(crate) fn inside(link: &Namespaces, side: Side, line: &str) -> Command {
    let mut words = line.split_whitespace();
    let mut command = link.command(side, program(words.next().unwrap()));
    command.args(words);
    command
}

pub(crate) fn recording(name: &str) -> Option<String> {
    let folder = std::env::var_os("FORESHORE_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        Into::into,
    );
    let path = folder.join(name);
    if path.exists() {
        return Some(path.display().to_string());
    }
    skip(
        &format!("there is no {}", path.display()),
        "FORESHORE_DATA says where recordings are",
    );
    None
}

fn edge(link: &Namespaces, recording: &str, options: &str) -> Running {
    let address = Side::A.address();
    let line = format!(
        "robot-edge replay {recording} --keep-serving --insecure --robot scout --listen tcp/{address}:{PORT} {options}"
    );
    Running::start(&mut inside(link, Side::A, &line), "edge")
}

fn console(link: &Namespaces, export: &Path, options: &str) -> Command {
    let (address, export) = (Side::A.address(), export.display());
    let line = format!(
        "operator-console --headless -v --robot scout --connect tcp/{address}:{PORT} --export {export} {options}"
    );
    inside(link, Side::B, &line)
}

/// Times at which a console reports that it is synchronized or not.
struct Steps {
    child: Child,
    steps: Receiver<(Monotonic, bool)>,
}

impl Steps {
    fn watch(command: &mut Command) -> Self {
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let printed = BufReader::new(child.stderr.take().unwrap());
        let (sender, steps) = sync_channel(1000);
        thread::spawn(move || {
            for line in printed.lines().map_while(Result::ok) {
                if line.contains("is_synchronized") {
                    sender.send((clock::now(), line.contains("true"))).ok();
                }
            }
        });
        Self { child, steps }
    }

    /// When it next reports this state; `None` after a minute.
    fn next(&self, is_synchronized: bool) -> Option<Monotonic> {
        loop {
            match self.steps.recv_timeout(Duration::from_mins(1)) {
                Ok((at, step)) if step == is_synchronized => return Some(at),
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return None,
            }
        }
    }

    fn forget(&self) {
        while self.steps.try_recv().is_ok() {}
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

#[test]
#[ignore = "a minute, needs root: measures"]
fn late_joiner_on_the_shaped_link() {
    let (Some(log), Some(link)) = (recording("carmen/fr-clinic_robotlaser.clf"), namespaces(1))
    else {
        return;
    };
    let folder = tempdir().unwrap();
    let edge = edge(&link, &log, "--rate max");
    sleep(Duration::from_secs(20));
    link.set_both(shaped(0.02));
    for run in 1..=5 {
        let before = link.sent_bytes()[0];
        let mut command = console(&link, &folder.path().join("export"), "");
        let printed = Running::start(&mut command, "console").ends_well();
        let bytes = link.sent_bytes()[0] - before;
        let figures: Vec<_> = printed
            .lines()
            .filter(|line| line.contains("after discovery") || line.contains("messages of"))
            .collect();
        println!(
            "late joiner {run}: {}; {bytes} bytes of IP towards the console",
            figures.join("; ")
        );
        assert!(!figures.is_empty(), "{printed}");
    }
    drop(edge);
}

/// Seconds from the end of each cut until the console is synchronized.
fn heal(seed: u64, cuts: usize, cut: Duration) -> Vec<f64> {
    let Some(link) = namespaces(seed) else {
        return Vec::new();
    };
    let folder = tempdir().unwrap();
    link.set_both(shaped(0.05));
    // In a loop: a console ends with its robot's data.
    let edge = edge(&link, &rooms(), "--rate 1 --loop");
    let steps = Steps::watch(&mut console(
        &link,
        &folder.path().join("export"),
        "--for 3600",
    ));
    assert!(steps.next(true).is_some(), "never synchronized");
    let mut healed = Vec::new();
    for _ in 0..cuts {
        sleep(Duration::from_secs(3));
        link.set_both(Conditions {
            blackhole: true,
            ..shaped(0.05)
        });
        sleep(cut);
        steps.forget();
        link.set_both(shaped(0.05));
        let passed = clock::now();
        healed.push(
            steps
                .next(true)
                .map_or(f64::INFINITY, |at| at.since(passed).as_secs_f64()),
        );
    }
    drop(edge);
    healed
}

#[test]
#[ignore = "five minutes, needs root: measures"]
fn healing_after_loss_and_cuts() {
    let links = 20;
    let runs: Vec<_> = (0..links)
        .map(|seed| thread::spawn(move || heal(seed, 5, Duration::from_secs(30))))
        .collect();
    let mut healed: Vec<f64> = runs
        .into_iter()
        .flat_map(|run| run.join().unwrap())
        .collect();
    if healed.is_empty() {
        return;
    }
    healed.sort_by(f64::total_cmp);
    let at = |share: f64| healed[((healed.len() - 1) as f64 * share).round() as usize];
    println!(
        "healing, {} cuts of 30 s at 5 % loss: p50 {:.1} s, p95 {:.1} s, most {:.1} s; {:.1?}",
        healed.len(),
        at(0.5),
        at(0.95),
        at(1.0),
        healed
    );
    // Targets are 5 s and 15 s.
    assert!(at(0.95) <= 10.0 && at(1.0) <= 20.0);
}
