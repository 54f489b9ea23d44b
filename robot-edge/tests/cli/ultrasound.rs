//! Glass that only ultrasonic sensors detect: on the obstacle map of a drive, and of its recording.

use std::path::Path;

use serde_json::Value;

use crate::process::{robot_edge, run, summary_of};

const MAPS: &str = "--rate max --set mapping.elevation.enabled=true --set mapping.octree.enabled=false \
                    --set mapping.cost.enabled=false --set mapping.rigidity.enabled=false";

fn glass() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/glass.toml")
}

fn obstacles(summary: &Value) -> (u64, String) {
    let layer = &summary["layers"]["obstacle"];
    let digest = layer["digest"].as_str().unwrap().to_owned();
    (layer["counts"]["obstacle"].as_u64().unwrap(), digest)
}

#[test]
fn glass_is_on_the_map_with_ultrasound_and_a_recording_gives_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("glass.mcap");
    let drive = |options: &str| {
        let mut command = robot_edge("simulate");
        command.arg(glass());
        command.args(MAPS.split_whitespace());
        command.args(options.split_whitespace());
        command
    };
    let driven = summary_of(drive("--record").arg(&recording));
    let (with, digest) = obstacles(&driven);
    let names = [
        "front_left",
        "front_right",
        "left",
        "right",
        "rear_left",
        "rear_right",
    ];
    let deaf: Vec<_> = names
        .iter()
        .map(|name| format!("--topic ultrasonic_{name}=/none"))
        .collect();
    let (without, _) = obstacles(&summary_of(&mut drive(&deaf.join(" "))));
    // Two arcs of 0.5 m, in cells of 0.2 m.
    assert!(
        (with - without) >= 4 && (with - without) <= 40,
        "{with} and {without}"
    );

    let replayed = summary_of(
        robot_edge("replay")
            .arg(&recording)
            .args(MAPS.split_whitespace()),
    );
    assert_eq!(obstacles(&replayed), (with, digest));
    let info = run(robot_edge("info").arg(&recording)).succeeds().stdout;
    for topic in ["/ultrasonic/front_left", "/bumper/rear"] {
        assert!(info.contains(topic), "{info}");
    }
}
