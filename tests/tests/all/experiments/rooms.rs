//! The world `rooms` and its variants.

use std::ops::RangeInclusive;

use robot_edge::simulation::truth::outline::Outline;
use robot_edge::simulation::truth::{self, Bounds};
use robot_edge::simulation::{SimulationOptions, World};

use super::agreement::Truth;
use crate::simulated_run::{SimulatedRun, vehicle_config};

const ROOMS: &str = include_str!("../../../../robot-edge/worlds/rooms.toml");

/// The seed of the normal run.
pub(super) const SEED: u64 = 1;
/// Those of the ignored tests.
pub(super) const SEEDS: RangeInclusive<u64> = 1..=20;

pub(super) fn rooms() -> World {
    World::load("rooms").unwrap()
}

/// The same rooms with a mirror that scatters light like any other surface.
pub(super) fn rooms_without_reflections() -> World {
    let mirrored = "reflectivity.specular = { probability = 0.3 }\n";
    assert_eq!(ROOMS.matches("reflectivity").count(), 1);
    assert!(ROOMS.contains(mirrored));
    World::parse("rooms without reflections", &ROOMS.replace(mirrored, "")).unwrap()
}

/// The same rooms; the vehicle stays in the one with the mirror and drives up and down before it, for as
/// long as it drives through all of them otherwise.
pub(super) fn rooms_seen_from_one() -> World {
    let (before, rest) = ROOMS.split_once("waypoints = [").unwrap();
    let (_, behind) = rest.split_once("\n]\n").unwrap();
    let up_and_down = "
    { x_m = 2.505, y_m = -1.935, corner_radius_m = 0.0 },
    { x_m = 2.505, y_m = 2.40, corner_radius_m = 0.0 },"
        .repeat(6);
    let text = format!(
        "{before}waypoints = [\n    {{ x_m = 2.505, y_m = 4.32 }},{up_and_down}\n]\n{behind}"
    );
    World::parse("rooms seen from one", &text).unwrap()
}

/// The truth of `world` in cells as large as the pioneer's, with room to spare on every side.
pub(super) fn truth_of(world: &World) -> Truth {
    let bounds = Bounds {
        min_m: [-10.0, -11.0],
        max_m: [26.0, 20.0],
    };
    let cell_m = vehicle_config(world, &[]).mapping.occupancy.cell_m;
    let grid = truth::occupancy(world, cell_m, bounds).unwrap();
    Truth::new(grid, world.laser_errors().range_noise_m)
}

/// The mirror's section in the plane of the laser.
pub(super) fn mirror_of(world: &World) -> Outline {
    let mirror = world.solids().iter().find(|solid| solid.name == "mirror");
    let height_m = world
        .simulated_vehicle()
        .laser
        .base_from_laser
        .translation
        .z;
    Outline::at_height(&[mirror.unwrap().clone()], height_m)
}

/// How long the vehicle drives through all rooms, seconds.
pub(super) fn duration_s() -> f64 {
    rooms().path().duration_s()
}

/// A run of at most [`duration_s`] with the vehicle's own configuration.
pub(super) fn run(world: &World, seed: u64) -> SimulatedRun {
    run_with(world, seed, &[])
}

/// The same with `settings` (`key=value`) over the configuration.
pub(super) fn run_with(world: &World, seed: u64, settings: &[&str]) -> SimulatedRun {
    let options = SimulationOptions {
        seed,
        duration_s: Some(duration_s()),
        ..SimulationOptions::default()
    };
    SimulatedRun::new(world, options, &vehicle_config(world, settings))
}
