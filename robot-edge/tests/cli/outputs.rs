//! What cannot be read or written is said before the mapping, and nothing that exists is lost.

use std::fs;
use std::path::Path;

use crate::process::{Ended, read_json, robot_edge, rooms, run};

fn replay(recording: &Path, option: &str, value: &Path) -> Ended {
    run(robot_edge("replay --quiet")
        .arg(recording)
        .arg(option)
        .arg(value))
}

#[test]
fn what_is_no_recording_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let refusal = |path: &Path, says: &[&str]| {
        for command in ["replay", "info"] {
            let ended = run(robot_edge(command).arg(path));
            ended.refuses(3, says);
            assert!(
                ended.stderr.contains(path.to_str().unwrap()),
                "{}",
                ended.stderr
            );
        }
    };
    refusal(folder.path(), &["this is a folder", ".mcap or .db3 file"]);
    refusal(&place("missing.mcap"), &["there is no such file"]);
    let folder_says = format!("there is no folder {}", place("no").display());
    refusal(&place("no/such/missing.mcap"), &[&folder_says]);
    fs::write(place("empty.mcap"), "").unwrap();
    refusal(
        &place("empty.mcap"),
        &["it begins with nothing: it is empty"],
    );
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0123\nsize 2835462\n";
    fs::write(place("pointer.mcap"), pointer).unwrap();
    refusal(&place("pointer.mcap"), &["Git LFS", "git lfs pull"]);
    fs::write(place("packed.bag"), b"\x1f\x8b\x08\x00").unwrap();
    refusal(
        &place("packed.bag"),
        &["not a recording this program reads", "\\x1f\\x8b"],
    );
}

#[test]
fn a_replay_without_an_export_says_how_to_get_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let says = "no picture was written: --export FOLDER";
    let without = run(robot_edge("replay --duration 1").arg(rooms())).succeeds();
    let last = without.stdout.lines().last().unwrap();
    assert!(last.starts_with(says), "{}", without.stdout);
    let mut exporting = robot_edge("replay --duration 1 --export");
    let exported = run(exporting.arg(folder.path()).arg(rooms())).succeeds();
    assert!(!exported.stdout.contains(says), "{}", exported.stdout);
}

#[test]
fn a_recording_that_was_cut_off_names_the_command_that_saves_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.mcap");
    let whole = fs::read(rooms()).unwrap();
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let says = format!("robot-edge recover {} saved.mcap", cut.display());
    for command in ["info", "replay"] {
        let ended = run(robot_edge(command).arg(&cut)).succeeds();
        assert!(ended.stdout.contains(&says), "{}", ended.stdout);
    }
}

/// What is written at the end is checked before the mapping: nothing else is there yet.
#[test]
fn outputs_that_cannot_be_written_are_reported_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    fs::write(place("file"), "").unwrap();
    let reported = |option: &str, value: &Path, says: &[&str]| {
        let mut command = robot_edge("replay");
        command.arg(rooms()).arg(option).arg(value);
        for (other, name) in [
            ("--export", "maps"),
            ("--record", "r.mcap"),
            ("--summary", "s.json"),
        ] {
            if other != option {
                command.arg(other).arg(place(name));
            }
        }
        let ended = run(&mut command);
        ended.refuses(1, says);
        assert!(
            ended.stderr.contains(value.to_str().unwrap()),
            "{}",
            ended.stderr
        );
        assert!(
            !place("s.json").exists() && !place("maps/occupancy.tif").exists(),
            "{option}"
        );
    };
    let no_folder = &format!("there is no folder {}", place("no").display());
    reported(
        "--export",
        &place("file"),
        &["cannot make the folder to export to", "File exists"],
    );
    reported(
        "--export",
        &place("file/maps"),
        &["cannot make the folder to export to"],
    );
    reported(
        "--summary",
        &place("no/such/s.json"),
        &["cannot write the summary", no_folder],
    );
    reported(
        "--summary",
        folder.path(),
        &["cannot write the summary", "directory"],
    );
    reported(
        "--record",
        &place("no/such/r.mcap"),
        &["cannot write the recording", no_folder],
    );
    reported(
        "--record",
        folder.path(),
        &["cannot write the recording", "directory"],
    );
    if Path::new("/proc/self").is_dir() {
        reported("--export", Path::new("/proc"), &["cannot write the maps"]);
    }
}

/// A shell forbids files of more than 1000 blocks of 512 or 1024 bytes, which the recording outgrows and the
/// maps do not.
#[cfg(unix)]
#[test]
fn a_full_disk_under_the_recording_does_not_cost_the_maps() {
    let folder = tempfile::tempdir().unwrap();
    let mut mapped = Vec::new();
    for threads in [1, 2] {
        let maps = folder.path().join(threads.to_string());
        let summary = folder.path().join("s.json");
        let mut command = std::process::Command::new("sh");
        command
            .args(["-c", "trap '' XFSZ; ulimit -f 1000; exec \"$0\" \"$@\""])
            .args([
                env!("CARGO_BIN_EXE_robot-edge"),
                "replay",
                "--no-network",
                "--set",
            ])
            .arg(format!("mapping.threads={threads}"))
            .arg(rooms())
            .arg("--record")
            .arg(folder.path().join("r.mcap"))
            .arg("--summary")
            .arg(&summary)
            .arg("--export")
            .arg(&maps);
        let ended = run(&mut command);
        assert_eq!(ended.code, Some(1), "{ended:#?}");
        // With two threads too, what was placed before the disk was full is mapped.
        let scans = read_json(&summary)["scans"].clone();
        assert_eq!(scans["mapped"], scans["in"], "{threads}: {scans}");
        assert!(scans["mapped"].as_u64().unwrap() > 100, "{scans}");
        mapped.push(scans);
        for says in ["r.mcap", "cannot write the recording", "File too large"] {
            assert!(ended.stderr.contains(says), "{ended:#?}");
        }
        assert!(maps.join("occupancy.tif").exists());
        assert!(maps.join("trajectory.tum").exists());
    }
    assert_eq!(mapped[0], mapped[1]);
}

/// An export may take long, and be ended; what was recorded is whole before it begins.
#[test]
fn a_recording_is_at_its_end_before_the_maps_are_exported() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, maps) = (folder.path().join("r.mcap"), folder.path().join("maps"));
    let mut command = robot_edge("replay --quiet --record");
    command.arg(&recording).arg(rooms());
    run(command.arg("--export").arg(&maps)).succeeds();
    let written = |path: &Path| fs::metadata(path).unwrap().modified().unwrap();
    let exported = fs::read_dir(&maps).unwrap();
    let exported: Vec<_> = exported.map(|file| file.unwrap().path()).collect();
    assert!(exported.len() >= 5, "{exported:?}");
    for file in &exported {
        assert!(written(&recording) <= written(file), "{}", file.display());
    }
}

#[test]
fn the_recording_itself_is_never_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("rooms.mcap");
    let whole = fs::read(rooms()).unwrap();
    fs::write(&recording, &whole).unwrap();
    let other_name = folder.path().join("x/../rooms.mcap");
    fs::create_dir(folder.path().join("x")).unwrap();
    for path in [&recording, &other_name] {
        for option in ["--record", "--summary"] {
            replay(&recording, option, path)
                .refuses(2, &["the recording that is replayed", option]);
            assert!(
                fs::read(&recording).unwrap() == whole,
                "{option} destroyed it"
            );
        }
    }
    #[cfg(unix)]
    {
        let link = folder.path().join("link.mcap");
        std::os::unix::fs::symlink(&recording, &link).unwrap();
        replay(&recording, "--record", &link).refuses(2, &["the recording that is replayed"]);
        assert!(fs::read(&recording).unwrap() == whole);
    }
}

#[test]
fn a_part_behind_the_end_is_refused() {
    run(robot_edge("replay --start 116 --duration 3").arg(rooms()))
        .refuses(2, &["--start 116", "115.8 s"]);
    let last = run(robot_edge("replay --start 115.75").arg(rooms())).succeeds();
    assert!(
        last.stdout.contains("1 of 1 scans mapped"),
        "{}",
        last.stdout
    );
}

/// An empty map is no success that a script should go on with.
#[test]
fn a_run_that_maps_nothing_fails_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.json");
    // Poses come every 0.02 s: none is that near.
    let words = "replay --quiet --set localization.max_gap_s=0.001 --set localization.max_extrapolation_s=0";
    let ended = run(robot_edge(words).arg(rooms()).arg("--summary").arg(&path));
    ended.refuses(
        1,
        &[
            "rooms.mcap",
            "none of its 1159 scans could be mapped",
            "pose_gap",
        ],
    );
    let summary = read_json(&path);
    assert_eq!(summary["scans"]["in"], 1159);
    assert_eq!(summary["scans"]["mapped"], 0);
}
