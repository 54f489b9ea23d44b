//! H1 [HYB 8.1, figure 4.5]: a tilt encoder that lags makes two ground surfaces; with its time offset there is one.

mod surfaces;

use super::land::{LandWorld, octree_and_cost};
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{SEED, Session};
use super::voxel_views::{Section, from_above};
use edge::runtime::Pipeline;
use simulation::SimulationOptions;
use surfaces::{BINS_M, OpenGround, Surfaces};

/// How late the encoder is, seconds: a twentieth, in which the laser turns by 1.9°. The document gives no number.
const LAG_S: f64 = 0.05;
/// Four periods of the tilt, seconds.
const DURATION_S: f64 = 16.0;
/// Farther apart than this the surfaces of the two sweeps must lie without the offset, at 8 m to 15 m, metres.
const APART_MIN_M: f64 = 0.1;
/// And no farther with it, metres.
const TOGETHER_MAX_M: f64 = 0.01;
/// Share of the open ground where there are two surfaces: at least without, at most with the offset.
const DOUBLE_PERCENT: [f64; 2] = [30.0, 1.0];
/// Columns below which a share means nothing.
const COLUMNS_MIN: f64 = 100.0;

/// One drive, measured three times.
struct Drive {
    without: Surfaces,
    with: Surfaces,
    /// With an encoder that does not lag.
    honest: Surfaces,
}

/// What the encoder and the configuration make of one another.
#[derive(Clone, Copy)]
enum Encoder {
    Lagging,
    MadeUpFor,
    Honest,
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let meadow = LandWorld::load("meadow", session.rules())?;
    session.step("H1: the truth")?;
    let open = OpenGround::of(&meadow)?;
    let drives = session.for_each_seed("H1: meadow", |seed| {
        let observed = open.observed(run_of(&meadow, Encoder::Honest, seed)?, DURATION_S)?;
        let measured = |encoder| {
            let run = run_of(&meadow, encoder, seed)?;
            open.surfaces(run, DURATION_S, &observed)
        };
        Ok(Drive {
            without: measured(Encoder::Lagging)?,
            with: measured(Encoder::MadeUpFor)?,
            honest: measured(Encoder::Honest)?,
        })
    })?;
    session.step("H1: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/h1.md")),
        Part::Table(heights(&drives)),
        Part::Table(columns(&drives)),
    ];
    for (encoder, name, caption) in [
        (Encoder::Lagging, "without", "without the time offset"),
        (Encoder::MadeUpFor, "with", "with the time offset"),
    ] {
        let mut run = run_of(&meadow, encoder, SEED)?;
        run.advance_to(DURATION_S)?;
        parts.extend(pictures(&open, run.pipeline(), name, caption)?);
    }
    Ok(Outcome {
        checks: checks(&drives),
        parts,
    })
}

fn run_of(
    meadow: &LandWorld,
    encoder: Encoder,
    seed: u64,
) -> anyhow::Result<super::run::SimulatedRun> {
    let (lag_s, offset_s) = match encoder {
        Encoder::Lagging => (LAG_S, 0.0),
        Encoder::MadeUpFor => (LAG_S, -LAG_S),
        Encoder::Honest => (0.0, 0.0),
    };
    let options = SimulationOptions {
        joint_lag_s: Some(lag_s),
        duration_s: Some(DURATION_S),
        ..SimulationOptions::default()
    };
    let setting = format!("sensors.laser.tilt.time_offset_s={offset_s}");
    meadow.run_with(seed, options, &[&setting])
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let far = BINS_M.len() - 1;
    let apart = Spread::over(drives, |drive| drive.without.apart_m(far));
    let together = Spread::over(drives, |drive| {
        let bins = (0..BINS_M.len()).map(|bin| drive.with.apart_m(bin).abs());
        bins.fold(0.0, f64::max)
    });
    let columns = Spread::count(drives, |drive| drive.with.columns);
    let double = Spread::over(drives, |drive| 100.0 * drive.without.double_share());
    let single = Spread::over(drives, |drive| 100.0 * drive.with.double_share());
    let [double_min, double_max] = DOUBLE_PERCENT;
    vec![
        Check::at_least(
            "ground of sweeps down above that of sweeps up, 8 m to 15 m, without the offset",
            (apart, 3, " m"),
            APART_MIN_M,
        ),
        Check::at_most(
            "the two apart with the offset, at any distance",
            (together, 4, " m"),
            TOGETHER_MAX_M,
        ),
        Check::gate(
            "columns of open ground with two surfaces, without the offset",
            format!("{} of {}", double.text(1, " %"), columns.text(0, "")),
            format!("≥ {double_min} % of ≥ {COLUMNS_MIN}"),
            double.least >= double_min && columns.least >= COLUMNS_MIN,
        ),
        Check::at_most("the same with the offset", (single, 2, " %"), double_max),
    ]
}

/// Heights of hits on the ground above it.
fn heights(drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        "hits on the ground, heights above it",
        "distance, m",
        "down, mean, m",
        "up, mean, m",
        "down, std. dev., m",
        "up, std. dev., m",
    ]);
    for (name, of) in CASES {
        for (bin, [near_m, far_m]) in BINS_M.iter().enumerate() {
            let median = |figure: &dyn Fn(&Surfaces) -> f64| {
                Spread::over(drives, |drive| figure(of(drive))).median
            };
            table.push([
                name.to_owned(),
                format!("{near_m:.0} to {far_m:.0}"),
                format!("{:+.3}", median(&|all| all.down[bin].mean_m())),
                format!("{:+.3}", median(&|all| all.up[bin].mean_m())),
                format!("{:.3}", median(&|all| all.down[bin].deviation_m())),
                format!("{:.3}", median(&|all| all.up[bin].deviation_m())),
            ]);
        }
    }
    table
}

/// How the occupied voxels of the open ground lie.
fn columns(drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        "columns of open ground",
        "columns",
        "two surfaces, %",
        "occupied over, mean, m",
        "occupied farther than a voxel from the ground, %",
    ]);
    for (name, of) in CASES {
        let median = |figure: &dyn Fn(&Surfaces) -> f64| {
            Spread::over(drives, |drive| figure(of(drive))).median
        };
        table.push([
            name.to_owned(),
            format!("{:.0}", median(&|all| all.columns as f64)),
            format!("{:.2}", median(&|all| 100.0 * all.double_share())),
            format!("{:.2}", median(&Surfaces::thickness_m)),
            format!("{:.2}", median(&|all| 100.0 * all.astray_share())),
        ]);
    }
    table
}

type Case = (&'static str, fn(&Drive) -> &Surfaces);

const CASES: [Case; 3] = [
    ("lag, no offset", |drive| &drive.without),
    ("lag and offset", |drive| &drive.with),
    ("no lag", |drive| &drive.honest),
];

fn pictures(
    open: &OpenGround<'_>,
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> anyhow::Result<Vec<Part>> {
    let (octree, _) = octree_and_cost(pipeline)?;
    let section = Section {
        from_m: [-2.0, -2.0],
        to_m: [30.0, 2.5],
        across_m: [-0.3, 0.3],
    };
    let section = section.picture(
        octree,
        &|at| open.ground().height_m(at),
        &format!("h1-{name}-section"),
        &format!("{caption}, from the right, y = −0.3 … 0.3 m"),
    );
    let above = from_above(
        octree,
        &format!("h1-{name}-octree"),
        &format!("{caption}, highest occupied voxels no higher than 2 m"),
        2.0,
    )?;
    Ok(vec![Part::Pictures(vec![section]), Part::Pictures(above)])
}
