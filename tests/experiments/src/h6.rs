//! H6: a person walks through and leaves no trail; walls stay.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::bail;

use super::outcome::{Check, Outcome, Part, Spread};
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, Cell, TerrainWorld, extent_m, obstacle_map};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;

/// No trail so long after the person has left, seconds.
const AFTER_S: f64 = 10.0;
/// Share of the walls' cells that must stay.
const WALLS_STAY_MIN_PERCENT: f64 = 99.0;
/// Time between two looks, seconds.
const STEP_S: f64 = 0.2;

struct Drive {
    /// Most cells of the person's way that were obstacles at one time.
    most_trail: f64,
    /// Those 10 s after the person left.
    trail: f64,
    /// Those at the end.
    trail_at_end: f64,
    /// Cells of walls that were obstacles at any time until then, and those of them that still are.
    walls: f64,
    walls_left: f64,
    agreement: Agreement,
}

/// Where the person walks.
struct WalkerPath {
    cells: BTreeSet<Cell>,
    comes_s: f64,
    leaves_s: f64,
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let walker = TerrainWorld::load("walker", None, session.rules())?;
    let plane = walker.plane_at(0.0);
    let walker_path = WalkerPath::of(&walker, &plane)?;
    let sweep = Sweep::of(&walker, &plane, |_| true)?;
    let drives = session.for_each_seed("H6: walker", |seed| {
        drive(&walker, &plane, &walker_path, &sweep, seed)
    })?;
    session.step("H6: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/h6.md")),
        Part::Pictures(terrain::world_from_above(&walker, &plane, "h6-world")?),
    ];
    let mut run = walker.run(SEED, 0.0)?;
    for (until_s, name, caption) in [
        (
            0.5 * (walker_path.comes_s + walker_path.leaves_s),
            "during",
            "while the person is there",
        ),
        (
            walker_path.leaves_s + AFTER_S,
            "after",
            "10 s after it left",
        ),
    ] {
        run.advance_to(until_s)?;
        let name = format!("h6-{name}");
        parts.push(Part::Pictures(terrain::maps(
            run.pipeline(),
            &name,
            caption,
        )?));
    }
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

impl WalkerPath {
    fn of(walker: &TerrainWorld, plane: &GroundPlane) -> anyhow::Result<Self> {
        let mut walker_path = Self {
            cells: BTreeSet::new(),
            comes_s: f64::INFINITY,
            leaves_s: 0.0,
        };
        let steps = (walker.duration_s() / STEP_S) as u32;
        for time_s in (0..=steps).map(|step| f64::from(step) * STEP_S) {
            let movers = walker.world.solids().iter();
            let movers = movers.filter(|solid| solid.motion.is_some());
            for solid in movers.filter_map(|solid| solid.at(time_s)) {
                walker_path.comes_s = walker_path.comes_s.min(time_s);
                walker_path.leaves_s = walker_path.leaves_s.max(time_s);
                let (x, y) = (extent_m(&solid, 0), extent_m(&solid, 1));
                let (first, last) = (walker.cell_at([x[0], y[0]]), walker.cell_at([x[1], y[1]]));
                // Noise carries points into the next cell.
                let columns = first[0] - 1..=last[0] + 1;
                let cells = columns.flat_map(|x| (first[1] - 1..=last[1] + 1).map(move |y| [x, y]));
                walker_path.cells.extend(cells.filter(|&cell| {
                    let verdict = walker.verdict(cell, plane);
                    verdict.is_some_and(|verdict| !verdict.is_obstacle)
                }));
            }
        }
        if walker_path.cells.is_empty() || walker_path.leaves_s + AFTER_S > walker.duration_s() {
            bail!("nobody walks through the world `walker` in time");
        }
        Ok(walker_path)
    }

    fn trail(&self, map: &BTreeMap<Cell, CellClass>) -> f64 {
        let is_obstacle = |cell: &&Cell| map.get(*cell) == Some(&CellClass::Obstacle);
        self.cells.iter().filter(is_obstacle).count() as f64
    }
}

fn drive(
    walker: &TerrainWorld,
    plane: &GroundPlane,
    walker_path: &WalkerPath,
    sweep: &Sweep,
    seed: u64,
) -> anyhow::Result<Drive> {
    let mut run = walker.run(seed, 0.0)?;
    let after_s = walker_path.leaves_s + AFTER_S;
    let mut most_trail = 0.0_f64;
    let mut walls = BTreeSet::new();
    let steps = (after_s / STEP_S) as u32;
    for until_s in (1..=steps).map(|step| f64::from(step) * STEP_S) {
        run.advance_to(until_s)?;
        let map = obstacle_map(&run.store());
        most_trail = most_trail.max(walker_path.trail(&map));
        walls.extend(map.into_iter().filter_map(|(cell, class)| {
            let is_wall = class == CellClass::Obstacle
                && walker
                    .verdict(cell, plane)
                    .is_some_and(|verdict| verdict.is_obstacle);
            is_wall.then_some(cell)
        }));
    }
    run.advance_to(after_s)?;
    let map = obstacle_map(&run.store());
    let (trail, pipeline) = (walker_path.trail(&map), run.finish()?);
    let map = obstacle_map(&pipeline.publisher().store());
    let left = walls
        .iter()
        .filter(|cell| map.get(*cell) == Some(&CellClass::Obstacle));
    Ok(Drive {
        most_trail,
        trail,
        trail_at_end: walker_path.trail(&map),
        walls_left: left.count() as f64,
        walls: walls.len() as f64,
        agreement: Agreement::of(walker, plane, &map, sweep),
    })
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let stay = Spread::over(drives, |drive| 100.0 * drive.walls_left / drive.walls);
    let most = Spread::over(drives, |drive| drive.most_trail);
    let walls = Spread::over(drives, |drive| drive.walls);
    let mut checks = vec![
        Check::zero(
            "obstacle cells where the person walked, 10 s after it left",
            Spread::over(drives, |drive| drive.trail),
        ),
        Check::at_least(
            "cells of walls that stay obstacles to the end",
            (stay, 2, " %"),
            WALLS_STAY_MIN_PERCENT,
        ),
        Check::at_least("most such cells at one time", (most, 0, ""), 3.0),
        Check::zero(
            "such cells at the end",
            Spread::over(drives, |drive| drive.trail_at_end),
        ),
        Check::at_least("cells of walls", (walls, 0, ""), 50.0),
    ];
    let agreements = drives.iter().map(|drive| &drive.agreement);
    checks.extend(agreement::checks("walker", agreements));
    checks
}
