//! Every real recording at hand is mapped, or refused with words that say what to do.

use std::fs;

use crate::process::{Ended, events, read_json, robot_edge, run};
use crate::shared_data::shared_data;

/// A file, the options it is replayed with, and what has to come of it.
struct Case {
    file: &'static str,
    options: &'static str,
    outcome: Outcome,
}

enum Outcome {
    /// Every scan is mapped; the events hold these words.
    Mapped {
        scans: u64,
        beams: u64,
        says: &'static [&'static str],
    },
    /// Exit code and words of the message.
    Refused {
        code: i32,
        says: &'static [&'static str],
    },
}

const fn mapped(file: &'static str, scans: u64, beams: u64, says: &'static [&'static str]) -> Case {
    let outcome = Outcome::Mapped { scans, beams, says };
    Case {
        file,
        options: "",
        outcome,
    }
}

const fn refused(file: &'static str, code: i32, says: &'static [&'static str]) -> Case {
    let outcome = Outcome::Refused { code, says };
    Case {
        file,
        options: "",
        outcome,
    }
}

const fn with(options: &'static str, case: Case) -> Case {
    Case { options, ..case }
}

const STANDS_STILL: &str = "--set localization.source=static";

fn carmen() -> Vec<Case> {
    const OWN_POSES: &str = "poses: those that FLASER brings for its own scans";
    const NO_VEHICLE: &str = "generic2d (the recording names no vehicle";
    let picture = |file| refused(file, 3, &["not a recording this program reads", "\\x89PNG"]);
    let relations = |file| {
        let says = &[
            "not a recording this program reads: it begins with ",
            "MCAP",
            "CARMEN",
        ];
        refused(file, 3, says)
    };
    vec![
        mapped(
            "intel-corrected.log",
            910,
            163_800,
            &[OWN_POSES, NO_VEHICLE, "stamps"],
        ),
        mapped(
            "aces-corrected.log",
            440,
            79_200,
            &[OWN_POSES, "FLASER reports 50 m where it sees nothing"],
        ),
        mapped("csail-corrected.log", 406, 146_566, &[OWN_POSES]),
        mapped("belgioioso-corrected.log", 395, 142_595, &[OWN_POSES]),
        mapped(
            "infinite-corridor-corrected.log",
            1941,
            349_380,
            &[
                OWN_POSES,
                "FLASER reports 51.01 m where it sees nothing",
                "stamps",
            ],
        ),
        mapped(
            "aces.clf",
            7374,
            1_327_320,
            &[OWN_POSES, "FLASER reports 50 m where it sees nothing"],
        ),
        // Counted by awk: lines that begin with FLASER, and the sum of their second words.
        mapped("intel.clf", 13_631, 2_453_580, &[OWN_POSES, "stamps"]),
        mapped("mit-csail.clf", 1988, 717_668, &[OWN_POSES]),
        relations("aces.relations"),
        relations("intel.relations"),
        relations("csail.relations"),
        picture("intel-corrected.png"),
        picture("aces-corrected.png"),
        picture("csail-corrected.png"),
        picture("belgioioso-corrected.png"),
        picture("infinite-corridor-corrected.png"),
    ]
}

fn rosbag1() -> Vec<Case> {
    let no_poses = &[
        "nothing in it says where the laser was",
        "--set localization.source=static",
    ];
    vec![
        refused("urg04lx_handheld.bag", 2, no_poses),
        with(
            STANDS_STILL,
            mapped(
                "urg04lx_handheld.bag",
                360,
                245_160,
                &["the vehicle stands still"],
            ),
        ),
        refused("damaged_index.bag", 2, no_poses),
        with(
            STANDS_STILL,
            mapped(
                "damaged_index.bag",
                360,
                245_160,
                &[
                    "the recording lost 2 × damaged",
                    "byte 792650: an index whose length",
                ],
            ),
        ),
        refused(
            "lms1xx_with_tf.bag",
            2,
            &[
                "there are transforms (cloud → radar)",
                "none leads from cloud",
                "--set localization.source=static",
            ],
        ),
        with(
            STANDS_STILL,
            mapped(
                "lms1xx_with_tf.bag",
                89,
                48_149,
                &["laser: /sick_lms_1xx/scan"],
            ),
        ),
        refused(
            "two_lasers.bag",
            2,
            &["/rear_scan, /front_scan", "--topic laser=/rear_scan"],
        ),
        with(
            "--topic laser=/front_scan",
            refused("two_lasers.bag", 2, no_poses),
        ),
        with(
            "--topic laser=/front_scan --set localization.source=static",
            mapped("two_lasers.bag", 331, 240_306, &["laser: /front_scan"]),
        ),
        with(
            "--topic laser=/rear_scan --set localization.source=static",
            mapped("two_lasers.bag", 330, 239_580, &["laser: /rear_scan"]),
        ),
        with(
            "--topic laser=/side_scan",
            refused(
                "two_lasers.bag",
                2,
                &[
                    "no scans on \"/side_scan\"",
                    "it has /rear_scan, /front_scan",
                ],
            ),
        ),
        refused(
            "version_1.2.bag",
            3,
            &["ROS bag version 1.2 is not supported", "rosbag fix"],
        ),
    ]
}

fn mcap() -> Vec<Case> {
    vec![
        mapped(
            "intel_corrected.mcap",
            910,
            163_800,
            &["poses: transforms up to frame odom"],
        ),
        refused(
            "turtlebot_tf_odom.mcap",
            2,
            &["there is no range sensor in it", "robot-edge info"],
        ),
    ]
}

fn check(folder: &std::path::Path, case: &Case) {
    let Case {
        file,
        options,
        outcome,
    } = case;
    let figures = tempfile::tempdir().unwrap();
    let path = figures.path().join("s.json");
    let words = format!("replay --quiet {options}");
    let ended: Ended = run(robot_edge(&words)
        .arg(folder.join(file))
        .arg("--summary")
        .arg(&path));
    match outcome {
        Outcome::Refused { code, says } => {
            ended.refuses(*code, says);
            assert!(
                ended.stderr.contains(file),
                "the message names no file: {}",
                ended.stderr
            );
            assert!(!path.exists(), "{file} was refused and has a summary");
        }
        Outcome::Mapped { scans, beams, says } => {
            assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{file}");
            let summary = read_json(&path);
            let fate = serde_json::json!({"in": scans, "mapped": scans, "dropped": {}});
            assert_eq!(summary["scans"], fate, "{file}");
            let of_beams = &summary["beams"];
            let number = |name: &str| of_beams[name].as_u64().unwrap();
            let dropped = of_beams["dropped"].as_object().unwrap().values();
            let dropped: u64 = dropped.map(|n| n.as_u64().unwrap()).sum();
            assert_eq!(number("in"), *beams, "{file}");
            assert_eq!(
                number("hits") + number("misses") + dropped,
                *beams,
                "{file}"
            );
            assert!(number("hits") * 2 > *beams, "{file}: {of_beams}");
            let events = events(&summary).join("\n");
            for part in *says {
                assert!(events.contains(part), "{file}: no {part:?} in\n{events}");
            }
        }
    }
}

/// Checks the cases, and that there is one for every file in the folder but those `elsewhere`.
fn check_folder(part: &str, cases: &[Case], elsewhere: &[&str]) {
    let Some(folder) = shared_data(part) else {
        return;
    };
    for entry in fs::read_dir(&folder).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        let is_known =
            cases.iter().any(|case| case.file == name) || elsewhere.contains(&name.as_str());
        assert!(is_known, "nothing is expected of {name}");
    }
    for case in cases {
        check(&folder, case);
    }
}

#[test]
fn carmen_logs() {
    check_folder("carmen", &carmen(), &["fr-clinic_robotlaser.clf"]);
}

#[test]
fn ros_1_bags() {
    check_folder("rosbag1", &rosbag1(), &[]);
}

#[test]
fn mcap_files() {
    check_folder("mcap", &mcap(), &["conformance"]);
}

#[test]
fn a_log_of_1400_m_is_mapped_in_little_memory() {
    let Some(folder) = shared_data("carmen") else {
        return;
    };
    let file = folder.join("fr-clinic_robotlaser.clf");
    let summary = crate::process::summary_of(robot_edge("replay --rate max").arg(file));
    assert_eq!(
        summary["scans"],
        serde_json::json!({"in": 6917, "mapped": 6917, "dropped": {}})
    );
    assert_eq!(summary["beams"]["in"], 1_246_808);
    let peak = summary["peak_rss_bytes"].as_u64().unwrap();
    println!("peak memory of fr-clinic: {:.1} MB", peak as f64 / 1e6);
    assert!(peak < 200_000_000, "{peak} bytes");
}
