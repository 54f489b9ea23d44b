//! The CSV file of `--drive-log`, one line for each round of the teleop loop, and its comparison with the commands of operators.
//!
//! Independent of the arbiter: it knows when a command was built, by the same clock, and the motor output.

use std::time::Duration;

use measurement::time::Monotonic;

use crate::operator::{Input, Journal, Sent};

const COLUMNS: &str = "t_ns,mode,requested_linear_mps,requested_lateral_mps,requested_angular_radps,\
                       output_linear_mps,output_lateral_mps,output_angular_radps,age_ms,epoch,seq,clamp,collision_monitor";

/// Speeds of `base_link`: along x and y, m/s, and about z, rad/s.
pub type Speeds = [f64; 3];

/// The end of one round of the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Round {
    /// When it ended, by this machine's clock.
    pub at: Monotonic,
    /// State: `driving`, `held`, ….
    pub mode: String,
    /// Request of the last accepted command.
    pub requested: Speeds,
    pub output: Speeds,
    /// Upper bound on the age of the last accepted command; `None` if there is none under this grant.
    pub age: Option<Duration>,
    /// The grant of the lease.
    pub epoch: u64,
    /// Number of the last command accepted under it.
    pub seq: Option<u64>,
    /// Why the output differs from the request; empty if it does not.
    pub clamp: String,
    pub collision_monitor: String,
}

impl Round {
    pub fn is_stopped(&self) -> bool {
        self.output.iter().all(|speed| speed.abs() <= 0.0)
    }

    /// When the token of the last accepted command was issued.
    pub fn issued(&self) -> Option<Monotonic> {
        let at = self.at.since(Monotonic::default());
        let issued = at.checked_sub(self.age?)?;
        Some(Monotonic::default() + issued)
    }
}

/// The rounds of one run of a robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriveLog {
    pub rounds: Vec<Round>,
    /// Rounds that were not written in time.
    pub missing: u64,
}

impl DriveLog {
    /// Reads a log and ignores an incomplete last line. Fails at the first invalid line, with its number.
    pub fn parse(csv: &str) -> Result<Self, String> {
        let mut lines = csv.split_inclusive('\n');
        let first = lines.next().unwrap_or_default().trim_end();
        if first != COLUMNS {
            return Err(format!("line 1 is {first:?}, not {COLUMNS:?}"));
        }
        let mut log = Self::default();
        for (number, line) in (2..).zip(lines) {
            let Some(line) = line.strip_suffix('\n') else {
                break;
            };
            let wrong = || format!("line {number}: {line:?}");
            if let Some(words) = line.strip_prefix("# ") {
                let missing = words.split(' ').next().and_then(|count| count.parse().ok());
                log.missing += missing.unwrap_or(0_u64);
            } else {
                log.rounds.push(parse_round(line).ok_or_else(wrong)?);
            }
        }
        Ok(log)
    }

    /// The rounds that ended at `from` or later.
    pub fn since(&self, from: Monotonic) -> &[Round] {
        let first = self.rounds.partition_point(|round| round.at < from);
        self.rounds.get(first..).unwrap_or_default()
    }

    /// The rounds from `from` to just before `to`.
    pub fn during(&self, from: Monotonic, to: Monotonic) -> &[Round] {
        let rounds = self.since(from);
        let last = rounds.partition_point(|round| round.at < to);
        rounds.get(..last).unwrap_or_default()
    }

    pub fn periods(&self) -> Vec<Duration> {
        let pairs = self.rounds.windows(2);
        pairs.map(|pair| pair[1].at.since(pair[0].at)).collect()
    }
}

fn parse_round(line: &str) -> Option<Round> {
    let fields: [&str; 13] = line.split(',').collect::<Vec<_>>().try_into().ok()?;
    let [
        at,
        mode,
        requested_x,
        requested_y,
        requested_z,
        output_x,
        output_y,
        output_z,
        age,
        epoch,
        seq,
        clamp,
        collision_monitor,
    ] = fields;
    let speeds =
        |x: &str, y: &str, z: &str| Some([x.parse().ok()?, y.parse().ok()?, z.parse().ok()?]);
    let age = match age {
        "" => None,
        age => {
            let millis: f64 = age.parse().ok()?;
            Some(Duration::try_from_secs_f64(millis / 1e3).ok()?)
        }
    };
    let seq = match seq {
        "" => None,
        seq => Some(seq.parse().ok()?),
    };
    Some(Round {
        at: Monotonic::from_nanos(at.parse().ok()?),
        mode: mode.to_owned(),
        requested: speeds(requested_x, requested_y, requested_z)?,
        output: speeds(output_x, output_y, output_z)?,
        age,
        epoch: epoch.parse().ok()?,
        seq,
        clamp: clamp.to_owned(),
        collision_monitor: collision_monitor.to_owned(),
    })
}

/// For each press of a journal, the time from its first command to the end of the first round in which it
/// moved the motors; `None` if it was released before.
pub fn press_latencies(log: &DriveLog, journal: &Journal) -> Vec<Option<Duration>> {
    let sent = journal.sent();
    let presses = sent.windows(2).filter_map(|pair| {
        let is_press = pair[0].input == Input::NEUTRAL && pair[1].input != Input::NEUTRAL;
        is_press.then_some(pair[1])
    });
    presses
        .map(|press| {
            let released = journal
                .between(press.seq, u64::MAX)
                .iter()
                .find(|later| later.input == Input::NEUTRAL)
                .map_or(u64::MAX, |later| later.seq);
            let is_moved_by_it =
                |seq: Option<u64>| seq.is_some_and(|seq| (press.seq..released).contains(&seq));
            let mut rounds = log.since(press.at).iter();
            let moved = rounds.find(|round| {
                round.epoch == press.epoch && is_moved_by_it(round.seq) && !round.is_stopped()
            })?;
            Some(moved.at.since(press.at))
        })
        .collect()
}

/// Rounding of outputs in the log, m/s and rad/s.
const SPEED_STEP: f64 = 2e-6;
/// Rounding of requests.
const REQUEST_STEP: f64 = 1e-4;
/// Rounding of ages.
const AGE_STEP: Duration = Duration::from_micros(2);
/// Faults that are reported; every round may have one.
const MAX_REPORTED_FAULTS: usize = 20;

/// Neutral time that a press needs before it, less the jitter of the link.
const NEUTRAL: Duration = Duration::from_millis(160);

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest age of a command that has an effect.
    pub max_age: Duration,
    /// The stopping ramp: m/s² and rad/s².
    pub stop_decel: [f64; 3],
}

/// A stop because commands had become too old.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// When the token of the last accepted command was issued.
    pub issued: Monotonic,
    /// From then to the first round whose output fell.
    pub fell_after: Duration,
    /// From that round to the first with an output of zero; `None` if commands came back before.
    pub stood_after: Option<Duration>,
    /// Duration of the stopping ramp: v/a, the longer of both axes.
    pub ramp: Duration,
}

/// Result of [`evaluate`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    pub faults: Vec<String>,
    pub stops: Vec<Stop>,
    /// Rounds with an output other than zero.
    pub moving_rounds: usize,
}

impl Evaluation {
    pub fn assert_no_faults(&self) {
        let faults = self.faults.join("\n");
        assert!(self.faults.is_empty(), "{faults}");
    }
}

/// Checks a run against the journals of all its drivers. Every round must keep these rules:
///
/// 1. The age that the vehicle uses is no less than the time since the command was built.
/// 2. Beyond the greatest age the output follows the stopping ramp: it never grows, and falls at least as fast.
/// 3. The logged request was sent, by the driver.
/// 4. A standing vehicle moves only by a command after a neutral time that began after its last motion.
/// 5. It moves only in the modes `driving` and `stopping`.
pub fn evaluate(log: &DriveLog, journals: &[&Journal], limits: &Limits) -> Evaluation {
    let mut verdict = Evaluation::default();
    let mut before: Option<&Round> = None;
    // The last command in force while the vehicle moved; neutral commands do not count.
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
        // A key held before an obstacle needs no new press.
        let was_limited = before
            .is_some_and(|before| before.mode == "driving" && before.clamp == "collision_monitor");
        if is_standing && !was_limited && !round.is_stopped() {
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
                faults.push(format!("it moves in mode {}", round.mode));
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
    let is_too_fast = (0..3).any(|axis| {
        let (was, is) = (before.output[axis], round.output[axis]);
        let most = (was.abs() - limits.stop_decel[axis] * elapsed_s).max(0.0);
        is.abs() > most + SPEED_STEP || is * was < 0.0
    });
    is_too_fast.then(|| {
        format!(
            "a command of {:?} moves it; the output before was {:?}",
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
        return Some("no operator sent that".to_owned());
    };
    let Input {
        linear_mps,
        lateral_mps,
        angular_radps,
    } = sent.input;
    let asked = [linear_mps, lateral_mps, angular_radps].map(f64::from);
    let differs = (0..3).any(|axis| (asked[axis] - round.requested[axis]).abs() > REQUEST_STEP);
    differs.then(|| format!("{asked:?} was requested"))
}

/// Rule 4, for a round in which the vehicle begins to move.
fn pressed_after_neutral(
    round: &Round,
    journal: Option<&Journal>,
    moved_by: Option<&Sent>,
    sent: Option<&Sent>,
) -> Option<String> {
    let (Some(journal), Some(sent), Some(seq)) = (journal, sent, round.seq) else {
        return Some("it starts without a command".to_owned());
    };
    let after = moved_by.map_or(0, |moved_by| {
        // Numbers of another driver are unrelated.
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
    (lasted < NEUTRAL)
        .then(|| format!("command {seq} follows {lasted:?} of neutral, after command {after}"))
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
        let ramp_s = (0..3)
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
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        max_age: Duration::from_millis(400),
        stop_decel: [1.0, 1.0, 4.0],
    };

    const PRESSED: Input = Input::of(0.2, 0.0);

    fn at_ms(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    /// A command every 20 ms: neutral for 400 ms, then a key until 3 s, except neutral from 2 s to 2.3 s. Each
    /// carries a token received 10 ms before.
    fn journal() -> Journal {
        let mut journal = Journal::default();
        for seq in 1..150 {
            let at = 20 * seq;
            let is_neutral = at < 400 || (2000..2300).contains(&at);
            journal.push(Sent {
                at: at_ms(at),
                seq,
                epoch: 5,
                token: seq,
                token_received: at_ms(at - 10),
                input: if is_neutral { Input::NEUTRAL } else { PRESSED },
            });
        }
        journal
    }

    /// A round every 20 ms, 5 ms after the command, whose token was issued 30 ms before. Commands from 1 s to 1.6 s
    /// are lost.
    fn log() -> DriveLog {
        let mut rounds: Vec<Round> = Vec::new();
        for seq in 2..150 {
            let at = 20 * seq + 5;
            let arrived = if (1000..1600).contains(&at) { 49 } else { seq };
            let issued = 20 * arrived - 25;
            let age = at - issued;
            let was = rounds.last().map_or(0.0, |round| round.output[0]);
            let (mode, is) = if age > 400 {
                ("stopping", f64::max(was - 0.02, 0.0))
            } else if at < 400 || (1400..2300).contains(&at) {
                ("held", 0.0)
            } else {
                ("driving", f64::min(was + 0.01, 0.2))
            };
            let asked = if at < 400 || (2000..2300).contains(&at) {
                0.0
            } else {
                0.2
            };
            rounds.push(Round {
                at: at_ms(at),
                mode: mode.to_owned(),
                requested: [asked, 0.0, 0.0],
                // As the log rounds it.
                output: [(is * 1e6).round() / 1e6, 0.0, 0.0],
                age: Some(Duration::from_millis(age)),
                epoch: 5,
                seq: Some(arrived),
                clamp: String::new(),
                collision_monitor: "on".to_owned(),
            });
        }
        DriveLog { rounds, missing: 0 }
    }

    fn verdict(log: &DriveLog) -> Evaluation {
        evaluate(log, &[&journal()], &LIMITS)
    }

    /// The changed round must be the first fault.
    fn is_faulted(at: u64, change: impl Fn(&mut Round), says: &str) {
        let mut log = log();
        let mut rounds = log.rounds.iter_mut();
        change(rounds.find(|round| round.at == at_ms(at)).unwrap());
        let verdict = verdict(&log);
        let fault = verdict.faults.first().expect(says);
        assert!(fault.contains(says), "{fault}");
        assert!(
            fault.starts_with(&format!("{:?}", Duration::from_millis(at))),
            "{fault}"
        );
    }

    #[test]
    fn a_run_within_the_rules_has_no_faults() {
        let verdict = verdict(&log());
        assert_eq!(verdict.faults, [""; 0]);
        let [stop] = verdict.stops[..] else {
            panic!("{:?}", verdict.stops)
        };
        assert_eq!(stop.issued, at_ms(955));
        assert_eq!(stop.fell_after, Duration::from_millis(410));
        assert_eq!(stop.stood_after, Some(Duration::from_millis(180)));
        assert_eq!(stop.ramp, Duration::from_millis(200));
        assert!(verdict.moving_rounds > 60, "{}", verdict.moving_rounds);
    }

    #[test]
    fn each_broken_rule_is_a_fault() {
        is_faulted(
            705,
            |round| round.age = Some(Duration::from_millis(14)),
            "command 35 is 15ms old at least",
        );
        // 19 mm/s less in a round that must take 20 mm/s off.
        is_faulted(1365, |round| round.output[0] += 0.001, "moves it");
        is_faulted(1425, |round| round.output[0] = -0.01, "moves it");
        is_faulted(1425, |round| round.output[2] = 0.5, "moves it");
        is_faulted(705, |round| round.requested[2] = 0.3, "was requested");
        is_faulted(705, |round| round.seq = Some(999), "no operator sent that");
        is_faulted(705, |round| round.epoch = 4, "no operator sent that");
        is_faulted(
            705,
            |round| "held".clone_into(&mut round.mode),
            "in mode held",
        );
        // A key that was not released.
        is_faulted(
            1705,
            |round| {
                round.output[0] = 0.001;
                "driving".clone_into(&mut round.mode);
            },
            "follows 0ns of neutral, after command 49",
        );
        is_faulted(105, |round| round.output[0] = 0.001, "of neutral");
        is_faulted(
            45,
            |round| {
                round.output[0] = 0.001;
                round.seq = None;
                "driving".clone_into(&mut round.mode);
            },
            "without a command",
        );
    }
}
