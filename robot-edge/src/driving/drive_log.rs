//! A log of every round of the loop, for whoever wants to know afterwards what the vehicle was told, and why.

use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};

use crate::clock::Monotonic;
use crate::teleop::report::Clamp;
use crate::teleop::{GuardVerdict, Mode, TeleopReport};

/// Rounds that wait for the disk at most: 80 s of them.
const CAPACITY: usize = 4096;

const HEADER: &str = "t_ns,mode,requested_linear_mps,requested_angular_radps,output_linear_mps,output_angular_radps,\
                      age_ms,epoch,seq,clamp,guard";

/// Where the loop leaves its rounds. A thread of its own writes them as lines of comma-separated values; what it writes
/// is complete up to the last round whatever becomes of the process.
#[derive(Debug)]
pub struct DriveLog {
    rounds: Option<SyncSender<Round>>,
    missed: u64,
    writer: Option<JoinHandle<()>>,
}

/// The end of a round.
#[derive(Clone, Copy, Debug)]
struct Round {
    at: Monotonic,
    report: TeleopReport,
    /// Rounds before it that found no room.
    missed: u64,
}

impl DriveLog {
    /// Begins a log; a file that is there is overwritten.
    ///
    /// # Errors
    /// Where the file cannot be written or the system gives no thread.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut file = BufWriter::new(File::create(path)?);
        writeln!(file, "{HEADER}")?;
        file.flush()?;
        let (rounds, to_write) = sync_channel(CAPACITY);
        let writer = thread::Builder::new()
            .name("drive-log".to_owned())
            .spawn(move || {
                if let Err(error) = write_all(&to_write, &mut file) {
                    tracing::error!(%error, "the drive log cannot be written any more; driving goes on");
                }
            })?;
        Ok(Self {
            rounds: Some(rounds),
            missed: 0,
            writer: Some(writer),
        })
    }

    /// Adds a round, at once: where the disk does not follow it is left out, and the next line says how many were.
    pub(super) fn add(&mut self, at: Monotonic, report: &TeleopReport) {
        let Some(rounds) = &self.rounds else { return };
        let round = Round {
            at,
            report: *report,
            missed: self.missed,
        };
        match rounds.try_send(round) {
            Ok(()) => self.missed = 0,
            Err(TrySendError::Full(_)) => self.missed += 1,
            // The writer said why.
            Err(TrySendError::Disconnected(_)) => self.rounds = None,
        }
    }
}

impl Drop for DriveLog {
    fn drop(&mut self) {
        self.rounds = None;
        if let Some(writer) = self.writer.take()
            && writer.join().is_err()
        {
            tracing::error!("the thread that writes the drive log failed");
        }
    }
}

fn write_all(rounds: &Receiver<Round>, file: &mut impl Write) -> io::Result<()> {
    while let Ok(first) = rounds.recv() {
        write_round(&first, file)?;
        for round in rounds.try_iter() {
            write_round(&round, file)?;
        }
        file.flush()?;
    }
    Ok(())
}

fn write_round(round: &Round, file: &mut impl Write) -> io::Result<()> {
    let Round { at, report, missed } = round;
    if *missed > 0 {
        writeln!(
            file,
            "# {missed} rounds are missing: the disk did not follow"
        )?;
    }
    let age_ms = report.age.map(|age| age.as_secs_f64() * 1e3);
    writeln!(
        file,
        "{},{},{:.4},{:.4},{:.6},{:.6},{},{},{},{},{}",
        at.since(Monotonic::default()).as_nanos(),
        mode(report.mode),
        report.requested.linear_mps,
        report.requested.angular_radps,
        report.applied.linear_mps,
        report.applied.angular_radps,
        OrEmpty(age_ms.map(|age_ms| format!("{age_ms:.3}"))),
        report.lease.epoch,
        OrEmpty(report.last_seq),
        OrEmpty(report.clamp.map(clamp)),
        guard(report.guard),
    )
}

struct OrEmpty<T>(Option<T>);

impl<T: fmt::Display> fmt::Display for OrEmpty<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.as_ref().map_or(Ok(()), |value| value.fmt(f))
    }
}

const fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::SafeBoot => "safe_boot",
        Mode::Idle => "idle",
        Mode::Held => "held",
        Mode::Driving => "driving",
        Mode::Stopping { .. } => "stopping",
        Mode::EStop => "estop",
        Mode::Fault(_) => "fault",
    }
}

const fn clamp(clamp: Clamp) -> &'static str {
    match clamp {
        Clamp::Vehicle => "vehicle",
        Clamp::Age => "age",
        Clamp::Guard => "guard",
        Clamp::Ramp => "ramp",
    }
}

const fn guard(verdict: Option<GuardVerdict>) -> &'static str {
    match verdict {
        None => "silent",
        Some(GuardVerdict::Off) => "off",
        Some(GuardVerdict::Stale) => "stale",
        Some(GuardVerdict::Limits(limits)) if limits.is_blind => "blind",
        Some(GuardVerdict::Limits(_)) => "on",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::VehicleConfig;
    use crate::teleop::{ArbiterState, Rules, TeleopConfig};

    #[test]
    fn every_round_is_a_line_and_what_is_missing_is_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("drive.csv");
        let rules = Rules::new(&TeleopConfig::default(), &VehicleConfig::default()).unwrap();
        let now = Monotonic::from_nanos(7_000_000_000);
        let report = ArbiterState::new(1).report(&rules, now);
        let mut log = DriveLog::create(&path).unwrap();
        log.add(now, &report);
        log.missed = 3;
        log.add(now, &report);
        drop(log);
        let text = std::fs::read_to_string(&path).unwrap();
        let line = "7000000000,safe_boot,0.0000,0.0000,0.000000,0.000000,,0,,,silent";
        assert_eq!(
            text.lines().collect::<Vec<_>>(),
            [
                HEADER,
                line,
                "# 3 rounds are missing: the disk did not follow",
                line
            ]
        );
    }

    #[test]
    fn a_file_that_cannot_be_made_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        assert!(DriveLog::create(&dir.path().join("none/drive.csv")).is_err());
    }
}
