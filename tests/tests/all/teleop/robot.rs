//! A simulated robot and its drive log, drives while something else happens, and the rounds of the teleop loop.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::scope;
use std::time::Duration;

use foreshore_tests::drive_log::{DriveLog, Evaluation, Limits, evaluate};
use foreshore_tests::operator::{Input, Journal, Operator};
use measurement::time::Monotonic;
use network::clock;
use tempfile::{TempDir, tempdir};

use crate::processes::{Running, SERVED, command, free_endpoint, wait_until};

pub(super) const NAME: &str = "scout";

/// A circle that fits into the corridor in which it begins.
pub(super) const CIRCLE: Input = Input::of(0.15, 1.0);

/// Limits of the vehicle of `rooms`.
pub(crate) const LIMITS: Limits = Limits {
    max_age: Duration::from_millis(400),
    stop_decel: [1.0, 1.0, 4.0],
};

pub(super) struct Robot {
    pub(super) edge: Running,
    pub(super) endpoint: String,
    log: PathBuf,
    /// Each run logs into a file of its own.
    runs: u32,
    run: Box<dyn Fn(&Path) -> Running>,
    _folder: TempDir,
}

impl Robot {
    /// Starts one that listens at a free port.
    pub(super) fn start() -> Self {
        Self::start_in("rooms")
    }

    /// The same in another world.
    pub(super) fn start_in(world: &str) -> Self {
        let endpoint = free_endpoint();
        Self::start_with(world, &endpoint, &format!("--listen {endpoint}"), |_| ())
    }

    /// Starts one that operators reach at `endpoint`, with these options and a changed command.
    pub(super) fn start_with(
        world: &str,
        endpoint: &str,
        options: &str,
        change: impl Fn(&mut Command) + 'static,
    ) -> Self {
        let options = options.to_owned();
        Self::launch(world, endpoint, move |line| {
            let mut command = command(&format!("robot-edge {line} {options}"));
            change(&mut command);
            command
        })
    }

    /// Starts the command that `command` makes of arguments.
    pub(super) fn launch(
        world: &str,
        endpoint: &str,
        command: impl Fn(&str) -> Command + 'static,
    ) -> Self {
        let folder = tempdir().unwrap();
        let log = folder.path().join("drive.csv");
        let simulate = format!("simulate {world} {SERVED} --robot {NAME} --drive-log");
        let run = move |log: &Path| {
            let mut command = command(&format!("{simulate} {}", log.display()));
            Running::start(&mut command, "edge")
        };
        Self {
            edge: run(&log),
            endpoint: endpoint.to_owned(),
            log,
            runs: 1,
            run: Box::new(run),
            _folder: folder,
        }
    }

    pub(super) fn restart(&mut self) {
        // A killed process keeps its ports until it has ended.
        wait_until("the old one ends", || !self.edge.is_running());
        self.edge = (self.run)(&self.log);
        self.runs += 1;
    }

    /// An operator, ready to send commands.
    pub(super) fn operator(&self, name: &str) -> Operator {
        Operator::ready(&self.endpoint, NAME, name)
    }

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

/// Runs `attack` while `driver` holds [`CIRCLE`]; returns its begin and end.
pub(super) fn while_driving(
    driver: &mut Operator,
    attack: impl FnOnce(),
) -> (Monotonic, Monotonic) {
    driver.start_driving(CIRCLE);
    while_holding(driver, attack)
}

/// The same, if it drives already.
pub(super) fn while_holding(
    driver: &mut Operator,
    attack: impl FnOnce(),
) -> (Monotonic, Monotonic) {
    let is_over = AtomicBool::new(false);
    scope(|scope| {
        scope.spawn(|| driver.hold_until(CIRCLE, || is_over.load(Ordering::Relaxed)));
        let began = clock::now();
        attack();
        let ended = clock::now();
        is_over.store(true, Ordering::Relaxed);
        (began, ended)
    })
}

/// Share of the time in which the vehicle drove, from 0 to 1; below 1 on a busy machine.
pub(super) fn drove(what: &str, log: &DriveLog, (began, ended): (Monotonic, Monotonic)) -> f64 {
    let driving_s = log.during(began, ended).windows(2).map(|pair| {
        let is_driving = pair[0].mode == "driving";
        f64::from(u8::from(is_driving)) * pair[1].at.since(pair[0].at).as_secs_f64()
    });
    let share = driving_s.sum::<f64>() / ended.since(began).as_secs_f64();
    println!("{what}: it drove {:.1} % of the time", 100.0 * share);
    share
}

pub(super) const ROUND: Duration = Duration::from_millis(20);

/// Delays of rounds beyond [`ROUND`].
pub(super) struct Lateness {
    /// Sorted.
    late: Vec<Duration>,
    /// Share of the time in rounds that were late by more than [`ROUND`], from 0 to 1.
    delayed: f64,
}

impl Lateness {
    /// Of the rounds of a drive; prints them.
    pub(super) fn of(what: &str, log: &DriveLog, (began, ended): (Monotonic, Monotonic)) -> Self {
        let rounds = log.during(began, ended).to_vec();
        let periods = DriveLog { rounds, missing: 0 }.periods();
        let delayed = periods.iter().filter(|&&period| period > 2 * ROUND);
        let delayed = delayed.sum::<Duration>().as_secs_f64() / ended.since(began).as_secs_f64();
        let late = periods.iter().map(|period| period.saturating_sub(ROUND));
        let mut late: Vec<_> = late.collect();
        late.sort_unstable();
        println!(
            "{what}: {} rounds, late by p50 {:.1?}, p99 {:.1?}, most {:.1?}",
            late.len(),
            at(&late, 0.5),
            at(&late, 0.99),
            at(&late, 1.0)
        );
        Self { late, delayed }
    }

    /// The quantile `share`.
    pub(super) fn at(&self, share: f64) -> Duration {
        at(&self.late, share)
    }

    /// Panics if these rounds are later than those without a flood. A busy machine delays some in
    /// both.
    pub(super) fn is_no_worse_than(&self, quiet: &Self) {
        assert!(
            self.delayed <= 0.1 + 2.0 * quiet.delayed,
            "{:.1} % of the time was in rounds that were delayed by more than {ROUND:?}, and {:.1} % without a flood",
            100.0 * self.delayed,
            100.0 * quiet.delayed
        );
        let (median, limit) = (self.at(0.5), quiet.at(0.5) + ROUND / 4);
        assert!(median <= limit, "every second round is late by {median:?}");
    }

    /// Panics if any round is late: for an idle machine.
    pub(super) fn is_none(&self) {
        for (share, limit) in [(0.99, ROUND / 4), (1.0, ROUND)] {
            let late = self.at(share);
            assert!(late <= limit, "{share} of all rounds: late by {late:?}");
        }
    }
}

/// The quantile `share` of sorted times.
pub(crate) fn at(times: &[Duration], share: f64) -> Duration {
    let last = times.len().checked_sub(1).expect("figures");
    times[(last as f64 * share).round() as usize]
}
