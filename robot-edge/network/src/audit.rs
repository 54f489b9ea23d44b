//! The audit log: who connected, who drove, who stopped the vehicle, who was refused.
//!
//! An append-only file of JSON lines. A thread of its own writes it: callers never wait. If the disk is full or slow,
//! lines are dropped and counted, and driving goes on.
//!
//! A log of `FILE_BYTES` is renamed: `audit.jsonl` to `audit.jsonl.1`, that to `audit.jsonl.2` and so on, as
//! `logrotate` does. `OLD_FILES` are kept; the oldest is deleted then, which the first line of the new log reports.

mod connections;

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde_json::json;

use crate::clock;

use connections::ConnectionSummary;

pub use connections::LinkEvent;

const MAX_WAITING: usize = 1024;
/// A log that would become larger is renamed: lines are never split.
const FILE_BYTES: u64 = 16 << 20;
/// So many renamed ones are kept.
const OLD_FILES: u32 = 8;
const POLL_PERIOD: Duration = Duration::from_millis(100);

#[derive(Clone, Debug)]
pub struct Audit {
    entry: SyncSender<AuditEntry>,
    lost: Arc<AtomicU64>,
}

/// The log. Dropping it writes all waiting lines and closes it.
#[derive(Debug)]
pub struct AuditLog {
    audit: Audit,
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
enum AuditEntry {
    Line(Line),
    /// A link was set up or has ended, at this time, seconds since 1970.
    Link(LinkEvent, u64),
}

#[derive(Debug, PartialEq, Eq)]
struct Line {
    /// Seconds since 1970.
    at_s: u64,
    kind: &'static str,
    /// What was refused, in a word for programs; absent where nothing was.
    what: Option<&'static str>,
    message: String,
}

impl Audit {
    /// Queues a line: kind and message of an event.
    pub fn write(&self, kind: &'static str, message: impl Into<String>) {
        self.write_line(kind, None, message.into());
    }

    /// Queues a refusal: `what` for programs, and a message.
    pub fn write_refused(&self, what: &'static str, message: impl Into<String>) {
        self.write_line("refused", Some(what), message.into());
    }

    fn write_line(&self, kind: &'static str, what: Option<&'static str>, message: String) {
        self.enqueue(AuditEntry::Line(Line {
            at_s: clock::seconds_since_1970(),
            kind,
            what,
            message,
        }));
    }

    /// Writes down that a link was set up or has ended: in a line of its own, or with others of the same minute.
    pub fn write_link(&self, link: LinkEvent) {
        self.enqueue(AuditEntry::Link(link, clock::seconds_since_1970()));
    }

    fn enqueue(&self, entry: AuditEntry) {
        if self.entry.try_send(entry).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl AuditLog {
    /// Opens the log at `path`, which is made if it is not there. `run` names this run of the program in every line.
    pub fn open(path: &Path, run: String) -> io::Result<Self> {
        Self::with_limit(path, run, FILE_BYTES)
    }

    fn with_limit(path: &Path, run: String, file_bytes: u64) -> io::Result<Self> {
        let file = open_to_append(path)?;
        let (entry, waiting) = sync_channel(MAX_WAITING);
        let audit = Audit {
            entry,
            lost: Arc::default(),
        };
        let is_closing = Arc::new(AtomicBool::new(false));
        let mut writer = Writer {
            file,
            file_bytes,
            path: path.to_owned(),
            run,
            lost: Arc::clone(&audit.lost),
            has_failed: false,
            connections: ConnectionSummary::default(),
        };
        let is_over = Arc::clone(&is_closing);
        let thread = thread::Builder::new()
            .name("audit".to_owned())
            .spawn(move || writer.write_all(&waiting, &is_over))?;
        Ok(Self {
            audit,
            is_closing,
            thread: Some(thread),
        })
    }

    pub fn audit(&self) -> Audit {
        self.audit.clone()
    }
}

impl Drop for AuditLog {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that writes the audit log failed");
        }
    }
}

fn open_to_append(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.append(true).create(true);
    restrict(&mut options);
    options.open(path)
}

#[cfg(unix)]
fn restrict(options: &mut OpenOptions) {
    use std::os::unix::fs::OpenOptionsExt as _;
    options.mode(0o640);
}

#[cfg(not(unix))]
fn restrict(_options: &mut OpenOptions) {}

struct Writer {
    file: File,
    /// Longer, it is renamed; a device never is.
    file_bytes: u64,
    path: PathBuf,
    run: String,
    lost: Arc<AtomicU64>,
    has_failed: bool,
    connections: ConnectionSummary,
}

impl Writer {
    fn write_all(&mut self, waiting: &Receiver<AuditEntry>, is_over: &AtomicBool) {
        loop {
            // Asked first: what came before it closes is written.
            let is_last = is_over.load(Ordering::Relaxed);
            let mut lines = Vec::new();
            match waiting.recv_timeout(POLL_PERIOD) {
                Ok(first) => {
                    let all = std::iter::once(first).chain(waiting.try_iter());
                    for entry in all.take(MAX_WAITING) {
                        self.take(entry, &mut lines);
                    }
                }
                Err(RecvTimeoutError::Timeout) if !is_last => {}
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    let rest = self.connections.end();
                    self.write(rest);
                    return;
                }
            }
            lines.extend(self.connections.due(clock::now()));
            self.write(lines);
        }
    }

    fn take(&mut self, entry: AuditEntry, lines: &mut Vec<Line>) {
        match entry {
            AuditEntry::Line(line) => {
                lines.extend(self.connections.flush_pending());
                lines.push(line);
            }
            AuditEntry::Link(link, at_s) => {
                lines.extend(self.connections.record(link, at_s, clock::now()));
            }
        }
    }

    /// Writes what there is, and lets the disk have it.
    fn write(&mut self, lines: Vec<Line>) {
        if lines.is_empty() {
            return;
        }
        let is_full = self.bytes().is_some_and(|bytes| bytes >= self.file_bytes);
        let deleted = is_full.then(|| self.rotate()).flatten();
        let before = self.bytes();
        // What is not written after all, with what its lines would have contained.
        let (mut text, mut pending_lines) = (String::new(), 0);
        for line in deleted.into_iter().chain(lines) {
            let Line {
                at_s,
                kind,
                what,
                message,
            } = line;
            let mut fields = json!({
                "time": clock::utc_label(at_s),
                "run": self.run,
                "kind": kind,
                "message": message,
            });
            if let Some(what) = what {
                fields["what"] = json!(what);
            }
            let lost = self.lost.swap(0, Ordering::Relaxed);
            pending_lines += 1 + lost;
            if lost > 0 {
                fields["lost_before"] = json!(lost);
            }
            text.push_str(&fields.to_string());
            text.push('\n');
        }
        let written = self
            .file
            .write_all(text.as_bytes())
            .and_then(|()| self.file.sync_data());
        match written {
            Ok(()) => self.has_failed = false,
            Err(why) => {
                // Half a line would make the next one unreadable too.
                drop(before.map(|bytes| self.file.set_len(bytes)));
                self.lost.fetch_add(pending_lines, Ordering::Relaxed);
                if !self.has_failed {
                    tracing::error!(%why, path = %self.path.display(), "the audit log cannot be written");
                }
                self.has_failed = true;
            }
        }
    }

    /// How long the file is; `None` of a device.
    fn bytes(&self) -> Option<u64> {
        let found = self.file.metadata().ok()?;
        found.is_file().then_some(found.len())
    }

    /// Begins a new file; says so in its first line where old lines are deleted for that. Where the system refuses, the
    /// log goes on in the file that it has.
    fn rotate(&mut self) -> Option<Line> {
        let renamed = rename_old(&self.path).and_then(|was_deleted| {
            self.file = open_to_append(&self.path)?;
            sync_folder_of(&self.path);
            Ok(was_deleted)
        });
        let was_deleted = renamed.unwrap_or_else(|why| {
            tracing::error!(%why, path = %self.path.display(), "the audit log cannot be renamed, and grows");
            self.file_bytes = u64::MAX;
            false
        });
        was_deleted.then(|| Line {
            at_s: clock::seconds_since_1970(),
            kind: "log_deleted",
            what: None,
            message: format!("the oldest log was deleted: {OLD_FILES} old ones are kept"),
        })
    }
}

/// Or a power cut leaves a file that no folder knows. Some folders cannot be synced: the log goes on.
fn sync_folder_of(path: &Path) {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let folder = folder.unwrap_or(Path::new("."));
    if let Err(error) = File::open(folder).and_then(|folder| folder.sync_all()) {
        tracing::warn!(folder = %folder.display(), %error, "the folder cannot be synced");
    }
}

/// Makes `path` free: each file takes the next number, up to the first that is free. Says whether none was, and the
/// oldest file is deleted by that.
///
/// A crash in between leaves a number free, and every line in some file.
fn rename_old(path: &Path) -> io::Result<bool> {
    let numbered = |number: u32| {
        let mut name = path.as_os_str().to_owned();
        if number > 0 {
            name.push(format!(".{number}"));
        }
        PathBuf::from(name)
    };
    let free = (1..=OLD_FILES).find(|&number| !numbered(number).exists());
    for number in (0..free.unwrap_or(OLD_FILES)).rev() {
        fs::rename(numbered(number), numbered(number + 1))?;
    }
    Ok(free.is_none())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_added_in_order_and_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        for run in ["one", "two"] {
            let log = AuditLog::open(&path, run.to_owned()).unwrap();
            let audit = log.audit();
            for n in 0..100 {
                audit.write("lease_granted", format!("{n} \"quoted\"\nand broken"));
            }
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<serde_json::Value> = text
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert_eq!(lines.len(), 200);
        for (n, line) in lines.iter().enumerate() {
            assert_eq!(line["run"], ["one", "two"][n / 100]);
            assert_eq!(
                line["message"],
                format!("{} \"quoted\"\nand broken", n % 100)
            );
            assert_eq!(line["time"].as_str().unwrap().len(), 20);
        }
    }

    /// Through more files than are kept, and over restarts.
    #[test]
    fn a_full_log_is_renamed_and_deletions_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let lines = |path: &Path| -> Vec<serde_json::Value> {
            let text = fs::read_to_string(path).unwrap();
            assert!(text.ends_with('\n'), "a line was split");
            let lines = text.lines().map(|line| serde_json::from_str(line).unwrap());
            lines.collect()
        };
        let mut runs = 0;
        // Each run fills what is left of a file, and begins the next.
        let mut run = || {
            runs += 1;
            let log = AuditLog::with_limit(&path, format!("{runs}"), 1_000).unwrap();
            for n in 0..4 {
                log.audit()
                    .write("refused", format!("{n}{}", " ".repeat(240)));
            }
        };
        for _ in 0..=OLD_FILES {
            run();
        }
        let numbered = |number: u32| PathBuf::from(format!("{}.{number}", path.display()));
        // The oldest has the highest number, and no line is lost.
        let mut all = Vec::new();
        for number in (1..=OLD_FILES).rev() {
            all.extend(lines(&numbered(number)));
        }
        all.extend(lines(&path));
        let found: Vec<_> = all
            .iter()
            .map(|line| {
                (
                    line["run"].clone(),
                    line["message"].as_str().unwrap().trim().to_owned(),
                )
            })
            .collect();
        let expected = (1..=OLD_FILES + 1)
            .flat_map(|run| (0..4).map(move |n| (json!(run.to_string()), n.to_string())));
        assert_eq!(found, expected.collect::<Vec<_>>());

        run();
        let deleted = lines(&path)
            .into_iter()
            .find(|line| line["kind"] == "log_deleted")
            .unwrap();
        assert_eq!(
            deleted["message"],
            "the oldest log was deleted: 8 old ones are kept"
        );
        assert!(!numbered(OLD_FILES + 1).exists());
        assert_eq!(lines(&numbered(OLD_FILES))[0]["run"], "2");

        // As a crash between two renamings leaves them: that number is taken first, and nothing is deleted.
        fs::rename(numbered(3), folder.path().join("apart")).unwrap();
        let kept = fs::read(numbered(4)).unwrap();
        run();
        assert_eq!(fs::read(numbered(4)).unwrap(), kept);
        assert!(numbered(3).exists());
        assert!(
            lines(&path)
                .iter()
                .all(|line| line["kind"] != "log_deleted")
        );
    }

    #[test]
    fn links_are_logged_before_the_actions_over_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let log = AuditLog::open(&path, "one".to_owned()).unwrap();
        let audit = log.audit();
        let link = |is_up, port: u16| {
            audit.write_link(LinkEvent {
                who: "operator:anna".to_owned(),
                channel: "control",
                from: format!("quic/10.0.0.5:{port}"),
                is_up,
            });
        };
        for (is_up, port) in [(true, 1), (false, 1), (true, 2)] {
            link(is_up, port);
        }
        audit.write("lease_granted", "anna drives");
        for (is_up, port) in [(true, 3), (false, 3), (false, 2)] {
            link(is_up, port);
        }
        drop(log);
        let text = std::fs::read_to_string(&path).unwrap();
        let kinds: Vec<_> = text
            .lines()
            .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["kind"].clone())
            .collect();
        let before = ["connect", "disconnect", "connect", "lease_granted"];
        let after = ["disconnect", "short_connections"];
        assert_eq!(kinds, [&before[..], &after].concat());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_loses_lines_and_nobody_waits() {
        let log = AuditLog::open(Path::new("/dev/full"), "run".to_owned()).unwrap();
        let audit = log.audit();
        let started = clock::now();
        for _ in 0..100_000 {
            audit.write("refused", "x");
        }
        assert!(clock::elapsed(started) < Duration::from_secs(5));
        drop(log);
        assert_eq!(audit.lost.load(Ordering::Relaxed), 100_000);
    }
}
