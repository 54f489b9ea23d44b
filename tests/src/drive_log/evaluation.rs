//! Holds what the motors were told against what an operator sent.
//!
//! It knows nothing of the arbiter: only when a command was built, by the same clock, and what came out at the other end.

use std::time::Duration;

use measurement::time::Monotonic;

use super::{DriveLog, Round};
use crate::operator::{Input, Journal, Sent};

/// What a line of the log is rounded to, m/s and rad/s.
const SPEED_STEP: f64 = 2e-6;
/// The same of what is asked.
const REQUEST_STEP: f64 = 1e-4;
/// The same of ages.
const AGE_STEP: Duration = Duration::from_micros(2);
/// Faults that are told; there may be one in every round.
const MAX_REPORTED_FAULTS: usize = 20;

/// How long a press must have been preceded by nothing pressed, less what the link may take off it at both ends.
const NEUTRAL: Duration = Duration::from_millis(160);

/// What the vehicle promises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest age of a command that has an effect.
    pub max_age: Duration,
    /// The stopping ramp: m/s² and rad/s².
    pub stop_decel: [f64; 2],
}

/// A stop because commands had become too old.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// When the token of the last command taken was issued.
    pub issued: Monotonic,
    /// From then to the first round whose output fell.
    pub fell_after: Duration,
    /// From that round to the first with an output of zero; `None` where commands came back in time.
    pub stood_after: Option<Duration>,
    /// How long the stopping ramp lasts from the speed at its beginning: v/a, of both axes the longer.
    pub ramp: Duration,
}

/// What became of commands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// What should not have been; the first few.
    pub faults: Vec<String>,
    /// Every stop for age.
    pub stops: Vec<Stop>,
    /// Rounds in which the motors were told to move.
    pub moving_rounds: usize,
}

impl Evaluation {
    /// Fails where there is a fault.
    pub fn assert_no_faults(&self) {
        let faults = self.faults.join("\n");
        assert!(self.faults.is_empty(), "{faults}");
    }
}

/// Judges a run by the journals of everybody who drove in it. Every round must keep these rules:
///
/// 1. The age that the vehicle reckons with is no less than the time since the command was built.
/// 2. Beyond the greatest age the output follows the stopping ramp: it never grows, and falls at least as fast.
/// 3. Nothing is done that was not asked for: what is said to be requested was sent, by who drives.
/// 4. Once it stands, it moves only by a command before which nothing was pressed, for long enough, since it moved.
/// 5. It moves only while it says that it is `driving` or `stopping`.
pub fn evaluate(log: &DriveLog, journals: &[&Journal], limits: &Limits) -> Evaluation {
    let mut verdict = Evaluation::default();
    let mut before: Option<&Round> = None;
    // The last command in force while the vehicle moved, but for those that let go and made it stop.
    let mut moved_by: Option<Sent> = None;
    for round in &log.rounds {
        let sent = command_in_force(round, journals);
        let mut faults = Vec::new();
        faults.extend(age_is_no_less(round, sent.as_ref()));
        if let Some(before) = before {
            faults.extend(old_commands_stop(before, round, limits));
        }
        faults.extend(matches_request(round, sent.as_ref()));
        let is_standing = before.is_none_or(Round::is_stopped);
        // A key that is held before an obstacle goes on counting.
        let was_guarded =
            before.is_some_and(|before| before.mode == "driving" && before.clamp == "guard");
        if is_standing && !was_guarded && !round.is_stopped() {
            let journal = journals.iter().find(|journal| is_of(journal, round));
            faults.extend(pressed_after_neutral(
                round,
                journal.copied(),
                moved_by.as_ref(),
                sent.as_ref(),
            ));
        }
        if !round.is_stopped() {
            verdict.moving_rounds += 1;
            let is_pressed = |sent: &Sent| sent.input != Input::NEUTRAL;
            moved_by = sent.filter(is_pressed).or(moved_by);
            if round.mode != "driving" && round.mode != "stopping" {
                faults.push(format!("it moves and says that it is {}", round.mode));
            }
        }
        for fault in faults {
            if verdict.faults.len() < MAX_REPORTED_FAULTS {
                let at = round.at.since(Monotonic::default());
                verdict.faults.push(format!("{at:?}: {fault}: {round:?}"));
            }
        }
        before = Some(round);
    }
    verdict.stops = stops(log, limits);
    verdict
}

fn is_of(journal: &Journal, round: &Round) -> bool {
    round
        .seq
        .and_then(|seq| journal.find(seq))
        .is_some_and(|sent| sent.epoch == round.epoch)
}

fn command_in_force(round: &Round, journals: &[&Journal]) -> Option<Sent> {
    let seq = round.seq?;
    let mut found = journals.iter().filter_map(|journal| journal.find(seq));
    found.find(|sent| sent.epoch == round.epoch).copied()
}

fn age_is_no_less(round: &Round, sent: Option<&Sent>) -> Option<String> {
    let (sent, age) = (sent?, round.age?);
    let least = round.at.since(sent.token_received.min(sent.at));
    (age + AGE_STEP < least).then(|| format!("command {} is {least:?} old at least", sent.seq))
}

fn old_commands_stop(before: &Round, round: &Round, limits: &Limits) -> Option<String> {
    if round.age? <= limits.max_age + AGE_STEP {
        return None;
    }
    let elapsed_s = round.at.since(before.at).as_secs_f64();
    let is_too_fast = (0..2).any(|axis| {
        let (was, is) = (before.output[axis], round.output[axis]);
        let most = (was.abs() - limits.stop_decel[axis] * elapsed_s).max(0.0);
        is.abs() > most + SPEED_STEP || is * was < 0.0
    });
    is_too_fast.then(|| {
        format!(
            "a command of {:?} moves it; before, {:?} were told",
            round.age, before.output
        )
    })
}

fn matches_request(round: &Round, sent: Option<&Sent>) -> Option<String> {
    let zero = round.requested.iter().all(|speed| speed.abs() <= 0.0);
    if zero {
        return None;
    }
    let Some(sent) = sent else {
        return Some("nobody sent that".to_owned());
    };
    let Input {
        linear_mps,
        angular_radps,
    } = sent.input;
    let asked = [linear_mps, angular_radps].map(f64::from);
    let differs = (0..2).any(|axis| (asked[axis] - round.requested[axis]).abs() > REQUEST_STEP);
    differs.then(|| format!("{asked:?} was asked for"))
}

/// Rule 4, of the round in which the vehicle begins to move.
fn pressed_after_neutral(
    round: &Round,
    journal: Option<&Journal>,
    moved_by: Option<&Sent>,
    sent: Option<&Sent>,
) -> Option<String> {
    let (Some(journal), Some(sent), Some(seq)) = (journal, sent, round.seq) else {
        return Some("it sets off by itself".to_owned());
    };
    let after = moved_by.map_or(0, |moved_by| {
        // Another driver's numbers mean nothing here.
        let is_same = journal.find(moved_by.seq) == Some(moved_by);
        if is_same { moved_by.seq } else { 0 }
    });
    let neutral = journal.between(after, seq).iter().rev();
    let mut neutral = neutral
        .skip_while(|one| one.input == sent.input)
        .take_while(|one| one.input == Input::NEUTRAL && one.epoch == sent.epoch);
    let lasted = neutral.next().map_or(Duration::ZERO, |last| {
        let first = neutral.last().unwrap_or(last);
        last.at.since(first.at)
    });
    (lasted < NEUTRAL).then(|| {
        format!("before command {seq} nothing was pressed for {lasted:?}, after command {after}")
    })
}

fn stops(log: &DriveLog, limits: &Limits) -> Vec<Stop> {
    let mut stops = Vec::new();
    for (at, pair) in log.rounds.windows(2).enumerate() {
        let [before, round] = pair else { continue };
        let is_old = |round: &Round| round.age.is_some_and(|age| age > limits.max_age);
        if before.mode != "driving" || is_old(before) || !is_old(round) {
            continue;
        }
        let Some(issued) = round.issued() else {
            continue;
        };
        let rest = log.rounds.get(at + 1..).unwrap_or_default();
        let end = rest
            .iter()
            .find(|later| later.is_stopped() || !is_old(later))
            .filter(|later| later.is_stopped());
        let ramp_s = (0..2)
            .map(|axis| before.output[axis].abs() / limits.stop_decel[axis])
            .fold(0.0, f64::max);
        stops.push(Stop {
            issued,
            fell_after: round.at.since(issued),
            stood_after: end.map(|end| end.at.since(round.at)),
            ramp: Duration::from_secs_f64(ramp_s),
        });
    }
    stops
}

#[cfg(test)]
mod tests;
