//! Wrong usage ends with code 2 and says what to do; `check` and `vehicles` help to get it right.

use std::fs;

use crate::process::{robot_edge, rooms, run, summary_of};

#[track_caller]
fn refused(options: &str, says: &[&str]) {
    run(robot_edge("replay")
        .arg(rooms())
        .args(options.split_whitespace()))
    .refuses(2, says);
}

#[test]
fn settings_that_do_not_exist_name_the_nearest() {
    refused(
        "--set mapping.occupancy.cell=0.2",
        &["`mapping.occupancy.cell`: unknown key: did you mean `mapping.occupancy.cell_m`?"],
    );
    refused(
        "--set mapping.ocupancy.cell_m=0.2",
        &["did you mean `mapping.occupancy"],
    );
    refused(
        "--vehicle pionear",
        &[
            "did you mean `pioneer`?",
            "Presets: generic2d, holos, introbot, pioneer, riverwatch",
        ],
    );
    refused("--vehicle boat.toml", &["boat.toml", "No such file"]);
    refused("--topic lidar=/scan", &["no sensor of this name", "laser"]);
}

#[test]
fn settings_of_the_wrong_kind_say_what_is_right() {
    refused(
        "--set mapping.occupancy.cell_m=wide",
        &["expected a number", "\"wide\""],
    );
    refused(
        "--set mapping.occupancy.cell_m=0",
        &["mapping.occupancy.cell_m", "not allowed", "allowed:"],
    );
    refused("--set mapping.threads=3", &["3 is not allowed", "1 to 2"]);
    refused(
        "--set localization.source=stars",
        &["localization.source", "stars", "odometry"],
    );
    refused("--set cell", &["no `=`"]);
    refused("--rate 0", &["a number above 0", "`max`"]);
    refused("--rate fast", &["a number above 0", "`max`"]);
    refused("--topic /scan", &["laser=/scan"]);
    refused("--duration 0", &["a number above 0"]);
    refused("--start=-1", &["0 or more"]);
    refused("--frobnicate", &["--frobnicate", "--help"]);
}

#[test]
fn pose_sources_that_the_recording_lacks_are_told_apart() {
    refused(
        "--set localization.source=log",
        &[
            "\"log\"",
            "its scans bring no poses of their own",
            "transforms",
            "localization.source=auto",
        ],
    );
    refused(
        "--set localization.fixed_frame=map",
        &["no frame \"map\"", "odom", "localization.fixed_frame"],
    );
}

#[test]
fn faults_of_the_command_line_do_not_wait_for_the_recording() {
    let ended = run(&mut robot_edge(
        "replay no_such_file.mcap --vehicle pionear",
    ));
    ended.refuses(2, &["did you mean `pioneer`?"]);
}

#[test]
fn worlds_that_do_not_exist_are_refused() {
    run(&mut robot_edge("simulate roams")).refuses(2, &["`roams`", "rooms"]);
    run(&mut robot_edge("simulate rooms --vehicle pionear"))
        .refuses(2, &["did you mean `pioneer`?"]);
    run(&mut robot_edge("simulate rooms --seed x")).refuses(2, &["--seed"]);
    run(&mut robot_edge(
        "simulate rooms --set localization.source=log",
    ))
    .refuses(2, &["\"auto\""]);
}

#[test]
fn no_command_and_unknown_commands_show_what_there_is() {
    let none = run(&mut robot_edge(""));
    assert_eq!(none.code, Some(2));
    for command in [
        "replay",
        "simulate",
        "info",
        "recover",
        "vehicles",
        "check",
        "completions",
    ] {
        assert!(
            none.stderr.contains(&format!("\n  {command} ")),
            "{}",
            none.stderr
        );
    }
    run(&mut robot_edge("reply x")).refuses(2, &["reply", "replay"]);
    let help = run(&mut robot_edge("--help")).succeeds();
    assert!(
        help.stdout
            .contains("3 the recording could not be read; 130 interrupted")
    );
    let version = run(&mut robot_edge("--version")).succeeds();
    assert_eq!(
        version.stdout,
        concat!("robot-edge ", env!("CARGO_PKG_VERSION"), "\n")
    );
}

#[test]
fn a_printed_preset_is_a_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("mine.toml");
    let list = run(&mut robot_edge("vehicles")).succeeds().stdout;
    let names: Vec<_> = list
        .lines()
        .map(|line| line.split_whitespace().next().unwrap())
        .collect();
    assert_eq!(
        names,
        ["generic2d", "holos", "introbot", "pioneer", "riverwatch"]
    );
    for name in names {
        let printed = run(robot_edge("vehicles").arg(name)).succeeds().stdout;
        fs::write(&mine, printed).unwrap();
        let checked = run(robot_edge("check").arg(&mine)).succeeds().stdout;
        assert!(
            checked.starts_with(&format!("ok\nvehicle: {name}, ")),
            "{checked}"
        );
        assert_eq!(
            run(robot_edge("check").arg(name)).succeeds().stdout,
            checked
        );
    }
    // The recording names the pioneer.
    let pioneer = run(&mut robot_edge("vehicles pioneer")).succeeds().stdout;
    fs::write(&mine, pioneer).unwrap();
    let by_file = summary_of(
        robot_edge("replay")
            .arg(rooms())
            .arg("--vehicle")
            .arg(&mine),
    );
    let by_name = summary_of(robot_edge("replay").arg(rooms()));
    assert_eq!(by_file["layers"], by_name["layers"]);
    run(&mut robot_edge("vehicles pionear")).refuses(2, &["did you mean `pioneer`?"]);
}

#[test]
fn check_tells_every_fault_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.toml");
    fs::write(
        &bad,
        "preset = \"pioneer\"\n\n[mapping.occupancy]\ncell = 0.1\np_free = 2\n\n[vehicle]\nlength_m = \"long\"\n",
    )
    .unwrap();
    let checked = run(robot_edge("check").arg(&bad));
    assert_eq!((checked.code, checked.stderr.as_str()), (Some(2), ""));
    assert_eq!(
        checked
            .stdout
            .replace(&format!("{}/", folder.path().display()), ""),
        "bad.toml:4:1: `mapping.occupancy.cell`: unknown key: did you mean `mapping.occupancy.cell_m`?\n\
         bad.toml:8:1: `vehicle.length_m`: expected a number, found the text \"long\"\n"
    );
    run(robot_edge("replay").arg(rooms()).arg("--vehicle").arg(&bad));
    let missing = run(&mut robot_edge("check missing.toml"));
    assert_eq!(missing.code, Some(2));
    assert!(missing.stdout.contains("missing.toml"), "{missing:?}");
}

#[test]
fn completions_are_for_the_program_by_its_name() {
    for shell in ["bash", "zsh", "fish"] {
        let script = run(robot_edge("completions").arg(shell)).succeeds().stdout;
        assert!(
            script.contains("robot-edge") && script.contains("replay"),
            "{shell}"
        );
    }
    run(&mut robot_edge("completions csh")).refuses(2, &["bash"]);
}
