//! E4 [LOD §5.4]: straight on, with true encoders and with those of the document.

use std::collections::BTreeMap;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{Rules, SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, Cell, TerrainWorld, extent_m, faces, front_m, obstacle_map};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;
use nalgebra::{Point3, Vector3};
use protocol::layer::Scheme;
use simulation::World;

/// Shares by which encoders read too far [LOD §5.4]: not at all, 4.2 m as 4.4 m, 20 m as 21.4 m.
const ENCODER_ERRORS: [f64; 3] = [0.0, 0.048, 0.07];
/// With the greatest encoder error things are mapped so much too far ahead, metres.
const LATE_M: f64 = 2.5;

/// Columns that must be compared, so that none are is no agreement: 2 m of the way.
const COLUMNS_MIN: f64 = 10.0;

/// A way that is driven.
struct Track {
    world: TerrainWorld,
    /// What stands up on both sides, the left one first: solids with an inner face along x.
    sides: [&'static str; 2],
    sides_label: &'static str,
    /// Two things one behind the other.
    landmarks: [&'static str; 2],
    /// The map at the beginning is the one after so long, seconds.
    beginning_s: f64,
    label: &'static str,
    name: &'static str,
}

/// What one drive gave.
struct Drive {
    beginning: Distances,
    end: Distances,
    agreement: Agreement,
    /// Swept cells of which the map knows nothing.
    holes: usize,
    /// Where the vehicle takes itself to be in the end, metres along x.
    estimated_x_m: f64,
}

/// Distances in an obstacle map.
struct Distances {
    /// Between the sides, in cells, by column.
    sides: BTreeMap<i64, i64>,
    /// Between the fronts of the landmarks, metres.
    landmarks_m: Option<f64>,
}

const STREET: &str = include_str!("../../../robot-edge/simulation/worlds/street.toml");
/// Between the vehicle's lane and the left pavement, which is raised, the road rises by 4° from y = 0.87 m. The
/// document's lane rolled by −2° and the surface beside it lay "slightly above"; heights refer to the plane
/// that the vehicle stands on, so that only the angle between the two counts.
const SLOPING: [(&str, &str); 4] = [
    (
        "name = \"street\"\nvehicle",
        "name = \"sloping street\"\nvehicle",
    ),
    (
        "centre_m = [27.0, 1.57, -0.25]\nsize_m = [68.06, 5.0, 0.5]\n",
        "centre_m = [27.0, -0.03, -0.25]\nsize_m = [68.06, 1.8, 0.5]\n\n[[solids]]\nname = \"sloping surface\"\n\
         shape = \"box\"\ncentre_m = [27.0, 2.52344, -0.13499]\nsize_m = [68.06, 3.3, 0.5]\nroll_deg = 4.0\n",
    ),
    (
        "centre_m = [27.0, 5.45, -0.1]",
        "centre_m = [27.0, 5.45, 0.12]",
    ),
    (
        "centre_m = [19.6, 8.9, -0.1]",
        "centre_m = [19.6, 8.9, 0.12]",
    ),
];
/// From there to the pavement the surface slopes, metres along y.
const SLOPE_M: [f64; 2] = [0.87, 4.07];
const SLOPE_DEG: f64 = 4.0;
/// ε of the document's second experiment, and heights above the ground around each cell.
const DOCUMENT: &[&str] = &["mapping.ground.epsilon_deg=0.7"];
const LOCAL: &[&str] = &[
    "mapping.ground.epsilon_deg=0.7",
    "mapping.ground.reference=local",
];
/// False obstacles that must be there for their absence to mean anything: 1 m².
const FALSE_OBSTACLES_MIN: f64 = 25.0;
/// Per cent of the surface's cells that may be false obstacles where heights are above the ground around each:
/// where the beams meet the surface first no free cell is near.
const FALSE_OBSTACLES_MAX: f64 = 2.0;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    outcome.parts.push(Part::text(include_str!("notes/e4.md")));
    for track in [
        Track {
            world: TerrainWorld::load("hall", Some(21.0), session.rules())?,
            sides: ["left wall", "right wall"],
            sides_label: "the walls",
            landmarks: ["first pillar", "second pillar"],
            beginning_s: 5.0,
            label: "hall, 4.2 m",
            name: "hall",
        },
        Track {
            world: TerrainWorld::load("street", None, session.rules())?,
            sides: ["left pavement", "right pavement"],
            sides_label: "the kerbs",
            landmarks: ["car on the left", "van on the left"],
            // Kerbs are met where the beams meet the ground, 8 m ahead: 4 m of them by then.
            beginning_s: 20.0,
            label: "street, 20 m and 12 m more",
            name: "street",
        },
    ] {
        track.run(session, &mut outcome)?;
    }
    beside_a_slope(session, &mut outcome)?;
    Ok(outcome)
}

/// Along a street whose left half rises, with the document's ε: how much of it is an obstacle.
fn beside_a_slope(session: &Session<'_>, outcome: &mut Outcome) -> anyhow::Result<()> {
    outcome
        .parts
        .push(Part::text(include_str!("notes/e4_slope.md")));
    let street = World::parse("sloping street", &terrain::changed(STREET, &SLOPING)?)?;
    let (sin, cos) = libm::sincos(SLOPE_DEG.to_radians());
    let surface = GroundPlane {
        point_m: Point3::new(0.0, SLOPE_M[0], 0.0),
        normal: Vector3::new(0.0, -sin, cos),
    };
    // The document knows no other reference than the plane.
    let references = match session.rules() {
        Rules::Own => &[DOCUMENT, LOCAL][..],
        Rules::Document => &[DOCUMENT],
    };
    for &settings in references {
        let (label, name) = if settings == LOCAL {
            ("beside a slope, reference = \"local\"", "e4-slope-local")
        } else {
            ("beside a slope", "e4-slope")
        };
        let street = TerrainWorld::new(street.clone(), None, session.rules(), settings)?;
        let is_slope = |cell: &&Cell| {
            let [from_m, to_m] = [cell[1], cell[1] + 1].map(|row| row as f64 * street.cell_m());
            from_m >= SLOPE_M[0] && to_m <= SLOPE_M[1] && street.is_drivable(**cell, &surface)
        };
        // The last row of cells before the raised pavement's face holds its edge.
        let kerb = street.cell_at([0.0, SLOPE_M[1]])[1];
        let counts = session.for_each_seed(&format!("E4: {label}"), |seed| {
            let map = obstacle_map(&street.run(seed, 0.0)?.finish()?.publisher().store());
            let slope = map.iter().filter(|(cell, _)| is_slope(cell));
            let obstacles = slope
                .clone()
                .filter(|(_, class)| **class == CellClass::Obstacle);
            let kerbs = map.iter().filter(|(cell, _)| cell[1] == kerb);
            let shown = kerbs
                .clone()
                .filter(|(_, class)| **class == CellClass::Obstacle);
            let share = shown.count() as f64 / kerbs.count().max(1) as f64;
            Ok((slope.count(), obstacles.count(), 100.0 * share))
        })?;
        let obstacles = Spread::count(&counts, |(_, obstacles, _)| *obstacles);
        let share = Spread::over(&counts, |(known, obstacles, _)| {
            100.0 * *obstacles as f64 / (*known).max(1) as f64
        });
        outcome.checks.push(if settings == LOCAL {
            let what = format!("{label}: cells of it that are false obstacles");
            Check::at_most(what, (share, 1, " %"), FALSE_OBSTACLES_MAX)
        } else {
            let what = format!("{label}: false obstacles on it, as in the document");
            Check::at_least(what, (obstacles, 0, ""), FALSE_OBSTACLES_MIN)
        });
        let known = Spread::count(&counts, |(known, ..)| *known);
        let kerb = Spread::over(&counts, |(.., share)| *share);
        outcome.checks.extend([
            Check::shown(format!("{label}: known cells of it"), known.text(0, "")),
            Check::shown(
                format!("{label}: known cells of the kerb that are obstacles"),
                kerb.text(0, " %"),
            ),
        ]);
        session.step("E4: pictures beside a slope")?;
        let pipeline = street.run(SEED, 0.0)?.finish()?;
        let maps = terrain::maps_in(Scheme::GroundPlane6, &pipeline, name, label)?;
        outcome.parts.push(Part::Pictures(maps));
    }
    Ok(())
}

impl Track {
    fn run(&self, session: &Session<'_>, outcome: &mut Outcome) -> anyhow::Result<()> {
        session.step(&format!("E4: the truth of {}", self.label))?;
        let plane = self.world.plane_at(0.0);
        let sweep = Sweep::of(&self.world, &plane, |_| true)?;
        let truly_m = self.landmarks_truly_m()?;
        let mut table = Table::new(&[
            "encoders read too far by",
            "way at the end, m",
            "landmarks apart, truly, m",
            "in the map, m",
            "false obstacles",
            "agreement, %",
            "holes",
        ]);
        for error in ENCODER_ERRORS {
            let what = format!("E4: {}, encoders {:.1} % off", self.label, 100.0 * error);
            let drives =
                session.for_each_seed(&what, |seed| self.drive(seed, error, &plane, &sweep))?;
            table.rows.push(row(error, truly_m, &drives));
            if error == 0.0 {
                outcome.checks.extend(self.checks(&drives, truly_m, &sweep));
            }
        }
        outcome
            .parts
            .push(Part::text(format!("### {}", self.label)));
        outcome.parts.push(Part::Table(table));
        session.step(&format!("E4: pictures of {}", self.label))?;
        let name = |rest: &str| format!("e4-{}-{rest}", self.name);
        let world = terrain::world_from_above(&self.world, &plane, &name("world"))?;
        outcome.parts.push(Part::Pictures(world));
        let mut run = self.world.run(SEED, 0.0)?;
        run.advance_to(self.beginning_s)?;
        let beginning = terrain::maps(run.pipeline(), &name("beginning"), "at the beginning")?;
        outcome.parts.push(Part::Pictures(beginning));
        for error in ENCODER_ERRORS {
            let pipeline = self.world.run(SEED, error)?.finish()?;
            let percent = format!("{:.1}", 100.0 * error);
            let name = name(&format!("end-{}", percent.replace('.', "-")));
            let caption = format!("at the end, encoders {percent} % off");
            let pictures = terrain::maps(&pipeline, &name, &caption)?;
            outcome.parts.push(Part::Pictures(pictures));
        }
        Ok(())
    }

    fn drive(
        &self,
        seed: u64,
        error: f64,
        plane: &GroundPlane,
        sweep: &Sweep,
    ) -> anyhow::Result<Drive> {
        let mut run = self.world.run(seed, error)?;
        run.advance_to(self.beginning_s)?;
        let beginning = self.distances(&obstacle_map(&run.store()), plane)?;
        let pipeline = run.finish()?;
        let map = obstacle_map(&pipeline.publisher().store());
        let holes = sweep.cells().filter(|cell| !map.contains_key(cell));
        let holes: Vec<_> = holes.map(|cell| self.world.centre_m(cell)).collect();
        tracing::debug!(world = self.name, error, ?holes);
        Ok(Drive {
            beginning,
            end: self.distances(&map, plane)?,
            agreement: Agreement::of(&self.world, plane, &map, sweep),
            holes: holes.len(),
            estimated_x_m: pipeline.mapper().vehicle_in_odom().x,
        })
    }

    fn distances(
        &self,
        map: &BTreeMap<Cell, CellClass>,
        plane: &GroundPlane,
    ) -> anyhow::Result<Distances> {
        let world = &self.world;
        let [left, right] = self.sides;
        let left = faces(world, map, plane, extent_m(world.solid(left)?, 1)[0], 1);
        let right = faces(world, map, plane, extent_m(world.solid(right)?, 1)[1], -1);
        let sides = left.into_iter().filter_map(|(column, left)| {
            let right = right.get(&column)?;
            Some((column, left - right))
        });
        let [first, second] = self.landmarks;
        let [first, second] = [
            front_m(world, map, world.solid(first)?, LATE_M),
            front_m(world, map, world.solid(second)?, LATE_M),
        ];
        Ok(Distances {
            sides: sides.collect(),
            landmarks_m: second.zip(first).map(|(second, first)| second - first),
        })
    }

    fn landmarks_truly_m(&self) -> anyhow::Result<f64> {
        let [first, second] = self.landmarks;
        let first_m = extent_m(self.world.solid(first)?, 0)[0];
        Ok(extent_m(self.world.solid(second)?, 0)[0] - first_m)
    }

    /// What is asked of drives with true encoders.
    fn checks(&self, drives: &[Drive], truly_m: f64, sweep: &Sweep) -> Vec<Check> {
        let label = self.label;
        let cell_m = self.world.cell_m();
        let changes = Spread::over(drives, Drive::greatest_change);
        let columns = Spread::count(drives, Drive::columns);
        let holes = Spread::count(drives, |drive| drive.holes);
        let apart = Spread::over(drives, |drive| drive.end.landmarks_m.unwrap_or(f64::NAN));
        let is_near = |m: f64| (m - truly_m).abs() <= cell_m + 1e-9;
        let mut checks = vec![
            Check::gate(
                format!(
                    "{label}: greatest change of the distance between {}",
                    self.sides_label
                ),
                changes.text(0, " cells"),
                "≤ 1 cell",
                changes.most <= 1.0,
            ),
            Check::at_least(
                format!("{label}: columns where it is known at the beginning and at the end"),
                (columns, 0, ""),
                COLUMNS_MIN,
            ),
            Check::gate(
                format!("{label}: {} to {}", self.landmarks[0], self.landmarks[1]),
                apart.text(2, " m"),
                format!("{truly_m:.2} m ± {cell_m} m"),
                is_near(apart.least) && is_near(apart.most),
            ),
            Check::gate(
                format!("{label}: holes among the swept cells"),
                format!("{} of {}", holes.text(0, ""), sweep.cells().count()),
                "0",
                holes.most == 0.0,
            ),
        ];
        let agreements = drives.iter().map(|drive| &drive.agreement);
        checks.extend(agreement::checks(label, agreements));
        checks
    }
}

impl Drive {
    /// By how many cells the distance between the sides changed most, in any column.
    fn greatest_change(&self) -> f64 {
        let both = self.beginning.sides.iter().filter_map(|(column, before)| {
            let after = self.end.sides.get(column)?;
            Some((after - before).abs() as f64)
        });
        both.fold(0.0, f64::max)
    }

    fn columns(&self) -> usize {
        let known = |column: &&i64| self.end.sides.contains_key(*column);
        self.beginning.sides.keys().filter(known).count()
    }
}

fn row(error: f64, truly_m: f64, drives: &[Drive]) -> Vec<String> {
    let text = |decimals: usize, figure: &dyn Fn(&Drive) -> f64| {
        Spread::over(drives, figure).text(decimals, "")
    };
    vec![
        format!("{:.1} %", 100.0 * error),
        text(2, &|drive| drive.estimated_x_m),
        format!("{truly_m:.2}"),
        text(2, &|drive| drive.end.landmarks_m.unwrap_or(f64::NAN)),
        text(0, &|drive| drive.agreement.false_obstacles.len() as f64),
        text(2, &|drive| 100.0 * drive.agreement.share()),
        text(0, &|drive| drive.holes as f64),
    ]
}
