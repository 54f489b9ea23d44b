//! The commands of an operator, with times of the drive log's clock.

use std::io::{self, Write};

use measurement::time::Monotonic;

use super::Input;

/// The first line of a journal as CSV.
const COLUMNS: &str = "t_ns,seq,epoch,token,token_t_ns,linear_mps,angular_radps";

/// One command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sent {
    /// When it was built.
    pub at: Monotonic,
    /// Its number.
    pub seq: u64,
    /// The grant of the lease that it names.
    pub epoch: u64,
    /// Number of its token.
    pub token: u64,
    /// When that token was first received: later than it was issued.
    pub token_received: Monotonic,
    /// The requested speeds.
    pub input: Input,
}

/// All commands of one operator, by rising [`Sent::seq`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Journal {
    sent: Vec<Sent>,
}

impl Journal {
    /// Adds the next command.
    pub fn push(&mut self, sent: Sent) {
        debug_assert!(self.sent.last().is_none_or(|last| last.seq < sent.seq));
        self.sent.push(sent);
    }

    /// All of them.
    pub fn sent(&self) -> &[Sent] {
        &self.sent
    }

    /// The command of that number.
    pub fn find(&self, seq: u64) -> Option<&Sent> {
        let at = self.sent.binary_search_by_key(&seq, |sent| sent.seq).ok()?;
        self.sent.get(at)
    }

    /// Commands with numbers between `after` and `before`.
    pub fn between(&self, after: u64, before: u64) -> &[Sent] {
        let from = self.sent.partition_point(|sent| sent.seq <= after);
        let to = self.sent.partition_point(|sent| sent.seq < before);
        self.sent.get(from..to).unwrap_or_default()
    }

    /// Writes the first line of a CSV file.
    pub fn begin(out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "{COLUMNS}")
    }

    /// Writes one command as a line of it.
    pub fn write(out: &mut impl Write, sent: &Sent) -> io::Result<()> {
        let Sent {
            at,
            seq,
            epoch,
            token,
            token_received,
            input,
        } = sent;
        let [at, received] = [*at, *token_received].map(nanos);
        let Input {
            linear_mps,
            angular_radps,
        } = input;
        let line = format!("{at},{seq},{epoch},{token},{received},{linear_mps},{angular_radps}\n");
        out.write_all(line.as_bytes())
    }

    /// Reads such a file and ignores an incomplete last line.
    ///
    /// Fails at the first other invalid line, with its number.
    pub fn parse(csv: &str) -> Result<Self, String> {
        let mut lines = csv.split_inclusive('\n');
        let first = lines.next().unwrap_or_default().trim_end();
        if first != COLUMNS {
            return Err(format!("line 1 is {first:?}, not {COLUMNS:?}"));
        }
        let mut sent = Vec::new();
        for (number, line) in (2..).zip(lines) {
            let Some(line) = line.strip_suffix('\n') else {
                break;
            };
            sent.push(parse_line(line).ok_or_else(|| format!("line {number}: {line:?}"))?);
        }
        Ok(Self { sent })
    }
}

fn parse_line(line: &str) -> Option<Sent> {
    let mut fields = line.split(',');
    let mut whole = || fields.next()?.parse::<u64>().ok();
    let (at, seq, epoch) = (whole()?, whole()?, whole()?);
    let (token, received) = (whole()?, whole()?);
    let mut speed = || fields.next()?.parse::<f32>().ok();
    let input = Input::of(speed()?, speed()?);
    fields.next().is_none().then(|| Sent {
        at: Monotonic::from_nanos(at),
        seq,
        epoch,
        token,
        token_received: Monotonic::from_nanos(received),
        input,
    })
}

fn nanos(moment: Monotonic) -> u128 {
    moment.since(Monotonic::default()).as_nanos()
}
