use std::net::TcpListener;
use std::path::Path;

use clap::Parser as _;

use super::super::replay::{look_through, set_up};
use super::super::source::Source;
use super::*;
use crate::cli::{Cli, Command};
use crate::measurement::MeasurementData;

/// A port that is free, as is the one behind it, for now.
fn free_port() -> u16 {
    let bind = |port| TcpListener::bind(("127.0.0.1", port));
    let pairs = std::iter::repeat_with(|| {
        let control = bind(0).ok()?;
        let port = control.local_addr().ok()?.port();
        bind(port.checked_add(1)?).ok().map(|_bulk| port)
    });
    pairs.flatten().next().unwrap()
}

/// The clock of a robot is set back while a scan waits for the pose behind it, as most scans do.
#[test]
fn poses_of_a_clock_that_was_set_back_are_told_at_once() {
    let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap");
    let listen = format!("tcp/127.0.0.1:{}", free_port());
    let line = ["robot-edge", "replay", rooms.to_str().unwrap(), "--quiet"];
    let line = line.into_iter().chain(["--insecure", "--listen", &listen]);
    let Command::Replay(command) = Cli::try_parse_from(line).unwrap().command else {
        unreachable!("it says so");
    };
    let (survey, config, plan) = look_through(&command).unwrap();
    let (run, mut source) = set_up(&command, true, &survey, &config, plan).unwrap();
    let mut side = run.start().unwrap();
    let told = |side: &MappingSide| {
        let network = side.network.as_ref().unwrap();
        network.link.shared().pose().map(|(stamp, _)| stamp)
    };

    let is_scan = |at: &Measurement| matches!(at.data, MeasurementData::Scan { .. });
    let (mut first_poses, mut scans) = (Vec::new(), 0);
    while scans <= 20 {
        let Some(item) = source.next().unwrap() else {
            panic!("it has more scans");
        };
        let measurement = match item {
            Item::Due(Ordered::Measurement(measurement)) | Item::AtOnce(measurement) => measurement,
            Item::Due(Ordered::ClockReset { .. })
            | Item::Aside(_)
            | Item::Came { .. }
            | Item::Pause => continue,
        };
        scans += u32::from(is_scan(&measurement));
        if !is_scan(&measurement) && scans == 0 {
            first_poses.push(measurement.clone());
        }
        // The last scan has no pose behind it.
        let ordered = Ordered::Measurement(measurement);
        side.take_ordered(ordered, Monotonic::now()).unwrap();
    }
    let before = told(&side).unwrap();
    let set_back = Ordered::ClockReset {
        from: before,
        to: RobotTime::from_nanos(0),
    };
    side.take_ordered(set_back, Monotonic::now()).unwrap();
    for pose in first_poses {
        side.take_ordered(Ordered::Measurement(pose), Monotonic::now())
            .unwrap();
    }
    let after = told(&side).unwrap();
    assert!(after < before, "{after} is told behind {before}");
}
