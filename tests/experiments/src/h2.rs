//! H2 [HYB 8.2]: what slopes cost; a canopy is no obstacle, a low branch is.

mod evaluation;

use super::land::{Found, Hits, LETHAL, LandWorld, Poses, TRAVERSABLE, octree_and_cost, published};
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::known_cells;
use super::session::{SEED, Session};
use super::voxel_views;
use edge::runtime::Pipeline;
use evaluation::{Evaluation, Kind, Plane, YardTruth};
use protocol::layer::LayerId;
use simulation::SimulationOptions;

/// Share of the swept cells of planes whose cost must be right [`docs/methods.md` §4].
const RIGHT_MIN_PERCENT: f64 = 95.0;
/// Share of the columns of things, where the laser met them, that must be lethal.
const FOUND_MIN_PERCENT: f64 = 95.0;
/// Cells below which a share means nothing.
const CELLS_MIN: f64 = 500.0;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let yard = LandWorld::load("yard", session.rules())?;
    session.step("H2: the truth")?;
    let truth = YardTruth::of(&yard)?;
    let drives = session.for_each_seed("H2: yard", |seed| {
        drive(&yard, &truth, seed, Poses::Averaged)
    })?;
    let (drives, let_through): (Vec<_>, Vec<_>) = drives.into_iter().unzip();
    session.step("H2: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/h2.md")),
        Part::Table(by_slope(&drives)),
        Part::Table(by_object(&drives)),
        Part::text(include_str!("notes/h2_variants.md")),
        Part::Table(variants(session, &yard, &truth, [&drives, &let_through])?),
    ];
    parts.extend(pictures(&yard, &truth)?);
    let mut all = checks(&drives);
    all.extend(rigidity_checks(&let_through));
    Ok(Outcome { checks: all, parts })
}

fn mapped(
    yard: &LandWorld,
    truth: &YardTruth<'_>,
    seed: u64,
    settings: &[&str],
    poses: Poses,
) -> anyhow::Result<(Hits, Pipeline)> {
    let mut run = yard.run_with_poses(seed, SimulationOptions::default(), settings, poses)?;
    let mut hits = Hits::default();
    run.advance_with(run.duration_s(), |_, scan| {
        hits.add(yard, truth.ground(), scan);
    })?;
    Ok((hits, run.finish()?))
}

/// One drive by the cost of slopes alone, and with what gives way let through.
fn drive(
    yard: &LandWorld,
    truth: &YardTruth<'_>,
    seed: u64,
    poses: Poses,
) -> anyhow::Result<(Evaluation, Evaluation)> {
    let (hits, pipeline) = mapped(yard, truth, seed, &[], poses)?;
    let store = pipeline.publisher().store();
    let mut costs = published(&store, LayerId::Cost).collect();
    let let_through = Evaluation::of(truth, &hits, &costs);
    // Only lethal columns are let through.
    let gives_way = known_cells(&store, LayerId::Rigidity);
    let gives_way = gives_way.filter(|(_, code)| *code == TRAVERSABLE);
    costs.extend(gives_way.map(|(cell, _)| (cell, LETHAL)));
    Ok((Evaluation::of(truth, &hits, &costs), let_through))
}

/// What other poses and the document's next step make of the same drive.
fn variants(
    session: &Session<'_>,
    yard: &LandWorld,
    truth: &YardTruth<'_>,
    [drives, let_through]: [&[Evaluation]; 2],
) -> anyhow::Result<Table> {
    let mut table = Table::new(&[
        "seed 1",
        "planes right, %",
        "planes lethal, cells",
        "boxes lethal, %",
        "low branch lethal, %",
    ]);
    let mut row = |name: &str, evaluation: &Evaluation| {
        let found = |kind| format!("{:.0}", 100.0 * evaluation.of_kind(kind).found_share());
        table.push([
            name.to_owned(),
            format!("{:.1}", 100.0 * evaluation.planes.right_share()),
            evaluation.planes.lethal.to_string(),
            found(Kind::Box),
            found(Kind::LowBranch),
        ]);
    };
    if let Some(first) = drives.first() {
        row("attitudes of 0.1°, averaged (above)", first);
    }
    for (name, poses) in [
        ("true poses", Poses::True),
        ("attitudes of 0.1°, each by itself", Poses::Raw),
    ] {
        session.step(&format!("H2: {name}"))?;
        row(name, &drive(yard, truth, SEED, poses)?.0);
    }
    if let Some(first) = let_through.first() {
        row("averaged, what gives way let through", first);
    }
    Ok(table)
}

fn checks(drives: &[Evaluation]) -> Vec<Check> {
    let spread = |figure: &dyn Fn(&Evaluation) -> f64| Spread::over(drives, figure);
    let share = |what: String, share: Spread, of: Spread, (share_min, of_min): (f64, f64)| {
        Check::gate(
            what,
            format!("{} of {}", share.text(1, " %"), of.text(0, "")),
            format!("≥ {share_min} %"),
            share.least >= share_min && of.least >= of_min,
        )
    };
    let none_of = |what: &str, count: Spread, of: Spread| {
        Check::gate(
            what,
            format!("{} of {}", count.text(0, ""), of.text(0, "")),
            format!("0 of ≥ {CELLS_MIN}"),
            count.most == 0.0 && of.least >= CELLS_MIN,
        )
    };
    let found = |what: String, figure: &dyn Fn(&Evaluation) -> Found| {
        let found = spread(&|drive| 100.0 * figure(drive).found_share());
        let seen = spread(&|drive| figure(drive).seen as f64);
        share(what, found, seen, (FOUND_MIN_PERCENT, 1.0))
    };
    let swept = spread(&|drive| drive.planes.swept as f64);
    let mut checks = vec![
        share(
            "swept cells of planes whose cost is right".to_owned(),
            spread(&|drive| 100.0 * drive.planes.right_share()),
            swept,
            (RIGHT_MIN_PERCENT, CELLS_MIN),
        ),
        none_of(
            "those of them that are lethal",
            spread(&|drive| drive.planes.lethal as f64),
            swept,
        ),
        none_of(
            "those beneath the canopy that are lethal",
            spread(&|drive| drive.beneath.lethal as f64),
            spread(&|drive| drive.beneath.swept as f64),
        ),
    ];
    checks.extend(Kind::ALL.map(|kind| {
        let what = format!("{} that are lethal", kind.label());
        found(what, &|drive| drive.of_kind(kind))
    }));
    checks.push(found(
        "places along the pit's rim, where the laser saw below it, with a lethal cell".to_owned(),
        &|drive| drive.rim,
    ));
    let unseen = spread(&|drive| drive.rim_unseen.seen as f64).text(0, "");
    let unseen_lethal = spread(&|drive| 100.0 * drive.rim_unseen.found_share());
    checks.push(Check::shown(
        "the others with a lethal cell",
        format!("{} of {unseen}", unseen_lethal.text(1, " %")),
    ));
    let shown = |what: &str, count: fn(&Evaluation) -> usize| {
        Check::shown(what, Spread::count(drives, count).text(0, ""))
    };
    checks.extend([
        shown("lethal cells where nothing is, swept", |drive| {
            drive.false_lethal_swept
        }),
        shown("the same, not swept", |drive| drive.false_lethal_unswept),
        shown("cells of which nothing is known, though swept", |drive| {
            drive.planes.unknown
        }),
    ]);
    checks
}

/// With rigidity, as the preset has it.
fn rigidity_checks(drives: &[Evaluation]) -> impl Iterator<Item = Check> + '_ {
    Kind::ALL.into_iter().map(move |kind| {
        let found = |drive: &Evaluation| 100.0 * drive.of_kind(kind).found_share();
        let found = Spread::over(drives, found);
        let what = format!("{} that stay lethal with rigidity", kind.label());
        Check::at_least(what, (found, 1, " %"), FOUND_MIN_PERCENT)
    })
}

/// Each slope of the yard.
fn by_slope(drives: &[Evaluation]) -> Table {
    let mut table = Table::new(&[
        "slope, °",
        "true cost",
        "swept cells",
        "right, %, least",
        "median error",
        "lethal",
    ]);
    let slopes = drives.iter().flat_map(|drive| drive.by_slope.keys());
    let slopes: std::collections::BTreeSet<u32> = slopes.copied().collect();
    for tenths in slopes {
        let of_slope = drives
            .iter()
            .filter_map(|drive| drive.by_slope.get(&tenths));
        let of_slope: Vec<_> = of_slope.collect();
        let spread =
            |figure: &dyn Fn(&Plane) -> f64| Spread::over(&of_slope, |plane| figure(plane));
        let slope_deg = f64::from(tenths) / 10.0;
        table.push([
            format!("{slope_deg:.1}"),
            format!("{:.2}", libm::tan(slope_deg.to_radians())),
            format!("{:.0}", spread(&|plane| plane.swept as f64).median),
            format!("{:.1}", spread(&|plane| 100.0 * plane.right_share()).least),
            format!("{:+.3}", spread(&Plane::median_error).median),
            format!("{:.0}", spread(&|plane| plane.lethal as f64).most),
        ]);
    }
    table
}

/// Each thing of the yard.
fn by_object(drives: &[Evaluation]) -> Table {
    let mut table = Table::new(&["", "columns that the laser met", "lethal, %, least"]);
    for name in drives.iter().take(1).flat_map(|drive| drive.objects.keys()) {
        let each = drives.iter().filter_map(|drive| drive.objects.get(name));
        let each: Vec<_> = each.collect();
        let seen = Spread::count(&each, |object| object.seen);
        let found = Spread::over(&each, |object| 100.0 * object.found_share());
        table.push([
            name.clone(),
            format!("{:.0}", seen.median),
            format!("{:.1}", found.least),
        ]);
    }
    table
}

fn pictures(yard: &LandWorld, truth: &YardTruth<'_>) -> anyhow::Result<Vec<Part>> {
    let slopes_alone = ["mapping.rigidity.enabled=false"];
    let (hits, pipeline) = mapped(yard, truth, SEED, &slopes_alone, Poses::Averaged)?;
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
        Part::Pictures(vec![evaluation::errors(truth, &hits, &cost)]),
    ])
}
