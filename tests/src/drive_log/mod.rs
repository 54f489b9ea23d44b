//! The CSV file of `--drive-log`: one line for each round of the teleop loop.

mod evaluation;

use std::time::Duration;

use measurement::time::Monotonic;

use crate::operator::{Input, Journal};

pub use evaluation::{Evaluation, Limits, Stop, evaluate};

/// The columns in their order.
const COLUMNS: &str = "t_ns,mode,requested_linear_mps,requested_angular_radps,output_linear_mps,output_angular_radps,\
                       age_ms,epoch,seq,clamp,guard";

/// Speeds of `base_link`: along x, m/s, and about z, rad/s.
pub type Speeds = [f64; 2];

/// The end of one round of the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Round {
    /// When it ended, by this machine's clock.
    pub at: Monotonic,
    /// State: `driving`, `held`, ….
    pub mode: String,
    /// Request of the last accepted command.
    pub requested: Speeds,
    /// Output to the motors.
    pub output: Speeds,
    /// Upper bound on the age of the last accepted command; `None` if there is none under this grant.
    pub age: Option<Duration>,
    /// The grant of the lease.
    pub epoch: u64,
    /// Number of the last command accepted under it.
    pub seq: Option<u64>,
    /// Why the output differs from the request; empty if it does not.
    pub clamp: String,
    /// State of the collision monitor.
    pub guard: String,
}

impl Round {
    /// Whether the output is zero.
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
    /// All of them, in the order of time.
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

    /// From each round to the next.
    pub fn periods(&self) -> Vec<Duration> {
        let pairs = self.rounds.windows(2);
        pairs.map(|pair| pair[1].at.since(pair[0].at)).collect()
    }
}

fn parse_round(line: &str) -> Option<Round> {
    let fields: [&str; 11] = line.split(',').collect::<Vec<_>>().try_into().ok()?;
    let [
        at,
        mode,
        requested_x,
        requested_z,
        output_x,
        output_z,
        age,
        epoch,
        seq,
        clamp,
        guard,
    ] = fields;
    let speeds = |x: &str, z: &str| Some([x.parse().ok()?, z.parse().ok()?]);
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
        requested: speeds(requested_x, requested_z)?,
        output: speeds(output_x, output_z)?,
        age,
        epoch: epoch.parse().ok()?,
        seq,
        clamp: clamp.to_owned(),
        guard: guard.to_owned(),
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
