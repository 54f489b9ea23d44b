//! Reads the list of operators again while the vehicle runs.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::operators::PendingOperatorList;
use crate::clock;
use crate::credentials::{CredentialsError, OperatorList};
use measurement::time::Monotonic;

/// Between two looks at the file. It is small: reading all of it misses no change, whatever the file system says.
const PERIOD: Duration = Duration::from_millis(500);
/// A file that stays broken is complained of again after this.
const REMINDER: Duration = Duration::from_mins(1);
/// A file that is missing for so long revokes everybody. Some editors and copies remove a file before they write the new one.
const GRACE: Duration = Duration::from_secs(10);

/// Tells that something happened: its kind, and in words.
pub type EventSink = Box<dyn Fn(&'static str, String) + Send>;

/// The watch over a vehicle's list. It ends when it is dropped.
#[derive(Debug)]
pub struct OperatorListWatcher {
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl OperatorListWatcher {
    /// Watches the file at `path`, in which `list` was found. Newer lists go to each of `pending_lists`; `report` reports what
    /// becomes of the file.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(
        path: PathBuf,
        list: OperatorList,
        pending_lists: Vec<PendingOperatorList>,
        report: EventSink,
    ) -> std::io::Result<Self> {
        let is_closing = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&is_closing);
        let thread = thread::Builder::new()
            .name("operators".to_owned())
            .spawn(move || {
                let mut state = WatcherState::new(list, pending_lists, report);
                let is_over = || is_over.load(Ordering::Relaxed);
                while clock::sleep_until(clock::now() + PERIOD, is_over) {
                    state.poll(&path, clock::now());
                }
            })?;
        Ok(Self {
            is_closing,
            thread: Some(thread),
        })
    }
}

impl Drop for OperatorListWatcher {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that watches the list of operators failed");
        }
    }
}

struct WatcherState {
    current: OperatorList,
    pending_lists: Vec<PendingOperatorList>,
    report: EventSink,
    /// What is wrong with the file now, and when that was said.
    reported_error: Option<(String, Monotonic)>,
    /// Since when the file is missing.
    missing: Option<Monotonic>,
}

impl WatcherState {
    const fn new(
        current: OperatorList,
        pending_lists: Vec<PendingOperatorList>,
        report: EventSink,
    ) -> Self {
        Self {
            current,
            pending_lists,
            report,
            reported_error: None,
            missing: None,
        }
    }

    fn poll(&mut self, path: &Path, now: Monotonic) {
        let read = OperatorList::read(path);
        if let Err(CredentialsError::Read { why, .. }) = &read
            && matches!(
                why.kind(),
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
            )
        {
            self.is_missing(path, now);
            return;
        }
        if self.missing.take().is_some() {
            (self.report)("operators", "the list of operators is back".to_owned());
        }
        match read {
            Ok(list) => {
                self.reported_error = None;
                if list != self.current {
                    (self.report)("operators", changes(&self.current, &list));
                    self.apply_list(list);
                }
            }
            // A list that is being written, or was spoilt, takes nobody's leave away and gives none.
            Err(why) => {
                let why = format!("{why}. The list read before stays in force");
                let is_news = self
                    .reported_error
                    .as_ref()
                    .is_none_or(|(reported, at)| *reported != why || now.since(*at) >= REMINDER);
                if is_news {
                    tracing::error!("the list of operators cannot be used: {why}");
                    (self.report)("operators_unreadable", why.clone());
                    self.reported_error = Some((why, now));
                }
            }
        }
    }

    fn is_missing(&mut self, path: &Path, now: Monotonic) {
        let path = path.display();
        let Some(since) = self.missing else {
            self.missing = Some(now);
            let grace_s = GRACE.as_secs();
            let message = format!(
                "the list of operators is missing: nobody may drive in {grace_s} s unless it comes back ({path})"
            );
            tracing::error!("{message}");
            (self.report)("operators_missing", message);
            return;
        };
        let nobody = OperatorList::default();
        if now.since(since) >= GRACE && self.current != nobody {
            let message =
                format!("the list of operators is missing: nobody may watch or drive ({path})");
            tracing::error!("{message}");
            (self.report)("operators_missing", message);
            self.apply_list(nobody);
        }
    }

    fn apply_list(&mut self, list: OperatorList) {
        for pending in &self.pending_lists {
            pending.set(list.clone());
        }
        self.current = list;
    }
}

fn changes(before: &OperatorList, after: &OperatorList) -> String {
    let missing = |from: &OperatorList, of: &OperatorList| {
        let missing = of
            .people()
            .iter()
            .filter(|listed| !from.people().contains(listed));
        let names: Vec<_> = missing
            .map(|listed| listed.identity().to_string())
            .collect();
        if names.is_empty() {
            "nobody".to_owned()
        } else {
            names.join(", ")
        }
    };
    format!(
        "the list of operators changed: off it {}; new on it {}",
        missing(after, before),
        missing(before, after)
    )
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Mutex;

    use super::*;

    /// A list's file, what is said of it, and the operators who are obeyed.
    struct Case {
        _folder: tempfile::TempDir,
        path: PathBuf,
        reported: Arc<Mutex<Vec<(&'static str, String)>>>,
        state: WatcherState,
        operators: crate::driving::Operators,
    }

    impl Case {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let reported = Arc::new(Mutex::new(Vec::new()));
            let report: EventSink = Box::new({
                let reported = Arc::clone(&reported);
                move |kind, message| reported.lock().unwrap().push((kind, message))
            });
            let list = OperatorList::default();
            let operators = crate::driving::Operators::listed(&list);
            Self {
                path: folder.path().join("operators.toml"),
                _folder: folder,
                reported,
                state: WatcherState::new(list, vec![operators.pending()], report),
                operators,
            }
        }

        fn write(&self, name: &str) {
            let text = format!("version = 1\n[[person]]\nname = \"{name}\"\nrole = \"observer\"\n");
            fs::write(&self.path, text).unwrap();
        }

        /// What is said of the file at that time.
        fn poll(&mut self, ms: u64) -> Vec<(&'static str, String)> {
            self.state
                .poll(&self.path, Monotonic::from_nanos(ms * 1_000_000));
            std::mem::take(&mut *self.reported.lock().unwrap())
        }
    }

    #[test]
    fn a_broken_file_keeps_the_list_and_says_so_once_a_minute() {
        let mut case = Case::new();
        case.write("tv");
        let reported = case.poll(0);
        assert_eq!(reported.len(), 1);
        assert!(
            reported[0]
                .1
                .ends_with("off it nobody; new on it observer:tv"),
            "{reported:?}"
        );
        assert_eq!(case.operators.take_pending(), Some(Vec::new()));
        assert_eq!(
            (case.poll(500), case.operators.take_pending()),
            (vec![], None),
            "no news"
        );
        for broken in ["", "version = 1\n[[person]]\nname = ", "\0\0\0"] {
            fs::write(&case.path, broken).unwrap();
            let reported = [case.poll(1000), case.poll(1500)].concat();
            assert_eq!(reported.len(), 1, "{broken:?}: {reported:?}");
            assert_eq!(reported[0].0, "operators_unreadable");
            assert!(
                reported[0].1.contains("operators.toml")
                    && reported[0].1.contains("stays in force")
            );
        }
        assert_eq!(case.poll(62_000).len(), 1, "a reminder");
        assert_eq!(case.operators.take_pending(), None);
        case.write("radio");
        let reported = case.poll(63_000);
        let changed = "off it observer:tv; new on it observer:radio";
        assert!(reported[0].1.ends_with(changed), "{reported:?}");
        assert!(case.operators.take_pending().is_some());
    }

    #[test]
    fn a_missing_file_revokes_everybody_after_ten_seconds_that_are_said() {
        let mut case = Case::new();
        let missing = |reported: &[(&'static str, String)], text: &str| {
            let [(kind, message)] = reported else {
                panic!("{reported:?}")
            };
            assert_eq!(*kind, "operators_missing");
            let expected = format!("the list of operators is missing: {text} (");
            assert!(message.starts_with(&expected), "{message}");
        };
        let countdown = "nobody may drive in 10 s unless it comes back";
        case.write("tv");
        drop(case.poll(0));
        assert!(case.operators.take_pending().is_some());
        // Away for 9.5 s: nothing changes.
        fs::remove_file(&case.path).unwrap();
        missing(&case.poll(500), countdown);
        assert_eq!(case.poll(10_000), []);
        case.write("tv");
        let back = ("operators", "the list of operators is back".to_owned());
        assert_eq!(case.poll(10_500), std::slice::from_ref(&back));
        assert_eq!(case.operators.take_pending(), None);
        // The countdown begins anew; with the whole folder away too.
        fs::remove_dir_all(case.path.parent().unwrap()).unwrap();
        missing(&case.poll(11_000), countdown);
        assert_eq!(
            (case.poll(20_500), case.operators.take_pending()),
            (vec![], None)
        );
        missing(&case.poll(21_000), "nobody may watch or drive");
        assert_eq!(case.state.current, OperatorList::default());
        assert!(case.operators.take_pending().is_some());
        assert_eq!(
            (case.poll(90_000), case.operators.take_pending()),
            (vec![], None)
        );
        // It gives leave again when it is back.
        fs::create_dir(case.path.parent().unwrap()).unwrap();
        case.write("tv");
        let reported = case.poll(91_000);
        assert_eq!(reported[0], back);
        assert!(
            reported[1]
                .1
                .ends_with("off it nobody; new on it observer:tv")
        );
        assert!(case.operators.take_pending().is_some());
    }

    #[test]
    fn a_file_that_comes_back_broken_keeps_the_list() {
        let mut case = Case::new();
        case.write("tv");
        drop(case.poll(0));
        drop(case.operators.take_pending());
        fs::remove_file(&case.path).unwrap();
        drop(case.poll(500));
        fs::write(&case.path, "").unwrap();
        let reported = case.poll(1000);
        assert_eq!(reported[1].0, "operators_unreadable", "{reported:?}");
        assert_eq!(case.poll(20_000), []);
        assert_eq!(case.operators.take_pending(), None);
    }
}
