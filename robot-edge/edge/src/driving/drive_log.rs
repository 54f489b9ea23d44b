//! A log of every round of the loop: what was requested, what was applied, and why they differ.

use std::fmt;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use measurement::time::Monotonic;
use network::clock;
use protocol::message::Clamp;
use recording::new_file::{self, NewFile};
use recording::new_file::{DiskSpaceFn, disk_space};
use teleop::{CollisionMonitorOutput, Mode, TeleopReport};

/// Rounds that wait for the disk at most: 80 s of them.
const CAPACITY: usize = 4096;
/// A file ends at this size, some four hours, and the next one begins.
const FILE_BYTES: u64 = 64 << 20;
/// The file is put on the disk this often, and the disk is looked at.
const SYNC_PERIOD: Duration = Duration::from_secs(1);

const HEADER: &str = "t_ns,mode,requested_linear_mps,requested_lateral_mps,requested_angular_radps,\
                      output_linear_mps,output_lateral_mps,output_angular_radps,age_ms,epoch,seq,clamp,collision_monitor";

/// Where the loop leaves its rounds. A thread of its own writes them as lines of comma-separated values; what it writes
/// is complete up to the last round whatever becomes of the process.
#[derive(Debug)]
pub struct DriveLog {
    rounds: Option<SyncSender<Round>>,
    missed: u64,
    writer: Option<JoinHandle<()>>,
}

#[derive(Clone, Copy, Debug)]
struct Round {
    at: Monotonic,
    report: TeleopReport,
    /// Rounds before it that found no room.
    missed: u64,
}

impl DriveLog {
    /// Begins a log in `file`, and goes on in others of its name, each of which begins with the header. Where it cannot
    /// be written any more or the disk is nearly full, `ended` gets the reason, once.
    pub fn start(file: NewFile, ended: impl FnOnce(String) + Send + 'static) -> io::Result<Self> {
        let (rounds, to_write) = sync_channel(CAPACITY);
        let writer = thread::Builder::new()
            .name("drive-log".to_owned())
            .spawn(move || {
                let path = file.path.clone();
                let written = Writer::new(file, FILE_BYTES, disk_space)
                    .and_then(|mut writer| writer.write_all(&to_write));
                if let Err(error) = written {
                    tracing::error!(path = %path.display(), %error, "the drive log ended; driving goes on");
                    ended(format!("the drive log ended, driving goes on: {error}"));
                }
            })?;
        Ok(Self {
            rounds: Some(rounds),
            missed: 0,
            writer: Some(writer),
        })
    }

    /// Adds a round without waiting. If the disk is too slow, the round is dropped and counted in the next line.
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
            // The writer reported why.
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

struct Writer {
    file: NewFile,
    out: BufWriter<std::fs::File>,
    bytes: u64,
    /// Where the log began: the next file is of the same name.
    first: PathBuf,
    file_bytes: u64,
    disk_space: DiskSpaceFn,
    synced_at: Monotonic,
    line: Vec<u8>,
}

impl Writer {
    fn new(file: NewFile, file_bytes: u64, disk_space: DiskSpaceFn) -> io::Result<Self> {
        let mut writer = Self {
            out: BufWriter::new(file.file.try_clone()?),
            first: file.path.clone(),
            file,
            bytes: 0,
            file_bytes,
            disk_space,
            synced_at: clock::now(),
            line: Vec::new(),
        };
        writer.begin()?;
        Ok(writer)
    }

    fn write_all(&mut self, rounds: &Receiver<Round>) -> io::Result<()> {
        while let Ok(first) = rounds.recv() {
            for round in std::iter::once(first).chain(rounds.try_iter()) {
                self.write(&round)?;
            }
            self.out.flush()?;
            if clock::elapsed(self.synced_at) >= SYNC_PERIOD {
                self.sync()?;
            }
        }
        self.file.sync()
    }

    fn write(&mut self, round: &Round) -> io::Result<()> {
        if self.bytes >= self.file_bytes && self.file.is_regular {
            self.out.flush()?;
            self.file.sync()?;
            self.file = new_file::create(&self.first)?;
            self.out = BufWriter::new(self.file.file.try_clone()?);
            self.bytes = 0;
            self.begin()?;
        }
        self.line.clear();
        write_round(round, &mut self.line)?;
        self.bytes += self.line.len() as u64;
        self.out.write_all(&self.line)
    }

    fn begin(&mut self) -> io::Result<()> {
        writeln!(self.out, "{HEADER}")?;
        self.out.flush()?;
        self.sync()
    }

    fn sync(&mut self) -> io::Result<()> {
        self.synced_at = clock::now();
        self.file.sync()?;
        self.file
            .low_space(self.disk_space)
            .map_or(Ok(()), |space| {
                let what = format!("the disk is nearly full: {space}");
                Err(io::Error::new(io::ErrorKind::StorageFull, what))
            })
    }
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
        "{},{},{:.4},{:.4},{:.4},{:.6},{:.6},{:.6},{},{},{},{},{}",
        at.since(Monotonic::default()).as_nanos(),
        mode(report.mode),
        report.requested.linear_mps,
        report.requested.lateral_mps,
        report.requested.angular_radps,
        report.applied.linear_mps,
        report.applied.lateral_mps,
        report.applied.angular_radps,
        OrEmpty(age_ms.map(|age_ms| format!("{age_ms:.3}"))),
        report.lease.epoch,
        OrEmpty(report.last_seq),
        OrEmpty(report.clamp.map(clamp)),
        collision_monitor(report.collision_monitor),
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
        Clamp::Speed => "vehicle",
        Clamp::Age => "age",
        Clamp::CollisionMonitor => "collision_monitor",
        Clamp::Ramp => "ramp",
        Clamp::Stop => "stop",
        Clamp::Locomotion => "locomotion",
    }
}

const fn collision_monitor(output: Option<CollisionMonitorOutput>) -> &'static str {
    match output {
        None => "silent",
        Some(CollisionMonitorOutput::Off) => "off",
        Some(CollisionMonitorOutput::Stale) => "stale",
        Some(CollisionMonitorOutput::Limits(limits)) if limits.in_unknown_space => "unknown_space",
        Some(CollisionMonitorOutput::Limits(_)) => "on",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapping::vehicle::VehicleConfig;
    use recording::new_file::DiskSpace;
    use teleop::{ArbiterState, Rules, TeleopConfig};

    fn report() -> TeleopReport {
        let rules = Rules::new(
            &TeleopConfig::default(),
            &VehicleConfig::default(),
            &teleop::LocomotionConfig::default(),
        )
        .unwrap();
        ArbiterState::new(1).report(&rules, AT)
    }

    const AT: Monotonic = Monotonic::from_nanos(7_000_000_000);
    const LINE: &str =
        "7000000000,safe_boot,0.0000,0.0000,0.0000,0.000000,0.000000,0.000000,,0,,,silent";

    #[test]
    fn every_round_is_a_line_and_what_is_missing_is_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("drive.csv");
        let file = new_file::create(&path).unwrap();
        let mut log = DriveLog::start(file, |why| panic!("{why}")).unwrap();
        log.add(AT, &report());
        log.missed = 3;
        log.add(AT, &report());
        drop(log);
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(
            text.lines().collect::<Vec<_>>(),
            [
                HEADER,
                LINE,
                "# 3 rounds are missing: the disk did not follow",
                LINE
            ]
        );
    }

    fn rounds(count: usize) -> Receiver<Round> {
        let (rounds, to_write) = sync_channel(count);
        for _ in 0..count {
            let round = Round {
                at: AT,
                report: report(),
                missed: 0,
            };
            rounds.send(round).unwrap();
        }
        to_write
    }

    #[test]
    fn a_full_log_is_followed_by_another_with_a_header() {
        let roomy: DiskSpaceFn = |_| {
            Ok(DiskSpace {
                free_bytes: 90_000_000_000,
                total_bytes: 100_000_000_000,
            })
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("drive.csv");
        let two_lines = 2 * (LINE.len() + 1) as u64;
        let file = new_file::create(&path).unwrap();
        // What an earlier run left is between them.
        std::fs::write(dir.path().join("drive-2.csv"), "kept").unwrap();
        let mut writer = Writer::new(file, two_lines, roomy).unwrap();
        writer.write_all(&rounds(5)).unwrap();
        let lines = |name: &str| {
            let text = std::fs::read_to_string(dir.path().join(name)).unwrap();
            assert!(text.ends_with('\n'), "{name}: a line was split");
            let lines: Vec<_> = text.lines().map(str::to_owned).collect();
            assert_eq!(lines[0], HEADER, "{name}");
            assert!(lines[1..].iter().all(|line| line == LINE), "{name}");
            lines.len() - 1
        };
        let names = ["drive.csv", "drive-3.csv", "drive-4.csv"];
        assert_eq!(names.map(lines), [2, 2, 1]);
        let kept = std::fs::read_to_string(dir.path().join("drive-2.csv")).unwrap();
        assert_eq!(kept, "kept");
    }

    #[test]
    fn it_ends_where_the_disk_is_nearly_full() {
        let scarce: DiskSpaceFn = |_| {
            Ok(DiskSpace {
                free_bytes: 900_000_000,
                total_bytes: 10_000_000_000,
            })
        };
        let dir = tempfile::tempdir().unwrap();
        let file = new_file::create(&dir.path().join("drive.csv")).unwrap();
        let ended = Writer::new(file, FILE_BYTES, scarce).err().unwrap();
        let why = "the disk is nearly full: 0.9 of 10.0 GB are free";
        assert_eq!(ended.to_string(), why);
    }

    /// The loop goes on, and one event says why nothing is logged.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_disk_that_is_full_is_said_once() {
        let (says, said) = sync_channel(9);
        let file = new_file::create("/dev/full".as_ref()).unwrap();
        let mut log = DriveLog::start(file, move |why| says.send(why).unwrap()).unwrap();
        let why = said.recv().unwrap();
        assert!(why.contains("driving goes on: No space left"), "{why}");
        while log.rounds.is_some() {
            log.add(AT, &report());
        }
        drop(log);
        assert!(said.recv().is_err(), "said once");
    }
}
