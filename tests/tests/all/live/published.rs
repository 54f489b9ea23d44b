//! What is published to ROS 2, as a node that is not ours receives it.

use std::process::Command;

use recording::ros::middleware::PublishedType;
use tempfile::tempdir;

use super::ros_system::{RosMiddleware, RosSystem};
use crate::processes::{Running, free_port, start, tcp, zenohd};
use crate::python::{client_folder, python};

/// Every topic, of a vehicle that has every layer.
const VEHICLE: &str = r#"preset = "introbot"
[mapping.occupancy]
enabled = true
[mapping.elevation]
enabled = true
[ros2_output]
map = { topic = "/map", rate_hz = 2.0, max_kb = 16000 }
cost_map = { topic = "/cost_map", rate_hz = 2.0, max_kb = 16000 }
elevation = { topic = "/elevation", rate_hz = 2.0, max_kb = 16000 }
voxels = { topic = "/octomap", rate_hz = 0.5, max_kb = 16000 }
obstacles = { topic = "/obstacles", rate_hz = 2.0, max_kb = 4000 }
tf = { topic = "/tf", rate_hz = 20.0, max_kb = 1 }
odometry = { topic = "/foreshore/odometry", rate_hz = 20.0, max_kb = 1 }
path = { topic = "/foreshore/path", rate_hz = 1.0, max_kb = 1000 }
"#;

#[test]
fn a_node_that_is_not_ours_has_the_maps_of_the_export() {
    let port = free_port();
    let _system = RosSystem::start(port, RosMiddleware::Rmw { domain: 0 });
    node_has_the_maps_of_the_export(port);
}

/// As above, through the router that others run.
#[test]
fn a_node_behind_zenohd_has_the_maps_of_the_export() {
    let port = free_port();
    if let Some(_router) = zenohd(&["--listen", &tcp(port)]) {
        node_has_the_maps_of_the_export(port);
    }
}

/// `port`: of a router.
fn node_has_the_maps_of_the_export(port: u16) {
    let imports = "rosbags, zenoh, zenoh_ros2_sdk";
    let Some(python) = python("ros2_requirements.txt", imports) else {
        return;
    };
    let folder = tempdir().unwrap();
    let (vehicle, export) = (folder.path().join("v.toml"), folder.path().join("export"));
    std::fs::write(&vehicle, VEHICLE).unwrap();
    // Faster than real time, so that nobody can drive it and its data end; not much faster, as the node may need 20 s to start.
    let robot = start(&format!(
        "robot-edge simulate yard --vehicle {} --rate 1.25 --duration 45 --keep-serving --quiet \
         --listen tcp/127.0.0.1:{} --ros {} --ros-domain 0 --export {}",
        vehicle.display(),
        free_port(),
        tcp(port),
        export.display()
    ));
    let mut command = Command::new(python);
    command
        .arg("-B")
        .arg(client_folder().join("ros2_client.py"));
    command.args(["--port", &port.to_string()]);
    command.arg("--export").arg(&export).arg("--hashes");
    let hashes = PublishedType::ALL.iter();
    command.args(hashes.map(|kind| format!("{}={}", kind.name, kind.hash)));
    let mut client = Running::start(&mut command, "the node");
    client.wait_for_output("received: ");
    robot.interrupt();
    let printed = client.ends_well();
    println!("{printed}");
    for line in [
        "same as the export: /map ",
        "same as the export: /cost_map ",
        "same as the export: /elevation ",
        "same as the export: /obstacles ",
        "same as the export: /octomap ",
    ] {
        assert!(printed.contains(line), "{line}: {printed}");
    }
}
