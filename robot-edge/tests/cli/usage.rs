//! Wrong usage ends with code 2 and says what to do; `check` and `vehicles` help to get it right. `experiments` writes a page with
//! pictures; the hidden command `motor-guard` owns the motors.

use std::fs;

use crate::process::{robot_edge, rooms, run, summary_of};

#[test]
fn wrong_options_say_what_is_right() {
    for (options, says) in [
        (
            "--set mapping.occupancy.cell=0.2",
            &["`mapping.occupancy.cell`: unknown key: did you mean `mapping.occupancy.cell_m`?"][..],
        ),
        (
            "--set mapping.ocupancy.cell_m=0.2",
            &["did you mean `mapping.occupancy"],
        ),
        (
            "--vehicle pionear",
            &[
                "did you mean `pioneer`?",
                "Presets: generic2d, generic3d, holos, holos-tilt, introbot, lidar16, lidar64, pioneer, riverwatch, riverwatch-lidar",
            ],
        ),
        ("--vehicle boat.toml", &["boat.toml: there is no such file"]),
        ("--topic lidar=/scan", &["no sensor of this name", "laser"]),
        (
            "--set mapping.occupancy.cell_m=wide",
            &["expected a number", "\"wide\""],
        ),
        (
            "--set mapping.occupancy.cell_m=0",
            &["mapping.occupancy.cell_m", "not allowed", "allowed:"],
        ),
        ("--set mapping.threads=3", &["3 is not allowed", "1 to 2"]),
        (
            "--set localization.source=stars",
            &["localization.source", "stars", "odometry"],
        ),
        ("--set cell", &["no `=`"]),
        ("--rate 0", &["a number above 0", "`max`"]),
        ("--rate fast", &["a number above 0", "`max`"]),
        ("--topic /scan", &["laser=/scan"]),
        ("--duration 0", &["a number above 0"]),
        ("--start=-1", &["0 or more"]),
        ("--frobnicate", &["--frobnicate", "--help"]),
        // The recording lacks this source of poses, or this frame.
        (
            "--set localization.source=log",
            &[
                "\"log\"",
                "its scans bring no poses of their own",
                "transforms",
                "localization.source=auto",
            ],
        ),
        (
            "--set localization.fixed_frame=map",
            &["no frame \"map\"", "odom", "localization.fixed_frame"],
        ),
    ] {
        run(robot_edge("replay").arg(rooms()).args(options.split(' '))).refuses(2, says);
    }
}

#[test]
fn faults_of_the_command_line_and_unknown_worlds_are_refused_at_once() {
    for (line, says) in [
        (
            "replay no_such_file.mcap --vehicle pionear",
            &["did you mean `pioneer`?"][..],
        ),
        ("simulate roams", &["`roams`", "rooms"]),
        (
            "simulate rooms --vehicle pionear",
            &["did you mean `pioneer`?"],
        ),
        ("simulate rooms --seed x", &["--seed"]),
        (
            "simulate rooms --set localization.source=log",
            &["\"auto\""],
        ),
    ] {
        run(&mut robot_edge(line)).refuses(2, says);
    }
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
    assert!(!help.stdout.contains("motor-guard"));
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
        [
            "generic2d",
            "generic3d",
            "holos",
            "holos-document",
            "holos-tilt",
            "introbot",
            "introbot-document",
            "lidar16",
            "lidar64",
            "pioneer",
            "pioneer-document",
            "riverwatch",
            "riverwatch-document",
            "riverwatch-lidar"
        ]
    );
    for name in names {
        let printed = run(robot_edge("vehicles").arg(name)).succeeds().stdout;
        fs::write(&mine, printed).unwrap();
        let checked = run(robot_edge("check").arg(&mine)).succeeds().stdout;
        assert!(
            checked.starts_with(&format!(
                "ok\nvehicle: {}, ",
                name.trim_end_matches("-document")
            )),
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
fn settings_that_are_probably_not_meant_are_reported_by_a_replay() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("mine.toml");
    let settings = "preset = \"pioneer\"\n[sensors.laser]\nbeams = 481\nfield_of_view_deg = 4\n[teleop]\nlease_s = 1.0\n";
    fs::write(&mine, settings).unwrap();
    let mut replay = robot_edge("replay --duration 1");
    let ended = run(replay.arg(rooms()).arg("--vehicle").arg(&mine)).succeeds();
    for line in [
        "warning: `sensors.laser.field_of_view_deg`: 481 beams in 4° are 0.0083° apart, which no laser resolves: are these radians?",
        "setup: without effect, as nothing is driven in this run: teleop.lease_s",
    ] {
        assert!(
            ended.stderr.lines().any(|found| found == line),
            "{}",
            ended.stderr
        );
    }
    fs::write(&mine, "[vehicle]\nwidth_m = 1\nheight_m = 1\n").unwrap();
    run(robot_edge("replay")
        .arg(rooms())
        .arg("--vehicle")
        .arg(&mine))
    .refuses(
        2,
        &["`vehicle.length_m`: missing: measure the vehicle, in metres"],
    );
}

/// Port 1 is nobody's.
#[test]
fn routers_that_do_not_answer_are_reported() {
    let live = run(&mut robot_edge(
        "run --no-network --ros tcp/127.0.0.1:1 --wait 2",
    ));
    assert_eq!(live.code, Some(1));
    for says in [
        "warning: no answer at tcp/127.0.0.1:1 yet: trying for ",
        "robot-edge: tcp/127.0.0.1:1: no ROS 2 system. Start its Zenoh router",
    ] {
        assert!(
            live.stderr.lines().any(|line| line.starts_with(says)),
            "{}",
            live.stderr
        );
    }
    assert!(!live.stderr.contains(".rs:"), "{}", live.stderr);

    let mut replay = robot_edge("");
    replay.arg("replay").arg(rooms());
    let ended = run(replay.args(["--rate", "25", "--connect", "tcp/127.0.0.1:1"])).succeeds();
    let says = "warning: nobody answers at tcp/127.0.0.1:1 yet: until a router does, no console reaches this robot there\n";
    assert!(ended.stderr.contains(says), "{}", ended.stderr);
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

#[test]
fn a_page_is_written_with_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let ended = run(robot_edge("experiments l1 L1").arg("--out").arg(&out)).succeeds();
    let page = out.join("experiments.md");
    assert_eq!(ended.stdout, format!("{}\n", page.display()));
    assert!(ended.stderr.starts_with("L1 pass ("), "{}", ended.stderr);
    assert_eq!(ended.stderr.lines().count(), 1);
    let text = fs::read_to_string(page).unwrap();
    assert_eq!(
        text.matches("\n## ").count(),
        1,
        "asked for twice, shown once"
    );
    for line in text.lines().filter(|line| line.contains("](experiments/")) {
        for link in line.split("](").skip(1) {
            let (file, _) = link.split_once(')').unwrap();
            assert!(out.join(file).is_file(), "{file}");
        }
    }
    assert!(text.contains("](experiments/l1-agreement.png)"));
}

#[test]
fn what_is_no_experiment_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let ended = run(robot_edge("experiments E99").arg("--out").arg(&out));
    ended.refuses(2, &["`E99`", "H8, L1, L2"]);
    assert!(!out.exists());
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    run(robot_edge("experiments L1").arg("--out").arg(&file)).refuses(1, &["file"]);
}

#[cfg(target_os = "linux")]
const CONFIG: &str = r#"{"Roboteq":{"port":"/dev/nonexistent","left_channel":"one","drive":{"track_width_m":0.5,"full_speed_mps":1.0}}}"#;

#[cfg(target_os = "linux")]
#[test]
fn the_motor_guard_tells_what_it_knows_and_ends_when_its_pipe_closes() {
    let mut guard = robot_edge("motor-guard");
    let ended = guard
        .arg(CONFIG)
        .stdin(std::process::Stdio::null())
        .output()
        .unwrap();
    assert!(ended.status.success());
    // Frames of 92 bytes, the first of which begins like this.
    assert_eq!(ended.stdout.get(..4), Some([0xF5, b'M', 1, 2].as_slice()));
    assert_eq!(ended.stdout.len() % 92, 0);
    assert!(
        ended.stderr.is_empty(),
        "a terminal that is stopped would stop it"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_motor_guard_without_a_configuration_is_refused_as_wrong_usage() {
    let ended = run(&mut robot_edge("motor-guard {\"port\":1}"));
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("motor guard: "), "{}", ended.stderr);
}
