//! Rules of ARCHITECTURE.md that the source text shows, and that every recording has an origin and a licence.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|err| panic!("{}: {err}", folder.display()));
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Lines of code below `folder` that contain one of `words`; comments do not count.
fn lines_with(folder: &str, words: &[&str], except: &[&str]) -> Vec<String> {
    let mut files = Vec::new();
    rust_files(&root().join(folder), &mut files);
    assert!(!files.is_empty(), "{folder} has no Rust file");
    files.sort();
    let mut found = Vec::new();
    for path in files {
        if except.iter().any(|file| path.ends_with(file)) {
            continue;
        }
        for (number, line) in fs::read_to_string(&path).unwrap().lines().enumerate() {
            let code = line.split("//").next().unwrap_or_default();
            if words.iter().any(|word| code.contains(word)) {
                found.push(format!(
                    "{}:{}: {}",
                    path.display(),
                    number + 1,
                    line.trim()
                ));
            }
        }
    }
    found
}

/// Their manifests exclude middleware; this excludes I/O and clocks of the standard library.
#[test]
fn pure_crates_do_no_io_and_read_no_clock() {
    let io = [
        "std::fs",
        "std::io",
        "std::net",
        "tokio",
        "zenoh",
        "tracing",
        "std::process",
        "std::thread",
        "mpsc",
        "Instant::now",
        "SystemTime",
        "Serialize",
    ];
    for crate_name in ["measurement", "mapping", "localization", "teleop"] {
        let folder = format!("robot-edge/{crate_name}/src");
        assert_eq!(lines_with(&folder, &io, &[]), [""; 0]);
    }
}

#[test]
fn one_file_reads_the_clock() {
    let words = [
        "Instant::now",
        "SystemTime::now",
        "clock_gettime",
        "UNIX_EPOCH",
    ];
    assert_eq!(
        lines_with("robot-edge", &words, &["src/clock.rs", "mapping/rounds.rs"]),
        [""; 0]
    );
    for folder in [
        "protocol/src",
        "operator-console/src",
        "tests/experiments/src",
    ] {
        assert_eq!(lines_with(folder, &words, &[]), [""; 0]);
    }
    // Ages need a clock that cannot be set and that counts while the machine sleeps.
    let clocks = lines_with("robot-edge", &["ClockId::"], &["mapping/rounds.rs"]);
    assert_eq!(clocks.len(), 1, "{clocks:?}");
    assert!(clocks[0].contains("ClockId::Boottime"), "{clocks:?}");
}

#[test]
fn one_file_turns_cells_into_tiles() {
    let found = lines_with(
        "robot-edge/edge/src",
        &["codes_mut", "TileCells::from_fn"],
        &["cells_to_tiles.rs"],
    );
    assert_eq!(found, [""; 0]);
}

#[test]
fn the_console_model_and_streaming_rules_are_pure() {
    let impure = [
        "std::fs",
        "std::net",
        "std::thread",
        "std::time::Instant",
        "mpsc",
        "clock::now",
        "zenoh",
        "egui",
    ];
    for folder in [
        "operator-console/src/model",
        "robot-edge/edge/src/sensor_monitor",
        "robot-edge/edge/src/publishing",
    ] {
        assert_eq!(lines_with(folder, &impure, &[]), [""; 0]);
    }
}

#[test]
fn only_link_modules_use_zenoh() {
    let words = ["zenoh::", "use zenoh"];
    let others = |line: &String| {
        let folders = ["/src/link/", "/edge/src/server/", "/edge/src/ros2/"];
        !folders.iter().any(|folder| line.contains(folder))
    };
    for folder in [
        "robot-edge/edge/src",
        "operator-console/src",
        "protocol/src",
    ] {
        let found: Vec<_> = lines_with(folder, &words, &[])
            .into_iter()
            .filter(others)
            .collect();
        assert_eq!(found, [""; 0]);
    }
}

#[test]
fn key_expressions_are_built_in_one_file() {
    for folder in [
        "robot-edge/edge/src",
        "robot-edge/network/src",
        "robot-edge/src",
        "operator-console/src",
    ] {
        assert_eq!(
            lines_with(folder, &["\"foreshore/", "\"map/"], &[]),
            [""; 0]
        );
    }
}

/// Every clip in `recordings/` is in `index.toml`.
#[test]
fn every_clip_matches_the_index() {
    let folder = root().join("recordings");
    let text = fs::read_to_string(folder.join("index.toml")).unwrap();
    let index: toml::Table = text.parse().unwrap();
    let mut listed = BTreeSet::from(["index.toml".to_owned()]);
    for (name, clip) in &index {
        let field = |key: &str| {
            clip[key]
                .as_str()
                .unwrap_or_else(|| panic!("{name} has no {key}"))
        };
        let bytes = fs::read(folder.join(field("file"))).unwrap();
        assert_eq!(
            blake3::hash(&bytes).to_hex().as_str(),
            field("blake3"),
            "{name}"
        );
        assert!(bytes.len() < 5_000_000, "{name} is too large for a clip");
        assert!(
            !field("origin").is_empty() && !field("licence").is_empty(),
            "{name}"
        );
        listed.insert(field("file").to_owned());
    }
    let names = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let found: BTreeSet<_> = names.map(|name| name.into_string().unwrap()).collect();
    assert_eq!(found, listed);
}
