//! E6 [LOD §5.6]: a left turn does not drag walls, and glass lets beams through.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Context as _;

use super::outcome::{Check, Outcome, Part, Spread};
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, Cell, TerrainWorld, extent_m, obstacle_map};
use mapping::elevation::CellClass;
use protocol::layer::Scheme;
use simulation::{Motion, World};

/// By how much the walls may grow.
const GROWTH_MAX: f64 = 1.05;
/// Walls along x that are mapped before the turn.
const WALLS: [&str; 2] = ["right wall", "left wall"];
/// Cells so near a wall's face are the wall's: drag would spread them, metres.
const NEAR_M: f64 = 0.6;
/// Cells beyond the glass that must be known at the end: 1 m².
const BEYOND_GLASS_MIN: f64 = 25.0;
/// The turn begins when the vehicle has turned by so much, degrees.
const TURNING_DEG: f64 = 0.5;
/// The whole turn, degrees.
const TURN_DEG: f64 = 90.0;
const STEP_S: f64 = 0.1;

struct Drive {
    before: f64,
    after: f64,
    beyond_glass: [f64; 2],
    resets: usize,
    agreement: Agreement,
}

/// [LOD §5.6], "so that the maps were not deleted".
const DOCUMENT: &[&str] = &["mapping.ground.epsilon_deg=0.9"];

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    outcome.parts.push(Part::text(include_str!("notes/e6.md")));
    for (settings, label, name, heights) in [
        (&[][..], "", "e6", Scheme::GroundPlane),
        (DOCUMENT, "ε 0.9°: ", "e6-document", Scheme::GroundPlane5),
    ] {
        let world = World::load("turn")?;
        let turn = TerrainWorld::new(world, None, session.rules(), settings)?;
        drive(session, &turn, (label, name, heights), &mut outcome)?;
    }
    Ok(outcome)
}

/// One turn with all seeds; `label` stands before each check, `name` before each picture.
fn drive(
    session: &Session<'_>,
    turn: &TerrainWorld,
    (label, name, heights): (&str, &str, Scheme),
    outcome: &mut Outcome,
) -> anyhow::Result<()> {
    let plane = turn.plane_at(0.0);
    let sweep = Sweep::of(turn, &plane, |_| true)?;
    let begins_s = time_of_yaw_s(turn, TURNING_DEG)?;
    let drives = session.for_each_seed("E6: turn", |seed| {
        let mut run = turn.run(seed, 0.0)?;
        run.advance_to(begins_s)?;
        let before = obstacle_map(&run.store());
        let mut pipeline = run.finish()?;
        let resets = pipeline.take_map_events().len();
        let after = obstacle_map(&pipeline.publisher().store());
        let (walls_before, walls_after) = walls(turn, &before, &after)?;
        Ok(Drive {
            before: walls_before as f64,
            after: walls_after as f64,
            beyond_glass: [
                beyond_glass(turn, &before)? as f64,
                beyond_glass(turn, &after)? as f64,
            ],
            resets,
            agreement: Agreement::of(turn, &plane, &after, &sweep),
        })
    })?;
    let mut checks = checks(&drives);
    for check in &mut checks {
        check.what.insert_str(0, label);
    }
    outcome.checks.extend(checks);
    let parts = &mut outcome.parts;
    if label.is_empty() {
        let world = terrain::world_from_above(turn, &plane, &format!("{name}-world"))?;
        parts.push(Part::Pictures(world));
    }
    session.step("E6: pictures")?;
    let mut run = turn.run(SEED, 0.0)?;
    for (until_s, moment, caption) in [
        (begins_s, "beginning", "before the turn"),
        (time_of_yaw_s(turn, 0.5 * TURN_DEG)?, "middle", "halfway"),
        (turn.duration_s(), "end", "after it"),
    ] {
        run.advance_to(until_s)?;
        let name = format!("{name}-{moment}");
        let caption = format!("{label}{caption}");
        let maps = terrain::maps_in(heights, run.pipeline(), &name, &caption)?;
        parts.push(Part::Pictures(maps));
    }
    Ok(())
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let growth = Spread::over(drives, |drive| drive.after / drive.before);
    let before = Spread::over(drives, |drive| drive.before);
    let [beyond_before, beyond] =
        [0, 1].map(|end: usize| Spread::over(drives, |drive| drive.beyond_glass[end]));
    let mut checks = vec![
        Check::at_most(
            "cells of the walls after the turn over those before",
            (growth, 3, ""),
            GROWTH_MAX,
        ),
        Check::at_least("cells of the walls before", (before, 0, ""), 20.0),
        Check::at_least(
            "known cells beyond the glass at the end",
            (beyond, 0, ""),
            BEYOND_GLASS_MIN,
        ),
        Check::shown(
            "known cells beyond the glass before the turn",
            beyond_before.text(0, ""),
        ),
        Check::shown(
            "changes of the ground plane",
            Spread::count(drives, |drive| drive.resets).text(0, ""),
        ),
    ];
    let agreements = drives.iter().map(|drive| &drive.agreement);
    checks.extend(agreement::checks("turn", agreements));
    checks
}

/// Cells of the stretches of wall that were mapped before: then, and after.
fn walls(
    turn: &TerrainWorld,
    before: &BTreeMap<Cell, CellClass>,
    after: &BTreeMap<Cell, CellClass>,
) -> anyhow::Result<(usize, usize)> {
    let mut counts = (0, 0);
    for wall in WALLS {
        let wall = turn.solid(wall)?;
        let ([from_m, to_m], [right_m, left_m]) = (extent_m(wall, 0), extent_m(wall, 1));
        let is_wall = |cell: &Cell| {
            let [x_m, y_m] = turn.centre_m(*cell);
            (from_m..=to_m).contains(&x_m) && (right_m - NEAR_M..=left_m + NEAR_M).contains(&y_m)
        };
        let cells = |map: &BTreeMap<Cell, CellClass>| -> Vec<Cell> {
            let obstacles = map
                .iter()
                .filter(|(_, class)| **class == CellClass::Obstacle);
            obstacles.map(|(&cell, _)| cell).filter(is_wall).collect()
        };
        let first = cells(before);
        let columns: BTreeSet<i64> = first.iter().map(|cell| cell[0]).collect();
        let later = cells(after);
        counts.0 += first.len();
        counts.1 += later
            .iter()
            .filter(|cell| columns.contains(&cell[0]))
            .count();
    }
    Ok(counts)
}

fn beyond_glass(turn: &TerrainWorld, map: &BTreeMap<Cell, CellClass>) -> anyhow::Result<usize> {
    let glass_m = extent_m(turn.solid("main glass wall")?, 0)[1];
    // Noise carries no point of the glass so far.
    let beyond = |cell: &&Cell| cell[0] as f64 * turn.cell_m() > glass_m + turn.cell_m();
    Ok(map.keys().filter(beyond).count())
}

/// When the vehicle has turned by so many degrees.
fn time_of_yaw_s(turn: &TerrainWorld, yaw_deg: f64) -> anyhow::Result<f64> {
    let motion = Motion::new(&turn.world);
    let steps = (turn.duration_s() / STEP_S) as u32;
    let mut times = (0..=steps).map(|step| f64::from(step) * STEP_S);
    let time_s = times.find(|&time_s| {
        measurement::pose::yaw_rad(&motion.world_from_base(time_s)).to_degrees() >= yaw_deg
    });
    time_s.with_context(|| format!("the world `turn` does not turn by {yaw_deg}°"))
}
