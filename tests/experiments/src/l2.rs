//! L2 \[LRF\]: a reflective surface gives false readings, and their errors vanish with further observations.
//!
//! A mirror shows the room in front of it a second time behind it. Two errors come of that: *ghosts*, cells
//! that are occupied where the truth asks for free, and *holes* in the mirror, cells that are free where it
//! asks for occupied because mirrored beams seem to pass. Ghosts are counted in the whole map, wherever
//! they are. What of both is not the mirror's doing shows in the same run, with the same noise, past a
//! mirror that scatters light.

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::rooms::{self, Expected, Truth};
use super::session::{Rules, SEED, Session};
use crate::truth::outline::Outline;
use nalgebra::Point2;
use protocol::export::Trinary;
use protocol::tile_store::TileStore;
use simulation::World;

/// Ghosts that must have been there for their vanishing to mean anything: 2 m of walls.
const GHOSTS_MIN: f64 = 20.0;
/// Holes in the mirror that may be left beyond those of a mirror that scatters light: 5 % of its 39 cells.
const HOLES_LEFT_MAX: f64 = 2.0;
/// Share of the run after which the vehicle has seen through the ghosts.
const GHOSTS_UNTIL: f64 = 0.25;
/// Times of the table, seconds.
const TIMES_S: [f64; 10] = [5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 60.0, 90.0, 95.0, 100.0];

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let truth = rooms::truth_of(&rooms::rooms()?)?;
    let rules = session.rules();
    let drives =
        session.for_each_seed("L2: three drives", |seed| Drives::of(&truth, rules, seed))?;
    let mut parts = vec![
        Part::text(include_str!("notes/l2.md")),
        Part::text(format!("Seed {SEED}:")),
    ];
    parts.extend(drives.first().map(|first| Part::Table(course_table(first))));
    parts.push(Part::text(format!("Over {}:", session.seeds_text())));
    parts.push(Part::Table(over_seeds(&drives)));
    parts.push(Part::text(include_str!("notes/l2_holes.md")));
    session.step("L2: pictures")?;
    parts.push(Part::Pictures(pictures(&truth, rules)?));
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

type Count = fn(&Drives) -> u64;

fn checks(drives: &[Drives]) -> Vec<Check> {
    let over = |figure: Count| Spread::over(drives, |drives| figure(drives) as f64);
    let end_s = drives.first().map_or(0.0, |drives| drives.mirror.end_s());
    let latest = Spread::over(drives, |drives| drives.mirror.most_ghosts().0);
    let most = over(|d| d.mirror.most_ghosts().1);
    let one_room = over(|d| d.one_room.end().ghosts);
    let holes_left = over(|d| {
        let scattering = d.scattering.end().holes;
        d.mirror.end().holes.saturating_sub(scattering)
    });
    vec![
        Check::zero("ghosts at the end", over(|d| d.mirror.end().ghosts)),
        Check::at_least("most ghosts on the way", (most, 0, ""), GHOSTS_MIN),
        Check::gate(
            "most ghosts after",
            latest.text(0, " s"),
            format!("< {:.0} s", GHOSTS_UNTIL * end_s),
            latest.most < GHOSTS_UNTIL * end_s,
        ),
        Check::zero(
            "ghosts before the mirror is in sight",
            over(|d| d.mirror.at(5.0).ghosts),
        ),
        Check::at_most(
            "holes in the mirror at the end beyond those of one that scatters",
            (holes_left, 0, ""),
            HOLES_LEFT_MAX,
        ),
        Check::zero(
            "most ghosts, mirror that scatters",
            over(|d| d.scattering.most_ghosts().1),
        ),
        Check::at_least(
            "ghosts at the end where it saw one room only",
            (one_room, 0, ""),
            GHOSTS_MIN,
        ),
    ]
}

fn course_table(drives: &Drives) -> Table {
    let mut table = Table::new(&[
        "after, s",
        "ghosts",
        "holes in the mirror",
        "holes, scattering mirror",
        "ghosts, one room only",
    ]);
    let times = TIMES_S.into_iter().chain([drives.mirror.end_s()]);
    for at_s in times {
        let [mirror, scattering, one_room] = [&drives.mirror, &drives.scattering, &drives.one_room]
            .map(|course: &Course| course.at(at_s));
        table.push([
            format!("{at_s:.0}"),
            mirror.ghosts.to_string(),
            mirror.holes.to_string(),
            scattering.holes.to_string(),
            one_room.ghosts.to_string(),
        ]);
    }
    table
}

fn over_seeds(drives: &[Drives]) -> Table {
    let rows: [(&str, Count); 8] = [
        ("most ghosts", |d| d.mirror.most_ghosts().1),
        ("ghosts at the end", |d| d.mirror.end().ghosts),
        ("ghosts at the end, one room only", |d| {
            d.one_room.end().ghosts
        }),
        ("most ghosts, scattering mirror", |d| {
            d.scattering.most_ghosts().1
        }),
        ("most holes in the mirror", |d| d.mirror.most_holes()),
        ("most holes, scattering mirror", |d| {
            d.scattering.most_holes()
        }),
        ("holes at the end", |d| d.mirror.end().holes),
        ("holes at the end, scattering mirror", |d| {
            d.scattering.end().holes
        }),
    ];
    Table::of_spreads(rows.map(|(name, figure)| {
        (
            name,
            0,
            Spread::over(drives, |drives| figure(drives) as f64),
        )
    }))
}

fn pictures(truth: &Truth, rules: Rules) -> anyhow::Result<Vec<Picture>> {
    let picture =
        |store: &_, name: &str, caption: &str| rooms::error_map(truth, store, name, caption);
    let mut run = rooms::run(&rooms::rooms()?, rules, SEED, &[])?;
    // The vehicle is about to leave the room with the mirror.
    run.advance_to(20.0)?;
    let before = picture(
        &run.store(),
        "l2-before",
        "after 20 s, before it leaves the room",
    );
    let pipeline = run.finish()?;
    let after = picture(&pipeline.publisher().store(), "l2-after", "at the end");
    let one_room = rooms::run(&rooms::seen_from_one()?, rules, SEED, &[])?.finish()?;
    let one_room = picture(
        &one_room.publisher().store(),
        "l2-one-room",
        "at the end, had it stayed in the room",
    );
    Ok(vec![before, after, one_room])
}

/// Time of the data between two counts, seconds.
const PERIOD_S: f64 = 5.0;

/// Errors at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Errors {
    /// Cells that are occupied where the truth asks for free.
    ghosts: u64,
    /// Cells of the mirror that are free.
    holes: u64,
}

/// The errors of one run, every [`PERIOD_S`] of data and at the end.
struct Course {
    /// When, seconds after the start, and what.
    samples: Vec<(f64, Errors)>,
}

impl Course {
    /// Drives through `world`.
    fn of(world: &World, truth: &Truth, rules: Rules, seed: u64) -> anyhow::Result<Self> {
        let mirror = rooms::mirror_of(world);
        let mut run = rooms::run(world, rules, seed, &[])?;
        let end_s = run.duration_s();
        let counts = (end_s / PERIOD_S) as u32;
        let mut samples = Vec::new();
        for at_s in (1..=counts).map(|count| f64::from(count) * PERIOD_S) {
            run.advance_to(at_s)?;
            samples.push((at_s, errors(&run.store(), truth, &mirror)));
        }
        let pipeline = run.finish()?;
        samples.push((end_s, errors(&pipeline.publisher().store(), truth, &mirror)));
        Ok(Self { samples })
    }

    /// When most ghosts were there for the first time, and how many.
    fn most_ghosts(&self) -> (f64, u64) {
        let ghosts = self
            .samples
            .iter()
            .map(|&(at_s, errors)| (at_s, errors.ghosts));
        ghosts
            .rev()
            .max_by_key(|&(_, ghosts)| ghosts)
            .unwrap_or_default()
    }

    /// Most free cells of the mirror at any one time.
    fn most_holes(&self) -> u64 {
        let holes = self.samples.iter().map(|sample| sample.1.holes);
        holes.max().unwrap_or_default()
    }

    /// The errors at the latest count up to a time.
    fn at(&self, at_s: f64) -> Errors {
        let behind = self.samples.iter().rev().find(|sample| sample.0 <= at_s);
        behind.map(|sample| sample.1).unwrap_or_default()
    }

    /// When the drive ends, seconds.
    fn end_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |sample| sample.0)
    }

    /// The errors of the finished map.
    fn end(&self) -> Errors {
        self.at(f64::INFINITY)
    }
}

fn errors(store: &TileStore, truth: &Truth, mirror: &Outline) -> Errors {
    let mut errors = Errors::default();
    for cell in truth.known_cells(store) {
        match (cell.expected, cell.map) {
            (Expected::Free, Trinary::Occupied) => errors.ghosts += 1,
            (Expected::Occupied, Trinary::Free) => {
                let centre_m = Point2::from(truth.centre_m(cell.index));
                let on_mirror =
                    mirror.contains(centre_m) || mirror.distance_m(centre_m) <= truth.near_m();
                errors.holes += u64::from(on_mirror);
            }
            (Expected::Free | Expected::Occupied | Expected::Unobservable | Expected::Edge, _) => {}
        }
    }
    errors
}

/// The same drive three times: past the mirror, past a mirror that scatters light, and, without what other
/// rooms show, only to and fro before the mirror.
struct Drives {
    mirror: Course,
    scattering: Course,
    one_room: Course,
}

impl Drives {
    fn of(truth: &Truth, rules: Rules, seed: u64) -> anyhow::Result<Self> {
        Ok(Self {
            mirror: Course::of(&rooms::rooms()?, truth, rules, seed)?,
            scattering: Course::of(&rooms::without_reflections()?, truth, rules, seed)?,
            one_room: Course::of(&rooms::seen_from_one()?, truth, rules, seed)?,
        })
    }
}
