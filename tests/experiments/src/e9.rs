//! E9 [LOD §6.2]: a laser that is turned to where the obstacle map is blind.

use nalgebra::{Point3, Vector3};
use protocol::layer::Scheme;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::run::SimulatedRun;
use super::session::{Rules, SEED, Session};
use super::terrain::{self, Cell, TerrainWorld, around, obstacle_map};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;
use simulation::World;

/// Per cent of the way's cells that must be known before the vehicle is there.
const KNOWN_MIN: f64 = 99.0;
/// The vehicle drives ahead to here, turns left on the spot, and drives on to the end, metres.
const CORNER_X_M: f64 = 3.0;
const END_Y_M: f64 = 9.0;
/// Blocks beside the way after the corner, no higher than a kerb and a crate: x from its middle, y, height, metres.
const BLOCKS: [[f64; 3]; 7] = [
    [0.75, 1.75, 0.15],
    [-0.85, 2.35, 0.25],
    [0.95, 3.45, 0.20],
    [-0.75, 4.55, 0.15],
    [1.25, 5.35, 0.30],
    [-1.05, 6.65, 0.25],
    [0.75, 8.15, 0.15],
];
const BLOCK_M: f64 = 0.3;
/// Half the width of the vehicle, and from its middle to its front, metres.
const HALF_WIDTH_M: f64 = 0.35;
const FRONT_M: f64 = 0.45;
/// Something must be known when the vehicle's front is so near, metres: more than it needs to stop.
const AHEAD_M: f64 = 1.0;
const LEVEL: GroundPlane = GroundPlane {
    point_m: Point3::new(0.0, 0.0, 0.0),
    normal: Vector3::new(0.0, 0.0, 1.0),
};

/// What one drive gave.
struct Drive {
    /// Cells of the way, and those of them that were known in time.
    way: usize,
    known: usize,
    /// Blocks that were obstacles in time.
    found: usize,
    false_obstacles: usize,
    /// Share of the scans on the way after the corner with all known up to 4 m ahead of the front.
    far: f64,
}

fn world(vehicle: &str) -> anyhow::Result<World> {
    let blocks = BLOCKS.map(|[aside_m, y, height_m]| {
        format!(
            "[[solids]]\nshape = \"box\"\ncentre_m = [{}, {y}, {}]\nsize_m = [{BLOCK_M}, {BLOCK_M}, {height_m}]\n",
            CORNER_X_M + aside_m,
            0.5 * height_m
        )
    });
    let text = format!(
        "name = \"corner\"\nvehicle = \"{vehicle}\"\n[noise]\nrange_m = 0.01\ndropout = 0.005\n[start]\nx_m = 0.0\ny_m = 0.0\n\
         yaw_deg = 0.0\n[path]\nspeed_mps = 0.4\nturn_rate_degps = 30.0\nwaypoints = [{{ x_m = {CORNER_X_M}, y_m = 0.0 }}, \
         {{ x_m = {CORNER_X_M}, y_m = {END_Y_M} }}]\n[[solids]]\nname = \"ground\"\nshape = \"plane\"\n{}",
        blocks.concat()
    );
    Ok(World::parse("corner", &text)?)
}

fn class(run: &SimulatedRun, cell: Cell) -> CellClass {
    let terrain = run.pipeline().mapper().terrain();
    let [x, y] = cell.map(|index| index as i32);
    let class = terrain.and_then(|terrain| {
        terrain
            .obstacle()
            .grid()
            .get(mapping::grid::CellIndex { x, y })
    });
    class.copied().unwrap_or(CellClass::Unknown)
}

fn drive(world: &TerrainWorld, seed: u64) -> anyhow::Result<Drive> {
    let mut run = world.run(seed, 0.0)?;
    let motion = simulation::Motion::new(&world.world);
    let cell_m = world.cell_m();
    let row = |y: f64| {
        let columns = (HALF_WIDTH_M / cell_m) as i64;
        let [x, y] = world.cell_at([CORNER_X_M, y]);
        (x - columns..=x + columns).map(move |x| [x, y])
    };
    let mut drive = Drive {
        way: 0,
        known: 0,
        found: 0,
        false_obstacles: 0,
        far: 0.0,
    };
    let (mut looks, mut far) = (0, 0);
    // The first row and block that have not been judged.
    let (mut next_y, mut next_block) = (AHEAD_M + FRONT_M, 0);
    let steps = (world.duration_s() / 0.1) as u32;
    for step in 1..=steps {
        let time_s = 0.1 * f64::from(step);
        run.advance_to(time_s)?;
        let place = motion.world_from_base(time_s);
        let front_y = place.translation.y + FRONT_M;
        if (place * Vector3::x()).y < 0.999 || place.translation.y < 0.05 {
            continue;
        }
        let is_known = |cell: Cell| class(&run, cell) != CellClass::Unknown;
        looks += 1;
        far += usize::from((0..40).all(|at| row(front_y + 0.1 * f64::from(at)).all(is_known)));
        while next_y <= front_y + AHEAD_M {
            drive.way += row(next_y).count();
            drive.known += row(next_y).filter(|&cell| is_known(cell)).count();
            next_y += cell_m;
        }
        while let Some([aside_m, y, _]) = BLOCKS
            .get(next_block)
            .filter(|[_, y, _]| y - 0.5 * BLOCK_M <= front_y + AHEAD_M)
        {
            let at = world.cell_at([CORNER_X_M + aside_m, *y]);
            drive.found +=
                usize::from(around(at).any(|cell| class(&run, cell) == CellClass::Obstacle));
            next_block += 1;
        }
    }
    drive.far = f64::from(far as u32) / f64::from(looks.max(1));
    let map = obstacle_map(&run.finish()?.publisher().store());
    let is_block = |cell: Cell| {
        let [x, y] = world.centre_m(cell);
        BLOCKS.iter().any(|[aside_m, block_y, _]| {
            (CORNER_X_M + aside_m - x).abs().max((block_y - y).abs()) < 0.5 * BLOCK_M + cell_m
        })
    };
    let obstacles = map
        .iter()
        .filter(|(_, class)| **class == CellClass::Obstacle);
    drive.false_obstacles = obstacles
        .filter(|(cell, _)| !is_block(**cell) && world.is_drivable(**cell, &LEVEL))
        .count();
    Ok(drive)
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    outcome.parts.push(Part::text(include_str!("notes/e9.md")));
    let mut table = Table::new(&[
        "laser",
        "cells of the way known in time, %",
        "blocks found in time",
        "false obstacles",
        "all known 4 m ahead, % of the way",
    ]);
    let mut pictures = Vec::new();
    // The document's laser is fixed.
    let vehicles = match session.rules() {
        Rules::Own => &[
            ("fixed at 7.5°", "holos"),
            ("turned to what is unknown", "holos-tilt"),
        ][..],
        Rules::Document => &[("fixed at 7.5°", "holos")],
    };
    for (label, vehicle) in vehicles {
        let world = TerrainWorld::new(world(vehicle)?, None, session.rules(), &[])?;
        let drives =
            session.for_each_seed(&format!("E9: laser {label}"), |seed| drive(&world, seed))?;
        let known = Spread::over(&drives, |drive| {
            100.0 * drive.known as f64 / drive.way.max(1) as f64
        });
        let found = Spread::count(&drives, |drive| drive.found);
        let false_obstacles = Spread::count(&drives, |drive| drive.false_obstacles);
        let all = BLOCKS.len();
        let found_text = format!("{} of {all}", found.text(0, ""));
        table.push([
            (*label).to_owned(),
            known.text(1, ""),
            found_text.clone(),
            false_obstacles.text(0, ""),
            Spread::over(&drives, |drive| 100.0 * drive.far).text(1, ""),
        ]);
        let what = |what: &str| format!("laser {label}: {what}");
        if *vehicle == "holos" {
            outcome
                .checks
                .push(Check::shown(what("blocks found in time"), found_text));
        } else {
            outcome.checks.extend([
                Check::at_least(
                    what("cells of the way known in time"),
                    (known, 1, " %"),
                    KNOWN_MIN,
                ),
                Check::gate(
                    what("blocks found in time"),
                    found_text,
                    "all",
                    found.least >= all as f64,
                ),
                Check::gate(
                    what("false obstacles"),
                    false_obstacles.text(0, ""),
                    "0",
                    false_obstacles.most == 0.0,
                ),
            ]);
        }
        session.step("E9: pictures")?;
        let pipeline = world.run(SEED, 0.0)?.finish()?;
        pictures.push(Part::Pictures(terrain::maps_in(
            Scheme::GroundPlane6,
            &pipeline,
            &format!("e9-{vehicle}"),
            &format!("laser {label}"),
        )?));
    }
    outcome.parts.push(Part::Table(table));
    outcome.parts.extend(pictures);
    Ok(outcome)
}
