//! E8 [LOD §6.2]: grass before a laser that is tilted down.

use nalgebra::{Point3, Vector3};
use protocol::layer::Scheme;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{Rules, SEED, Session};
use super::terrain::{self, Cell, TerrainWorld, around, obstacle_map};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;
use simulation::World;

/// Per cent of the grass's known cells that may be obstacles where grass is recognised, and that must be where it is not.
const OBSTACLES_MAX: f64 = 20.0;
const OBSTACLES_MIN: f64 = 50.0;

/// Patches of grass: where they begin along x, and least and greatest height, metres.
const PATCHES: [(f64, [f64; 2]); 3] = [
    (6.0, [0.10, 0.20]),
    (12.0, [0.20, 0.30]),
    (18.0, [0.30, 0.45]),
];
/// Size along x, and half the size along y, metres.
const PATCH_M: [f64; 2] = [4.0, 4.0];
const STEMS_PER_M2: f64 = 200.0;
/// What stands in each patch: how far in, y, and width, metres. The first is a block, the others are posts.
const THINGS: [(f64, f64, f64); 3] = [(2.0, 1.73, 0.3), (2.0, -1.77, 0.1), (3.0, 2.73, 0.05)];
const THING_HEIGHT_M: f64 = 0.6;
const LEVEL: GroundPlane = GroundPlane {
    point_m: Point3::new(0.0, 0.0, 0.0),
    normal: Vector3::new(0.0, 0.0, 1.0),
};

/// How grass is recognised.
const METHODS: [(&str, &[&str]); 2] = [
    ("all above the ground are obstacles", &[]),
    (
        "`least_width_m = 0.04`",
        &["mapping.obstacle.least_width_m=0.04"],
    ),
];

/// What one drive gave of each patch, and of things by their place in `THINGS`.
struct Drive {
    known: [usize; 3],
    obstacles: [usize; 3],
    found: [usize; 3],
}

fn world() -> anyhow::Result<World> {
    let head = "name = \"grass\"\nvehicle = \"holos\"\n[noise]\nrange_m = 0.01\ndropout = 0.005\n[start]\n\
                    x_m = 0.0\ny_m = 0.0\nyaw_deg = 0.0\n[path]\nspeed_mps = 0.4\nturn_rate_degps = 30.0\n\
                    waypoints = [{ x_m = 18.0, y_m = 0.0 }]\n\
                    [wind]\ntowards_deg = 40.0\nlean = 0.05\nsway = 0.1\nperiod_s = 1.5\n\
                    [[solids]]\nname = \"ground\"\nshape = \"plane\"\n";
    let mut tables = vec![head.to_owned()];
    let [length_m, half_m] = PATCH_M;
    for (number, (x, [least, most])) in PATCHES.into_iter().enumerate() {
        tables.push(format!(
            "[[plants]]\nkind = \"stems\"\nname = \"grass {number}\"\nseed = {number}\nrigidity = \"flexible\"\n\
             density_per_m2 = {STEMS_PER_M2}\nrectangle_m = [[{x}, {}], [{}, {half_m}]]\n\
             height_m = [{least}, {most}]\nthickness_mm = [3.0, 6.0]\nlean_deg = 20.0\n",
            -half_m,
            x + length_m
        ));
        for (in_m, y, width_m) in THINGS {
            let (x, radius_m) = (x + in_m, 0.5 * width_m);
            tables.push(if width_m > 0.2 {
                format!(
                    "[[solids]]\nshape = \"box\"\ncentre_m = [{x}, {y}, {}]\nsize_m = [{width_m}, {width_m}, {THING_HEIGHT_M}]\n",
                    0.5 * THING_HEIGHT_M
                )
            } else {
                format!(
                    "[[solids]]\nshape = \"cylinder\"\nbase_m = [{x}, {y}, 0.0]\nradius_m = {radius_m}\nheight_m = {THING_HEIGHT_M}\n"
                )
            });
        }
    }
    Ok(World::parse("grass", &tables.concat())?)
}

/// The patch whose grass alone is in a cell.
fn patch_of(world: &TerrainWorld, cell: Cell) -> Option<usize> {
    let [x, y] = world.centre_m(cell);
    let half_cell_m = 0.5 * world.cell_m();
    let number = PATCHES.into_iter().position(|(from_m, _)| {
        (from_m + half_cell_m..from_m + PATCH_M[0] - half_cell_m).contains(&x)
            && y.abs() < PATCH_M[1] - half_cell_m
    })?;
    let near = |(in_m, thing_y, width_m): (f64, f64, f64)| {
        let near_m = 0.5 * width_m + 2.0 * world.cell_m();
        (PATCHES[number].0 + in_m - x).abs() < near_m && (thing_y - y).abs() < near_m
    };
    (!THINGS.into_iter().any(near) && world.is_drivable(cell, &LEVEL)).then_some(number)
}

fn drive(world: &TerrainWorld, seed: u64) -> anyhow::Result<Drive> {
    let map = obstacle_map(&world.run(seed, 0.0)?.finish()?.publisher().store());
    let is_obstacle = |cell: Cell| map.get(&cell) == Some(&CellClass::Obstacle);
    let (mut known, mut obstacles, mut found) = ([0; 3], [0; 3], [0; 3]);
    for &cell in map.keys() {
        if let Some(patch) = patch_of(world, cell) {
            known[patch] += 1;
            obstacles[patch] += usize::from(is_obstacle(cell));
        }
    }
    for (from_m, _) in PATCHES {
        for (found, (in_m, y, _)) in found.iter_mut().zip(THINGS) {
            let at = world.cell_at([from_m + in_m, y]);
            *found += usize::from(around(at).any(is_obstacle));
        }
    }
    Ok(Drive {
        known,
        obstacles,
        found,
    })
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    let mut table = Table::new(&[
        "method",
        "grass, cm",
        "known cells",
        "obstacles among them, %",
    ]);
    let mut things = Table::new(&[
        "method",
        "blocks of 30 cm found",
        "posts of 10 cm",
        "posts of 5 cm",
    ]);
    let mut pictures = Vec::new();
    // The document has no method for grass.
    let methods = match session.rules() {
        Rules::Own => &METHODS[..],
        Rules::Document => &METHODS[..1],
    };
    for (number, (method, settings)) in methods.iter().enumerate() {
        let world = TerrainWorld::new(world()?, None, session.rules(), settings)?;
        let drives = session.for_each_seed(&format!("E8: {method}"), |seed| drive(&world, seed))?;
        let recognises_grass = number > 0;
        for (patch, (_, height_m)) in PATCHES.into_iter().enumerate() {
            let share = Spread::over(&drives, |drive| {
                100.0 * drive.obstacles[patch] as f64 / drive.known[patch].max(1) as f64
            });
            let [least, most] = height_m.map(|m| format!("{:.0}", 100.0 * m));
            let height = format!("{least} … {most}");
            table.push([
                (*method).to_owned(),
                height.clone(),
                Spread::count(&drives, |drive| drive.known[patch]).text(0, ""),
                share.text(1, ""),
            ]);
            let what = format!("grass of {height} cm that is an obstacle, {method}");
            outcome.checks.push(match (recognises_grass, patch) {
                (true, _) => Check::at_most(what, (share, 1, " %"), OBSTACLES_MAX),
                (false, 0) => Check::shown(what, share.text(1, " %")),
                (false, _) => Check::at_least(what, (share, 1, " %"), OBSTACLES_MIN),
            });
        }
        let found = [0, 1, 2].map(|thing| Spread::count(&drives, |drive| drive.found[thing]));
        let [blocks, ..] = &found;
        let all = PATCHES.len();
        outcome.checks.push(Check::gate(
            format!("blocks of 30 cm in grass that are found, {method}"),
            format!("{} of {all}", blocks.text(0, "")),
            "all",
            blocks.least >= all as f64,
        ));
        let found = found.map(|found| format!("{} of {all}", found.text(0, "")));
        things.push(std::iter::once((*method).to_owned()).chain(found));
        session.step("E8: pictures")?;
        let pipeline = world.run(SEED, 0.0)?.finish()?;
        pictures.push(Part::Pictures(terrain::maps_in(
            Scheme::GroundPlane6,
            &pipeline,
            &format!("e8-{number}"),
            method,
        )?));
    }
    outcome.parts = vec![
        Part::text(include_str!("notes/e8.md")),
        Part::Table(table),
        Part::Table(things),
    ];
    outcome.parts.extend(pictures);
    Ok(outcome)
}
