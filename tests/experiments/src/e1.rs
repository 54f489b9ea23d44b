//! E1 [LOD §5.1]: a hall with pillars in cells of four sizes.

use std::collections::BTreeMap;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::SimulatedRun;
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, Cell, TerrainWorld, extent_m, obstacle_map};
use mapping::elevation::CellClass;
use mapping::terrain::Terrain;
use simulation::SimulationOptions;

/// Side of a cell, metres, and cells along an edge: 20 × 20 m.
const SIZES: [(f64, u32); 4] = [(0.05, 401), (0.1, 201), (0.2, 101), (0.5, 41)];
/// From the first pillar to the left wall, metres [LOD §5.1].
const DISTANCE_M: f64 = 1.7;
/// The first 4.2 m of the path, seconds.
const DURATION_S: f64 = 21.0;

/// What the times are those of.
const BUILD: &str = if cfg!(debug_assertions) {
    "a development build, which checks every sum"
} else {
    "a release build"
};

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    session.step("E1: the truth of the hall")?;
    let hall = TerrainWorld::load("hall", Some(DURATION_S), session.rules())?;
    let plane = hall.plane_at(0.0);
    let sweep = Sweep::of(&hall, &plane, |_| true)?;
    let mut outcome = Outcome::default();
    let mut distances = Table::new(&["cells", "least, m", "median, m", "greatest, m"]);
    let mut costs = Table::new(&[
        "cells",
        "map",
        "elevation and obstacles, bytes",
        "document's, bytes",
        "mapping a scan, p50 µs",
        "p99 µs",
    ]);
    let mut pictures = Vec::new();
    for (cell_m, cells) in SIZES {
        let is_preset = cell_m.to_bits() == hall.cell_m().to_bits();
        let runs = session.for_each_seed(&format!("E1: hall, cells of {cell_m} m"), |seed| {
            let run = mapped(&hall, cell_m, cells, seed)?;
            let map = obstacle_map(&run.store());
            let distance_m = pillar_to_wall_m(&hall, cell_m, &map)?;
            let agreement = is_preset.then(|| Agreement::of(&hall, &plane, &map, &sweep));
            Ok((distance_m, agreement))
        })?;
        let spread = Spread::over(&runs, |(distance_m, _)| distance_m.unwrap_or(f64::NAN));
        let is_near = |distance_m: &Option<f64>| {
            distance_m.is_some_and(|distance_m| (distance_m - DISTANCE_M).abs() <= cell_m + 1e-9)
        };
        outcome.checks.push(Check::gate(
            format!("pillar to wall, cells of {cell_m} m"),
            spread.text(2, " m"),
            format!("{DISTANCE_M} m ± {cell_m} m"),
            runs.iter().all(|(distance_m, _)| is_near(distance_m)),
        ));
        let [least, median, most] = spread.cells(2);
        distances.push([format!("{cell_m} m"), least, median, most]);
        if is_preset {
            let agreements = runs.iter().filter_map(|(_, agreement)| agreement.as_ref());
            outcome.checks.extend(agreement::checks("hall", agreements));
        }
        session.step(&format!("E1: time and memory, cells of {cell_m} m"))?;
        let run = mapped(&hall, cell_m, cells, SEED)?;
        costs.rows.push(cost(&run, cell_m, cells));
        pictures.extend(size_pictures(&run, cell_m)?);
    }
    outcome.parts = vec![
        Part::text(include_str!("notes/e1.md")),
        Part::Pictures(terrain::world_from_above(&hall, &plane, "e1-world")?),
        Part::text("Distance from the pillar to the wall in the obstacle map:"),
        Part::Table(distances),
        Part::text(include_str!("notes/e1_cost.md")),
        Part::text(format!("This page was written by {BUILD}.")),
        Part::Table(costs),
    ];
    outcome.parts.extend(pictures);
    Ok(outcome)
}

fn mapped(hall: &TerrainWorld, cell_m: f64, cells: u32, seed: u64) -> anyhow::Result<SimulatedRun> {
    let settings = [
        format!("mapping.elevation.cell_m={cell_m:?}"),
        format!("mapping.elevation.cells={cells}"),
        format!("mapping.obstacle.cells={cells}"),
    ];
    let options = SimulationOptions {
        seed,
        duration_s: Some(DURATION_S),
        encoder_error: Some(0.0),
        ..SimulationOptions::default()
    };
    let settings = settings.each_ref().map(String::as_str);
    let mut run = SimulatedRun::new(&hall.world, options, &hall.config_with(&settings)?)?;
    run.advance_to(DURATION_S)?;
    Ok(run)
}

/// From the middle of the pillar's last cell to the middle of the wall's first, in the column of cells that
/// holds the pillar's front; `None` where the map lacks one of them.
fn pillar_to_wall_m(
    hall: &TerrainWorld,
    cell_m: f64,
    map: &BTreeMap<Cell, CellClass>,
) -> anyhow::Result<Option<f64>> {
    let (pillar, wall) = (hall.solid("first pillar")?, hall.solid("left wall")?);
    let at = |m: f64| libm::floor(m / cell_m) as i64;
    let x = at(extent_m(pillar, 0)[0]);
    let [right_m, left_m] = extent_m(pillar, 1);
    let is_obstacle = |y: &i64| map.get(&[x, *y]) == Some(&CellClass::Obstacle);
    // Noise carries a point at most into the next cell.
    let last_of_pillar = (at(right_m)..=at(left_m) + 1).rev().find(is_obstacle);
    Ok(last_of_pillar.and_then(|last| {
        let beyond = last + 1..=at(extent_m(wall, 1)[1]);
        let mut gap = beyond.skip_while(is_obstacle);
        let first = gap.find(is_obstacle)?;
        Some((first - last) as f64 * cell_m)
    }))
}

fn cost(run: &SimulatedRun, cell_m: f64, cells: u32) -> Vec<String> {
    let pipeline = run.pipeline();
    let bytes = pipeline.mapper().terrain().map_or(0, Terrain::bytes);
    let times = pipeline.report().mapping_time.times();
    vec![
        format!("{cell_m} m"),
        format!("{cells} × {cells}"),
        bytes.to_string(),
        (u64::from(cells) * u64::from(cells) * 5).to_string(),
        format!("{:.0}", times.p50_us),
        format!("{:.0}", times.p99_us),
    ]
}

fn size_pictures(run: &SimulatedRun, cell_m: f64) -> anyhow::Result<Option<Part>> {
    let name = format!("e1-{:.0}cm", 100.0 * cell_m);
    let pictures: Vec<Picture> =
        terrain::maps(run.pipeline(), &name, &format!("cells of {cell_m} m"))?;
    Ok((!pictures.is_empty()).then_some(Part::Pictures(pictures)))
}
