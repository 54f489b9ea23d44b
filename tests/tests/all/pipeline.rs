//! Simulated worlds through the edge's pipeline, at library level: the order of measurements, eviction, pose jumps.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use edge::config::Config;
use edge::publishing::cells_to_tiles;
use edge::runtime::{MapEvent, Pipeline};
use experiments::run::{self, SimulatedRun};
use mapping::registered_scan::ScanKind;
use measurement::time::{Monotonic, RobotDuration};
use measurement::{Measurement, MeasurementData};
use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::{TileCells, TileKey};
use protocol::tile_store::RootDigest;
use serde_json::Value;
use simulation::source::START;
use simulation::{SimulatedSource, SimulationOptions, World};
use teleop::collision_monitor::BlockageDetector;

use crate::processes::start;

/// All measurements of a run, by stamp.
fn measurements(world: &World, options: SimulationOptions) -> Vec<Measurement> {
    let mut source = SimulatedSource::new(world, options).unwrap();
    std::iter::from_fn(|| source.next_measurement()).collect()
}

/// The pipeline of `robot-edge simulate` (a test below compares the two).
fn pipeline(config: &Config) -> Pipeline {
    run::pipeline(config, &[]).unwrap()
}

/// The configuration of the world's vehicle, changed by `settings` (`key=value`).
fn vehicle_config(world: &World, settings: &[&str]) -> Config {
    run::vehicle_config(world, settings).unwrap()
}

fn digest(pipeline: &Pipeline) -> RootDigest {
    let store = pipeline.publisher().store();
    store.root_digest(LayerId::Occupancy).unwrap()
}

/// The vehicle drives through a corridor into the first room.
const DURATION_S: f64 = 12.0;

fn measured(world: &World, seed: u64) -> Vec<Measurement> {
    let options = SimulationOptions {
        seed,
        duration_s: Some(DURATION_S),
        ..SimulationOptions::default()
    };
    measurements(world, options)
}

fn map_of(world: &World, measurements: Vec<Measurement>, settings: &[&str]) -> RootDigest {
    let mut pipeline = pipeline(&vehicle_config(world, settings));
    let scans = measurements
        .iter()
        .filter(|measurement| is_scan(measurement))
        .count();
    for measurement in measurements {
        pipeline.push(measurement).unwrap();
    }
    pipeline.finish().unwrap();
    assert_eq!(pipeline.report().scans_mapped, scans as u64);
    assert_eq!(pipeline.registration().counts().dropped_scans.total(), 0);
    digest(&pipeline)
}

fn is_scan(measurement: &Measurement) -> bool {
    matches!(measurement.data, MeasurementData::Scan { .. })
}

/// Batches of `period_s`, as a link with delays delivers them: in each, all poses before all scans, or
/// the reverse.
fn in_batches(
    mut measurements: Vec<Measurement>,
    period_s: f64,
    poses_first: bool,
) -> Vec<Measurement> {
    let first = measurements[0].stamp;
    measurements.sort_by_key(|measurement| {
        let batch = (measurement.stamp.since(first).as_secs_f64() / period_s) as u64;
        (batch, is_scan(measurement) == poses_first)
    });
    measurements
}

#[test]
fn the_map_does_not_depend_on_how_measurements_arrive() {
    let world = World::load("rooms").unwrap();
    let measured = measured(&world, 1);
    let in_order = map_of(&world, measured.clone(), &[]);
    for (period_s, poses_first) in [(0.5, true), (5.0, true), (0.1, false)] {
        let batches = in_batches(measured.clone(), period_s, poses_first);
        assert_ne!(batches, measured, "{period_s}");
        let map = map_of(&world, batches, &[]);
        assert_eq!(map, in_order, "{period_s} {poses_first}");
    }
}

#[test]
fn the_map_does_not_depend_on_how_often_it_is_published() {
    let world = World::load("rooms").unwrap();
    let measured = measured(&world, 1);
    let maps = ["0.1", "1.0", "1000.0"].map(|period_s| {
        let setting = format!("streaming.publish_period_s={period_s}");
        map_of(&world, measured.clone(), &[&setting])
    });
    assert_eq!(maps, [maps[0]; 3]);
}

#[test]
fn oblong_cells_are_published_as_squares_of_their_shorter_side() {
    let world = World::load("hall").unwrap();
    let settings = [
        "mapping.elevation.cell_y_m=0.4",
        "mapping.elevation.cells_y=51",
        "mapping.obstacle.cell_m=0.3",
        "mapping.obstacle.cells=61",
    ];
    let options = SimulationOptions {
        seed: 1,
        duration_s: Some(3.0),
        ..SimulationOptions::default()
    };
    let run = SimulatedRun::with_settings(&world, options, &settings).unwrap();
    let pipeline = run.finish().unwrap();
    let terrain = pipeline.mapper().terrain().unwrap();
    let store = pipeline.publisher().store();
    assert_eq!(store.cell_m(LayerId::Elevation), Some(0.2));
    assert_eq!(store.cell_m(LayerId::Obstacle), Some(0.3));
    let heights: BTreeMap<_, _> = run::known_cells(&store, LayerId::Elevation).collect();
    let cells = terrain
        .elevation()
        .grid()
        .iter()
        .filter(|(_, cell)| cell.is_known());
    let mut squares = 0;
    for (cell, value) in cells {
        let code = cells_to_tiles::CellCoder::elevation(value);
        for y in [2 * cell.y, 2 * cell.y + 1] {
            assert_eq!(
                heights.get(&[cell.x.into(), y.into()]),
                Some(&code),
                "{cell:?}"
            );
            squares += 1;
        }
    }
    assert_eq!(squares, heights.len());
    let classes: BTreeMap<_, _> = run::known_cells(&store, LayerId::Obstacle).collect();
    let obstacles = terrain.obstacle().grid().iter();
    for (cell, &class) in obstacles {
        let code = classes.get(&[cell.x.into(), cell.y.into()]);
        let expected = cells_to_tiles::CellCoder::obstacle(class);
        assert_eq!(code.copied().unwrap_or(UNKNOWN), expected, "{cell:?}");
    }
    assert!(
        squares > 200 && classes.len() > 100,
        "{squares} {}",
        classes.len()
    );
}

#[test]
fn the_map_depends_on_the_seed_alone() {
    let world = World::load("rooms").unwrap();
    let map = |seed| map_of(&world, measured(&world, seed), &[]);
    assert_eq!(map(2), map(2));
    assert_ne!(map(2), map(1));
}

/// The program creates its own pipeline, passes measurements in batches, uses one thread or two, and
/// reports the digest of the map that it exports.
#[test]
fn the_program_makes_the_map_of_the_library() {
    let world = World::load("rooms").unwrap();
    let in_order = map_of(&world, measured(&world, 3), &[]).to_string();
    for threads in ["mapping.threads=1", "mapping.threads=2"] {
        let layers = layers_of_simulate("rooms", threads);
        assert_eq!(layers["occupancy"]["digest"], in_order, "{threads}");
    }
}

#[test]
fn one_thread_and_two_make_the_same_shores() {
    let layers = |threads| layers_of_simulate("lake", threads);
    let [one, two] = ["mapping.threads=1", "mapping.threads=2"].map(layers);
    assert!(one["shore"]["digest"].is_string(), "{one}");
    assert_eq!(one, two);
}

/// Digests of the layers, with seed 3.
fn layers_of_simulate(world: &str, setting: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let summary = folder.path().join("summary.json");
    start(&format!(
        "robot-edge simulate {world} --rate max --no-network --quiet --seed 3 --duration {DURATION_S} --set {setting} \
         --summary {}",
        summary.display()
    ))
    .ends_well();
    let summary: Value = serde_json::from_str(&fs::read_to_string(summary).unwrap()).unwrap();
    summary["layers"].clone()
}

const LIMIT_MB: u32 = 1;

/// The tiles in the mapping memory.
fn held(pipeline: &Pipeline) -> BTreeSet<TileKey> {
    let tiles = pipeline.mapper().occupancy().unwrap().grid().tiles();
    tiles
        .map(|tile| cells_to_tiles::key(LayerId::Occupancy, tile.index))
        .collect()
}

/// The published tiles.
fn published(pipeline: &Pipeline) -> BTreeMap<TileKey, TileCells> {
    let store = pipeline.publisher().store();
    let tiles = store.tiles(LayerId::Occupancy);
    tiles
        .map(|(key, stored)| (key, stored.cells().unwrap().clone()))
        .collect()
}

fn revisions(pipeline: &Pipeline) -> BTreeMap<TileKey, u64> {
    let store = pipeline.publisher().store();
    let tiles = store.tiles(LayerId::Occupancy);
    tiles
        .map(|(key, stored)| (key, stored.revision()))
        .collect()
}

/// Tiles of a pipeline, observed after each publication.
#[derive(Default)]
struct Watch {
    publications: u64,
    held: BTreeSet<TileKey>,
    revisions: BTreeMap<TileKey, u64>,
    evicted: BTreeSet<TileKey>,
    /// Evicted and observed again later: they were blank in the mapping memory.
    seen_again: BTreeSet<TileKey>,
    evictions: u64,
}

impl Watch {
    fn look(&mut self, pipeline: &Pipeline) {
        let publications = pipeline.report().publish_time.runs();
        if publications == self.publications {
            return;
        }
        assert_eq!(
            publications,
            self.publications + 1,
            "a publication was missed"
        );
        self.publications = publications;
        let bytes = pipeline.mapper().occupancy().unwrap().bytes();
        assert!(bytes <= LIMIT_MB as usize * 1_000_000, "{bytes}");
        let (held, revisions) = (held(pipeline), revisions(pipeline));
        for (&key, &revision) in &revisions {
            let touched = self.revisions.get(&key) != Some(&revision);
            let is_held = held.contains(&key);
            if self.evicted.contains(&key) && (touched || is_held) {
                self.seen_again.insert(key);
            }
            if (self.held.contains(&key) || touched) && !is_held {
                self.evicted.insert(key);
                self.evictions += 1;
            }
        }
        (self.held, self.revisions) = (held, revisions);
    }
}

/// Maps with [`LIMIT_MB`] and without and compares the published tiles; returns the observation and the pipeline's
/// count of evictions.
fn check(cell_m: f64, duration_s: f64) -> (Watch, u64) {
    let world = World::load("rooms").unwrap();
    let options = SimulationOptions {
        seed: 1,
        duration_s: Some(duration_s),
        ..SimulationOptions::default()
    };
    let cell = format!("mapping.occupancy.cell_m={cell_m}");
    let limit = format!("mapping.occupancy.memory_limit_mb={LIMIT_MB}");
    let mut limited = pipeline(&vehicle_config(&world, &[&cell, &limit]));
    let mut unlimited = pipeline(&vehicle_config(&world, &[&cell]));
    let mut watch = Watch::default();
    for measurement in measurements(&world, options) {
        limited.push(measurement.clone()).unwrap();
        unlimited.push(measurement).unwrap();
        watch.look(&limited);
    }
    for pipeline in [&mut limited, &mut unlimited] {
        pipeline.finish().unwrap();
        let counters = pipeline.publisher().store().counters();
        assert_eq!(counters.tiles_evicted, 0, "the store has room for all");
    }
    watch.look(&limited);
    assert_eq!(unlimited.publisher().traffic().evicted_from_mapping, 0);

    let (ours, all) = (published(&limited), published(&unlimited));
    assert!(ours.keys().eq(all.keys()));
    for (key, cells) in ours {
        let known = |cells: &TileCells| cells.codes().map(|code| code != UNKNOWN);
        assert_eq!(known(&cells), known(&all[&key]), "{key}: known cells");
        if !watch.seen_again.contains(&key) {
            assert_eq!(cells, all[&key], "{key}: values");
        }
    }
    (watch, limited.publisher().traffic().evicted_from_mapping)
}

/// The memory holds twice what is in sight: only tiles that are left behind are evicted.
#[test]
fn evicted_tiles_stay_published_as_they_were() {
    let (watch, counted) = check(0.02, 116.0);
    assert_eq!(counted, watch.evictions);
    let untouched = watch.evicted.difference(&watch.seen_again).count();
    assert!(untouched > 50, "{untouched}");
    assert!(watch.seen_again.len() > 20, "{}", watch.seen_again.len());
}

/// The memory holds half of what is in sight: tiles are evicted in the second in which they change.
#[test]
fn tiles_are_published_before_they_are_evicted() {
    let (watch, counted) = check(0.01, 20.0);
    // A tile that was reloaded and evicted without a change is not visible outside.
    assert!(
        (watch.evictions..watch.evictions + 5).contains(&counted),
        "{counted}"
    );
    assert!(counted > 2 * watch.evicted.len() as u64, "{counted}");
}

/// Time at which the odometry jumps, seconds.
const JUMP_S: f64 = 4.0;
const JUMP_M: f64 = 5.0;
const END_S: f64 = 6.0;

/// Drives through the hall; returns the maps and events.
fn drive(on_jump: &str) -> (Pipeline, Vec<MapEvent>) {
    let world = World::load("hall").unwrap();
    let settings = [
        "localization.source=odometry",
        &format!("localization.on_jump={on_jump}"),
    ];
    let config = vehicle_config(&world, &settings);
    let options = SimulationOptions {
        duration_s: Some(END_S),
        ..SimulationOptions::default()
    };
    let mut source = SimulatedSource::new(&world, options).unwrap();
    let mut pipeline = run::pipeline(&config, source.streams()).unwrap();
    while let Some(measurement) = source.next_measurement() {
        pipeline.push(jumping(measurement)).unwrap();
    }
    pipeline.finish().unwrap();
    let map_events = pipeline.take_map_events();
    (pipeline, map_events)
}

fn jumping(mut measurement: Measurement) -> Measurement {
    let jumps_at = START + RobotDuration::from_secs_f64(JUMP_S);
    if measurement.stamp >= jumps_at
        && let MeasurementData::Odometry { odom_from_base, .. } = &mut measurement.data
    {
        odom_from_base.translation.x += JUMP_M;
    }
    measurement
}

/// Least x of the published cells, metres, and the number of erasures.
fn least_x_and_erasures(pipeline: &Pipeline) -> (f64, u32) {
    let store = pipeline.publisher().store();
    let layer = LayerId::Obstacle;
    let raster = protocol::mosaic::Raster::of_layer(&store, layer, 1_000_000).unwrap();
    (raster.unwrap().corners_m().0[0], store.epoch(layer))
}

#[test]
fn a_pose_jump_keeps_or_erases_the_maps_as_configured() {
    let (kept, map_events) = drive("keep");
    let [map_event] = &map_events[..] else {
        panic!("{map_events:?}");
    };
    assert_eq!(map_event.kind, "pose_jump");
    assert_eq!(
        map_event.message,
        "the poses jumped by 5.00 m: the maps were kept"
    );
    let (least_x_m, erased) = least_x_and_erasures(&kept);
    assert!(least_x_m < 4.0, "the earlier cells are kept: {least_x_m}");
    assert_eq!(erased, 0);

    let (reset, map_events) = drive("reset");
    assert!(
        map_events[0].message.ends_with("the maps were erased"),
        "{map_events:?}"
    );
    let (least_x_after_m, erased) = least_x_and_erasures(&reset);
    assert!(
        least_x_after_m > least_x_m + 4.0,
        "{least_x_after_m} {least_x_m}"
    );
    assert_eq!(erased, 1);

    // Only scans between the poses before and after the jump lack a pose.
    for pipeline in [&kept, &reset] {
        let counts = pipeline.registration().counts();
        assert!(counts.dropped_scans.total() <= 1, "{counts:?}");
        assert_eq!(
            counts.scans_in,
            counts.scans_registered + counts.dropped_scans.total()
        );
    }
}

/// Fixed and tilting lasers, before walls, canes and grass.
#[test]
fn a_cover_is_found_within_a_second_and_nothing_else_is_taken_for_one() {
    const COVERED_S: f64 = 20.1;
    for name in ["lake", "dock", "meadow", "yard"] {
        let path = format!(
            "{}/../robot-edge/simulation/worlds/{name}.toml",
            env!("CARGO_MANIFEST_DIR")
        );
        let covered = format!("[noise]\nlaser_covered_s = [{COVERED_S}, 1e6]");
        let text = fs::read_to_string(path)
            .unwrap()
            .replacen("[noise]", &covered, 1);
        let world = World::parse(name, &text).unwrap();
        let options = SimulationOptions {
            duration_s: Some(COVERED_S + 2.0),
            ..SimulationOptions::default()
        };
        let unused =
            ["cost", "shore", "rigidity"].map(|layer| format!("mapping.{layer}.enabled=false"));
        let unused = unused.each_ref().map(String::as_str);
        let mut run = SimulatedRun::with_settings(&world, options, &unused).unwrap();
        let mut detectors = BTreeMap::<_, BlockageDetector>::new();
        // When which sensors were taken for blocked.
        let mut blocked = Vec::new();
        run.advance_with(run.duration_s(), |_, scan| {
            if scan.kind != ScanKind::Beams {
                return;
            }
            let at_s = scan.stamp.since(START).as_secs_f64();
            let detector = detectors.entry(scan.sensor).or_default();
            detector.update(scan, Monotonic::from_nanos((at_s * 1e9) as u64));
            if detector.is_blocked() {
                blocked.push((scan.sensor.0, at_s));
            }
        })
        .unwrap();
        let found_s = blocked.first().unwrap().1 - COVERED_S;
        assert!((0.0..1.0).contains(&found_s), "{name}: {blocked:?}");
        // Before the sonar, by name.
        let laser = detectors.keys().next().unwrap().0;
        assert!(
            blocked.iter().all(|(sensor, _)| *sensor == laser),
            "{name}: {blocked:?}"
        );
        assert!(
            blocked.last().unwrap().1 > COVERED_S + 1.5,
            "{name}: {blocked:?}"
        );
    }
}
