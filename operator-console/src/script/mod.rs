//! `--headless drive --script FILE`: timed inputs through the window's teleop client.

use std::collections::{BTreeSet, VecDeque};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use edge::exit::{Exit, Interrupted, UsageError};
use measurement::time::Monotonic;
use network::clock;
use protocol::message::{Clamp, DockingChoice, Info, TeleopStatus};
use protocol::shores::site_letters;

use crate::identity::{Identity, OBSERVER_HINT, is_observer};
use crate::link::RobotSession;
use crate::model::LinkState;
use crate::panels::driving::is_stopped_by_monitor;
use crate::panels::driving::labels::{clamp, note as note_in_words, state};
use crate::target::{Target, WaitForRobot};
use crate::teleop_client::{EStopState, Intent};
use crate::teleop_handle::TeleopSession;
use crate::teleop_input::{DriveKey, InputEvent};

mod parse;

pub use parse::{Action, LANGUAGE, ScriptError, State, Step, parse};

/// Time to wait for the last answer: longer than the teleop client waits.
const LAST_ANSWER: Duration = Duration::from_secs(5);
/// Longest time between two iterations: the period of drive commands.
const PERIOD: Duration = Duration::from_millis(20);
const STORE_MB: u32 = 1;

#[derive(Clone)]
pub struct Drive {
    pub(crate) target: Target,
    pub(crate) identity: Identity,
    pub(crate) script: PathBuf,
}

/// [`Exit::Failed`] if a request is refused or not answered, or a state is not reached.
pub fn run(
    settings: &Drive,
    is_interrupted: impl Fn() -> bool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    if is_observer(settings.identity.role) {
        return Err(UsageError(OBSERVER_HINT.to_owned()).into());
    }
    let steps = load(&settings.script)?;
    let target = &settings.target;
    let found = target.find(&is_interrupted)?;
    let wait_for_robot = target.wait_for_robot(&found);
    let mut session = target
        .open(&found, BTreeSet::new(), STORE_MB)
        .context("cannot drive")?;
    let link = session
        .take_driving()
        .ok_or_else(|| anyhow!("the robot is driven already"))?;
    let mut teleop_session = TeleopSession::new(found.robot, settings.identity.clone(), link)?;
    // A script has no window that could lose the focus.
    teleop_session.client.apply(InputEvent::Focus(true));
    let info = abilities(&session, wait_for_robot, target.timeout, &is_interrupted)?;
    teleop_session.client.set_robot_info(&info);

    let mut runner = ScriptRunner {
        session,
        teleop_session,
        steps: steps.into(),
        started: clock::now(),
        waited: Duration::ZERO,
        awaiting: None,
        ended: None,
        status_line: StatusLine::default(),
        peak_age_ms: 0,
        failures: 0,
        out,
    };
    let is_whole = runner.run(&is_interrupted)?;
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

/// Waits until the robot describes itself and can be driven.
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

struct ScriptRunner<'a> {
    session: RobotSession,
    teleop_session: TeleopSession,
    steps: VecDeque<Step>,
    started: Monotonic,
    /// Time spent in `await`, during which the script's clock stops.
    waited: Duration,
    awaiting: Option<(State, Monotonic, Duration, usize)>,
    ended: Option<Monotonic>,
    status_line: StatusLine,
    peak_age_ms: u32,
    failures: u32,
    out: &'a mut dyn Write,
}

impl ScriptRunner<'_> {
    /// Returns whether the script ran to its end.
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
                    // All inputs are released while the last answers arrive.
                    let keys = DriveKey::ALL.map(InputEvent::Release);
                    for event in keys.into_iter().chain([InputEvent::PadGone]) {
                        self.teleop_session.client.apply(event);
                    }
                }
                let ended = *self.ended.get_or_insert(now);
                let state = self.teleop_session.client.state(now);
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
            next = next.min(self.teleop_session.client.due(now).unwrap_or(next));
            if let Some(step) = self.steps.front() {
                next = next.min(self.started + self.waited + step.at);
            }
            if !clock::sleep_until(next, is_interrupted) {
                return Ok(false);
            }
        }
    }

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
                        self.teleop_session.client.apply(event);
                    }
                }
                Action::Intent(intent) => self.teleop_session.client.submit(intent, now),
                Action::Dock(site) => {
                    if let Some(choice) = self.docking_choice(&site) {
                        let intent = Intent::Dock(Some(choice));
                        self.teleop_session.client.submit(intent, now);
                    } else {
                        let words = format!(
                            "line {}: there is no docking site {site} in vegetation",
                            step.line
                        );
                        self.fail(&words)?;
                    }
                }
                Action::Reset => {
                    if let Some(estop) = self.teleop().and_then(|teleop| teleop.estop) {
                        self.teleop_session
                            .client
                            .submit(Intent::Reset(estop.number), now);
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

    /// Whether no state is awaited any more. A state that is not reached ends the script.
    fn is_awaited(&mut self, now: Monotonic) -> io::Result<bool> {
        let Some((state, since, longest, line)) = self.awaiting else {
            return Ok(true);
        };
        let is_so = match state {
            State::Lease => self.teleop_session.client.state(now).lease.held().is_some(),
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
            // The following steps assume that state.
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

    fn docking_choice(&self, letters: &str) -> Option<DockingChoice> {
        let model = self.session.model();
        let sites = &model.shores()?.sites;
        let site = sites
            .iter()
            .find(|site| site_letters(site.number) == letters)?;
        site.choice()
    }

    fn teleop(&self) -> Option<TeleopStatus> {
        let model = self.session.model();
        model.status()?.0.teleop.clone()
    }

    fn print_changes(&mut self) -> io::Result<()> {
        let notes = self.teleop_session.client.take_notifications();
        for note in notes {
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

#[derive(Debug, Default)]
struct StatusLine(String);

impl StatusLine {
    /// A line if the text is new. Changes of numbers alone do not count.
    fn changed_line(&mut self, status: &TeleopStatus) -> Option<String> {
        let state_text = state_text(status);
        if self.0 == state_text {
            return None;
        }
        let line = format!("{state_text}, {}", figures(status));
        self.0 = state_text;
        Some(line)
    }
}

fn state_text(status: &TeleopStatus) -> String {
    let held_back = if is_stopped_by_monitor(status) {
        format!(", limited by {}", clamp(Clamp::CollisionMonitor))
    } else {
        String::new()
    };
    let holder = status.lease.holder.as_ref();
    let holder = holder.map_or_else(|| "nobody".to_owned(), ToString::to_string);
    format!("{}{held_back}, lease of {holder}", state(status.state))
}

fn figures(status: &TeleopStatus) -> String {
    let age = status
        .age_ms
        .map_or_else(|| "–".to_owned(), |age_ms| format!("{age_ms} ms"));
    format!(
        "asked {:.2} m/s {:.2} rad/s, applied {:.2} m/s {:.2} rad/s, age {age}",
        status.requested.linear_mps,
        status.requested.angular_radps,
        status.applied.linear_mps,
        status.applied.angular_radps,
    )
}

#[cfg(test)]
mod tests {
    use protocol::message::{LeaseStatus, TeleopState, Velocity};

    use super::*;
    use crate::test_support::idle_teleop_status;

    /// Anna drives with this applied speed, m/s.
    fn driven(applied_mps: f32) -> TeleopStatus {
        let going = |linear_mps| Velocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps: 0.0,
        };
        TeleopStatus {
            state: TeleopState::Driving,
            lease: LeaseStatus {
                holder: Some("anna".parse().unwrap()),
                ..LeaseStatus::default()
            },
            age_ms: Some(31),
            requested: going(0.8),
            applied: going(applied_mps),
            clamp: Some(Clamp::CollisionMonitor),
            ..idle_teleop_status()
        }
    }

    #[test]
    fn stop_by_collision_monitor_is_printed() {
        let line_for = |applied_mps| {
            StatusLine::default()
                .changed_line(&driven(applied_mps))
                .unwrap()
        };
        assert_eq!(
            line_for(0.0),
            "Driving, limited by the collision monitor, lease of anna, asked 0.80 m/s 0.00 rad/s, \
             applied 0.00 m/s 0.00 rad/s, age 31 ms"
        );
        assert_eq!(
            line_for(0.3),
            "Driving, lease of anna, asked 0.80 m/s 0.00 rad/s, applied 0.30 m/s 0.00 rad/s, age 31 ms"
        );
    }

    #[test]
    fn status_line_repeats_for_new_text_only() {
        let mut said = StatusLine::default();
        let mut is_said = |status: &TeleopStatus| said.changed_line(status).is_some();
        assert!(is_said(&driven(0.0)));
        // Rounded to zero.
        assert!(!is_said(&driven(0.001)));
        assert!(!is_said(&driven(0.0)));
        assert!(is_said(&driven(0.1)));
        assert!(!is_said(&driven(0.3)));
        let mut handed_over = driven(0.3);
        handed_over.lease.holder = Some("bert".parse().unwrap());
        assert!(is_said(&handed_over));
        assert!(is_said(&idle_teleop_status()));
        assert!(!is_said(&idle_teleop_status()));
    }
}
