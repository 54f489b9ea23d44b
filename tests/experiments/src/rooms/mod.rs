//! The world `rooms` and its variants, and how its map is judged.

pub(super) mod agreement;
pub(super) mod erosion;
pub(super) mod error_map;

use self::agreement::Truth;
use super::ExperimentError;
use super::run::{SimulatedRun, vehicle_config};
use simulation::truth::outline::Outline;
use simulation::truth::{self, Bounds};
use simulation::{SimulationOptions, World};

const ROOMS: &str = include_str!("../../../../robot-edge/simulation/worlds/rooms.toml");
const MIRRORED: &str = "reflectivity.specular = { probability = 0.3 }\n";

/// The rooms as they are.
pub(super) fn rooms() -> Result<World, ExperimentError> {
    Ok(World::parse("rooms", ROOMS)?)
}

/// The same rooms with a mirror that scatters light like any other surface.
pub(super) fn without_reflections() -> Result<World, ExperimentError> {
    let text = ROOMS.replace(MIRRORED, "");
    Ok(World::parse("rooms without reflections", &text)?)
}

/// The same rooms; the vehicle stays in the one with the mirror and drives up and down before it, for as
/// long as it drives through all of them otherwise.
pub(super) fn seen_from_one() -> Result<World, ExperimentError> {
    let path = ROOMS
        .split_once("waypoints = [")
        .and_then(|(before, rest)| {
            let (_, behind) = rest.split_once("\n]\n")?;
            Some((before, behind))
        });
    let (before, behind) = path.ok_or_else(|| {
        ExperimentError::Unsuitable("the path of the world `rooms` is not where it was".to_owned())
    })?;
    let up_and_down = "
    { x_m = 2.505, y_m = -1.935, corner_radius_m = 0.0 },
    { x_m = 2.505, y_m = 2.40, corner_radius_m = 0.0 },"
        .repeat(6);
    let text = format!(
        "{before}waypoints = [\n    {{ x_m = 2.505, y_m = 4.32 }},{up_and_down}\n]\n{behind}"
    );
    Ok(World::parse("rooms seen from one", &text)?)
}

/// The truth of `world` in cells as large as the vehicle's, over more than its laser reaches.
pub(super) fn truth_of(world: &World) -> Result<Truth, ExperimentError> {
    let bounds = Bounds {
        min_m: [-10.0, -11.0],
        max_m: [26.0, 20.0],
    };
    let cell_m = vehicle_config(world, &[])?.mapping.occupancy.cell_m;
    let grid = truth::occupancy(world, cell_m, bounds)?;
    Ok(Truth::new(grid, world.laser_errors().range_noise_m))
}

/// The mirror's section in the plane of the laser.
pub(super) fn mirror_of(world: &World) -> Outline {
    let mirror: Vec<_> = world
        .solids()
        .iter()
        .filter(|solid| solid.name == "mirror")
        .cloned()
        .collect();
    let laser = &world.simulated_vehicle().laser;
    Outline::at_height(&mirror, laser.base_from_mount.translation.z)
}

/// A run with the vehicle's own configuration and `settings` (`key=value`) over it, for as long as the
/// vehicle drives through all rooms.
pub(super) fn run(
    world: &World,
    seed: u64,
    settings: &[&str],
) -> Result<SimulatedRun, ExperimentError> {
    let options = SimulationOptions {
        seed,
        duration_s: Some(rooms()?.path().duration_s()),
        ..SimulationOptions::default()
    };
    SimulatedRun::with_settings(world, options, settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variants_differ_where_they_should() {
        assert_eq!(ROOMS.matches("reflectivity").count(), 1);
        assert_eq!(ROOMS.matches(MIRRORED).count(), 1);
        let (rooms, one) = (rooms().unwrap(), seen_from_one().unwrap());
        assert_eq!(rooms.solids(), one.solids());
        assert!(one.path().duration_s() > rooms.path().duration_s());
        let plain = without_reflections().unwrap();
        assert_eq!(rooms.solids().len(), plain.solids().len());
        assert_ne!(rooms.solids(), plain.solids());
        assert!(!mirror_of(&rooms).segments().is_empty());
    }
}
