//! What Foxglove's own client receives, decoded by Google's protobuf.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use serde_json::{Value, json};

use crate::process::{events, robot_edge, run, summary_of};
use crate::python::{client_folder, python};
use crate::skip::skip;

/// The client with its packages, installed once; `None`, and a skipped test, without them.
fn client() -> Option<&'static PathBuf> {
    static CLIENT: LazyLock<Option<PathBuf>> = LazyLock::new(install);
    if CLIENT.is_none() {
        skip(
            "Foxglove's client cannot be installed",
            "Node.js, and npm's registry",
        );
    }
    CLIENT.as_ref()
}

/// Into a folder that later runs reuse.
fn install() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("foxglove-client");
    fs::create_dir_all(&folder).unwrap();
    for file in ["package.json", "foxglove_client.mjs"] {
        let from = client_folder().join("../node").join(file);
        fs::copy(from, folder.join(file)).unwrap();
    }
    let mut npm = Command::new("npm");
    npm.args(["install", "--silent", "--prefer-offline", "--prefix"])
        .arg(&folder);
    let is_installed = npm.output().is_ok_and(|output| output.status.success());
    is_installed.then(|| folder.join("foxglove_client.mjs"))
}

/// What the client receives of a robot until there is a message of each topic, decoded; `None`, and a skipped test, without it.
fn received(robot: &mut Command, topics: &[&str]) -> Option<Value> {
    let (python, client) = python("foxglove_requirements.txt", "google.protobuf").zip(client())?;
    let mut robot = robot
        .args(["--foxglove", "127.0.0.1:0"])
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(robot.stderr.take().unwrap()).lines();
    let url = lines.find_map(|line| Some(line.unwrap().strip_prefix("foxglove: ")?.to_owned()));
    let mut node = Command::new("node");
    node.arg(client).args([&url.unwrap(), "5"]).args(topics);
    let received = node.output().unwrap();
    robot.kill().unwrap();
    robot.wait().unwrap();
    let said = String::from_utf8_lossy(&received.stderr);
    assert!(received.status.success(), "{said}");
    let mut decoder = Command::new(python)
        .arg(client_folder().join("foxglove_report.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = decoder.stdin.take().unwrap();
    input.write_all(&received.stdout).unwrap();
    drop(input);
    let report = decoder.wait_with_output().unwrap();
    Some(serde_json::from_slice(&report.stdout).unwrap())
}

#[test]
fn foxgloves_own_client_receives_every_channel() {
    let mut robot = robot_edge("simulate lake --set mapping.occupancy.enabled=true");
    let topics = [
        "/map/occupancy",
        "/map/cost",
        "/map/depth",
        "/map/intra",
        "/map/inter",
        "/map/shore",
        "/shores",
        "/path",
        "/pose",
        "/tf",
        "/scan/laser",
        "/scan/sonar",
    ];
    let Some(report) = received(&mut robot, &topics) else {
        return;
    };

    // Nothing can be driven by it: it has no capability, and refuses what the client publishes.
    assert_eq!(report["capabilities"], json!([]));
    let words = report["words"].to_string();
    assert!(words.contains("does not support"), "{words}");
    let seconds = report["seconds"].as_f64().unwrap();
    let channels = report["channels"].as_object().unwrap();
    for (topic, channel) in channels {
        let count = channel["count"].as_f64().unwrap();
        let is_event = topic == "/events";
        assert!(
            is_event || count <= seconds + 1.0,
            "{topic}: {count} in {seconds} s"
        );
        if count > 0.0 {
            assert_eq!(channel["is_of_schema"], true, "{topic}");
        }
    }
    let message = |topic: &str| &channels[topic]["message"];
    for (topic, schema) in [
        ("/map/occupancy", "foxglove.Grid"),
        ("/shores", "foxglove.SceneUpdate"),
        ("/path", "foxglove.PosesInFrame"),
        ("/pose", "foxglove.PoseInFrame"),
        ("/tf", "foxglove.FrameTransforms"),
        ("/scan/laser", "foxglove.PointCloud"),
        ("/events", "foxglove.Log"),
    ] {
        assert_eq!(channels[topic]["schemaName"], schema);
    }
    let transforms = message("/tf")["transforms"].as_array().unwrap();
    let frames = transforms
        .iter()
        .map(|transform| &transform["child_frame_id"]);
    assert_eq!(frames.collect::<Vec<_>>(), ["odom", "base_link"]);
    assert!(message("/shores")["entities"].as_array().unwrap().len() > 1);
}

#[test]
fn events_and_maps_of_a_recording_are_received() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("ramp.mcap");
    let driven =
        summary_of(robot_edge("simulate ramp --duration 60 --rate max --record").arg(&recording));
    let mut replay = robot_edge("replay --vehicle holos --rate 4");
    let Some(report) = received(replay.arg(&recording), &["/events", "/map/elevation"]) else {
        return;
    };
    let event = &report["channels"]["/events"]["message"];
    assert_eq!(
        (&event["name"], &event["level"]),
        (&json!("ground_plane"), &json!("INFO"))
    );
    let events = events(&driven);
    let said = format!("ground_plane: {}", event["message"].as_str().unwrap());
    assert!(events.contains(&said), "{said}: {events:?}");
    assert_eq!(report["channels"]["/map/elevation"]["is_of_schema"], true);
}

#[test]
fn other_machines_need_consent_and_a_taken_port_is_named() {
    let refused = run(&mut robot_edge("simulate rooms --foxglove 0.0.0.0:8765"));
    refused.refuses(2, &["--foxglove 0.0.0.0:8765", "ssh -L", "--insecure"]);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let failed =
        run(robot_edge("simulate rooms --quiet --duration 1 --foxglove").arg(address.to_string()));
    failed.refuses(
        1,
        &[
            &format!("--foxglove {address}: cannot listen there"),
            "in use",
        ],
    );
}
