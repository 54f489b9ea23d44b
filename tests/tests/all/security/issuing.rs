//! `robot-edge keys`

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use crate::fleet::{Fleet, text};
use crate::link::processes::program;

/// Text and permissions of every file below a folder.
fn files(root: &Path) -> BTreeMap<PathBuf, (String, u32)> {
    let mut found = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let mode = fs::metadata(&path).unwrap().permissions().mode() & 0o777;
            let name = path.strip_prefix(root).unwrap().to_owned();
            found.insert(name, (text(&path), mode));
        }
    }
    found
}

#[test]
fn adding_people_and_vehicles_keeps_existing_keys() {
    let fleet = Fleet::new();
    let first = files(&fleet.root());
    let names: Vec<_> = first.keys().map(|name| name.to_str().unwrap()).collect();
    assert_eq!(
        names,
        [
            "authority/ca.key.pem",
            "authority/ca.pem",
            "people/anna/ca.pem",
            "people/anna/link.key.pem",
            "people/anna/link.pem",
            "people/anna/signing.key.pem",
            "people/bert/ca.pem",
            "people/bert/link.key.pem",
            "people/bert/link.pem",
            "people/bert/signing.key.pem",
            "people/sam/ca.pem",
            "people/sam/link.key.pem",
            "people/sam/link.pem",
            "people/sam/signing.key.pem",
            "people/tv/ca.pem",
            "people/tv/link.key.pem",
            "people/tv/link.pem",
            "vehicles/scout/ca.pem",
            "vehicles/scout/link.key.pem",
            "vehicles/scout/link.pem",
            "vehicles/scout/operators.toml",
        ]
    );
    for (name, (content, mode)) in &first {
        let is_secret = name.to_str().unwrap().ends_with(".key.pem");
        assert_eq!(*mode, if is_secret { 0o600 } else { 0o644 }, "{name:?}");
        assert_eq!(content.contains("PRIVATE"), is_secret, "{name:?}");
    }

    let again = fleet.keys(&["--robot", "scout", "--operator", "anna"]);
    let printed = String::from_utf8(again.stdout).unwrap();
    assert!(
        again.status.success() && printed.contains("nothing to do"),
        "{printed}"
    );
    assert_eq!(files(&fleet.root()), first);

    // Another vehicle, for Anna and a new observer; the first vehicle's list stays as it is.
    let more = fleet.keys(&[
        "--robot",
        "barge",
        "--operator",
        "anna",
        "--observer",
        "radio",
        "--router",
        "relay.example",
    ]);
    assert!(more.status.success(), "{more:?}");
    let second = files(&fleet.root());
    for (name, content) in &first {
        assert_eq!(second.get(name), Some(content), "{name:?}");
    }
    let (list, _) = &second[Path::new("vehicles/barge/operators.toml")];
    assert!(list.contains("\"anna\"") && list.contains("\"radio\"") && !list.contains("\"bert\""));
    let (router, mode) = &second[Path::new("router/router.json5")];
    assert_eq!(*mode, 0o600);
    assert!(router.contains("operator:bert") && router.contains("vehicle:barge"));

    // Without --robot, people are for all vehicles.
    assert!(fleet.keys(&["--supervisor", "zoe"]).status.success());
    for robot in ["scout", "barge"] {
        let list = text(
            fleet
                .root()
                .join(format!("vehicles/{robot}/operators.toml")),
        );
        assert!(list.contains("\"zoe\""), "{robot}");
    }
    assert!(text(fleet.root().join("router/router.json5")).contains("supervisor:zoe"));
}

#[test]
fn conflicting_key_requests_are_refused_with_a_reason() {
    let fleet = Fleet::new();
    let before = files(&fleet.root());
    for (arguments, says) in [
        (&["--supervisor", "anna"][..], "a name has one role"),
        (&["--operator", "eve", "--observer", "eve"], "two roles"),
        (&["--host", "boat.example"], "give one --robot"),
        (
            &["--robot", "scout", "--host", "boat.example"],
            "not good for boat.example",
        ),
    ] {
        let refused = fleet.keys(arguments);
        let printed = String::from_utf8(refused.stderr).unwrap();
        assert_eq!(refused.status.code(), Some(2), "{arguments:?}: {printed}");
        assert!(printed.contains(says), "{arguments:?}: {printed}");
        assert_eq!(files(&fleet.root()), before, "{arguments:?}");
    }
    fs::remove_file(fleet.root().join("authority/ca.key.pem")).unwrap();
    let refused = fleet.keys(&["--operator", "eve"]);
    let printed = String::from_utf8(refused.stderr).unwrap();
    assert!(printed.contains("ca.key.pem is missing"), "{printed}");
}

#[test]
fn unusable_keys_are_refused_with_a_reason() {
    let fleet = Fleet::new();
    let (vehicle, anna) = (fleet.vehicle(), fleet.person("anna"));
    let run = |keys: &Path, more: &[&str]| {
        let mut command = program("robot-edge");
        command.args([
            "simulate",
            "rooms",
            "--duration",
            "0.1",
            "--rate",
            "max",
            "--keys",
        ]);
        let ended = command.arg(keys).args(more).output().unwrap();
        let printed = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(2), "{printed}");
        printed
    };
    assert!(run(&fleet.root(), &[]).contains("vehicles/NAME"));
    assert!(run(&anna, &[]).contains("not of a vehicle"));
    assert!(run(&vehicle, &["--robot", "barge"]).contains("--robot says barge"));
    assert!(run(&vehicle, &["--listen", "tcp/0.0.0.0:7447"]).contains("quic/HOST:PORT"));
    let key = vehicle.join("link.key.pem");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
    assert!(run(&vehicle, &[]).contains("chmod 600"));
    fs::copy(anna.join("link.key.pem"), &key).unwrap();
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).unwrap();
    assert!(run(&vehicle, &[]).contains("not the key of link.pem"));

    let open = |endpoint: &str| {
        let mut command = program("robot-edge");
        command.args(["simulate", "rooms", "--duration", "0.1", "--rate", "max"]);
        let ended = command.args(["--listen", endpoint]).output().unwrap();
        (
            ended.status.code(),
            String::from_utf8(ended.stderr).unwrap(),
        )
    };
    for (endpoint, says) in [
        ("tcp/0.0.0.0:7447", "drive it"),
        ("quic/127.0.0.1:7447", "need --keys"),
        ("tls/0.0.0.0:7447", "need --keys"),
    ] {
        let (code, printed) = open(endpoint);
        assert!(
            code == Some(2) && printed.contains(says),
            "{endpoint}: {printed}"
        );
    }
}
