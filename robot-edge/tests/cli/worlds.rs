//! Elevation, obstacles, octree, slope cost, rigidity and shores: drives, their recordings, and the files they leave behind.

use std::fs;

use serde_json::{Value, json};

use crate::gdal::gis_report;
use crate::process::{assert_every_beam_counted, names_in, robot_edge, run, summary_of};

/// The obstacle layer of the world `ramp` with seed 1. If a change to the mapping core is meant to change
/// maps, look at the map and put the new digest here.
const OBSTACLE: &str = "ace72b5e3b8598f13546e488afbc2ac537ee268e377559106b54168402986ac8";

#[test]
fn a_recorded_drive_gives_the_maps_of_the_drive() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("ramp.mcap");
    let driven = summary_of(robot_edge("simulate ramp --rate max --record").arg(&recording));
    let digest = |summary: &Value, layer: &str| {
        summary["layers"][layer]["digest"]
            .as_str()
            .unwrap()
            .to_owned()
    };
    assert_eq!(digest(&driven, "obstacle"), OBSTACLE);
    for options in ["", "--set mapping.threads=2", "--rate 25"] {
        let replayed = summary_of(
            robot_edge("replay")
                .arg(&recording)
                .args(options.split_whitespace()),
        );
        for layer in ["elevation", "obstacle"] {
            assert_eq!(
                digest(&replayed, layer),
                digest(&driven, layer),
                "{layer} {options}"
            );
        }
    }

    assert_eq!(driven["vehicle"], "holos");
    let changes: Vec<_> = driven["events"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|event| event["kind"] == "ground_plane")
        .collect();
    let [change] = changes[..] else {
        panic!("{changes:?}");
    };
    let message = change["message"].as_str().unwrap();
    assert!(
        message.contains("pitch went from 0.0° to 4.0°"),
        "{message}"
    );
    assert!(change["stamp_s"].as_f64().unwrap() > 946_684_830.0);

    assert_every_beam_counted(&driven);
    let classes = &driven["layers"]["obstacle"]["counts"];
    let known = driven["layers"]["obstacle"]["cells_known"]
        .as_u64()
        .unwrap();
    let [free, obstacle] = ["free", "obstacle"].map(|class| classes[class].as_u64().unwrap());
    assert_eq!(free + obstacle, known);
    assert!(free > 1500 && obstacle > 100, "{classes}");
}

/// The octree of the first 8 s in the world `yard` with seed 1. If a change to the mapping core is meant to change
/// maps, look at the map and put the new digest here.
const VOXELS: &str = "e9c5c1e11e5a9b1fa9f7d151b95530f6e6ab4c12421e6810ec83c39251c4cdfa";

fn digests(summary: &Value) -> Vec<String> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let layers = summary["layers"].as_object().unwrap().values();
    let layers = layers.map(|layer| text(&layer["digest"]));
    layers.chain([text(&summary["voxels"]["digest"])]).collect()
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
        names_in(&maps),
        [
            "cost.png",
            "cost.tif",
            "inter.png",
            "inter.tif",
            "intra.png",
            "intra.tif",
            "points.ply",
            "rigidity.png",
            "rigidity.tif",
            "trajectory.geojson",
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

    assert_every_beam_counted(&driven);
    let beams = &driven["beams"];
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
    let names = names_in(&maps);
    for name in [
        "cost.tif",
        "depth.geojson",
        "depth.tif",
        "intra.tif",
        "shore.tif",
        "shores.geojson",
        "trajectory.geojson",
        "voxels.bt",
    ] {
        assert!(
            names.iter().any(|found| found == name),
            "{name} is not among {names:?}"
        );
    }
    if let Some(report) = gis_report(&maps) {
        for (name, raster) in report["rasters"].as_object().unwrap() {
            assert_eq!(raster["problems"], json!([]), "{name}");
            assert_eq!(raster["method"], "Transverse_Mercator", "{name}");
        }
        let overviews = &report["rasters"]["cost.tif"]["overviews"];
        assert_eq!(overviews.as_array().map(Vec::len), Some(2));
        for (name, vector) in report["vectors"].as_object().unwrap() {
            assert_eq!(vector["crs"], "WGS 84", "{name}");
            let wrong = (&vector["invalid"], &vector["clockwise"]);
            assert_eq!(wrong, (&json!(0), &json!(0)), "{name}");
        }
        assert_eq!(report["vectors"].as_object().unwrap().len(), 3);
        // Longitudes and latitudes have steps of a millimetre.
        let error_m = report["place_error_m"].as_f64().unwrap();
        assert!(error_m < 0.001, "{error_m}");
    }
    let depths = &driven["layers"]["depth"];
    assert!(depths["cells_known"].as_u64().unwrap() > 1000, "{depths}");
    let contours: Value =
        serde_json::from_slice(&fs::read(maps.join("depth.geojson")).unwrap()).unwrap();
    let contours = contours["features"].as_array().unwrap();
    let is_of_3_m = |contour: &&Value| contour["properties"]["depth_m"] == 3.0;
    let contour = contours.iter().find(is_of_3_m).unwrap();
    let [longitude, latitude] = [0, 1].map(|axis| {
        let place = &contour["geometry"]["coordinates"][0];
        place[axis].as_f64().unwrap()
    });
    assert!((longitude + 9.17).abs() < 0.01 && (latitude - 38.51).abs() < 0.01);
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
    let limited = "simulate yard --duration 8 --rate max --set mapping.octree.memory_limit_mb=1";
    let on_disk = summary_of(&mut robot_edge(limited));
    assert!(on_disk["voxels"]["disk_bricks"].as_u64().unwrap() > 1000);
    assert_eq!(on_disk["voxels"]["evicted_bricks"], 0);
    let unlimited = summary_of(&mut robot_edge("simulate yard --duration 8 --rate max"));
    assert_eq!(on_disk["voxels"]["digest"], unlimited["voxels"]["digest"]);
    let without_disk = format!("{limited} --set mapping.octree.disk_limit_mb=0");
    let evicting = summary_of(&mut robot_edge(&without_disk));
    let voxels = &evicting["voxels"];
    assert!(
        voxels["evicted_bricks"].as_u64().unwrap() > 1000,
        "{voxels}"
    );
    assert!(voxels["bytes"].as_u64().unwrap() < 1_200_000, "{voxels}");
    let events = evicting["events"].as_array().unwrap();
    let reported: Vec<_> = events
        .iter()
        .filter(|event| event["kind"] == "voxels_evicted")
        .collect();
    let [event] = reported[..] else {
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
fn senseless_settings_are_refused() {
    for (world, setting, says) in [
        ("hall", "mapping.elevation.cells=3000", "5 to 2001"),
        ("hall", "mapping.obstacle.cells=102", "1 to 101"),
        (
            "floor",
            "mapping.obstacle.cell_m=0.4",
            "`mapping.obstacle.cells`: 101 is not allowed",
        ),
        ("hall", "mapping.obstacle.cell_y_m=0", "0.01 to 10"),
        (
            "floor",
            "mapping.elevation.cells_y=51",
            "`mapping.obstacle.cells_y`: 101 is not allowed",
        ),
        ("hall", "mapping.obstacle.h_pos_m=0", "above 0, up to 10"),
        (
            "hall",
            "mapping.elevation.enabled=false",
            "nothing would be mapped",
        ),
        ("hall", "vehicle.wheelbase_m=2", "up to length_m = 0.9"),
        (
            "hall",
            "vehicle.footprint_offset_m=0.91",
            "-0.9 to 0.9, length_m",
        ),
        (
            "hall",
            "vehicle.footprint_offset_m=nan",
            "-0.9 to 0.9, length_m",
        ),
        (
            "hall",
            "mapping.obstacle.rule=median",
            "one of \"mean\", \"points\"",
        ),
        ("yard", "mapping.octree.p_min=0.6", "0.001 to 0.499"),
        (
            "yard",
            "mapping.cost.enabled=false",
            "mapping.rigidity.enabled",
        ),
        ("yard", "mapping.cost.box_m=500", "1 to 200"),
        (
            "lake",
            "mapping.rigidity.enabled=true",
            "or false in mapping.shore.enabled",
        ),
        (
            "street",
            "mapping.obstacle.least_width_m=0.04 --set mapping.obstacle.rule=mean",
            "or \"points\" in mapping.obstacle.rule",
        ),
        ("lake", "mapping.shore.dense_from_per_m2=60", "0 to 46"),
        (
            "yard",
            "teleop.collision_monitor.min_depth_m=0.5",
            "on a boat only",
        ),
        (
            "lake",
            "teleop.collision_monitor.min_depth_m=-1",
            "0 to 100",
        ),
        ("yard", "mapping.shore.sparse_below=0.9", "0 to 0.68"),
        (
            "yard",
            "mapping.rigidity.traversable_vegetation_cost=1",
            "0 to 0.996",
        ),
        ("yard", "sensors.laser.p_hit=0.4", "sensors.laser.p_hit"),
    ] {
        let simulate = format!("simulate {world} --set {setting}");
        let key = setting.split('=').next().unwrap();
        let named = if world == "hall" { key } else { says };
        run(&mut robot_edge(&simulate)).refuses(2, &[named, says]);
    }
}
