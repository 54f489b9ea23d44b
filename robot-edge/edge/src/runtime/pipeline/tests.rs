use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use clap::Parser as _;

use super::super::live_recording::LiveRecording;
use super::super::mapping_stage::MAX_QUEUE_DELAY;
use super::super::outputs;
use super::super::replay::{create_run, survey_recording};
use super::super::source::{Source, SourceItem};
use super::super::state_publisher::build_status;
use super::*;
use crate::cli::{Cli, Command, Replay};
use localization::pose_buffer::PoseJump;
use measurement::drops::DropReason;
use measurement::time::Monotonic;
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData};
use network::clock;
use recording::time_sequencer::Ordered;

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
    let listen = format!("tcp/127.0.0.1:{}", free_port());
    replay_with(&["--insecure", "--listen", &listen])
}

fn replay_with(options: &[&str]) -> Replay {
    let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings/rooms.mcap");
    let line = ["robot-edge", "replay", rooms.to_str().unwrap(), "--quiet"];
    let line = line.iter().chain(options);
    let Command::Replay(command) = Cli::try_parse_from(line).unwrap().command else {
        unreachable!("it says so");
    };
    command
}

fn take(pipeline: &mut Pipeline, ordered: Ordered) {
    let Pipeline {
        localization,
        mapping,
    } = pipeline;
    let taken = localization.take_ordered(ordered, clock::now(), &mut |input| {
        mapping.take(input).map(drop)
    });
    taken.unwrap();
}

/// The next measurement that is mapped.
fn next_measured(source: &mut impl Source) -> Measurement {
    loop {
        let item = source.next().unwrap().expect("it has more");
        if let SourceItem::Timed(Ordered::Measurement(measurement))
        | SourceItem::Immediate(measurement) = item
        {
            return measurement;
        }
    }
}

/// What so many scans and all before them make of steps.
fn inputs_of(pipeline: &mut Pipeline, source: &mut impl Source, scans: usize) -> Vec<MappingInput> {
    let mut inputs = Vec::new();
    while inputs.len() < scans {
        let ordered = Ordered::Measurement(next_measured(source));
        let mut keep = |input| {
            inputs.push(input);
            Ok(())
        };
        let localization = &mut pipeline.localization;
        localization
            .take_ordered(ordered, clock::now(), &mut keep)
            .unwrap();
    }
    inputs
}

/// The clock of a robot is set back while a scan waits for the pose behind it, as most scans do.
#[test]
fn poses_after_a_clock_reset_are_published_at_once() {
    let command = on_the_network();
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let mut pipeline = run.start().unwrap();
    let published = |pipeline: &Pipeline| {
        pipeline
            .localization
            .state_publisher
            .as_ref()
            .unwrap()
            .published_pose()
    };

    let is_scan = |at: &Measurement| matches!(at.data, MeasurementData::Scan { .. });
    let (mut first_poses, mut scans) = (Vec::new(), 0);
    while scans <= 20 {
        let Some(item) = source.next().unwrap() else {
            panic!("it has more scans");
        };
        let measurement = match item {
            SourceItem::Timed(Ordered::Measurement(measurement))
            | SourceItem::Immediate(measurement) => measurement,
            SourceItem::Timed(Ordered::ClockReset { .. })
            | SourceItem::Unmapped(_)
            | SourceItem::Live { .. }
            | SourceItem::Idle => continue,
        };
        scans += u32::from(is_scan(&measurement));
        if !is_scan(&measurement) && scans == 0 {
            first_poses.push(measurement.clone());
        }
        // The last scan has no pose behind it.
        let ordered = Ordered::Measurement(measurement);
        take(&mut pipeline, ordered);
    }
    let before = published(&pipeline).unwrap();
    let set_back = Ordered::ClockReset {
        from: before,
        to: RobotTime::from_nanos(0),
    };
    take(&mut pipeline, set_back);
    for pose in first_poses {
        take(&mut pipeline, Ordered::Measurement(pose));
    }
    let after = published(&pipeline).unwrap();
    assert!(after < before, "{after} is received after {before}");
}

/// Who drives must not wait for what is mapped.
#[test]
fn poses_are_published_before_anything_is_mapped() {
    let command = on_the_network();
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let mut pipeline = run.start().unwrap();
    let (mut inputs, mut newest) = (Vec::new(), None);
    while inputs.len() < 20 {
        let Some(
            SourceItem::Timed(Ordered::Measurement(measurement))
            | SourceItem::Immediate(measurement),
        ) = source.next().unwrap()
        else {
            continue;
        };
        if !measurement.is_static_transform() {
            newest = newest.max(Some(measurement.stamp));
        }
        let ordered = Ordered::Measurement(measurement);
        let mut keep = |input| {
            inputs.push(input);
            Ok(())
        };
        pipeline
            .localization
            .take_ordered(ordered, clock::now(), &mut keep)
            .unwrap();
    }
    let published = pipeline
        .localization
        .state_publisher
        .as_ref()
        .unwrap()
        .published_pose();
    assert_eq!((published, published.is_some()), (newest, true));
    assert_eq!(pipeline.mapping.maps.report().scans_mapped, 0);
    for input in inputs {
        pipeline.mapping.take(input).unwrap();
    }
    assert_eq!(pipeline.mapping.maps.report().scans_mapped, 20);
}

/// Where mapping is too slow, it maps less and not later; a jump is no scan, and nothing is lost uncounted.
#[test]
fn live_scans_that_waited_too_long_are_dropped_and_counted() {
    let command = replay_with(&["--no-network"]);
    let (survey, config, plan) = survey_recording(&command).unwrap();
    for (is_live, left_out) in [(true, 10), (false, 0)] {
        let (run, mut source) = create_run(&command, true, &survey, &config, plan.clone()).unwrap();
        let mut pipeline = run.start().unwrap();
        assert!(!pipeline.mapping.is_live, "a replay is mapped whole");
        pipeline.mapping.is_live = is_live;
        let mut inputs = inputs_of(&mut pipeline, &mut source, 20);
        let now = clock::now();
        let too_late = now + MAX_QUEUE_DELAY + MAX_QUEUE_DELAY;
        let jump = RegistrationOutput::Jump(PoseJump {
            stamp: RobotTime::from_nanos(0),
            distance_m: 3.0,
        });
        let jump = MappingInput::Registered {
            output: jump,
            measured_at: Monotonic::default(),
            queued_at: now,
        };
        let late = inputs.split_off(10).into_iter().chain([jump]);
        let tick = pipeline.localization.tick(None);
        for input in inputs {
            pipeline.mapping.process_at(input, now).unwrap();
        }
        for input in late.chain([tick]) {
            pipeline.mapping.process_at(input, too_late).unwrap();
        }
        let report = pipeline.mapping.maps.report();
        assert_eq!(report.scans_mapped, 20 - left_out);
        assert_eq!(report.dropped_scans.get(DropReason::QueueFull), left_out);

        let localization = &pipeline.localization;
        let stats = localization.maps.get();
        let status = build_status(
            &stats,
            localization.registration.counts(),
            &localization.clock,
            0,
        );
        let queue_full = status.drops.iter().find(|drop| drop.name == "queue_full");
        assert_eq!(queue_full.map_or(0, |drop| drop.count), left_out);
        // What is younger is mapped again, although what came before it was not.
        pipeline.finish_run(0).unwrap();
        let scans = outputs::summary(&pipeline).scans;
        assert_eq!(scans.dropped.get(DropReason::QueueFull), left_out);
        assert_eq!(scans.mapped + scans.dropped.total(), scans.came_in);
        let events = std::mem::take(&mut pipeline.mapping.events).into_events();
        assert!(events.iter().any(|event| event.kind == "pose_jump"));
    }
}

/// The collision monitor needs a recent map from time to time, not one that is always nearly too old.
#[test]
fn after_a_late_scan_all_are_dropped_until_mapping_recovers() {
    let command = replay_with(&["--no-network"]);
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let mut pipeline = run.start().unwrap();
    pipeline.mapping.is_live = true;
    let waits_ms = [1_900, 2_100, 1_900, 300, 200, 1_900, 2_100, 0];
    let mut mapped = Vec::new();
    for (input, waited_ms) in inputs_of(&mut pipeline, &mut source, waits_ms.len())
        .into_iter()
        .zip(waits_ms)
    {
        let MappingInput::Registered { queued_at, .. } = &input else {
            panic!("a scan");
        };
        let now = *queued_at + Duration::from_millis(waited_ms);
        let before = pipeline.mapping.maps.report().scans_mapped;
        pipeline.mapping.process_at(input, now).unwrap();
        if pipeline.mapping.maps.report().scans_mapped > before {
            mapped.push(waited_ms);
        }
    }
    assert_eq!(mapped, [1_900, 200, 1_900, 0]);
}

/// Maps that are served, or exported, for long may be ended by force.
#[test]
fn recordings_are_finished_before_serving_and_export() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.mcap");
    let command = replay_with(&["--no-network", "--record", path.to_str().unwrap()]);
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let mut pipeline = run.start().unwrap();
    let mut live = LiveRecording::new(&folder.path().join("live"), "scout", "rover").unwrap();
    live.record(true);
    // Static transforms, and what else is known before the first scan.
    let before = Ordered::Measurement(next_measured(&mut source));
    pipeline.localization.streams = source.streams_from(0);
    live.add_streams(&pipeline.localization.streams);
    pipeline.localization.recordings.live = Some(live);
    take(&mut pipeline, before);
    inputs_of(&mut pipeline, &mut source, 5);
    let recorded = pipeline.localization.recordings.end(true);
    recorded.result.unwrap();
    assert!(pipeline.localization.recordings.recorder.is_none());
    // MCAP's magic stands at both ends of a file that is whole.
    let mut live_files = std::fs::read_dir(folder.path().join("live")).unwrap();
    for file in [path, live_files.next().unwrap().unwrap().path()] {
        let bytes = std::fs::read(&file).unwrap();
        assert!(bytes.len() > 1000, "{}", file.display());
        assert!(bytes.ends_with(b"\x89MCAP0\r\n"), "{}", file.display());
    }
}

/// To hand a scan over may wait for the maps, and the scan waited for the pose that places it.
#[test]
fn the_newest_pose_is_published_before_a_scan_is_sent() {
    let command = on_the_network();
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let mut pipeline = run.start().unwrap();
    let publish_state = Arc::clone(
        pipeline
            .mapping
            .network
            .as_ref()
            .unwrap()
            .link
            .publish_state(),
    );
    let published = || publish_state.pose().map(|(stamp, _)| stamp);
    let mut scans = 0;
    while scans < 20 {
        let ordered = Ordered::Measurement(next_measured(&mut source));
        let mut handed_over = Vec::new();
        let mut keep = |input| {
            if let MappingInput::Registered {
                output: RegistrationOutput::Scan(scan),
                ..
            } = input
            {
                handed_over.push((scan.stamp, published()));
            }
            Ok(())
        };
        let localization = &mut pipeline.localization;
        localization
            .take_ordered(ordered, clock::now(), &mut keep)
            .unwrap();
        for (stamp, published_then) in handed_over {
            assert_eq!(
                published_then,
                published(),
                "a newer pose was received only later"
            );
            assert!(
                published_then > Some(stamp),
                "it waited for a pose behind it"
            );
            scans += 1;
        }
    }
}
