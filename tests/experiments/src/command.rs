//! `experiments`: maps of simulated worlds against their truth, as a page.

use std::hash::{DefaultHasher, Hasher as _};
use std::io::{self, IsTerminal as _, Write};
use std::sync::atomic::AtomicBool;
use std::{env, fs};

use indicatif::{ProgressBar, ProgressDrawTarget};

use crate::outcome::Verdict;
use crate::report::{Compared, Folder};
use crate::{EXPERIMENTS, Experiment, Outcome, Session};
use edge::cli::Experiments;
use edge::exit::{Exit, Interrupted, UsageError};
use network::clock;

/// Runs the command. Progress goes to standard error, the path of the page to `out`. What the same program has finished in
/// that folder with as many seeds is not run again.
pub fn run(
    command: &Experiments,
    quiet: bool,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let mut chosen = Vec::new();
    for id in &command.ids {
        let experiment = Experiment::of_id(id).ok_or_else(|| {
            let known = EXPERIMENTS.each_ref().map(|experiment| experiment.id);
            let known = known.join(", ");
            UsageError(format!("no experiment is called `{id}`: there are {known}"))
        })?;
        chosen.push(experiment.id);
    }
    let is_chosen = |experiment: &&Experiment| chosen.is_empty() || chosen.contains(&experiment.id);
    let progress = Progress::new(quiet);
    let watch = |what: &str| progress.bar.set_message(what.to_owned());
    let session = Session::new(command.seeds, interrupt, &watch);
    let folder = Folder::prepare(&command.out, program_digest()?, &session)?;
    let mut sections = Vec::new();
    for experiment in EXPERIMENTS.iter().filter(is_chosen) {
        if let Some(finished) = folder.section(experiment) {
            progress.print(&format!("{}: finished before\n", experiment.id));
            sections.push(finished);
            continue;
        }
        let started = clock::now();
        let run = |session| {
            (experiment.run)(session).map_err(|error| {
                if error.is::<Interrupted>() {
                    error
                } else {
                    error.context(format!("{} could not be run", experiment.id))
                }
            })
        };
        let outcome = run(&session)?;
        progress.print_outcome(experiment, &outcome, clock::elapsed(started).as_secs_f64());
        let compared = Compared {
            experiment,
            outcome,
            by_document: run(&session.by_document())?,
        };
        sections.push(folder.keep(&compared, &session)?);
        folder.write(&sections)?;
    }
    progress.bar.finish_and_clear();
    writeln!(out, "{}", folder.write(&sections)?.display())?;
    let passed = sections.iter().all(|section| section.passed);
    Ok(if passed { Exit::Done } else { Exit::Failed })
}

/// Of the program that runs: figures of another one are not reused.
fn program_digest() -> io::Result<u64> {
    let mut hasher = DefaultHasher::new();
    hasher.write(&fs::read(env::current_exe()?)?);
    Ok(hasher.finish())
}

/// Prints one line per finished experiment; on a terminal, also the current one.
struct Progress {
    quiet: bool,
    bar: ProgressBar,
}

impl Progress {
    fn new(quiet: bool) -> Self {
        let bar = if quiet || !io::stderr().is_terminal() {
            ProgressBar::hidden()
        } else {
            ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(5))
        };
        Self { quiet, bar }
    }

    fn print_outcome(&self, experiment: &Experiment, outcome: &Outcome, took_s: f64) {
        let verdict = if outcome.passed() { "pass" } else { "FAIL" };
        let failed = outcome
            .checks
            .iter()
            .filter(|check| check.verdict == Verdict::Failed)
            .map(|check| {
                let (what, measured) = (&check.what, &check.measured);
                format!("  {what}: {measured}, required {}\n", check.required)
            });
        let first = format!("{} {verdict} ({took_s:.0} s)\n", experiment.id);
        let text: String = std::iter::once(first).chain(failed).collect();
        self.print(&text);
    }

    fn print(&self, text: &str) {
        if self.quiet {
            return;
        }
        // A failed write is ignored: the page is the result.
        self.bar
            .suspend(|| drop(io::stderr().write_all(text.as_bytes())));
    }
}
