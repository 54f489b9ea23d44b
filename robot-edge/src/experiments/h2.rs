//! H2 [HYB 8.2]: what slopes cost; a canopy is no obstacle, a low branch is.

mod judged;
mod truth;

use super::ExperimentError;
use super::land::columns::Hits;
use super::land::{LandWorld, Poses, octree_and_cost, published};
use super::outcome::{Check, Outcome, Part, Table};
use super::pictures::Picture;
use super::session::{SEED, Session};
use super::spread::Spread;
use super::voxel_views;
use crate::simulation::SimulationOptions;
use judged::Judged;
use protocol::layer::LayerId;
use truth::{Kind, YardTruth};

/// Share of the swept cells of planes whose cost must be right [`algorithms.md` §4].
const RIGHT_MIN: f64 = 0.95;
/// Share of the columns of things, where the laser met them, that must be fatal.
const FOUND_MIN: f64 = 0.95;
/// Cells below which a share means nothing.
const CELLS_MIN: f64 = 500.0;

pub(super) fn run(session: &Session<'_>) -> Result<Outcome, ExperimentError> {
    let yard = LandWorld::load("yard")?;
    session.step("H2: the truth")?;
    let truth = YardTruth::of(&yard)?;
    let drives = session.for_each_seed("H2: yard", |seed| drive(&yard, &truth, seed))?;
    session.step("H2: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/h2.md")),
        Part::Table(by_slope(&drives)),
        Part::Table(by_thing(&drives)),
        Part::text(include_str!("notes/h2_variants.md")),
        Part::Table(variants(session, &yard, &truth, &drives)?),
    ];
    parts.extend(pictures(&yard, &truth)?);
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

/// The cost of slopes alone: what gives way is not let through.
const SLOPES_ALONE: &[&str] = &["mapping.rigidity.enabled=false"];

fn drive(yard: &LandWorld, truth: &YardTruth<'_>, seed: u64) -> Result<Judged, ExperimentError> {
    judged(yard, truth, seed, SLOPES_ALONE, Poses::Averaged)
}

fn judged(
    yard: &LandWorld,
    truth: &YardTruth<'_>,
    seed: u64,
    settings: &[&str],
    poses: Poses,
) -> Result<Judged, ExperimentError> {
    let mut run = yard.run_posed(seed, SimulationOptions::default(), settings, poses)?;
    let mut hits = Hits::default();
    run.advance_with(run.duration_s(), |_, scan| {
        hits.add(yard, truth.ground(), scan);
    })?;
    let pipeline = run.finish()?;
    let store = pipeline.publisher().store();
    let costs = published(&store, LayerId::Cost).collect();
    Ok(Judged::of(truth, &hits, &costs))
}

/// What other poses and the document's next step make of the same drive.
fn variants(
    session: &Session<'_>,
    yard: &LandWorld,
    truth: &YardTruth<'_>,
    drives: &[Judged],
) -> Result<Table, ExperimentError> {
    let mut table = Table::new(&[
        "seed 1",
        "planes right, %",
        "planes fatal, cells",
        "boxes fatal, %",
        "low branch fatal, %",
    ]);
    let mut row = |name: &str, judged: &Judged| {
        let found = |kind| format!("{:.0}", 100.0 * judged.of_kind(kind).found_share());
        table.push([
            name.to_owned(),
            format!("{:.1}", 100.0 * judged.planes.right_share()),
            judged.planes.fatal.to_string(),
            found(Kind::Box),
            found(Kind::LowBranch),
        ]);
    };
    if let Some(first) = drives.first() {
        row("attitudes of 0.1°, averaged (above)", first);
    }
    for (name, settings, poses) in [
        ("true poses", SLOPES_ALONE, Poses::True),
        (
            "attitudes of 0.1°, each by itself",
            SLOPES_ALONE,
            Poses::Raw,
        ),
        ("averaged, what gives way let through", &[], Poses::Averaged),
    ] {
        session.step(&format!("H2: {name}"))?;
        row(name, &judged(yard, truth, SEED, settings, poses)?);
    }
    Ok(table)
}

fn checks(drives: &[Judged]) -> Vec<Check> {
    let spread = |figure: &dyn Fn(&Judged) -> f64| Spread::of(drives.iter().map(figure));
    let right = spread(&|drive| 100.0 * drive.planes.right_share());
    let swept = spread(&|drive| drive.planes.swept as f64);
    let fatal = spread(&|drive| drive.planes.fatal as f64);
    let beneath = spread(&|drive| drive.beneath.swept as f64);
    let beneath_fatal = spread(&|drive| drive.beneath.fatal as f64);
    let mut checks = vec![
        Check::gate(
            "swept cells of planes whose cost is right",
            format!("{} of {}", right.words(1, " %"), swept.words(0, "")),
            format!("≥ {:.0} %", 100.0 * RIGHT_MIN),
            right.least >= 100.0 * RIGHT_MIN && swept.least >= CELLS_MIN,
        ),
        Check::gate(
            "those of them that are fatal",
            format!("{} of {}", fatal.words(0, ""), swept.words(0, "")),
            format!("0 of ≥ {CELLS_MIN}"),
            fatal.most == 0.0 && swept.least >= CELLS_MIN,
        ),
        Check::gate(
            "those beneath the canopy that are fatal",
            format!("{} of {}", beneath_fatal.words(0, ""), beneath.words(0, "")),
            format!("0 of ≥ {CELLS_MIN}"),
            beneath_fatal.most == 0.0 && beneath.least >= CELLS_MIN,
        ),
    ];
    for kind in Kind::ALL {
        let seen = spread(&|drive| drive.of_kind(kind).seen as f64);
        let found = spread(&|drive| 100.0 * drive.of_kind(kind).found_share());
        checks.push(Check::gate(
            format!("{} that are fatal", kind.words()),
            format!("{} of {}", found.words(1, " %"), seen.words(0, "")),
            format!("≥ {:.0} %", 100.0 * FOUND_MIN),
            found.least >= 100.0 * FOUND_MIN && seen.least > 0.0,
        ));
    }
    let rim = spread(&|drive| 100.0 * drive.rim.found_share());
    let rim_seen = spread(&|drive| drive.rim.seen as f64);
    let rim_unseen = spread(&|drive| drive.rim_unseen.seen as f64);
    let rim_unseen_fatal = spread(&|drive| 100.0 * drive.rim_unseen.found_share());
    checks.push(Check::gate(
        "places along the pit's rim, where the laser saw below it, with a fatal cell",
        format!("{} of {}", rim.words(1, " %"), rim_seen.words(0, "")),
        format!("≥ {:.0} %", 100.0 * FOUND_MIN),
        rim.least >= 100.0 * FOUND_MIN && rim_seen.least > 0.0,
    ));
    checks.push(Check::shown(
        "the others with a fatal cell",
        format!(
            "{} of {}",
            rim_unseen_fatal.words(1, " %"),
            rim_unseen.words(0, "")
        ),
    ));
    let false_fatal = |what: &str, figure: &dyn Fn(&Judged) -> f64| {
        Check::shown(what, spread(figure).words(0, ""))
    };
    checks.extend([
        false_fatal("fatal cells where nothing is, swept", &|drive| {
            drive.false_fatal_swept as f64
        }),
        false_fatal("the same, not swept", &|drive| {
            drive.false_fatal_unswept as f64
        }),
        false_fatal("cells of which nothing is known, though swept", &|drive| {
            drive.planes.unknown as f64
        }),
    ]);
    checks
}

/// Each slope of the yard.
fn by_slope(drives: &[Judged]) -> Table {
    let mut table = Table::new(&[
        "slope, °",
        "true cost",
        "swept cells",
        "right, %, least",
        "median error",
        "fatal",
    ]);
    let slopes = drives.iter().flat_map(|drive| drive.by_slope.keys());
    let slopes: std::collections::BTreeSet<u32> = slopes.copied().collect();
    for tenths in slopes {
        let each = || {
            drives
                .iter()
                .filter_map(|drive| drive.by_slope.get(&tenths))
        };
        let spread = |figure: &dyn Fn(&judged::Plane) -> f64| Spread::of(each().map(figure));
        let slope_deg = f64::from(tenths) / 10.0;
        table.push([
            format!("{slope_deg:.1}"),
            format!("{:.2}", libm::tan(slope_deg.to_radians())),
            format!("{:.0}", spread(&|plane| plane.swept as f64).median),
            format!("{:.1}", spread(&|plane| 100.0 * plane.right_share()).least),
            format!("{:+.3}", spread(&judged::Plane::median_error).median),
            format!("{:.0}", spread(&|plane| plane.fatal as f64).most),
        ]);
    }
    table
}

/// Each thing of the yard.
fn by_thing(drives: &[Judged]) -> Table {
    let mut table = Table::new(&["", "columns that the laser met", "fatal, %, least"]);
    for name in drives.iter().take(1).flat_map(|drive| drive.things.keys()) {
        let each = || drives.iter().filter_map(|drive| drive.things.get(name));
        let seen = Spread::of(each().map(|thing| thing.seen as f64));
        let found = Spread::of(each().map(|thing| 100.0 * thing.found_share()));
        table.push([
            name.clone(),
            format!("{:.0}", seen.median),
            format!("{:.1}", found.least),
        ]);
    }
    table
}

fn pictures(yard: &LandWorld, truth: &YardTruth<'_>) -> Result<Vec<Part>, ExperimentError> {
    let mut run = yard.run_with(SEED, SimulationOptions::default(), SLOPES_ALONE)?;
    let mut hits = Hits::default();
    run.advance_with(run.duration_s(), |_, scan| {
        hits.add(yard, truth.ground(), scan);
    })?;
    let pipeline = run.finish()?;
    let (octree, _) = octree_and_cost(&pipeline)?;
    let store = pipeline.publisher().store();
    let mut from_above = voxel_views::from_above(
        octree,
        "h2-octree",
        "yard, highest occupied voxels no higher than 4 m",
        4.0,
    )?;
    from_above.extend(Picture::of_layer(
        &store,
        LayerId::Cost.default_palette(),
        None,
        "h2-cost",
        "yard, slope cost as published",
    )?);
    let section = voxel_views::Section {
        from_m: [-6.0, -1.0],
        to_m: [38.0, 4.0],
        across_m: [1.4, 1.8],
    };
    let cost = published(&store, LayerId::Cost).collect();
    Ok(vec![
        Part::Pictures(from_above),
        Part::Pictures(vec![section.picture(
            octree,
            &|at| truth.ground().height_m(at),
            "h2-section",
            "from the right, y = 1.4 … 1.8 m: occupied black, free light, the true ground blue",
        )]),
        Part::Pictures(vec![judged::errors(truth, &hits, &cost)]),
    ])
}
