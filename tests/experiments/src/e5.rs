//! E5 [LOD §5.5]: attitudes on objects, with and without compensation.

use std::collections::BTreeMap;

use protocol::layer::{LayerId, Scheme};

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::{Picture, elevation_in, obstacle, store_of};
use super::session::{SEED, Session};
use super::terrain::agreement::{self, Agreement};
use super::terrain::sweep::Sweep;
use super::terrain::{self, Cell, TerrainWorld, obstacle_map, seconds};
use edge::publishing::cells_to_tiles::CellCoder;
use mapping::elevation::CellClass;
use mapping::elevation::ElevationMap;
use mapping::ground_plane::GroundConfig;
use mapping::terrain::Terrain;
use measurement::pose;
use simulation::Motion;

/// An attitude that the vehicle takes on an object, degrees.
struct Attitude {
    pitch_deg: f64,
    roll_deg: f64,
    name: &'static str,
    label: &'static str,
}

const ATTITUDES: [Attitude; 3] = [
    Attitude {
        pitch_deg: -4.5,
        roll_deg: 0.0,
        name: "nose-up",
        label: "pitch −4.5°",
    },
    Attitude {
        pitch_deg: 2.5,
        roll_deg: 0.0,
        name: "nose-down",
        label: "pitch +2.5°",
    },
    Attitude {
        pitch_deg: 0.0,
        roll_deg: -5.2,
        name: "right-up",
        label: "roll −5.2°",
    },
];
/// How near the true attitude must be to that of the document, degrees …
const NEAR_DEG: f64 = 0.3;
/// … and for how long before and after the scan, seconds: it stands on the object and does not climb it.
const STEADY_S: f64 = 0.2;
/// Scans of each attitude, at least.
const SCANS_MIN: f64 = 10.0;
/// Wrong cells without compensation that are many: 0.4 m².
const WRONG_MIN: f64 = 10.0;

/// Maps made of the scans of one attitude alone.
struct OnObject {
    scans: usize,
    with: ElevationMap,
    without: ElevationMap,
}

/// What is wrong with them.
struct Wrong {
    scans: usize,
    with: Agreement,
    without: Agreement,
}

/// One drive.
struct Drive {
    wrong: Vec<Wrong>,
    events: usize,
    whole: Agreement,
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let bumps = TerrainWorld::load("bumps", None, session.rules())?;
    let plane = bumps.plane_at(0.0);
    let sweep = Sweep::of(&bumps, &plane, |_| true)?;
    let motion = Motion::new(&bumps.world);
    let on_objects: Result<Vec<Sweep>, _> = ATTITUDES
        .iter()
        .map(|attitude| Sweep::of(&bumps, &plane, |at_s| attitude.is_taken(&motion, at_s)))
        .collect();
    let on_objects = on_objects?;
    let drives = session.for_each_seed("E5: bumps", |seed| {
        let (maps, map, events) = drive(&bumps, seed)?;
        let evaluate =
            |map: &ElevationMap, sweep| Agreement::of(&bumps, &plane, &classes(map), sweep);
        let wrong = maps.iter().zip(&on_objects).map(|(maps, sweep)| Wrong {
            scans: maps.scans,
            with: evaluate(&maps.with, sweep),
            without: evaluate(&maps.without, sweep),
        });
        Ok(Drive {
            wrong: wrong.collect(),
            events,
            whole: Agreement::of(&bumps, &plane, &map, &sweep),
        })
    })?;
    session.step("E5: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/e5.md")),
        Part::Table(table(&drives)),
        Part::Pictures(terrain::world_from_above(&bumps, &plane, "e5-world")?),
    ];
    let (maps, ..) = drive(&bumps, SEED)?;
    for (attitude, on_object) in ATTITUDES.iter().zip(&maps) {
        for (map, name, label) in [
            (&on_object.with, "with", "with compensation"),
            (&on_object.without, "without", "without compensation"),
        ] {
            let name = format!("e5-{}-{name}", attitude.name);
            let caption = format!("{}, {label}", attitude.label);
            parts.push(Part::Pictures(pictures(map, &name, &caption)?));
        }
    }
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

/// The maps of each attitude, the finished map, and how often the ground plane was reset.
type Driven = (Vec<OnObject>, BTreeMap<Cell, CellClass>, usize);

/// Drives over the objects.
fn drive(bumps: &TerrainWorld, seed: u64) -> anyhow::Result<Driven> {
    let motion = Motion::new(&bumps.world);
    let mapping = &bumps.config.mapping;
    let fresh = |compensation| {
        let ground = GroundConfig {
            compensation,
            ..mapping.ground.clone()
        };
        ElevationMap::new(&mapping.elevation, &mapping.obstacle, &ground)
    };
    let mut maps = ATTITUDES.map(|_| OnObject {
        scans: 0,
        with: fresh(true),
        without: fresh(false),
    });
    let mut run = bumps.run(seed, 0.0)?;
    run.advance_with(bumps.duration_s(), |pipeline, scan| {
        let at_s = seconds(scan.stamp);
        let on = ATTITUDES.iter().zip(&mut maps);
        let plane = pipeline.mapper().terrain().and_then(Terrain::ground_plane);
        for (_, maps) in on.filter(|(attitude, _)| attitude.is_taken(&motion, at_s)) {
            if let Some(plane) = plane {
                maps.scans += 1;
                maps.with.integrate(scan, &plane);
                maps.without.integrate(scan, &plane);
            }
        }
    })?;
    let mut pipeline = run.finish()?;
    let events = pipeline.take_map_events().len();
    let map = obstacle_map(&pipeline.publisher().store());
    Ok((maps.into(), map, events))
}

impl Attitude {
    /// Whether the vehicle truly has it at a time, and for a while before and after.
    fn is_taken(&self, motion: &Motion, at_s: f64) -> bool {
        [-STEADY_S, 0.0, STEADY_S].into_iter().all(|away_s| {
            let pose = motion.world_from_base(at_s + away_s);
            let near = |rad: f64, deg: f64| (rad.to_degrees() - deg).abs() <= NEAR_DEG;
            near(pose::pitch_rad(&pose), self.pitch_deg)
                && near(pose.rotation.euler_angles().0, self.roll_deg)
        })
    }
}

fn classes(map: &ElevationMap) -> BTreeMap<Cell, CellClass> {
    map.grid()
        .iter()
        .filter(|(_, cell)| cell.is_known())
        .map(|(index, cell)| ([index.x.into(), index.y.into()], cell.class()))
        .collect()
}

fn pictures(map: &ElevationMap, name: &str, caption: &str) -> anyhow::Result<Vec<Picture>> {
    let known = || {
        let cells = map.grid().iter().filter(|(_, cell)| cell.is_known());
        cells.map(|(index, cell)| ([i64::from(index.x), i64::from(index.y)], cell))
    };
    let heights = known().map(|(index, cell)| (index, CellCoder::elevation(cell)));
    let cell_m = map.size().shorter_m();
    let heights = store_of(LayerId::Elevation, cell_m, heights)?;
    let classes = known().map(|(index, cell)| (index, CellCoder::obstacle(cell.class())));
    let classes = store_of(LayerId::Obstacle, cell_m, classes)?;
    let mut pictures = Vec::new();
    for (store, palette) in [
        (heights, elevation_in(Scheme::GroundPlane)),
        (classes, obstacle()),
    ] {
        let name = format!("{name}-{}", palette.layer());
        pictures.extend(Picture::of_layer(&store, palette, None, &name, caption)?);
    }
    Ok(pictures)
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let mut checks = Vec::new();
    for (place, attitude) in ATTITUDES.iter().enumerate() {
        let label = attitude.label;
        let count = |figure: &dyn Fn(&Wrong) -> usize| {
            Spread::count(&of_attitude(drives, place), |wrong| figure(wrong))
        };
        let without =
            count(&|wrong| wrong.without.false_obstacles.len() + wrong.without.false_free.len());
        checks.extend([
            Check::zero(
                format!("{label}: false obstacles with compensation"),
                count(&|wrong| wrong.with.false_obstacles.len()),
            ),
            Check::at_least(
                format!("{label}: wrong cells without"),
                (without, 0, ""),
                WRONG_MIN,
            ),
            Check::at_least(
                format!("{label}: scans"),
                (count(&|wrong| wrong.scans), 0, ""),
                SCANS_MIN,
            ),
        ]);
    }
    checks.push(Check::zero(
        "changes of the ground plane",
        Spread::count(drives, |drive| drive.events),
    ));
    let whole = drives.iter().map(|drive| &drive.whole);
    checks.extend(agreement::checks("the whole drive", whole));
    checks
}

/// What is wrong with the maps of one attitude, with every seed.
fn of_attitude(drives: &[Drive], place: usize) -> Vec<&Wrong> {
    drives
        .iter()
        .filter_map(|drive| drive.wrong.get(place))
        .collect()
}

fn table(drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        "attitude",
        "compensation",
        "scans",
        "cells compared",
        "false obstacles",
        "obstacles that are free",
    ]);
    for (place, attitude) in ATTITUDES.iter().enumerate() {
        let of_attitude = of_attitude(drives, place);
        let mut row = |label: &str, agreement: fn(&Wrong) -> &Agreement| {
            let text = |figure: &dyn Fn(&Agreement) -> usize| {
                Spread::count(&of_attitude, |wrong| figure(agreement(wrong))).text(0, "")
            };
            table.push([
                attitude.label.to_owned(),
                label.to_owned(),
                Spread::count(&of_attitude, |wrong| wrong.scans).text(0, ""),
                text(&|agreement| agreement.compared as usize),
                text(&|agreement| agreement.false_obstacles.len()),
                text(&|agreement| agreement.false_free.len()),
            ]);
        };
        row("with", |wrong| &wrong.with);
        row("without", |wrong| &wrong.without);
    }
    table
}
