//! Reads the list of operators again while the vehicle runs.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::operators::NewerList;
use crate::clock::{self, Monotonic};
use crate::credentials::{CredentialsError, OperatorList};

/// Between two looks at the file. It is small: reading all of it misses no change, whatever the file system says.
const PERIOD: Duration = Duration::from_millis(500);
/// A file that stays broken is complained of again after this.
const REMINDER: Duration = Duration::from_mins(1);
/// A file that is missing for so long revokes everybody. Some editors and copies remove a file before they write the new one.
const GRACE: Duration = Duration::from_secs(10);

/// Tells that something happened: its kind, and in words.
pub type Teller = Box<dyn Fn(&'static str, String) + Send>;

/// The watch over a vehicle's list. It ends when it is dropped.
#[derive(Debug)]
pub struct ListWatch {
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ListWatch {
    /// Watches the file at `path`, in which `list` was found. Newer lists go to each of `newer`; `tell` reports what
    /// becomes of the file.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(
        path: PathBuf,
        list: OperatorList,
        newer: Vec<NewerList>,
        tell: Teller,
    ) -> std::io::Result<Self> {
        let is_closing = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&is_closing);
        let thread = thread::Builder::new()
            .name("operators".to_owned())
            .spawn(move || {
                let mut watched = Watched::new(list, newer, tell);
                let is_over = || is_over.load(Ordering::Relaxed);
                while clock::sleep_until(Monotonic::now() + PERIOD, is_over) {
                    watched.look(&path, Monotonic::now());
                }
            })?;
        Ok(Self {
            is_closing,
            thread: Some(thread),
        })
    }
}

impl Drop for ListWatch {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that watches the list of operators failed");
        }
    }
}

struct Watched {
    in_force: OperatorList,
    newer: Vec<NewerList>,
    tell: Teller,
    /// What is wrong with the file now, and when that was said.
    complaint: Option<(String, Monotonic)>,
    /// Since when the file is missing.
    missing: Option<Monotonic>,
}

impl Watched {
    const fn new(in_force: OperatorList, newer: Vec<NewerList>, tell: Teller) -> Self {
        Self {
            in_force,
            newer,
            tell,
            complaint: None,
            missing: None,
        }
    }

    fn look(&mut self, path: &Path, now: Monotonic) {
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
            (self.tell)("operators", "the list of operators is back".to_owned());
        }
        match read {
            Ok(list) => {
                self.complaint = None;
                if list != self.in_force {
                    (self.tell)("operators", changes(&self.in_force, &list));
                    self.put_in_force(list);
                }
            }
            // A list that is being written, or was spoilt, takes nobody's leave away and gives none.
            Err(why) => {
                let why = format!("{why}. The list read before stays in force");
                let is_news = self
                    .complaint
                    .as_ref()
                    .is_none_or(|(said, at)| *said != why || now.since(*at) >= REMINDER);
                if is_news {
                    tracing::error!("the list of operators cannot be used: {why}");
                    (self.tell)("operators_unreadable", why.clone());
                    self.complaint = Some((why, now));
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
            (self.tell)("operators_missing", message);
            return;
        };
        let nobody = OperatorList::default();
        if now.since(since) >= GRACE && self.in_force != nobody {
            let message =
                format!("the list of operators is missing: nobody may watch or drive ({path})");
            tracing::error!("{message}");
            (self.tell)("operators_missing", message);
            self.put_in_force(nobody);
        }
    }

    fn put_in_force(&mut self, list: OperatorList) {
        for newer in &self.newer {
            newer.leave(list.clone());
        }
        self.in_force = list;
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
        said: Arc<Mutex<Vec<(&'static str, String)>>>,
        watched: Watched,
        operators: crate::driving::Operators,
    }

    impl Case {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let said = Arc::new(Mutex::new(Vec::new()));
            let tell: Teller = Box::new({
                let said = Arc::clone(&said);
                move |kind, message| said.lock().unwrap().push((kind, message))
            });
            let list = OperatorList::default();
            let operators = crate::driving::Operators::listed(&list);
            Self {
                path: folder.path().join("operators.toml"),
                _folder: folder,
                said,
                watched: Watched::new(list, vec![operators.newer()], tell),
                operators,
            }
        }

        fn write(&self, name: &str) {
            let text = format!("version = 1\n[[person]]\nname = \"{name}\"\nrole = \"observer\"\n");
            fs::write(&self.path, text).unwrap();
        }

        /// What is said of the file at that time.
        fn look(&mut self, ms: u64) -> Vec<(&'static str, String)> {
            self.watched
                .look(&self.path, Monotonic::from_nanos(ms * 1_000_000));
            std::mem::take(&mut *self.said.lock().unwrap())
        }
    }

    #[test]
    fn a_broken_file_keeps_the_list_and_says_so_once_a_minute() {
        let mut case = Case::new();
        case.write("tv");
        let said = case.look(0);
        assert_eq!(said.len(), 1);
        assert!(
            said[0].1.ends_with("off it nobody; new on it observer:tv"),
            "{said:?}"
        );
        assert_eq!(case.operators.take_newer(), Some(Vec::new()));
        assert_eq!(
            (case.look(500), case.operators.take_newer()),
            (vec![], None),
            "no news"
        );
        for broken in ["", "version = 1\n[[person]]\nname = ", "\0\0\0"] {
            fs::write(&case.path, broken).unwrap();
            let said = [case.look(1000), case.look(1500)].concat();
            assert_eq!(said.len(), 1, "{broken:?}: {said:?}");
            assert_eq!(said[0].0, "operators_unreadable");
            assert!(said[0].1.contains("operators.toml") && said[0].1.contains("stays in force"));
        }
        assert_eq!(case.look(62_000).len(), 1, "a reminder");
        assert_eq!(case.operators.take_newer(), None);
        case.write("radio");
        let said = case.look(63_000);
        let changed = "off it observer:tv; new on it observer:radio";
        assert!(said[0].1.ends_with(changed), "{said:?}");
        assert!(case.operators.take_newer().is_some());
    }

    #[test]
    fn a_missing_file_revokes_everybody_after_ten_seconds_that_are_said() {
        let mut case = Case::new();
        let missing = |said: &[(&'static str, String)], words: &str| {
            let [(kind, message)] = said else {
                panic!("{said:?}")
            };
            assert_eq!(*kind, "operators_missing");
            let expected = format!("the list of operators is missing: {words} (");
            assert!(message.starts_with(&expected), "{message}");
        };
        let countdown = "nobody may drive in 10 s unless it comes back";
        case.write("tv");
        drop(case.look(0));
        assert!(case.operators.take_newer().is_some());
        // Away for 9.5 s: nothing changes.
        fs::remove_file(&case.path).unwrap();
        missing(&case.look(500), countdown);
        assert_eq!(case.look(10_000), []);
        case.write("tv");
        let back = ("operators", "the list of operators is back".to_owned());
        assert_eq!(case.look(10_500), std::slice::from_ref(&back));
        assert_eq!(case.operators.take_newer(), None);
        // The countdown begins anew; with the whole folder away too.
        fs::remove_dir_all(case.path.parent().unwrap()).unwrap();
        missing(&case.look(11_000), countdown);
        assert_eq!(
            (case.look(20_500), case.operators.take_newer()),
            (vec![], None)
        );
        missing(&case.look(21_000), "nobody may watch or drive");
        assert_eq!(case.watched.in_force, OperatorList::default());
        assert!(case.operators.take_newer().is_some());
        assert_eq!(
            (case.look(90_000), case.operators.take_newer()),
            (vec![], None)
        );
        // It gives leave again when it is back.
        fs::create_dir(case.path.parent().unwrap()).unwrap();
        case.write("tv");
        let said = case.look(91_000);
        assert_eq!(said[0], back);
        assert!(said[1].1.ends_with("off it nobody; new on it observer:tv"));
        assert!(case.operators.take_newer().is_some());
    }

    #[test]
    fn a_file_that_comes_back_broken_keeps_the_list() {
        let mut case = Case::new();
        case.write("tv");
        drop(case.look(0));
        drop(case.operators.take_newer());
        fs::remove_file(&case.path).unwrap();
        drop(case.look(500));
        fs::write(&case.path, "").unwrap();
        let said = case.look(1000);
        assert_eq!(said[1].0, "operators_unreadable", "{said:?}");
        assert_eq!(case.look(20_000), []);
        assert_eq!(case.operators.take_newer(), None);
    }
}
