//! What `robot-edge simulate --drive-log` wrote: one line for each round of the loop that drives.

mod evaluation;
mod latency;

use std::time::Duration;

use measurement::time::Monotonic;

pub use evaluation::{Evaluation, Limits, Stop, evaluate};
pub use latency::press_latencies;

/// The columns that are relied on, in this order.
const COLUMNS: &str = "t_ns,mode,requested_linear_mps,requested_angular_radps,output_linear_mps,output_angular_radps,\
                       age_ms,epoch,seq,clamp,guard";

/// Speeds of `base_link`: along x, m/s, and about z, rad/s.
pub type Speeds = [f64; 2];

/// The end of one round of the loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Round {
    /// When it ended, by this machine's clock.
    pub at: Monotonic,
    /// What the vehicle was doing: `driving`, `held`, ….
    pub mode: String,
    /// What the last command taken asked for.
    pub requested: Speeds,
    /// What the motors were told.
    pub output: Speeds,
    /// An upper bound on the age of the last command taken; `None` where there is none under this grant.
    pub age: Option<Duration>,
    /// The grant of the lease.
    pub epoch: u64,
    /// Number of the last command taken under it.
    pub seq: Option<u64>,
    /// What made the output differ from what was asked; empty for nothing.
    pub clamp: String,
    /// What the collision monitor said.
    pub guard: String,
}

impl Round {
    /// Whether the motors were told zero.
    pub fn is_stopped(&self) -> bool {
        self.output.iter().all(|speed| speed.abs() <= 0.0)
    }

    /// When the token of the last command taken was issued.
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
    /// Rounds that the disk did not follow.
    pub missing: u64,
}

impl DriveLog {
    /// Reads a log; a last line that is not yet whole is left out. Fails at the first line that is none, and says which.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_are_read_and_what_is_missing_is_counted() {
        let csv = format!(
            "{COLUMNS}\n\
             7000000000,held,0.0000,0.0000,0.000000,0.000000,,3,,,off\n\
             # 12 rounds are missing: the disk did not follow\n\
             7040000000,driving,0.2500,-0.5000,0.010000,-0.020000,31.250,3,17,ramp,on\n\
             7060000000,dri"
        );
        let log = DriveLog::parse(&csv).unwrap();
        assert_eq!(log.missing, 12);
        let [held, driving] = &log.rounds[..] else {
            panic!("{log:?}")
        };
        assert!(held.is_stopped() && held.age.is_none() && held.seq.is_none());
        assert_eq!(
            driving.output.map(f64::to_bits),
            [0.01_f64, -0.02].map(f64::to_bits)
        );
        assert_eq!(driving.seq, Some(17));
        let issued = Monotonic::from_nanos(7_008_750_000);
        assert_eq!(driving.issued(), Some(issued));
        assert_eq!(log.periods(), [Duration::from_millis(40)]);
        assert_eq!(log.since(driving.at).len(), 1);
        assert_eq!(log.during(held.at, driving.at).len(), 1);
        for wrong in [
            csv.replace("31.250", "-1"),
            csv.replace(",ramp", ""),
            csv.replace("t_ns", "t"),
        ] {
            assert!(
                DriveLog::parse(&wrong).unwrap_err().starts_with("line"),
                "{wrong}"
            );
        }
    }
}
