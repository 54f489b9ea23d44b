//! Every real recording at hand is mapped, or refused with words that say what to do; the same log in two formats gives the
//! same map.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::process::{
    Comparison, Ended, OccupancyTiff, assert_every_beam_counted, events, names_in, read_json,
    robot_edge, run, summary_of,
};
use crate::shared_data::shared_data;

/// A file, the options it is replayed with, scans and beams of which all are mapped, and words of the events.
type Mapped = (
    &'static str,
    &'static str,
    u64,
    u64,
    &'static [&'static str],
);
/// A file, the options it is replayed with, exit code, and words of the message.
type Refused = (&'static str, &'static str, i32, &'static [&'static str]);

const STANDS_STILL: &str = "--set localization.source=static";
const FRONT_STANDS_STILL: &str = "--topic laser=/front_scan --set localization.source=static";
const REAR_STANDS_STILL: &str = "--topic laser=/rear_scan --set localization.source=static";

const OWN_POSES: &str = "poses: those that FLASER brings for its own scans";
const NO_RETURN_50_M: &str = "FLASER reports 50 m where it sees nothing";
const NO_RETURN_51_M: &str = "FLASER reports 51.01 m where it sees nothing";
const NO_VEHICLE: &str = "generic2d (the recording names no vehicle";
const BAD_INDEX: &[&str] = &[
    "the recording lost 2 × damaged",
    "byte 792650: an index whose length",
];
const NO_POSES: &[&str] = &["nothing in it says where the laser was", STANDS_STILL];
const PICTURE: &[&str] = &["not a recording this program reads", "\\x89PNG"];
const RELATIONS: &[&str] = &[
    "not a recording this program reads: it begins with ",
    "MCAP",
    "CARMEN",
];

const CARMEN: &[Mapped] = &[
    (
        "intel-corrected.log",
        "",
        910,
        163_800,
        &[OWN_POSES, NO_VEHICLE, "stamps"],
    ),
    (
        "aces-corrected.log",
        "",
        440,
        79_200,
        &[OWN_POSES, NO_RETURN_50_M],
    ),
    ("csail-corrected.log", "", 406, 146_566, &[OWN_POSES]),
    ("belgioioso-corrected.log", "", 395, 142_595, &[OWN_POSES]),
    (
        "infinite-corridor-corrected.log",
        "",
        1941,
        349_380,
        &[OWN_POSES, NO_RETURN_51_M, "stamps"],
    ),
    (
        "aces.clf",
        "",
        7374,
        1_327_320,
        &[OWN_POSES, NO_RETURN_50_M],
    ),
    // Counted by awk: lines that begin with FLASER, and the sum of their second words.
    ("intel.clf", "", 13_631, 2_453_580, &[OWN_POSES, "stamps"]),
    ("mit-csail.clf", "", 1988, 717_668, &[OWN_POSES]),
];
const NO_CARMEN: &[Refused] = &[
    ("aces.relations", "", 3, RELATIONS),
    ("intel.relations", "", 3, RELATIONS),
    ("csail.relations", "", 3, RELATIONS),
    ("intel-corrected.png", "", 3, PICTURE),
    ("aces-corrected.png", "", 3, PICTURE),
    ("csail-corrected.png", "", 3, PICTURE),
    ("belgioioso-corrected.png", "", 3, PICTURE),
    ("infinite-corridor-corrected.png", "", 3, PICTURE),
];

const ROSBAG1: &[Mapped] = &[
    (
        "urg04lx_handheld.bag",
        STANDS_STILL,
        360,
        245_160,
        &["the vehicle stands still"],
    ),
    ("damaged_index.bag", STANDS_STILL, 360, 245_160, BAD_INDEX),
    (
        "lms1xx_with_tf.bag",
        STANDS_STILL,
        89,
        48_149,
        &["laser: /sick_lms_1xx/scan"],
    ),
    (
        "two_lasers.bag",
        FRONT_STANDS_STILL,
        331,
        240_306,
        &["laser: /front_scan"],
    ),
    (
        "two_lasers.bag",
        REAR_STANDS_STILL,
        330,
        239_580,
        &["laser: /rear_scan"],
    ),
];
const REFUSED_ROSBAG1: &[Refused] = &[
    ("urg04lx_handheld.bag", "", 2, NO_POSES),
    ("damaged_index.bag", "", 2, NO_POSES),
    (
        "lms1xx_with_tf.bag",
        "",
        2,
        &[
            "there are transforms (cloud → radar)",
            "none leads from cloud",
            STANDS_STILL,
        ],
    ),
    (
        "two_lasers.bag",
        "",
        2,
        &["/rear_scan, /front_scan", "--topic laser=/rear_scan"],
    ),
    ("two_lasers.bag", "--topic laser=/front_scan", 2, NO_POSES),
    (
        "two_lasers.bag",
        "--topic laser=/side_scan",
        2,
        &[
            "no scans on \"/side_scan\"",
            "it has /rear_scan, /front_scan",
        ],
    ),
    (
        "version_1.2.bag",
        "",
        3,
        &["ROS bag version 1.2 is not supported", "rosbag fix"],
    ),
];

const MCAP: &[Mapped] = &[(
    "intel_corrected.mcap",
    "",
    910,
    163_800,
    &["poses: transforms up to frame odom"],
)];
const REFUSED_MCAP: &[Refused] = &[(
    "turtlebot_tf_odom.mcap",
    "",
    2,
    &["there is no range sensor in it", "robot-edge info"],
)];

fn replay(folder: &Path, file: &str, options: &str, summary: &Path) -> Ended {
    run(robot_edge(&format!("replay --quiet {options}"))
        .arg(folder.join(file))
        .arg("--summary")
        .arg(summary))
}

/// Checks the cases, and that there is one for every file in the folder but those `elsewhere`.
fn check_folder(part: &str, mapped: &[Mapped], refused: &[Refused], elsewhere: &[&str]) {
    let Some(folder) = shared_data(part) else {
        return;
    };
    let files = mapped.iter().map(|case| case.0);
    let files = files.chain(refused.iter().map(|case| case.0));
    let expected: BTreeSet<_> = files.chain(elsewhere.iter().copied()).collect();
    for name in names_in(&folder) {
        assert!(
            expected.contains(name.as_str()),
            "nothing is expected of {name}"
        );
    }
    let figures = tempfile::tempdir().unwrap();
    let path = figures.path().join("s.json");
    for &(file, options, code, says) in refused {
        let ended = replay(&folder, file, options, &path);
        ended.refuses(code, says);
        assert!(
            ended.stderr.contains(file),
            "the message names no file: {}",
            ended.stderr
        );
        assert!(!path.exists(), "{file} was refused and has a summary");
    }
    for &(file, options, scans, beams, says) in mapped {
        let ended = replay(&folder, file, options, &path);
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{file}");
        let summary = read_json(&path);
        let fate = serde_json::json!({"in": scans, "mapped": scans, "dropped": {}});
        assert_eq!(summary["scans"], fate, "{file}");
        assert_eq!(assert_every_beam_counted(&summary), beams, "{file}");
        let hits = summary["beams"]["hits"].as_u64().unwrap();
        assert!(hits * 2 > beams, "{file}: {hits}");
        let events = events(&summary).join("\n");
        for part in says {
            assert!(events.contains(part), "{file}: no {part:?} in\n{events}");
        }
    }
}

#[test]
fn carmen_logs() {
    check_folder("carmen", CARMEN, NO_CARMEN, &["fr-clinic_robotlaser.clf"]);
}

#[test]
fn ros_1_bags() {
    check_folder("rosbag1", ROSBAG1, REFUSED_ROSBAG1, &[]);
}

#[test]
fn mcap_files() {
    check_folder("mcap", MCAP, REFUSED_MCAP, &["conformance"]);
}

#[test]
fn a_log_of_1400_m_is_mapped_in_little_memory() {
    let Some(folder) = shared_data("carmen") else {
        return;
    };
    let file = folder.join("fr-clinic_robotlaser.clf");
    let summary = summary_of(robot_edge("replay --rate max").arg(file));
    assert_eq!(
        summary["scans"],
        serde_json::json!({"in": 6917, "mapped": 6917, "dropped": {}})
    );
    assert_eq!(summary["beams"]["in"], 1_246_808);
    let peak = summary["peak_rss_bytes"].as_u64().unwrap();
    println!("peak memory of fr-clinic: {:.1} MB", peak as f64 / 1e6);
    assert!(peak < 200_000_000, "{peak} bytes");
}

fn map_of(recording: &Path) -> OccupancyTiff {
    let maps = tempfile::tempdir().unwrap();
    let summary = summary_of(
        robot_edge("replay")
            .arg(recording)
            .arg("--export")
            .arg(maps.path()),
    );
    assert_eq!(
        summary["scans"]["mapped"],
        summary["scans"]["in"],
        "{}",
        recording.display()
    );
    OccupancyTiff::read(maps.path())
}

fn print(name: &str, comparison: &Comparison) {
    println!(
        "{name}: {:.4} % agree: {comparison:?}",
        100.0 * comparison.share()
    );
}

/// All that differs is the order of four pairs of scans. The log holds them with stamps that go back, and
/// what is logged first is mapped first; the MCAP file gives each its own stamp, and stamps decide. Where
/// cells are clamped the order shows: a handful of them differ, and none once the log is in order. Yaws as
/// quaternions, and ranges and angles as f32, change not one cell.
#[test]
fn intel_from_carmen_and_from_mcap_agree() {
    let (Some(carmen), Some(mcap)) = (shared_data("carmen"), shared_data("mcap")) else {
        return;
    };
    let (log, mcap) = (
        carmen.join("intel-corrected.log"),
        mcap.join("intel_corrected.mcap"),
    );
    let of_mcap = map_of(&mcap);
    let comparison = map_of(&log).compare(&of_mcap);
    print("intel, CARMEN against MCAP", &comparison);
    assert!(comparison.cells > 50_000);
    assert!(comparison.share() >= 0.999, "{comparison:?}");

    let folder = tempfile::tempdir().unwrap();
    let in_order = folder.path().join("in-order.log");
    fs::write(&in_order, scans_in_order(&fs::read_to_string(log).unwrap())).unwrap();
    let comparison = map_of(&in_order).compare(&of_mcap);
    print("intel, its scans in order, against MCAP", &comparison);
    assert_eq!(comparison.equal, comparison.cells);
}

/// The log with its FLASER lines in the order of their stamps.
fn scans_in_order(log: &str) -> String {
    let is_scan = |line: &&str| line.starts_with("FLASER ");
    let stamp = |line: &str| line.rsplit(' ').next().unwrap().parse::<f64>().unwrap();
    let mut scans: Vec<&str> = log.lines().filter(is_scan).collect();
    scans.sort_by(|one, other| stamp(one).total_cmp(&stamp(other)));
    let mut scans = scans.into_iter();
    let lines = log.lines().map(|line| {
        if is_scan(&line) {
            scans.next().unwrap()
        } else {
            line
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Logs whose stamps repeat, are negative or stand still, and lasers that do not say what a miss is.
#[test]
fn carmen_logs_recorded_as_mcap_give_the_same_maps() {
    let Some(carmen) = shared_data("carmen") else {
        return;
    };
    for name in [
        "intel-corrected.log",
        "aces-corrected.log",
        "csail-corrected.log",
        "belgioioso-corrected.log",
        "infinite-corridor-corrected.log",
    ] {
        let folder = tempfile::tempdir().unwrap();
        let recorded = folder.path().join("recorded.mcap");
        summary_of(
            robot_edge("replay")
                .arg(carmen.join(name))
                .arg("--export")
                .arg(folder.path())
                .arg("--record")
                .arg(&recorded),
        );
        let comparison = OccupancyTiff::read(folder.path()).compare(&map_of(&recorded));
        print(name, &comparison);
        assert!(comparison.share() >= 0.999, "{name}: {comparison:?}");
    }
}

/// Keyframes lie a metre apart in these logs, and their clocks say nothing of the speed.
#[test]
fn keyframes_without_a_clock_are_no_pose_jumps() {
    let Some(folder) = shared_data("carmen") else {
        return;
    };
    for name in [
        "belgioioso-corrected.log",
        "csail-corrected.log",
        "infinite-corridor-corrected.log",
    ] {
        let ended = run(robot_edge("replay").arg(folder.join(name))).succeeds();
        let jumps = ended
            .stdout
            .lines()
            .filter(|line| line.starts_with("pose_jump"));
        assert!(jumps.count() <= 1, "{}", ended.stdout);
        assert!(ended.stdout.lines().count() < 12, "{}", ended.stdout);
    }
}
