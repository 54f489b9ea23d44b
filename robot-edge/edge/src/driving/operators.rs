//! The operators of this vehicle, and the watcher that reads the operator list again while the vehicle runs.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, TryLockError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::OperatorId as OperatorName;
use protocol::signed::{PublicKey, SecretKey};

use crate::lock;
use measurement::time::Monotonic;
use network::clock;
use network::credentials::{CredentialsError, OperatorList};
use teleop::{OperatorId, Role};

/// Greatest number of operators in one run.
pub const MAX_OPERATORS: usize = 64;

/// The list of operators. One who is removed from the list and added again keeps the number.
#[derive(Clone, Debug)]
pub struct Operators {
    known: Vec<Operator>,
    is_open: bool,
    pending: PendingOperatorList,
}

/// A slot for a newer operator list; the last one counts.
#[derive(Clone, Debug, Default)]
pub struct PendingOperatorList(Arc<Mutex<Option<OperatorList>>>);

impl PendingOperatorList {
    pub fn set(&self, list: OperatorList) {
        *lock(&self.0) = Some(list);
    }

    /// Takes the newer list. It does not wait for a writer.
    pub(crate) fn take(&self) -> Option<OperatorList> {
        match self.0.try_lock() {
            Ok(mut pending) => pending.take(),
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner().take(),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

#[derive(Clone, Debug)]
pub struct Operator {
    /// The name in the key of what they send.
    pub name: OperatorName,
    pub role: Role,
    pub key: PublicKey,
    pub is_listed: bool,
}

impl Operators {
    /// Everybody, by whatever name they give, as a supervisor: for a link that only this machine reaches, and for
    /// `--insecure`. What they sign with is [`SecretKey::without_secret`], which proves nothing.
    pub fn open() -> Self {
        Self {
            known: Vec::new(),
            is_open: true,
            pending: PendingOperatorList::default(),
        }
    }

    /// Only the operators of a list that have a signing key.
    pub fn listed(list: &OperatorList) -> Self {
        Self {
            known: signers(list).take(MAX_OPERATORS).collect(),
            is_open: false,
            pending: PendingOperatorList::default(),
        }
    }

    pub fn pending(&self) -> PendingOperatorList {
        self.pending.clone()
    }

    /// Takes the newer list, if there is one. Returns the operators who lost rights or have another key.
    pub(super) fn take_pending(&mut self) -> Option<Vec<OperatorId>> {
        let list = self.pending.take()?;
        let mut revoked = Vec::new();
        for (at, known) in self.known.iter_mut().enumerate() {
            let listed = signers(&list).find(|listed| listed.name == known.name);
            let is_same = listed.as_ref().is_some_and(|listed| {
                listed.key == known.key && (listed.role.may_drive() || !known.role.may_drive())
            });
            if known.is_listed && !is_same {
                revoked.push(OperatorId(at as u32));
            }
            match listed {
                Some(listed) => *known = listed,
                None => known.is_listed = false,
            }
        }
        for listed in signers(&list) {
            if self.known.iter().any(|known| known.name == listed.name) {
                continue;
            }
            if self.known.len() < MAX_OPERATORS {
                self.known.push(listed);
            } else {
                tracing::error!(
                    name = %listed.name,
                    "not more than {MAX_OPERATORS} operators are distinguished in one run: start the vehicle again"
                );
            }
        }
        Some(revoked)
    }

    pub fn find(&mut self, name: &OperatorName) -> Option<(OperatorId, &Operator)> {
        let known = self
            .known
            .iter()
            .position(|operator| operator.name == *name);
        let at = known.or_else(|| self.welcome(name))?;
        let operator = self.known.get(at)?;
        operator
            .is_listed
            .then_some((OperatorId(at as u32), operator))
    }

    /// Adds an operator, if the list is open to all.
    fn welcome(&mut self, name: &OperatorName) -> Option<usize> {
        if !self.is_open || self.known.len() >= MAX_OPERATORS {
            return None;
        }
        self.known.push(Operator {
            name: name.clone(),
            role: Role::Supervisor,
            key: SecretKey::without_secret(name).public(),
            is_listed: true,
        });
        Some(self.known.len() - 1)
    }

    pub fn names(&self) -> impl Iterator<Item = &OperatorName> {
        self.known.iter().map(|operator| &operator.name)
    }
}

/// The operators of a list that have a signing key.
fn signers(list: &OperatorList) -> impl Iterator<Item = Operator> {
    list.people().iter().filter_map(|listed| {
        Some(Operator {
            name: listed.name.clone(),
            role: listed.role,
            key: listed.key?,
            is_listed: true,
        })
    })
}

/// Period of reading the file. It is small: reading all of it finds every change, whatever its modification time is.
const PERIOD: Duration = Duration::from_millis(500);
/// A persistent error is reported again after this.
const REMINDER: Duration = Duration::from_mins(1);
/// A file that is missing for this long revokes all operators. Some editors remove a file before they write the new
/// one.
const GRACE: Duration = Duration::from_secs(10);

/// Reports an event: its kind and its message.
pub type EventSink = Box<dyn Fn(&'static str, String) + Send>;

/// The watcher thread. It ends when this is dropped.
#[derive(Debug)]
pub struct OperatorListWatcher {
    is_closing: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl OperatorListWatcher {
    /// Watches the file at `path`, in which `list` was found. Newer lists go to each of `pending_lists`; `report`
    /// reports what becomes of the file.
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
    /// The present error of the file, and when it was reported.
    reported_error: Option<(String, Monotonic)>,
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
            // An unreadable list changes no rights: it may be half written.
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

    fn name(name: &str) -> OperatorName {
        name.parse().unwrap()
    }

    #[test]
    fn an_open_list_knows_everybody_up_to_its_limit() {
        let mut open = Operators::open();
        for n in 0..MAX_OPERATORS {
            let (id, operator) = open.find(&name(&format!("o{n}"))).unwrap();
            assert_eq!((id.0 as usize, operator.role), (n, Role::Supervisor));
        }
        assert!(open.find(&name("one-too-many")).is_none());
        assert_eq!(open.find(&name("o7")).unwrap().0, OperatorId(7));
    }

    /// A list of names, roles and seeds of keys.
    fn list(people: &[(&str, &str, u8)]) -> OperatorList {
        let entry = |(name, role, seed): &(&str, &str, u8)| {
            let key = SecretKey::from_seed(&[*seed; 32])
                .public()
                .to_pem()
                .unwrap();
            format!("[[person]]\nname = \"{name}\"\nrole = \"{role}\"\nkey = \"\"\"\n{key}\"\"\"\n")
        };
        let text = "version = 1\n".to_owned() + &people.iter().map(entry).collect::<String>();
        OperatorList::parse(&text).unwrap()
    }

    #[test]
    fn a_list_knows_nobody_else() {
        let mut listed = Operators::listed(&list(&[("anna", "operator", 7)]));
        assert_eq!(listed.find(&name("anna")).unwrap().1.role, Role::Operator);
        assert!(listed.find(&name("mallory")).is_none());
    }

    #[test]
    fn a_newer_list_revokes_who_is_off_it_and_numbers_stay() {
        let people = [
            ("anna", "operator", 1),
            ("bert", "operator", 2),
            ("cleo", "operator", 3),
            ("dora", "supervisor", 4),
        ];
        let mut operators = Operators::listed(&list(&people));
        assert_eq!(operators.take_pending(), None);
        let pending = operators.pending();
        pending.set(list(&[]));
        // Bert's key is another, Cleo only watches, Dora may less but may drive, Emil is new.
        pending.set(list(&[
            ("emil", "operator", 5),
            ("dora", "operator", 4),
            ("bert", "operator", 9),
            ("cleo", "observer", 3),
        ]));
        let revoked = [0, 1, 2].map(OperatorId).to_vec();
        assert_eq!(operators.take_pending(), Some(revoked));
        assert!(operators.find(&name("anna")).is_none());
        for (who, number, role, seed) in [
            ("bert", 1, Role::Operator, 9),
            ("cleo", 2, Role::Observer, 3),
            ("dora", 3, Role::Operator, 4),
            ("emil", 4, Role::Operator, 5),
        ] {
            let (id, operator) = operators.find(&name(who)).unwrap();
            let key = SecretKey::from_seed(&[seed; 32]).public();
            assert_eq!((id.0, operator.role, operator.key), (number, role, key));
        }
        pending.set(list(&people[..1]));
        let revoked = [1, 2, 3, 4].map(OperatorId).to_vec();
        assert_eq!(operators.take_pending(), Some(revoked));
        assert_eq!(operators.find(&name("anna")).unwrap().0, OperatorId(0));
        pending.set(list(&people[..1]));
        assert_eq!(operators.take_pending(), Some(Vec::new()));
    }

    /// A list's file, the reports about it, and the permitted operators.
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
    fn a_missing_file_revokes_all_operators_after_ten_seconds() {
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
