use std::collections::BTreeMap;

use super::super::{IssueRequest, issue};
use super::*;

/// A fleet with the vehicles `scout` and `barge`, and a place for keys to be installed.
struct Case(tempfile::TempDir);

impl Case {
    fn new() -> Self {
        let case = Self(tempfile::tempdir().unwrap());
        case.issue(&["scout", "barge"]);
        fs::create_dir(case.0.path().join("etc")).unwrap();
        case
    }

    fn issue(&self, robots: &[&str]) {
        let request = IssueRequest {
            folder: self.0.path().join("fleet"),
            vehicles: robots.iter().map(|name| name.parse().unwrap()).collect(),
            people: [("anna".parse().unwrap(), teleop::Role::Operator)].into(),
            days: 1,
            ..IssueRequest::default()
        };
        issue(&request).unwrap();
    }

    fn from(&self, robot: &str) -> PathBuf {
        self.0.path().join("fleet/vehicles").join(robot)
    }

    fn to(&self) -> PathBuf {
        self.0.path().join("etc/keys")
    }

    /// What is in the folder above the keys.
    fn beside(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path().join("etc")).unwrap();
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name();
        let mut names: Vec<_> = entries
            .map(|entry| name(entry).into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn installs(&self) {
        let installed = install(&self.from("scout"), &self.to()).unwrap();
        assert_eq!(installed.robot.as_str(), "scout");
        assert_eq!(contents(&self.to()), contents(&self.from("scout")));
        assert_eq!(self.beside(), ["keys"]);
    }

    fn refuses(&self, from: &Path, says: &str) {
        let before = fs::exists(self.to()).unwrap().then(|| contents(&self.to()));
        let error = install(from, &self.to()).unwrap_err().to_string();
        assert!(error.contains(says), "{says}: {error}");
        let after = fs::exists(self.to()).unwrap().then(|| contents(&self.to()));
        assert_eq!(before, after, "{says}");
        assert!(self.beside().len() <= 1, "{:?}", self.beside());
    }
}

fn contents(folder: &Path) -> BTreeMap<String, String> {
    let file = |entry: io::Result<fs::DirEntry>| {
        let entry = entry.unwrap();
        let text = fs::read_to_string(entry.path()).unwrap_or_else(|_| "a folder".to_owned());
        (entry.file_name().into_string().unwrap(), text)
    };
    fs::read_dir(folder).unwrap().map(file).collect()
}

#[test]
fn keys_are_replaced_as_a_whole_again_and_again() {
    let case = Case::new();
    case.installs();
    case.installs();
    // As `cp -r` made it: the newer keys inside the old ones.
    let list = case.from("scout").join(OPERATORS);
    fs::create_dir(case.to().join("scout")).unwrap();
    fs::write(case.to().join("scout").join(OPERATORS), "old").unwrap();
    fs::write(&list, "version = 1\n").unwrap();
    case.installs();
    // Keys that are there and are no good are replaced too.
    fs::write(case.to().join(PRIVATE_KEY), "broken").unwrap();
    case.installs();
    fs::remove_file(case.to().join(OPERATORS)).unwrap();
    case.installs();
}

#[test]
fn only_those_who_must_can_read_what_was_installed() {
    use std::os::unix::fs::{MetadataExt as _, chown};
    let case = Case::new();
    let above = case.0.path().join("etc");
    let is_root = fs::metadata(&above).unwrap().uid() == 0;
    if is_root {
        chown(&above, None, Some(4321)).unwrap();
    }
    for _ in 0..2 {
        case.installs();
        let of = |path: PathBuf| {
            let metadata = fs::metadata(path).unwrap();
            (metadata.mode() & 0o777, metadata.gid())
        };
        let group = fs::metadata(&above).unwrap().gid();
        let (folder, file) = if is_root {
            (0o750, 0o640)
        } else {
            (0o700, 0o600)
        };
        assert_eq!(of(case.to()).0, folder);
        for name in FILES {
            let (mode, gid) = of(case.to().join(name));
            assert_eq!(mode, file, "{name}");
            assert!(!is_root || gid == group, "{name}");
        }
        Credentials::of_vehicle(&case.to(), None).unwrap();
    }
}

#[test]
fn what_cannot_be_used_or_must_not_be_removed_changes_nothing() {
    let case = Case::new();
    case.refuses(&case.0.path().join("fleet"), "vehicles/NAME");
    case.installs();
    let scout = case.from("scout");
    case.refuses(&case.0.path().join("fleet/people/anna"), "not of a vehicle");
    case.refuses(&case.from("barge"), "those of barge are to be installed");
    case.refuses(&case.to(), "is in it");
    let text = fs::read_to_string(scout.join(OPERATORS)).unwrap();
    fs::write(scout.join(OPERATORS), "version = 1\n[[person]]").unwrap();
    case.refuses(&scout, "line");
    fs::write(scout.join(OPERATORS), text).unwrap();
    fs::copy(
        case.from("barge").join(PRIVATE_KEY),
        scout.join(PRIVATE_KEY),
    )
    .unwrap();
    case.refuses(&scout, "not the key of link.pem");
    fs::remove_file(scout.join(PRIVATE_KEY)).unwrap();
    case.refuses(&scout, PRIVATE_KEY);
    // A folder of something else is not removed.
    fs::remove_dir_all(case.to()).unwrap();
    fs::create_dir(case.to()).unwrap();
    fs::write(case.to().join("notes.txt"), "dear").unwrap();
    case.refuses(&case.from("barge"), "no folder of keys");
    let nowhere = case.0.path().join("none/keys");
    assert!(install(&case.from("barge"), &nowhere).is_err());
}

#[test]
fn what_a_run_left_that_was_cut_off_is_removed_by_the_next() {
    let case = Case::new();
    case.installs();
    for name in [".keys.new", ".keys.old"] {
        let left = case.0.path().join("etc").join(name);
        fs::create_dir(&left).unwrap();
        fs::write(left.join(PRIVATE_KEY), "half").unwrap();
    }
    case.installs();
}

#[test]
fn a_file_system_without_exchange_gets_the_new_keys_too() {
    let case = Case::new();
    let [draft, to, aside] = ["draft", "to", "aside"].map(|name| case.0.path().join(name));
    for (folder, text) in [(&draft, "new"), (&to, "old")] {
        fs::create_dir(folder).unwrap();
        fs::write(folder.join("file"), text).unwrap();
    }
    exchange_in_steps(&draft, &to, &aside).unwrap();
    assert_eq!(fs::read_to_string(to.join("file")).unwrap(), "new");
    assert_eq!(fs::read_to_string(aside.join("file")).unwrap(), "old");
    // Where the second step fails, the first is undone.
    assert!(exchange_in_steps(&draft, &to, &aside).is_err());
    assert_eq!(fs::read_to_string(to.join("file")).unwrap(), "new");
}
