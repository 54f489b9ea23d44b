//! `robot-edge install-keys`, repeated and killed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{scope, sleep};

use robot_edge::clock;
use robot_edge::credentials::Credentials;

use crate::fleet::{Fleet, text};
use crate::link::processes::program;
use crate::rng::SeededRng;

/// Every file of a folder.
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
    let programs = program("robot-edge").get_program().to_owned();
    let path = Path::new(&programs).parent().unwrap();
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
        let mut command = program("robot-edge");
        command.arg("install-keys").arg(from).arg(&to);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().unwrap()
    };
    assert!(install(&one).wait().unwrap().success());
    // Measured, so that a run is killed while it lasts, on a fast machine too.
    let started = clock::now();
    assert!(install(&one).wait().unwrap().success());
    let whole_run = clock::elapsed(started);
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
        let mut killed = 0;
        for run in 0..100 {
            let mut installing = install(if run % 2 == 0 { &two } else { &one });
            sleep(whole_run.mul_f64(rng.millis(0, 1000).as_secs_f64()));
            killed += u32::from(installing.try_wait().unwrap().is_none());
            drop(installing.kill());
            installing.wait().unwrap();
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
