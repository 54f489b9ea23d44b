//! `robot-edge keys`, and `robot-edge install-keys`, repeated and killed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use network::clock;
use network::credentials::Credentials;

use crate::fleet::{Fleet, text};
use crate::processes::{command, program, start};
use crate::rng::SeededRng;

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

    let again = fleet.keys("--robot scout --operator anna");
    let printed = String::from_utf8(again.stdout).unwrap();
    assert!(
        again.status.success() && printed.contains("nothing to do"),
        "{printed}"
    );
    assert_eq!(files(&fleet.root()), first);

    // Another vehicle, for Anna and a new observer; the first vehicle's list stays as it is.
    let more = fleet.keys("--robot barge --operator anna --observer radio --router relay.example");
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
    // Control and bulk of two vehicles, each with 64 consoles.
    assert!(router.contains("\"max_sessions\": 260"));

    // Without --robot, people are for all vehicles.
    assert!(fleet.keys("--supervisor zoe").status.success());
    for robot in ["scout", "barge"] {
        let list = format!("vehicles/{robot}/operators.toml");
        let list = text(fleet.root().join(list));
        assert!(list.contains("\"zoe\""), "{robot}");
    }
    assert!(text(fleet.root().join("router/router.json5")).contains("supervisor:zoe"));
}

#[test]
fn conflicting_key_requests_are_refused_with_a_reason() {
    let fleet = Fleet::new();
    let before = files(&fleet.root());
    for (arguments, says) in [
        ("--supervisor anna", "a name has one role"),
        ("--operator eve --observer eve", "two roles"),
        ("--host boat.example", "give one --robot"),
        (
            "--robot scout --host boat.example",
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
    let refused = fleet.keys("--operator eve");
    let printed = String::from_utf8(refused.stderr).unwrap();
    assert!(printed.contains("ca.key.pem is missing"), "{printed}");
}

#[test]
fn unusable_keys_are_refused_with_a_reason() {
    let fleet = Fleet::new();
    let (vehicle, anna) = (fleet.vehicle(), fleet.person("anna"));
    let refused = |options: &str| {
        let simulate = "robot-edge simulate rooms --duration 0.1 --rate max";
        start(&format!("{simulate} {options}")).ends_with(2)
    };
    let run = |keys: &Path, more: &str| refused(&format!("--keys {} {more}", keys.display()));
    assert!(run(&fleet.root(), "").contains("vehicles/NAME"));
    assert!(run(&anna, "").contains("not of a vehicle"));
    assert!(run(&vehicle, "--robot barge").contains("--robot says barge"));
    assert!(run(&vehicle, "--listen tcp/0.0.0.0:7447").contains("quic/HOST:PORT"));
    let key = vehicle.join("link.key.pem");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o644)).unwrap();
    assert!(run(&vehicle, "").contains("chmod 600"));
    fs::copy(anna.join("link.key.pem"), &key).unwrap();
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).unwrap();
    assert!(run(&vehicle, "").contains("not the key of link.pem"));

    for (endpoint, says) in [
        ("tcp/0.0.0.0:7447", "drive it"),
        ("quic/127.0.0.1:7447", "need --keys"),
        ("tls/0.0.0.0:7447", "need --keys"),
    ] {
        let printed = refused(&format!("--listen {endpoint}"));
        assert!(printed.contains(says), "{endpoint}: {printed}");
    }
}

fn contents(folder: &Path) -> BTreeMap<String, String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names
        .map(|name| {
            let content = text(folder.join(&name));
            (name, content)
        })
        .collect()
}

fn copied(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
}

/// Runs the command of docs/deployment.md that installs keys, twice.
#[test]
fn the_install_command_of_the_readme_removes_a_revoked_operator() {
    let fleet = Fleet::new();
    let page = text(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/deployment.md"));
    let etc = fleet.scratch("etc");
    fs::create_dir(&etc).unwrap();
    let lines = page
        .lines()
        .filter(|line| line.contains("/etc/foreshore/keys"));
    let mut recipe: Vec<_> = lines
        .filter(|line| line.starts_with("robot-edge install-keys ") || line.starts_with("cp "))
        .map(|line| line.replace("/etc/foreshore", etc.to_str().unwrap()))
        // The user may not exist here.
        .map(|line| line.split(" && chown").next().unwrap().to_owned())
        .collect();
    let recipe = recipe.pop().unwrap();
    let program = program("robot-edge");
    let path = program.parent().unwrap();
    copied(&fleet.vehicle(), &fleet.scratch("scout"));
    let run = || {
        let mut shell = Command::new("sh");
        shell.args(["-c", &recipe]).current_dir(fleet.scratch("."));
        let before = std::env::var("PATH").unwrap();
        shell.env("PATH", format!("{}:{before}", path.display()));
        let ended = shell.output().unwrap();
        assert!(ended.status.success(), "{recipe}: {ended:?}");
    };
    run();
    let list = fleet.scratch("scout/operators.toml");
    let whole = text(&list);
    let bert = whole.find("\n[[person]]\nname = \"bert\"").unwrap();
    fs::write(&list, &whole[..bert]).unwrap();
    run();
    let (_, _, people) = Credentials::of_vehicle(&etc.join("keys"), None).unwrap();
    let names: Vec<_> = people.people().iter().map(|of| of.name.as_str()).collect();
    assert_eq!(names, ["anna"], "{recipe}");
}

/// Runs are killed at random times while another thread reads the keys.
#[test]
fn installed_keys_are_all_old_or_all_new_after_a_kill() {
    let fleet = Fleet::new();
    let (one, two) = (fleet.vehicle(), fleet.scratch("two"));
    copied(&one, &two);
    fs::write(two.join("operators.toml"), "version = 1\n").unwrap();
    let etc = fleet.scratch("etc");
    fs::create_dir(&etc).unwrap();
    let to = etc.join("keys");
    let install = |from: &Path| {
        let (from, to) = (from.display(), to.display());
        let mut command = command(&format!("robot-edge install-keys {from} {to}"));
        command.stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().unwrap()
    };
    assert!(install(&one).wait().unwrap().success());
    let whole = [contents(&one), contents(&two)];
    let (is_over, looks) = (AtomicBool::new(false), AtomicU64::new(0));
    let mut rng = SeededRng::new(1);
    let mut found = BTreeSet::new();
    scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                // Never missing and never partial.
                let list = text(to.join("operators.toml"));
                assert!(
                    whole.iter().any(|of| of["operators.toml"] == list),
                    "{list}"
                );
                looks.fetch_add(1, Ordering::Relaxed);
            }
        });
        let (mut killed, mut whole_run) = (0, Duration::ZERO);
        for run in 0..100 {
            let started = clock::now();
            let mut installing = install(if run % 2 == 0 { &two } else { &one });
            // Every fifth is only measured, beside the reader, so that the others are killed while they last.
            if run % 5 == 0 {
                assert!(installing.wait().unwrap().success());
                whole_run = clock::elapsed(started);
            } else {
                sleep(whole_run.mul_f64(rng.millis(0, 1000).as_secs_f64()));
                killed += u32::from(installing.try_wait().unwrap().is_none());
                drop(installing.kill());
                installing.wait().unwrap();
            }
            let now = contents(&to);
            found.insert(whole.iter().position(|of| *of == now));
        }
        is_over.store(true, Ordering::Relaxed);
        println!(
            "{killed} of 100 runs were killed, {} looks",
            looks.load(Ordering::Relaxed)
        );
        assert!(killed > 10, "{killed}");
    });
    let both = BTreeSet::from([Some(0), Some(1)]);
    assert_eq!(found, both, "only complete sets were found, and both");
    assert!(looks.load(Ordering::Relaxed) > 1000);
    assert!(install(&two).wait().unwrap().success());
    assert_eq!(contents(&to), whole[1]);
    let left = fs::read_dir(&etc).unwrap().count();
    assert_eq!(left, 1, "killed runs left files behind");
}
