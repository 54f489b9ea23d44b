//! L2 \[LRF\]: a reflective surface gives false readings, and their errors vanish with further observations.
//!
//! A mirror shows the room in front of it a second time behind it. Two errors come of that: *ghosts*, cells
//! that are occupied where the truth asks for free, and *holes* in the mirror, cells that are free where it
//! asks for occupied because mirrored beams seem to pass. Ghosts are counted in the whole map, wherever
//! they are. What of both is not the mirror's doing shows in the same run, with the same noise, past a
//! mirror that scatters light.

mod course;

use super::outcome::{Check, Outcome, Part, Table};
use super::rooms::agreement::Truth;
use super::rooms::{self, error_map};
use super::session::{SEED, Session};
use super::spread::Spread;
use super::{ExperimentError, pictures::Picture};
use course::{Course, Drives};

/// Ghosts that must have been there for their vanishing to mean anything: 2 m of walls.
const GHOSTS_MIN: u64 = 20;
/// Holes in the mirror that may be left beyond those of a mirror that scatters light: 5 % of its 39 cells.
const HOLES_LEFT_MAX: u64 = 2;
/// Share of the run after which the vehicle has seen through the ghosts.
const GHOSTS_UNTIL: f64 = 0.25;
/// Times of the table, seconds.
const TIMES_S: [f64; 10] = [5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 60.0, 90.0, 95.0, 100.0];

pub(super) fn run(session: &Session<'_>) -> Result<Outcome, ExperimentError> {
    let truth = rooms::truth_of(&rooms::rooms()?)?;
    let drives = session.for_each_seed("L2: three drives", |seed| Drives::of(&truth, seed))?;
    let mut parts = vec![
        Part::text(include_str!("notes/l2.md")),
        Part::text(format!("Seed {SEED}:")),
    ];
    parts.extend(drives.first().map(|first| Part::Table(course_table(first))));
    parts.push(Part::text(format!("Over {}:", session.seeds_text())));
    parts.push(Part::Table(over_seeds(&drives)));
    parts.push(Part::text(include_str!("notes/l2_holes.md")));
    session.step("L2: pictures")?;
    parts.push(Part::Pictures(pictures(&truth)?));
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

fn checks(drives: &[Drives]) -> Vec<Check> {
    let gate = |what: &str,
                required: String,
                allowed: &dyn Fn(u64) -> bool,
                figure: &dyn Fn(&Drives) -> u64| {
        let figures: Vec<u64> = drives.iter().map(figure).collect();
        let spread = Spread::of(figures.iter().map(|&count| count as f64));
        let passed = figures.into_iter().all(allowed);
        Check::gate(what, spread.text(0, ""), required, passed)
    };
    let end_s = drives.first().map_or(0.0, |drives| drives.mirror.end_s());
    let latest = Spread::of(drives.iter().map(|drives| drives.mirror.most_ghosts().0));
    vec![
        gate("ghosts at the end", "0".to_owned(), &|n| n == 0, &|d| {
            d.mirror.end().ghosts
        }),
        gate(
            "most ghosts on the way",
            format!("≥ {GHOSTS_MIN}"),
            &|n| n >= GHOSTS_MIN,
            &|d| d.mirror.most_ghosts().1,
        ),
        Check::gate(
            "most ghosts after",
            latest.text(0, " s"),
            format!("< {:.0} s", GHOSTS_UNTIL * end_s),
            latest.most < GHOSTS_UNTIL * end_s,
        ),
        gate(
            "ghosts before the mirror is in sight",
            "0".to_owned(),
            &|n| n == 0,
            &|d| d.mirror.at(5.0).ghosts,
        ),
        gate(
            "holes in the mirror at the end beyond those of one that scatters",
            format!("≤ {HOLES_LEFT_MAX}"),
            &|n| n <= HOLES_LEFT_MAX,
            &|d| {
                d.mirror
                    .end()
                    .holes
                    .saturating_sub(d.scattering.end().holes)
            },
        ),
        gate(
            "most ghosts, mirror that scatters",
            "0".to_owned(),
            &|n| n == 0,
            &|d| d.scattering.most_ghosts().1,
        ),
        gate(
            "ghosts at the end where it saw one room only",
            format!("≥ {GHOSTS_MIN}"),
            &|n| n >= GHOSTS_MIN,
            &|d| d.one_room.end().ghosts,
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
    let mut table = Table::new(&["", "least", "median", "most"]);
    let mut row = |name: &str, figure: &dyn Fn(&Drives) -> u64| {
        let figures = drives.iter().map(|drives| figure(drives) as f64);
        let [least, median, most] = Spread::of(figures).cells(0);
        table.push([name.to_owned(), least, median, most]);
    };
    row("most ghosts", &|d| d.mirror.most_ghosts().1);
    row("ghosts at the end", &|d| d.mirror.end().ghosts);
    row("ghosts at the end, one room only", &|d| {
        d.one_room.end().ghosts
    });
    row("most ghosts, scattering mirror", &|d| {
        d.scattering.most_ghosts().1
    });
    row("most holes in the mirror", &|d| d.mirror.most_holes());
    row("most holes, scattering mirror", &|d| {
        d.scattering.most_holes()
    });
    row("holes at the end", &|d| d.mirror.end().holes);
    row("holes at the end, scattering mirror", &|d| {
        d.scattering.end().holes
    });
    table
}

fn pictures(truth: &Truth) -> Result<Vec<Picture>, ExperimentError> {
    let picture =
        |store: &_, name: &str, caption: &str| error_map::picture(truth, store, name, caption);
    let mut run = rooms::run(&rooms::rooms()?, SEED, &[])?;
    // The vehicle is about to leave the room with the mirror.
    run.advance_to(20.0)?;
    let before = picture(
        &run.store(),
        "l2-before",
        "after 20 s, before it leaves the room",
    );
    let pipeline = run.finish()?;
    let after = picture(&pipeline.publisher().store(), "l2-after", "at the end");
    let one_room = rooms::run(&rooms::seen_from_one()?, SEED, &[])?.finish()?;
    let one_room = picture(
        &one_room.publisher().store(),
        "l2-one-room",
        "at the end, had it stayed in the room",
    );
    Ok(vec![before, after, one_room])
}
