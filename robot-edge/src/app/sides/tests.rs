use std::net::TcpListener;
use std::path::Path;

use clap::Parser as _;

use super::super::replay::{look_through, set_up};
use super::super::source::{Item, Source as _};
use super::*;
use crate::cli::{Cli, Command, Replay};
use crate::clock::Monotonic;
use crate::measurement::{Measurement, MeasurementData};
use crate::recording::stamp_order::Ordered;
use crate::robot_time::RobotTime;

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

/// A replay of the rooms that consoles can hear.
fn on_the_network() -> Replay {
    let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap");
    let listen = format!("tcp/127.0.0.1:{}", free_port());
    let line = ["robot-edge", "replay", rooms.to_str().unwrap(), "--quiet"];
    let line = line.into_iter().chain(["--insecure", "--listen", &listen]);
    let Command::Replay(command) = Cli::try_parse_from(line).unwrap().command else {
        unreachable!("it says so");
    };
    command
}

fn take(sides: &mut Sides, ordered: Ordered) {
    let Sides { placing, mapping } = sides;
    let taken = placing.take_ordered(ordered, Monotonic::now(), &mut |step| {
        Ok(mapping.take(step)?)
    });
    taken.unwrap();
}

/// The clock of a robot is set back while a scan waits for the pose behind it, as most scans do.
#[test]
fn poses_of_a_clock_that_was_set_back_are_told_at_once() {
    let command = on_the_network();
    let (survey, config, plan) = look_through(&command).unwrap();
    let (run, mut source) = set_up(&command, true, &survey, &config, plan).unwrap();
    let mut sides = run.start().unwrap();
    let told = |sides: &Sides| sides.placing.herald.as_ref().unwrap().told_pose();

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
        take(&mut sides, ordered);
    }
    let before = told(&sides).unwrap();
    let set_back = Ordered::ClockReset {
        from: before,
        to: RobotTime::from_nanos(0),
    };
    take(&mut sides, set_back);
    for pose in first_poses {
        take(&mut sides, Ordered::Measurement(pose));
    }
    let after = told(&sides).unwrap();
    assert!(after < before, "{after} is told behind {before}");
}

/// Who drives must not wait for what is mapped.
#[test]
fn consoles_hear_where_the_vehicle_is_before_anything_is_mapped() {
    let command = on_the_network();
    let (survey, config, plan) = look_through(&command).unwrap();
    let (run, mut source) = set_up(&command, true, &survey, &config, plan).unwrap();
    let mut sides = run.start().unwrap();
    let (mut steps, mut newest) = (Vec::new(), None);
    while steps.len() < 20 {
        let Some(Item::Due(Ordered::Measurement(measurement)) | Item::AtOnce(measurement)) =
            source.next().unwrap()
        else {
            continue;
        };
        if !measurement.is_timeless() {
            newest = newest.max(Some(measurement.stamp));
        }
        let ordered = Ordered::Measurement(measurement);
        let mut keep = |step| {
            steps.push(step);
            Ok(())
        };
        sides
            .placing
            .take_ordered(ordered, Monotonic::now(), &mut keep)
            .unwrap();
    }
    let told = sides.placing.herald.as_ref().unwrap().told_pose();
    assert_eq!((told, told.is_some()), (newest, true));
    assert_eq!(sides.mapping.maps.report().scans_mapped, 0);
    for step in steps {
        sides.mapping.take(step).unwrap();
    }
    assert_eq!(sides.mapping.maps.report().scans_mapped, 20);
}
