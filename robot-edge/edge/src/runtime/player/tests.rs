use std::path::{Path, PathBuf};

use clap::Parser as _;
use protocol::export::StampedPose;
use protocol::layer::LayerId;
use protocol::tile::TileKey;

use super::super::replay::{create_run, length, survey_recording};
use super::super::source_reader::read_source;
use super::*;
use crate::cli::{Cli, Command, Replay};
use crate::export::voxels::voxel_digest;
use crate::replay_control::{ReplayState, ReplayStatus};

fn rooms() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings/rooms.mcap")
}

/// A world that is simulated for so long, as a recording.
fn recorded(world: &str, duration_s: &str, folder: &Path) -> PathBuf {
    let path = folder.join("run.mcap");
    let mut line = vec!["robot-edge", "simulate", world, "--duration", duration_s];
    line.extend(["--rate", "max", "--no-network", "--quiet", "--record"]);
    line.push(path.to_str().unwrap());
    let cli = Cli::try_parse_from(line).unwrap();
    super::super::run_until(&cli, &AtomicBool::new(false), &mut std::io::sink()).unwrap();
    path
}

fn command(recording: &Path) -> Replay {
    let recording = recording.to_str().unwrap();
    let line = ["robot-edge", "replay", recording, "--no-network", "--quiet"];
    let Command::Replay(replay) = Cli::try_parse_from(line).unwrap().command else {
        unreachable!("it says so");
    };
    replay
}

fn seconds(s: f64) -> RobotDuration {
    RobotDuration::from_secs_f64(s)
}

/// The digests of all layers, the stamps of their tiles, and the way.
type Left = (
    Vec<(LayerId, String)>,
    Vec<(TileKey, i64)>,
    Vec<StampedPose>,
);

fn left(pipeline: &Pipeline) -> Left {
    let store = pipeline.mapping.maps.publisher().store();
    let grids = store.grids();
    let digest = |layer| store.root_digest(layer).unwrap().to_string();
    let digests = grids.map(|grid| (grid.layer, digest(grid.layer))).collect();
    let tiles = store.grids().flat_map(|grid| store.tiles(grid.layer));
    let known = tiles.filter(|(_, stored)| stored.known() > 0);
    let stamps = known.map(|(key, stored)| (key, stored.stamp_ns()));
    (
        digests,
        stamps.collect(),
        pipeline.mapping.trajectory.lock().poses(),
    )
}

/// What `replay --duration` leaves behind; without one, `replay`.
fn fresh(recording: &Path, duration_s: Option<f64>) -> Left {
    left(&replayed(recording, duration_s))
}

fn replayed(recording: &Path, duration_s: Option<f64>) -> Pipeline {
    let command = Replay {
        duration_s,
        ..command(recording)
    };
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let mut pipeline = run.start().unwrap();
    let interrupt = AtomicBool::new(false);
    let end = read_source(&mut source, Rate::Max, &interrupt, |batch| {
        pipeline.take(batch).unwrap();
        true
    });
    end.result.unwrap();
    pipeline.finish_run(0).unwrap();
    pipeline
}

/// A player of `recording` at full speed, and its control.
fn with_player(recording: &Path, work: impl FnOnce(&mut Player<'_>, &ReplayControl)) {
    let command = command(recording);
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let control = ReplayControl::new(Rate::Max);
    let interrupt = AtomicBool::new(false);
    let mut player = Player::new(&run, source, &control, &interrupt).unwrap();
    work(&mut player, &control);
}

/// Runs it until it is idle.
fn settle(player: &mut Player<'_>, control: &ReplayControl) -> ReplayStatus {
    loop {
        // Resting waits for a wish, and would be a second of nothing.
        let status = control.status();
        if status.is_settled {
            return status;
        }
        player.step().unwrap();
    }
}

/// Seeks `to` and compares the map there with that of a replay that ends there.
#[track_caller]
fn assert_map_after_seek(
    player: &mut Player<'_>,
    control: &ReplayControl,
    recording: &Path,
    to: f64,
) {
    control.pause();
    control.seek(seconds(to));
    let status = settle(player, control);
    assert_eq!(
        (status.state, status.position),
        (ReplayState::Paused, seconds(to))
    );
    assert_eq!(
        left(&player.pipeline),
        fresh(recording, Some(to)),
        "at {to} s"
    );
}

#[test]
fn after_a_seek_the_map_equals_a_replay_up_to_there() {
    let rooms = rooms();
    with_player(&rooms, |player, control| {
        // Without copies on the way, whatever the speed of this machine.
        player.checkpoints.interval = Duration::MAX;
        for to in [60.0, 60.25, 30.0, 29.5] {
            assert_map_after_seek(player, control, &rooms, to);
        }
        assert_eq!(control.status().restarts, 2, "it was wound back twice");
        control.play();
        while !control.status().is_settled {
            player.step().unwrap();
        }
        assert_eq!(control.status().state, ReplayState::Ended);
        assert_eq!(left(&player.pipeline), fresh(&rooms, None));
    });
}

/// Its last scan has no pose behind it, and is in no map but those that are shown.
#[test]
fn the_octree_of_a_paused_replay_equals_its_other_maps() {
    let folder = tempfile::tempdir().unwrap();
    let yard = recorded("yard", "2", folder.path());
    let to = 1.0;
    let ended = replayed(&yard, Some(to));
    let octree = ended.mapping.maps.mapper().voxels().unwrap().octree();
    with_player(&yard, |player, control| {
        assert_map_after_seek(player, control, &yard, to);
        let maps = &player.pipeline.mapping.maps;
        let waiting = ended.mapping.maps.report().scans_mapped - maps.report().scans_mapped;
        // Of the laser, six ultrasonic sensors and two bumpers.
        assert_eq!(waiting, 9);
        let paused_snapshot = player.paused_snapshot.as_ref().unwrap();
        assert_eq!(paused_snapshot.last_scan(), ended.mapping.maps.last_scan());
        let shown = maps.octree_of(paused_snapshot).unwrap();
        assert_eq!(voxel_digest(&shown), voxel_digest(octree));
        let without = maps.mapper().voxels().unwrap().octree();
        assert_ne!(voxel_digest(without), voxel_digest(octree));
    });
}

#[test]
fn the_reported_length_equals_the_end() {
    // Its poses go on for 140 ms behind its last scan.
    let rooms = rooms();
    let command = command(&rooms);
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, mut source) = create_run(&command, true, &survey, &config, plan).unwrap();
    let reported = length(&survey, &mut source).unwrap().unwrap();
    assert!(!reported.is_estimate && reported.duration > survey.duration());
    let control = ReplayControl::new(Rate::Max);
    control.set_length(reported);
    let interrupt = AtomicBool::new(false);
    let mut player = Player::new(&run, source, &control, &interrupt).unwrap();
    let status = settle(&mut player, &control);
    assert_eq!(status.state, ReplayState::Ended);
    assert_eq!(
        (status.length, status.position),
        (Some(reported), reported.duration)
    );
    // To have been read before changes nothing.
    assert_eq!(left(&player.pipeline), fresh(&rooms, None));

    // Who clicks on the end of the time line comes to the end.
    control.pause();
    control.seek(seconds(50.0));
    assert_eq!(settle(&mut player, &control).state, ReplayState::Paused);
    control.seek(reported.duration);
    let status = settle(&mut player, &control);
    assert_eq!(
        (status.state, status.position),
        (ReplayState::Ended, reported.duration)
    );
}

#[test]
fn a_seek_uses_checkpoints_if_mapping_is_slow() {
    let rooms = rooms();
    with_player(&rooms, |player, control| {
        // As if every batch took a second to map.
        player.checkpoints.interval = Duration::ZERO;
        for to in [50.0, 30.0, 29.0, 2.0, 45.5] {
            assert_map_after_seek(player, control, &rooms, to);
        }
        assert!(!player.checkpoints.kept.is_empty());
        let (_, trail_m) = control.trail(0).unwrap();
        with_player(&rooms, |other, control| {
            assert_map_after_seek(other, control, &rooms, 45.5);
            assert_eq!(control.trail(0).unwrap().1, trail_m);
        });
    });
}

#[test]
fn checkpoints_are_few() {
    with_player(&rooms(), |player, control| {
        control.pause();
        control.seek(seconds(1.0));
        settle(player, control);
        for _ in 0..100 {
            player.take_checkpoint();
            assert!(player.checkpoints.kept.len() <= MAX_CHECKPOINTS);
        }
        assert!(
            player.checkpoints.interval > Duration::from_secs(10),
            "and ever fewer"
        );
    });
}

#[test]
fn a_seek_restores_erased_heights_and_obstacles() {
    let folder = tempfile::tempdir().unwrap();
    let ramp = recorded("ramp", "44", folder.path());
    with_player(&ramp, |player, control| {
        for to in [38.0, 41.5, 39.75, 43.0] {
            assert_map_after_seek(player, control, &ramp, to);
        }
        let kinds: Vec<_> = control.status().marks.iter().map(|m| m.kind).collect();
        assert_eq!(kinds, ["ground_plane"], "it is marked once");
    });
}

#[test]
fn a_seek_restores_the_layers_of_a_boat() {
    let folder = tempfile::tempdir().unwrap();
    let lake = recorded("lake", "2", folder.path());
    with_player(&lake, |player, control| {
        for to in [1.0, 1.7, 0.6] {
            assert_map_after_seek(player, control, &lake, to);
        }
        let layers: Vec<_> = left(&player.pipeline)
            .0
            .into_iter()
            .map(|(layer, _)| layer)
            .collect();
        let of_a_boat = [
            LayerId::Cost,
            LayerId::Shore,
            LayerId::Intra,
            LayerId::Inter,
            LayerId::Depth,
        ];
        assert_eq!(layers, of_a_boat);
    });
}

#[test]
fn damage_is_marked_once_with_position_and_reason() {
    let folder = tempfile::tempdir().unwrap();
    let damaged = folder.path().join("damaged.mcap");
    let mut bytes = std::fs::read(rooms()).unwrap();
    bytes[900_000..900_035].fill(0);
    std::fs::write(&damaged, bytes).unwrap();
    with_player(&damaged, |player, control| {
        let losses = |status: &ReplayStatus| -> Vec<String> {
            let losses = status.marks.iter().filter(|mark| mark.kind == "loss");
            losses.map(|mark| mark.message.clone()).collect()
        };
        let reported = losses(&settle(player, control));
        assert_eq!(reported.len(), 1, "{reported:?}");
        assert!(
            reported[0].starts_with("byte 796992: a chunk is lost"),
            "{reported:?}"
        );
        for to in [0.0, 110.0] {
            control.pause();
            control.seek(seconds(to));
            assert_eq!(losses(&settle(player, control)), reported, "{to}");
        }
    });
}
