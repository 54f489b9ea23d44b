//! Errors of a missing sensor, topic or ROS 2 system.

use super::ros_system::{RosMiddleware, RosSystem};
use crate::link::processes::{Running, free_port, program};

/// Encapsulation and a `geometry_msgs/Twist` of zeros.
const TWIST: [u8; 52] = {
    let mut message = [0; 52];
    message[1] = 1;
    message
};

#[test]
fn a_missing_sensor_is_an_error_that_lists_the_topics() {
    let mut system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 0 });
    system.announce("/bot/cmd_vel", "geometry_msgs/msg/Twist");
    system.announce("/bot/camera", "sensor_msgs/msg/Image");
    let mut command = program("robot-edge");
    command.args(["run", "--ros", &system.endpoint(), "--ros-domain", "0"]);
    command.args(["--no-network", "--quiet", "--wait", "4"]);
    let edge = Running::start(&mut command, "edge");
    system.wait_for_subscriber("/bot/cmd_vel");
    for _ in 0..3 {
        system.publish("/bot/cmd_vel", &TWIST);
    }
    let (code, printed) = edge.end();
    assert_eq!(code, Some(2), "{printed}");
    for words in [
        "no scans (sensor_msgs/LaserScan) came",
        "in 4 s, in domain 0 and from bridges, there were:",
        "/bot/cmd_vel (geometry_msgs/Twist): 3 messages",
        "/bot/camera (sensor_msgs/Image): announced, no messages received",
    ] {
        assert!(printed.contains(words), "{printed}");
    }
}

#[test]
fn a_domain_without_topics_is_an_error() {
    let mut system = RosSystem::start(free_port(), RosMiddleware::Rmw { domain: 3 });
    system.announce("/scan", "sensor_msgs/msg/LaserScan");
    let mut command = program("robot-edge");
    command.args(["run", "--ros", &system.endpoint(), "--ros-domain", "0"]);
    command.args(["--no-network", "--quiet", "--wait", "1"]);
    let (code, printed) = Running::start(&mut command, "edge").end();
    assert_eq!(code, Some(2), "{printed}");
    let words =
        "no topic was received or announced in 1 s; does it run in domain 0 (--ros-domain)?";
    assert!(printed.contains(words), "{printed}");
}

#[test]
fn a_missing_ros_system_is_an_error_that_says_what_to_start() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut command = program("robot-edge");
    command.args(["run", "--ros", &endpoint, "--no-network", "--quiet"]);
    let (code, printed) = Running::start(command.args(["--wait", "1"]), "edge").end();
    assert_eq!(code, Some(1), "{printed}");
    assert!(
        printed.contains(&format!("{endpoint}: no ROS 2 system. Start")),
        "{printed}"
    );

    let mut command = program("robot-edge");
    command.args(["run", "--ros", "localhost", "--no-network", "--quiet"]);
    let (code, printed) = Running::start(&mut command, "edge").end();
    assert_eq!(code, Some(2), "{printed}");
}
