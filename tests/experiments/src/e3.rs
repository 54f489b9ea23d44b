//! E3 [LOD §5.3]: the ground plane changes its orientation down a ramp, and not on bumps.

use std::collections::BTreeMap;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, Cell, TerrainWorld, obstacle_map, seconds};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;
use simulation::{Motion, World};

/// Where the ramp begins, metres along x.
const RAMP_M: f64 = 7.12;
/// Share of the swept ramp that must be free after the change.
const FREE_MIN: f64 = 0.95;
/// False obstacles that must have been there for their vanishing to mean anything: 1 m².
const FALSE_OBSTACLES_MIN: f64 = 25.0;

/// One drive.
struct Drive {
    /// When the ground plane was reset, seconds.
    changes_s: Vec<f64>,
    /// Where the vehicle was then, metres along x.
    changes_m: Vec<f64>,
    /// The map just before the first change.
    before: BTreeMap<Cell, CellClass>,
    /// Cells of the ramp that are obstacles although the vehicle can drive there, just before.
    false_before: usize,
    /// The finished map.
    map: BTreeMap<Cell, CellClass>,
}

const RAMP: &str = include_str!("../../../robot-edge/simulation/worlds/ramp.toml");
/// The document's ramp, on which its robot pitched by +1°: through the same edge, and as long.
const GENTLE: [(&str, &str); 4] = [
    (
        "centre_m = [20.0644, 0.0, -1.10565]",
        "centre_m = [20.10453, 0.0, -0.42668]",
    ),
    ("pitch_deg = 4.0", "pitch_deg = 1.0"),
    ("point_m = [0.0, 0.0, -1.68]", "point_m = [0.0, 0.0, -0.42]"),
    ("name = \"ramp\"\nvehicle", "name = \"ramp of 1°\"\nvehicle"),
];

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    outcome.parts.push(Part::text(include_str!("notes/e3.md")));
    let gentle = World::parse("ramp of 1°", &terrain::changed(RAMP, &GENTLE)?)?;
    for scene in [
        Scene {
            ramp: TerrainWorld::load("ramp", None, session.rules())?,
            label: "",
            name: "e3",
        },
        // ε 0.5 and η 0.1 are the document's in every preset.
        Scene {
            ramp: TerrainWorld::new(gentle, None, session.rules(), &[])?,
            label: "ramp of 1°: ",
            name: "e3-gentle",
        },
    ] {
        scene.run(session, &mut outcome)?;
    }
    Ok(outcome)
}

/// A ramp that is driven down.
struct Scene {
    ramp: TerrainWorld,
    /// Before each label.
    label: &'static str,
    name: &'static str,
}

impl Scene {
    fn run(&self, session: &Session<'_>, outcome: &mut Outcome) -> anyhow::Result<()> {
        let Self { ramp, label, .. } = self;
        let drives =
            session.for_each_seed(&format!("E3: {label}ramp"), |seed| drive(ramp, seed))?;
        session.step("E3: what was swept")?;
        let first = drives.iter().filter_map(|drive| drive.changes_s.first());
        let last = drives.iter().filter_map(|drive| drive.changes_s.last());
        let earliest_s = first.copied().fold(ramp.duration_s(), f64::min);
        let latest_s = last.copied().fold(0.0, f64::max);
        let old = ramp.plane_at(0.0);
        let new = ramp.plane_at(latest_s + SETTLED_S);
        let sweep = Sweep::of(ramp, &new, |at_s| at_s >= latest_s)?;
        let sweep_before = Sweep::of(ramp, &old, |at_s| at_s < earliest_s - UNPUBLISHED_S)?;
        let mut checks = checks(ramp, &drives, &sweep, &new);
        let before: Vec<_> = drives
            .iter()
            .map(|drive| Agreement::of(ramp, &old, &drive.before, &sweep_before))
            .collect();
        // Not asked for: it is the map that the change throws away, made while the front wheels leave the plane.
        let before = agreement::checks("before the change", before.iter());
        checks.extend(before.into_iter().map(Check::without_gate));
        let after: Vec<_> = drives
            .iter()
            .map(|drive| Agreement::of(ramp, &new, &drive.map, &sweep))
            .collect();
        checks.extend(agreement::checks("at the end", after.iter()));
        for check in &mut checks {
            check.what.insert_str(0, label);
        }
        outcome.checks.extend(checks);

        let parts = &mut outcome.parts;
        parts.push(Part::text(format!(
            "Changes of the ground plane, {label}seed {SEED}:"
        )));
        parts.push(Part::Table(changes(&drives)));
        let name = |rest: &str| format!("{}-{rest}", self.name);
        let world = terrain::world_from_above(ramp, &old, &name("world"))?;
        parts.push(Part::Pictures(world));
        session.step("E3: pictures")?;
        let mut run = ramp.run(SEED, 0.0)?;
        if let Some(first_s) = drives.first().and_then(|drive| drive.changes_s.first()) {
            run.advance_to(first_s - BEFORE_S)?;
            let caption = format!("{label}before the change");
            let before = terrain::maps(run.pipeline(), &name("before"), &caption)?;
            parts.push(Part::Pictures(before));
        }
        let pipeline = run.finish()?;
        let caption = format!("{label}at the end");
        let after = terrain::maps(&pipeline, &name("after"), &caption)?;
        parts.push(Part::Pictures(after));
        Ok(())
    }
}

/// After the change the vehicle stands on the ramp, seconds.
const SETTLED_S: f64 = 5.0;
/// What is shown as before the change was a little before, seconds.
const BEFORE_S: f64 = 0.3;

fn drive(ramp: &TerrainWorld, seed: u64) -> anyhow::Result<Drive> {
    let motion = Motion::new(&ramp.world);
    let mut run = ramp.run(seed, 0.0)?;
    let mut changes_s = Vec::new();
    let mut before = obstacle_map(&run.store());
    let steps = libm::ceil(ramp.duration_s() / STEP_S) as u32;
    for until_s in (1..=steps).map(|step| f64::from(step) * STEP_S) {
        run.advance_to(until_s)?;
        let events = run.take_map_events();
        changes_s.extend(events.iter().map(|event| seconds(event.stamp)));
        if changes_s.is_empty() {
            before = obstacle_map(&run.store());
        }
    }
    let mut pipeline = run.finish()?;
    let events = pipeline.take_map_events();
    changes_s.extend(events.iter().map(|event| seconds(event.stamp)));
    let obstacles = before
        .iter()
        .filter(|(_, class)| **class == CellClass::Obstacle);
    let on_ramp = ramp.plane_at(ramp.duration_s());
    let false_before = obstacles.filter(|(cell, _)| is_ramp(ramp, **cell, &on_ramp));
    let false_before = false_before.count();
    Ok(Drive {
        changes_m: changes_s
            .iter()
            .map(|&at_s| motion.world_from_base(at_s).translation.x)
            .collect(),
        false_before,
        before,
        map: obstacle_map(&pipeline.publisher().store()),
        changes_s,
    })
}

/// The published map before the change may lack what was seen so short before it, seconds.
const UNPUBLISHED_S: f64 = 0.6;
/// Time between two looks at the maps, seconds.
const STEP_S: f64 = 0.2;

/// Whether a cell is ramp that the vehicle can drive on.
fn is_ramp(ramp: &TerrainWorld, cell: Cell, on_ramp: &GroundPlane) -> bool {
    let begins_m = cell[0] as f64 * ramp.cell_m();
    begins_m > RAMP_M && ramp.is_drivable(cell, on_ramp)
}

fn checks(
    ramp: &TerrainWorld,
    drives: &[Drive],
    sweep: &Sweep,
    on_ramp: &GroundPlane,
) -> Vec<Check> {
    let swept: Vec<Cell> = sweep
        .cells()
        .filter(|&cell| is_ramp(ramp, cell, on_ramp))
        .collect();
    let free = Spread::over(drives, |drive| {
        let is_free = |cell: &&Cell| drive.map.get(*cell) == Some(&CellClass::Free);
        100.0 * swept.iter().filter(is_free).count() as f64 / swept.len().max(1) as f64
    });
    let false_before = Spread::count(drives, |drive| drive.false_before);
    let count = Spread::count(drives, |drive| drive.changes_s.len());
    let places = Spread::of(drives.iter().flat_map(|drive| &drive.changes_m).copied());
    // From here on the front wheels are on the ramp, whatever the rear wheels do.
    let front_axle_m = 0.5 * ramp.config.vehicle.wheelbase_m();
    let too_early = drives.iter().flat_map(|drive| &drive.changes_m);
    let too_early = too_early.filter(|place| **place < RAMP_M - front_axle_m);
    let too_early = too_early.count();
    vec![
        Check::gate(
            "swept cells of the ramp that are Free in the end",
            format!("{} of {}", free.text(1, " %"), swept.len()),
            format!("≥ {:.0} %", 100.0 * FREE_MIN),
            free.least >= 100.0 * FREE_MIN && !swept.is_empty(),
        ),
        Check::gate(
            "false obstacles on the ramp just before the change",
            false_before.text(0, " cells"),
            format!("≥ {FALSE_OBSTACLES_MIN}"),
            false_before.least >= FALSE_OBSTACLES_MIN,
        ),
        Check::gate(
            "changes of the ground plane, at the bumps or before the ramp",
            too_early.to_string(),
            "0",
            too_early == 0,
        ),
        Check::gate(
            "changes of the ground plane",
            count.text(0, ""),
            "1",
            drives.iter().all(|drive| drive.changes_s.len() == 1),
        ),
        Check::gate(
            "where: the vehicle's middle, the ramp begins at 7.12 m",
            places.text(2, " m"),
            format!("≥ {:.2} m: all wheels on the ramp", RAMP_M + front_axle_m),
            places.least >= RAMP_M + front_axle_m,
        ),
    ]
}

/// Each change of seed 1.
fn changes(drives: &[Drive]) -> Table {
    let mut table = Table::new(&["ground plane reset after, s", "at x, m"]);
    for drive in drives.iter().take(1) {
        for (at_s, at_m) in drive.changes_s.iter().zip(&drive.changes_m) {
            table.push([format!("{at_s:.1}"), format!("{at_m:.2}")]);
        }
    }
    table
}
