//! Octree, slope cost, rigidity and shores: drives, their recordings, and the files they leave behind.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::process::{robot_edge, run, summary_of};

/// The octree of the first 8 s in the world `yard` with seed 1. If a change to the mapping core is meant to change
/// maps, look at the map and put the new digest here.
const VOXELS: &str = "e9c5c1e11e5a9b1fa9f7d151b95530f6e6ab4c12421e6810ec83c39251c4cdfa";

fn digests(summary: &Value) -> Vec<String> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let layers = summary["layers"].as_object().unwrap().values();
    let layers = layers.map(|layer| text(&layer["digest"]));
    layers.chain([text(&summary["voxels"]["digest"])]).collect()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_recorded_drive_gives_the_voxels_of_the_drive_with_one_thread_or_two() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, maps) = (folder.path().join("yard.mcap"), folder.path().join("maps"));
    let driven = summary_of(
        robot_edge("simulate yard --duration 8 --rate max --record")
            .arg(&recording)
            .arg("--export")
            .arg(&maps),
    );
    assert_eq!(driven["vehicle"], "introbot");
    assert_eq!(driven["voxels"]["digest"], VOXELS);
    for options in ["", "--set mapping.threads=2", "--rate 50"] {
        let replayed = summary_of(
            robot_edge("replay")
                .arg(&recording)
                .args(options.split_whitespace()),
        );
        assert_eq!(digests(&replayed), digests(&driven), "{options}");
    }
    assert_eq!(
        names(&maps),
        [
            "cost.png",
            "cost.tif",
            "points.ply",
            "rigidity.png",
            "rigidity.tif",
            "trajectory.tum",
            "voxels.bt"
        ]
    );
    let voxels = &driven["voxels"];
    let occupied = voxels["occupied"].as_u64().unwrap();
    assert!(
        occupied > 5_000 && voxels["free"].as_u64().unwrap() > 500_000,
        "{voxels}"
    );
    let points = fs::read(maps.join("points.ply")).unwrap();
    let header = points
        .windows(10)
        .position(|bytes| bytes == b"end_header")
        .unwrap();
    let header = std::str::from_utf8(&points[..header]).unwrap();
    assert!(
        header.contains(&format!("element vertex {occupied}\n")),
        "{header}"
    );
    let tree = fs::read(maps.join("voxels.bt")).unwrap();
    assert!(tree.starts_with(b"# Octomap OcTree binary file"));

    // Every beam has one fate.
    let beams = &driven["beams"];
    let count = |what: &str| beams[what].as_u64().unwrap();
    let dropped = beams["dropped"].as_object().unwrap();
    let dropped: u64 = dropped.values().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(count("in"), count("hits") + count("misses") + dropped);
    assert!(
        beams["dropped"]["isolated"].as_u64().unwrap() > 0,
        "{beams}"
    );
}

#[test]
fn a_boat_leaves_its_shores_behind_where_they_are_on_earth() {
    let folder = tempfile::tempdir().unwrap();
    let maps = folder.path().join("maps");
    let driven =
        summary_of(robot_edge("simulate lake --duration 6 --rate max --export").arg(&maps));
    assert_eq!(driven["vehicle"], "riverwatch");
    let names = names(&maps);
    for name in ["cost.tif", "shore.tif", "shores.geojson", "voxels.bt"] {
        assert!(
            names.iter().any(|found| found == name),
            "{name} is not among {names:?}"
        );
    }
    let shores: Value =
        serde_json::from_slice(&fs::read(maps.join("shores.geojson")).unwrap()).unwrap();
    assert_eq!(shores["type"], "FeatureCollection");
    let features = shores["features"].as_array().unwrap();
    let clusters = features
        .iter()
        .map(|feature| &feature["properties"])
        .filter(|properties| properties["kind"] == "shore");
    assert!(clusters.clone().count() > 0, "{shores}");
    for cluster in clusters {
        let center = &cluster["center"];
        let [longitude, latitude] = [0, 1].map(|axis| center[axis].as_f64().unwrap());
        assert!(
            (longitude + 9.17).abs() < 0.01 && (latitude - 38.51).abs() < 0.01,
            "{center}"
        );
    }
}

#[test]
fn a_small_memory_limit_evicts_counts_tells_and_goes_on() {
    let evicting = summary_of(&mut robot_edge(
        "simulate yard --duration 8 --rate max --set mapping.octree.memory_limit_mb=1",
    ));
    let voxels = &evicting["voxels"];
    assert!(
        voxels["evicted_bricks"].as_u64().unwrap() > 1000,
        "{voxels}"
    );
    assert!(voxels["bytes"].as_u64().unwrap() < 1_200_000, "{voxels}");
    let events = evicting["events"].as_array().unwrap();
    let told: Vec<_> = events
        .iter()
        .filter(|event| event["kind"] == "voxels_evicted")
        .collect();
    let [event] = told[..] else {
        panic!("{events:?}")
    };
    let message = event["message"].as_str().unwrap();
    assert!(
        message.contains("mapping.octree.memory_limit_mb"),
        "{message}"
    );
    assert_eq!(evicting["scans"]["mapped"], evicting["scans"]["in"]);
}

#[test]
fn senseless_settings_of_voxels_are_refused() {
    for (setting, says) in [
        ("mapping.octree.p_min=0.6", "0.001 to 0.499"),
        ("mapping.cost.enabled=false", "mapping.rigidity.enabled"),
        ("mapping.cost.box_m=500", "1 to 200"),
        ("mapping.shore.sparse_below=0.9", "0 to 0.68"),
        (
            "mapping.rigidity.traversable_vegetation_cost=1",
            "0 to 0.996",
        ),
        ("sensors.laser.p_hit=0.4", "sensors.laser.p_hit"),
    ] {
        let ended = run(robot_edge("simulate yard --set").arg(setting));
        ended.refuses(2, &[says]);
    }
}
