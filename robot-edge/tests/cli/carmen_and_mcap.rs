//! The same log in two formats gives the same map.

use std::fs;
use std::path::Path;

use crate::exported_map::{Comparison, OccupancyTiff};
use crate::process::{robot_edge, summary_of};
use crate::shared_data::shared_data;

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
