//! The audit log: who connected, who drove, who stopped the vehicle, who was refused.
//!
//! A file to which lines of JSON are only ever added. A thread of its own writes it: whoever tells it something never
//! waits, and where the disk is full, or slow, lines are lost and counted, and driving goes on.

mod visits;

use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde_json::json;

use crate::clock::{self, Monotonic};

use visits::Visits;

pub use visits::LinkNews;

/// Lines that wait to be written at most.
const MAX_WAITING: usize = 1024;
/// Longest wait before it is asked whether the log closes.
const NAP: Duration = Duration::from_millis(100);

/// Where lines are left for the log.
#[derive(Clone, Debug)]
pub struct Audit {
    news: SyncSender<News>,
    lost: Arc<AtomicU64>,
}

/// The log. It is closed, with everything that was told before, when this is dropped.
#[derive(Debug)]
pub struct AuditLog {
    audit: Audit,
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// What the log is told.
#[derive(Debug)]
enum News {
    Line(Line),
    /// A link was set up or has ended, at this time, seconds since 1970.
    Link(LinkNews, u64),
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
    /// Writes a line, some time soon: what kind of thing happened, and what in words.
    pub fn write(&self, kind: &'static str, message: impl Into<String>) {
        self.write_line(kind, None, message.into());
    }

    /// Writes down that something was refused: `what`, in a word for programs, and what in words.
    pub fn write_refused(&self, what: &'static str, message: impl Into<String>) {
        self.write_line("refused", Some(what), message.into());
    }

    fn write_line(&self, kind: &'static str, what: Option<&'static str>, message: String) {
        self.tell(News::Line(Line {
            at_s: clock::seconds_since_1970(),
            kind,
            what,
            message,
        }));
    }

    /// Writes down that a link was set up or has ended: in a line of its own, or with others of the same minute.
    pub fn write_link(&self, link: LinkNews) {
        self.tell(News::Link(link, clock::seconds_since_1970()));
    }

    fn tell(&self, news: News) {
        if self.news.try_send(news).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl AuditLog {
    /// Opens the log at `path`, which is made if it is not there. `run` names this run of the program in every line.
    ///
    /// # Errors
    /// Where the file cannot be opened for adding to it, or the system gives no thread.
    pub fn open(path: &Path, run: String) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.append(true).create(true);
        restrict(&mut options);
        let file = options.open(path)?;
        let (news, waiting) = sync_channel(MAX_WAITING);
        let audit = Audit {
            news,
            lost: Arc::default(),
        };
        let is_closing = Arc::new(AtomicBool::new(false));
        let mut writer = Writer {
            file,
            path: path.to_owned(),
            run,
            lost: Arc::clone(&audit.lost),
            has_failed: false,
            visits: Visits::default(),
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

    /// Where to leave lines.
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

#[cfg(unix)]
fn restrict(options: &mut OpenOptions) {
    use std::os::unix::fs::OpenOptionsExt as _;
    options.mode(0o640);
}

#[cfg(not(unix))]
fn restrict(_options: &mut OpenOptions) {}

struct Writer {
    file: File,
    path: PathBuf,
    run: String,
    lost: Arc<AtomicU64>,
    has_failed: bool,
    visits: Visits,
}

impl Writer {
    fn write_all(&mut self, waiting: &Receiver<News>, is_over: &AtomicBool) {
        loop {
            // Asked first: what was told before it closes is written.
            let is_last = is_over.load(Ordering::Relaxed);
            let mut lines = Vec::new();
            match waiting.recv_timeout(NAP) {
                Ok(first) => {
                    let all = std::iter::once(first).chain(waiting.try_iter());
                    for news in all.take(MAX_WAITING) {
                        self.take(news, &mut lines);
                    }
                }
                Err(RecvTimeoutError::Timeout) if !is_last => {}
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    let rest = self.visits.end();
                    self.write(rest);
                    return;
                }
            }
            lines.extend(self.visits.due(Monotonic::now()));
            self.write(lines);
        }
    }

    /// What is to be written of it now.
    fn take(&mut self, news: News, lines: &mut Vec<Line>) {
        match news {
            News::Line(line) => {
                lines.extend(self.visits.before_others());
                lines.push(line);
            }
            News::Link(link, at_s) => {
                lines.extend(self.visits.hear(link, at_s, Monotonic::now()));
            }
        }
    }

    /// Writes what there is, and lets the disk have it.
    fn write(&mut self, lines: Vec<Line>) {
        if lines.is_empty() {
            return;
        }
        // What is not written after all, with what its lines would have told of.
        let (mut text, mut at_stake) = (String::new(), 0);
        for line in lines {
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
            at_stake += 1 + lost;
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
                self.lost.fetch_add(at_stake, Ordering::Relaxed);
                if !self.has_failed {
                    tracing::error!(%why, path = %self.path.display(), "the audit log cannot be written");
                }
                self.has_failed = true;
            }
        }
    }
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

    #[test]
    fn links_are_written_before_what_is_done_by_them_and_the_last_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let log = AuditLog::open(&path, "one".to_owned()).unwrap();
        let audit = log.audit();
        let link = |is_up, port: u16| {
            audit.write_link(LinkNews {
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
        let after = ["disconnect", "looks"];
        assert_eq!(kinds, [&before[..], &after].concat());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_loses_lines_and_nobody_waits() {
        let log = AuditLog::open(Path::new("/dev/full"), "run".to_owned()).unwrap();
        let audit = log.audit();
        let started = clock::Monotonic::now();
        for _ in 0..100_000 {
            audit.write("refused", "x");
        }
        assert!(started.elapsed() < Duration::from_secs(5));
        drop(log);
        assert_eq!(audit.lost.load(Ordering::Relaxed), 100_000);
    }
}
