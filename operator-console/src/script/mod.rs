//! `--headless drive --script FILE`: timed inputs through the same helm as the window's.

mod parse;
mod status_line;

use std::collections::{BTreeSet, VecDeque};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use measurement::time::Monotonic;
use protocol::keys::RobotId;
use protocol::message::{Info, TeleopStatus};
use protocol::tile::BootId;
use robot_edge::clock;
use robot_edge::credentials::Credentials;
use robot_edge::exit::{Exit, Interrupted, UsageError};
use robot_edge::link::sessions::Endpoints;
use robot_edge::link::{random_id, zenoh_config_file};

use crate::identity::Identity;
use crate::link::RobotSession;
use crate::model::{LinkState, ModelSettings};
use crate::panels::driving::labels::note as note_in_words;
use crate::role::{OBSERVER_HINT, is_observer};
use crate::target::{Target, WaitForRobot};
use crate::teleop_client::{EStopState, Intent};
use crate::teleop_input::{DriveKey, InputEvent};
use crate::teleop_session::TeleopSession;

pub use parse::{Action, LANGUAGE, ScriptError, State, Step, parse};

/// What was asked for at the end is waited for so long at most: longer than the helm waits for an answer.
const LAST_ANSWER: Duration = Duration::from_secs(5);
/// Between two iterations at most: a queue is looked at no more rarely than commands are sent.
const PERIOD: Duration = Duration::from_millis(20);
/// Tiles are not asked for.
const STORE_MB: u32 = 1;

/// What to drive, and how.
#[derive(Clone)]
pub struct Drive {
    /// Addresses to ask; where there are none the network is searched.
    pub connect: Vec<String>,
    /// Which robot; else the only one there is.
    pub robot: Option<RobotId>,
    /// A Zenoh configuration.
    pub zenoh_config: Option<PathBuf>,
    /// Who connects, where the link is secured.
    pub credentials: Option<Credentials>,
    /// Who drives.
    pub identity: Identity,
    /// The script.
    pub script: PathBuf,
    /// How long to wait for the robot.
    pub timeout: Duration,
    /// Say nothing but what the script does.
    pub quiet: bool,
}

/// Drives, and tells what happens. Ends with [`Exit::Failed`] where something was refused, not answered, or awaited in
/// vain.
///
/// # Errors
/// Where the operator may only watch, the script cannot be read, or there is no robot that can be driven.
pub fn run(
    settings: &Drive,
    is_interrupted: impl Fn() -> bool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    if is_observer(settings.identity.role) {
        return Err(UsageError(OBSERVER_HINT.to_owned()).into());
    }
    let steps = load(&settings.script)?;
    let target = Target {
        connect: settings.connect.clone(),
        robot: settings.robot.clone(),
        zenoh_config: settings.zenoh_config.clone(),
        credentials: settings.credentials.clone(),
        timeout: settings.timeout,
        quiet: settings.quiet,
    };
    let found = target.find(&is_interrupted)?;
    let wait_for_robot = target.wait_for_robot(&found);
    let model = ModelSettings {
        robot: found.robot.clone(),
        session: BootId(random_id()?),
        tile_store_mb: STORE_MB,
        layers: BTreeSet::new(),
    };
    let endpoints = Endpoints {
        connect: vec![found.endpoint],
        zenoh_config: zenoh_config_file(settings.zenoh_config.clone()),
        credentials: settings.credentials.clone(),
        ..Endpoints::default()
    };
    let mut session = RobotSession::open(model, &endpoints, || {}).context("cannot drive")?;
    let link = session
        .take_driving()
        .ok_or_else(|| anyhow!("the robot is driven already"))?;
    let mut teleop_session = TeleopSession::new(found.robot, settings.identity.clone(), link)?;
    // A terminal does not tell whether somebody is there; a script is.
    teleop_session.apply(InputEvent::Focus(true));
    let info = abilities(&session, wait_for_robot, target.timeout, &is_interrupted)?;
    teleop_session.set_robot_info(&info);

    let mut runner = ScriptRunner {
        session,
        teleop_session,
        steps: steps.into(),
        started: clock::now(),
        waited: Duration::ZERO,
        awaiting: None,
        ended: None,
        status_line: status_line::StatusLine::default(),
        peak_age_ms: 0,
        failures: 0,
        out,
    };
    let is_whole = runner.run(&is_interrupted)?;
    // While there is still a session to say it on.
    runner.teleop_session.shut_down();
    runner.print_summary()?;
    if !is_whole {
        return Err(Interrupted.into());
    }
    Ok(if runner.failures == 0 {
        Exit::Done
    } else {
        Exit::Failed
    })
}

fn load(path: &Path) -> anyhow::Result<Vec<Step>> {
    let text =
        fs::read_to_string(path).map_err(|why| UsageError(format!("{}: {why}", path.display())))?;
    Ok(parse(&text).map_err(|why| UsageError(format!("{}: {why}", path.display())))?)
}

/// What the robot can do, as soon as it tells and can be driven.
fn abilities(
    session: &RobotSession,
    mut wait_for_robot: WaitForRobot,
    timeout: Duration,
    is_interrupted: &impl Fn() -> bool,
) -> anyhow::Result<Info> {
    let deadline = clock::now() + timeout;
    loop {
        {
            let model = session.model();
            let pose = model.vehicle().pose();
            let is_drivable = pose.is_some_and(|(pose, _)| pose.token.is_some());
            if let Some(info) = model.info().filter(|_| is_drivable) {
                return Ok(info.clone());
            }
            let now = clock::now();
            if model.connection().state(now) == LinkState::Waiting {
                wait_for_robot.report_progress(now);
            }
            if deadline.since(now).is_zero() {
                if model.connection().totals().1 == 0 {
                    drop(model);
                    return Err(wait_for_robot.conclusion(is_interrupted));
                }
                let why = match (session.problem(), model.info()) {
                    (Some(problem), _) => problem,
                    (None, None) => "it says nothing".to_owned(),
                    (None, Some(_)) => "it cannot be driven".to_owned(),
                };
                return Err(anyhow!("{} cannot be driven: {why}", model.robot()));
            }
        }
        if !clock::sleep_until(clock::now() + PERIOD, is_interrupted) {
            return Err(Interrupted.into());
        }
    }
}

/// A script that is being played.
struct ScriptRunner<'a> {
    session: RobotSession,
    teleop_session: TeleopSession,
    steps: VecDeque<Step>,
    started: Monotonic,
    /// What was spent waiting: the script's clock stands still then.
    waited: Duration,
    awaiting: Option<(State, Monotonic, Duration, usize)>,
    /// When nothing was left to do.
    ended: Option<Monotonic>,
    status_line: status_line::StatusLine,
    peak_age_ms: u32,
    failures: u32,
    out: &'a mut dyn Write,
}

impl ScriptRunner<'_> {
    /// Whether it was played to its end.
    fn run(&mut self, is_interrupted: &impl Fn() -> bool) -> io::Result<bool> {
        loop {
            let now = clock::now();
            self.teleop_session.begin(now);
            let freeze = self.act(now)?;
            self.teleop_session.end(clock::now());
            self.print_changes()?;
            if let Some(freeze) = freeze
                && !clock::sleep_until(clock::now() + freeze, is_interrupted)
            {
                return Ok(false);
            }
            if self.steps.is_empty() && self.awaiting.is_none() {
                if self.ended.is_none() {
                    // Nobody's hands are on anything while answers are waited for.
                    let keys = DriveKey::ALL.map(InputEvent::Release);
                    for event in keys.into_iter().chain([InputEvent::PadGone]) {
                        self.teleop_session.apply(event);
                    }
                }
                let ended = *self.ended.get_or_insert(now);
                let state = self.teleop_session.state(now);
                let is_stopping = matches!(state.estop, EStopState::Sending(_));
                if !state.is_asking && !is_stopping {
                    return Ok(true);
                }
                if now.since(ended) >= LAST_ANSWER {
                    self.fail("the last request was not answered")?;
                    return Ok(true);
                }
            }
            let mut next = now + PERIOD;
            next = next.min(self.teleop_session.due(now).unwrap_or(next));
            if let Some(step) = self.steps.front() {
                next = next.min(self.started + self.waited + step.at);
            }
            if !clock::sleep_until(next, is_interrupted) {
                return Ok(false);
            }
        }
    }

    /// Takes out of the queue what is due.
    fn act(&mut self, now: Monotonic) -> io::Result<Option<Duration>> {
        if !self.is_awaited(now)? {
            return Ok(None);
        }
        while let Some(step) = self
            .steps
            .pop_front_if(|step| self.started + self.waited + step.at <= now)
        {
            match step.action {
                Action::Input(events) => {
                    for event in events {
                        self.teleop_session.apply(event);
                    }
                }
                Action::Intent(intent) => self.teleop_session.submit(intent, now),
                Action::Reset => {
                    if let Some(estop) = self.teleop().and_then(|teleop| teleop.estop) {
                        self.teleop_session.submit(Intent::Reset(estop.number), now);
                    } else {
                        let words = format!("line {}: there is no emergency stop", step.line);
                        self.fail(&words)?;
                    }
                }
                Action::Freeze(time) => {
                    self.say(&format!("stands still for {:.1} s", time.as_secs_f64()))?;
                    return Ok(Some(time));
                }
                Action::Await(state, longest) => {
                    self.awaiting = Some((state, now, longest, step.line));
                    return Ok(None);
                }
            }
        }
        Ok(None)
    }

    /// Whether nothing is waited for any more. What is awaited in vain ends the script.
    fn is_awaited(&mut self, now: Monotonic) -> io::Result<bool> {
        let Some((state, since, longest, line)) = self.awaiting else {
            return Ok(true);
        };
        let is_so = match state {
            State::Lease => self.teleop_session.state(now).lease.held().is_some(),
            State::Idle
            | State::Held
            | State::Driving
            | State::Stopping
            | State::EStop
            | State::Fault => self.teleop().is_some_and(|teleop| state.is(teleop.state)),
        };
        let is_late = now.since(since) >= longest;
        if is_so || is_late {
            self.awaiting = None;
            self.waited += now.since(since);
        }
        if is_late && !is_so {
            // What follows takes the vehicle to be in that state.
            let rest = if self.steps.is_empty() {
                ""
            } else {
                "; the rest is left out"
            };
            self.steps.clear();
            let state = state.word();
            self.fail(&format!("line {line}: waited in vain for {state}{rest}"))?;
        }
        Ok(is_so || is_late)
    }

    fn teleop(&self) -> Option<TeleopStatus> {
        let model = self.session.model();
        model.status()?.0.teleop.clone()
    }

    fn print_changes(&mut self) -> io::Result<()> {
        let notes: Vec<_> = self.teleop_session.take_notifications().collect();
        for (_, note) in notes {
            match note_in_words(&note) {
                (words, true) => self.fail(&words)?,
                (words, false) => self.say(&words)?,
            }
        }
        if let Some(teleop) = self.teleop() {
            self.peak_age_ms = self.peak_age_ms.max(teleop.peak_age_ms.unwrap_or(0));
            if let Some(line) = self.status_line.changed_line(&teleop) {
                self.say(&line)?;
            }
        }
        Ok(())
    }

    fn print_summary(&mut self) -> io::Result<()> {
        let Some(teleop) = self.teleop() else {
            return Ok(());
        };
        let counters = &teleop.counters;
        self.say(&format!(
            "{} commands accepted, greatest age {} ms, {} involuntary stops",
            counters.accepted, self.peak_age_ms, counters.involuntary_stops
        ))?;
        for refused in &counters.refused {
            self.say(&format!("{} refused: {}", refused.count, refused.reason))?;
        }
        Ok(())
    }

    fn fail(&mut self, words: &str) -> io::Result<()> {
        self.failures += 1;
        self.say(words)
    }

    fn say(&mut self, words: &str) -> io::Result<()> {
        let time_s = clock::elapsed(self.started).as_secs_f64();
        writeln!(self.out, "{time_s:8.3} {words}")?;
        self.out.flush()
    }
}
