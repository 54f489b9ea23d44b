//! Reads the list of operators again while the vehicle runs.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::operators::NewerList;
use crate::clock::{self, Monotonic};
use crate::credentials::OperatorList;

/// Between two looks at the file. It is small: reading all of it misses no change, whatever the file system says.
const PERIOD: Duration = Duration::from_millis(500);
/// A file that stays broken is complained of again after this.
const REMINDER: Duration = Duration::from_mins(1);

/// Tells that something happened: its kind, and in words.
pub type Teller = Box<dyn Fn(&'static str, String) + Send>;

/// The watch over a vehicle's list. It ends when it is dropped.
#[derive(Debug)]
pub struct ListWatch {
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ListWatch {
    /// Watches the file at `path`, in which `list` was found; `tell` hears what becomes of it.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(
        path: PathBuf,
        list: OperatorList,
        newer: NewerList,
        tell: Teller,
    ) -> std::io::Result<Self> {
        let is_closing = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&is_closing);
        let thread = thread::Builder::new()
            .name("operators".to_owned())
            .spawn(move || {
                let mut watched = Watched {
                    in_force: list,
                    complaint: None,
                };
                let is_over = || is_over.load(Ordering::Relaxed);
                while clock::sleep_until(Monotonic::now() + PERIOD, is_over) {
                    watched.look(&path, &newer, &tell, Monotonic::now());
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
    /// What is wrong with the file now, and when that was said.
    complaint: Option<(String, Monotonic)>,
}

impl Watched {
    fn look(&mut self, path: &Path, newer: &NewerList, tell: &Teller, now: Monotonic) {
        match OperatorList::read(path) {
            Ok(list) => {
                self.complaint = None;
                if list != self.in_force {
                    tell("operators", changes(&self.in_force, &list));
                    self.in_force = list.clone();
                    newer.leave(list);
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
                    tell("operators_unreadable", why.clone());
                    self.complaint = Some((why, now));
                }
            }
        }
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

    #[test]
    fn a_broken_file_keeps_the_list_and_says_so_once_a_minute() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("operators.toml");
        let text = |name: &str| {
            format!("version = 1\n[[person]]\nname = \"{name}\"\nrole = \"observer\"\n")
        };
        let told = Arc::new(Mutex::new(Vec::new()));
        let tell: Teller = Box::new({
            let told = Arc::clone(&told);
            move |kind, message| told.lock().unwrap().push((kind, message))
        });
        let take = || std::mem::take(&mut *told.lock().unwrap());
        let mut operators = crate::driving::Operators::listed(&OperatorList::default());
        let newer = operators.newer();
        let mut watched = Watched {
            in_force: OperatorList::default(),
            complaint: None,
        };
        let mut look =
            |ms: u64| watched.look(&path, &newer, &tell, Monotonic::from_nanos(ms * 1_000_000));
        fs::write(&path, text("tv")).unwrap();
        look(0);
        let said = take();
        assert_eq!(said.len(), 1);
        assert!(
            said[0].1.ends_with("off it nobody; new on it observer:tv"),
            "{said:?}"
        );
        assert_eq!(operators.take_newer(), Some(Vec::new()));
        look(500);
        assert_eq!((take(), operators.take_newer()), (vec![], None), "no news");

        for broken in ["", "version = 1\n[[person]]\nname = ", "\0\0\0"] {
            fs::write(&path, broken).unwrap();
            look(1000);
            look(1500);
            let said = take();
            assert_eq!(said.len(), 1, "{broken:?}: {said:?}");
            assert_eq!(said[0].0, "operators_unreadable");
            assert!(said[0].1.contains("operators.toml") && said[0].1.contains("stays in force"));
        }
        look(62_000);
        assert_eq!(take().len(), 1, "a reminder");
        fs::remove_file(&path).unwrap();
        look(62_500);
        assert_eq!((take().len(), operators.take_newer()), (1, None));
        fs::write(&path, text("radio")).unwrap();
        look(63_000);
        assert!(
            take()[0]
                .1
                .ends_with("off it observer:tv; new on it observer:radio")
        );
        assert!(operators.take_newer().is_some());
    }
}
