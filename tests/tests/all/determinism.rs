//! The same measurements give the same map, in whatever order they arrive.

use std::fs;
use std::io;

use measurement::{Measurement, MeasurementData};
use protocol::tile_store::RootDigest;
use robot_edge::cli::{
    Cli, Command, DrivingOptions, MappingOptions, NetworkOptions, Simulate, VehicleOptions,
    Verbosity,
};
use robot_edge::exit::Exit;
use robot_edge::pacer::Rate;
use robot_edge::runtime;
use simulation::{SimulationOptions, World};

use crate::simulated_run::{digest, measurements, pipeline, vehicle_config};

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
        assert_eq!(digest_of_simulate(3, threads), in_order, "{threads}");
    }
}

fn digest_of_simulate(seed: u64, setting: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let summary = folder.path().join("summary.json");
    let cli = Cli {
        command: Command::Simulate(Simulate {
            world: "rooms".to_owned(),
            seed,
            duration_s: Some(DURATION_S),
            drive_at_any_rate: false,
            rate: Rate::Max,
            driving: DrivingOptions::default(),
            mapping: MappingOptions {
                setup: VehicleOptions {
                    settings: vec![setting.parse().unwrap()],
                    ..VehicleOptions::default()
                },
                robot: None,
                network: NetworkOptions {
                    no_network: true,
                    ..NetworkOptions::default()
                },
                record: None,
                export: None,
                summary: Some(summary.clone()),
            },
        }),
        verbosity: Verbosity {
            quiet: true,
            verbose: 0,
        },
    };
    assert_eq!(runtime::run(&cli, &mut io::sink()).unwrap(), Exit::Done);
    let summary: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(summary).unwrap()).unwrap();
    summary["layers"]["occupancy"]["digest"]
        .as_str()
        .unwrap()
        .to_owned()
}
