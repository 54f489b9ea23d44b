//! Elevation and obstacles: a drive, its recording, and what is said of both.

use crate::process::{robot_edge, summary_of};

/// The obstacle layer of the world `ramp` with seed 1. If a change to the mapping core is meant to change
/// maps, look at the map and put the new digest here.
const OBSTACLE: &str = "ace72b5e3b8598f13546e488afbc2ac537ee268e377559106b54168402986ac8";

#[test]
fn a_recorded_drive_gives_the_maps_of_the_drive() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("ramp.mcap");
    let driven = summary_of(robot_edge("simulate ramp --rate max --record").arg(&recording));
    let digest = |summary: &serde_json::Value, layer: &str| {
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

    // Every beam has one fate.
    let beams = &driven["beams"];
    let count = |what: &str| beams[what].as_u64().unwrap();
    let dropped: u64 = beams["dropped"]
        .as_object()
        .unwrap()
        .values()
        .map(|n| n.as_u64().unwrap())
        .sum();
    assert_eq!(count("in"), count("hits") + count("misses") + dropped);
    let classes = &driven["layers"]["obstacle"]["counts"];
    let known = driven["layers"]["obstacle"]["cells_known"]
        .as_u64()
        .unwrap();
    let [free, obstacle] = ["free", "obstacle"].map(|class| classes[class].as_u64().unwrap());
    assert_eq!(free + obstacle, known);
    assert!(free > 1500 && obstacle > 100, "{classes}");
}

#[test]
fn senseless_settings_of_elevation_are_refused() {
    for (setting, says) in [
        ("mapping.elevation.cells=3000", "5 to 2001"),
        ("mapping.obstacle.cells=102", "1 to 101"),
        ("mapping.obstacle.h_pos_m=0", "above 0, up to 10"),
        ("mapping.elevation.enabled=false", "nothing would be mapped"),
        ("vehicle.wheelbase_m=2", "up to length_m = 0.9"),
        ("vehicle.footprint_offset_m=0.91", "-0.9 to 0.9, length_m"),
        ("vehicle.footprint_offset_m=nan", "-0.9 to 0.9, length_m"),
        (
            "mapping.obstacle.rule=median",
            "one of \"mean\", \"points\"",
        ),
    ] {
        let ended = crate::process::run(robot_edge("simulate hall --set").arg(setting));
        ended.refuses(2, &[setting.split('=').next().unwrap(), says]);
    }
}
