//! A simulated robot and its drive log.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, Evaluation, Limits, evaluate};
use foreshore_tests::operator::{Input, Journal};
use protocol::message::{Refusal, TeleopStatus};
use tempfile::{TempDir, tempdir};

use crate::link::processes::{Running, free_port, program};

/// Name of the robot.
pub(super) const NAME: &str = "scout";

/// A circle that fits into the corridor in which it begins.
pub(super) const CIRCLE: Input = Input::of(0.15, 1.0);

/// Limits of the vehicle of [`WORLD`].
pub(super) const LIMITS: Limits = Limits {
    max_age: Duration::from_millis(400),
    stop_decel: [1.0, 4.0],
};

const WORLD: &str = "rooms";

/// A running robot.
pub(super) struct Robot {
    pub(super) edge: Running,
    pub(super) port: u16,
    log: PathBuf,
    /// Each run logs into a file of its own.
    runs: u32,
    run: Box<dyn Fn(&Path) -> Running>,
    _folder: TempDir,
}

impl Robot {
    /// Starts one that listens at a free port.
    pub(super) fn start() -> Self {
        let port = free_port();
        Self::start_with(port, &["--listen", &format!("tcp/127.0.0.1:{port}")])
    }

    /// Starts one at that port, with these options.
    pub(super) fn start_with(port: u16, options: &[&str]) -> Self {
        let options: Vec<_> = options.iter().map(ToString::to_string).collect();
        Self::launch(program("robot-edge"), port, WORLD, move |command| {
            command.args(&options);
        })
    }

    /// Starts the program in a world, with a changed command.
    pub(super) fn launch(
        edge: Command,
        port: u16,
        world: &'static str,
        change: impl Fn(&mut Command) + 'static,
    ) -> Self {
        let folder = tempdir().unwrap();
        let log = folder.path().join("drive.csv");
        let run = move |log: &Path| {
            let mut command = Command::new(edge.get_program());
            command
                .args(edge.get_args())
                .env_remove("RUST_LOG")
                .env_remove("ZENOH_CONFIG")
                .args([
                    "simulate",
                    world,
                    "--rate",
                    "1",
                    "--keep-serving",
                    "--quiet",
                ])
                .args(["--robot", NAME, "--drive-log"])
                .arg(log);
            change(&mut command);
            Running::start(&mut command, "edge")
        };
        Self {
            edge: run(&log),
            port,
            log,
            runs: 1,
            run: Box::new(run),
            _folder: folder,
        }
    }

    /// Starts it again, with a new log.
    pub(super) fn restart(&mut self) {
        self.edge = (self.run)(&self.log);
        self.runs += 1;
    }

    pub(super) fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.port)
    }

    /// The outputs so far.
    pub(super) fn log(&self) -> DriveLog {
        let name = match self.runs {
            1 => self.log.clone(),
            run => self.log.with_file_name(format!("drive-{run}.csv")),
        };
        let csv =
            fs::read_to_string(&name).unwrap_or_else(|err| panic!("{}: {err}", name.display()));
        let log = DriveLog::parse(&csv).unwrap_or_else(|err| panic!("{err}"));
        assert_eq!(log.missing, 0, "rounds are missing: the disk was too slow");
        log
    }

    /// Checks the outputs so far against the journals of all drivers.
    pub(super) fn verdict(&self, journals: &[&Journal]) -> Evaluation {
        let verdict = evaluate(&self.log(), journals, &LIMITS);
        verdict.assert_no_faults();
        assert!(verdict.moving_rounds > 0, "it never moved");
        verdict
    }
}

/// Number of commands refused for that reason.
pub(super) fn refused(teleop: &TeleopStatus, reason: Refusal) -> u64 {
    let counters = teleop.counters.refused.iter();
    let mut found = counters.filter(|refused| refused.reason == reason);
    found.next().map_or(0, |refused| refused.count)
}
