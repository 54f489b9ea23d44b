//! H3 [HYB 8.4.1]: rocks and trunks stay lethal, grass and twigs are traversable.

mod objects;

use std::collections::BTreeMap;

use protocol::layer::{LayerId, Palette};

use super::ExperimentError;
use super::land::{Cell, LandWorld, octree_and_cost, published};
use super::outcome::{Check, Outcome, Part, Table};
use super::pictures::Picture;
use super::published::known_cells;
use super::session::{SEED, Session};
use super::spread::Spread;
use super::voxel_views::{self, Canvas};
use mapping::rigidity::ObstacleVoxel;
use objects::{Class, Columns, Objects};
use simulation::SimulationOptions;

/// Share of all traversable objects' obstructed columns that must be traversable: the document's metrics err in
/// single columns, and what counts is that most of what could be pushed through is shown as such.
const GIVES_WAY_MIN: f64 = 0.5;
/// Share of all rigid objects' obstructed columns that must be rigid.
const RIGID_MIN: f64 = 0.5;

type Drive = BTreeMap<String, Columns>;

pub(super) fn run(session: &Session<'_>) -> Result<Outcome, ExperimentError> {
    let meadow = LandWorld::load("meadow")?;
    session.step("H3: the truth")?;
    let objects = Objects::of(&meadow)?;
    let drives = session.for_each_seed("H3: meadow", |seed| {
        let pipeline = meadow.run(seed)?.finish()?;
        let store = pipeline.publisher().store();
        let costs = published(&store, LayerId::Cost).collect();
        let rigidity = known_cells(&store, LayerId::Rigidity).collect();
        Ok(objects.columns(&costs, &rigidity))
    })?;
    session.step("H3: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/h3.md")),
        Part::Table(by_object(&objects, &drives)),
    ];
    parts.extend(pictures(&meadow)?);
    Ok(Outcome {
        checks: checks(&objects, &drives),
        parts,
    })
}

fn checks(objects: &Objects, drives: &[Drive]) -> Vec<Check> {
    let mut checks = Vec::new();
    for class in Class::EVALUATED {
        let of_class = |drive: &Drive| -> Vec<Columns> {
            let names = objects.names(class);
            let found = names.filter_map(|name| drive.get(name).copied());
            found.collect()
        };
        let count = objects.names(class).count();
        let right = drives.iter().map(|drive| {
            let right = of_class(drive).into_iter();
            right
                .filter(|columns| columns.verdict() == Some(class.verdict()))
                .count() as f64
        });
        let right = Spread::of(right);
        checks.push(Check::gate(
            format!(
                "{} that are {} in most columns",
                class.label(),
                class.verdict_label()
            ),
            format!("{} of {count}", right.text(0, "")),
            "all",
            right.least >= count as f64 && count > 0,
        ));
    }
    let total = |drive: &Drive, rigid: bool| {
        let classes = Class::EVALUATED
            .into_iter()
            .filter(|class| class.is_rigid() == rigid);
        let names = classes.flat_map(|class| objects.names(class));
        names
            .filter_map(|name| drive.get(name))
            .fold(Columns::default(), |sum, columns| sum.plus(*columns))
    };
    let rigid = drives
        .iter()
        .map(|drive| 100.0 * total(drive, true).rigid_share());
    let gives_way = drives
        .iter()
        .map(|drive| 100.0 * total(drive, false).traversable_share());
    let (rigid, gives_way) = (Spread::of(rigid), Spread::of(gives_way));
    let least = drives.iter().flat_map(|drive| {
        let rigid = Class::EVALUATED
            .into_iter()
            .filter(|class| class.is_rigid());
        let names: Vec<_> = rigid.flat_map(|class| objects.names(class)).collect();
        names
            .into_iter()
            .map(|name| drive.get(name).map_or(0.0, |columns| columns.rigid as f64))
    });
    let least = Spread::of(least);
    checks.extend([
        Check::gate(
            "rigid columns of a rock or trunk",
            least.text(0, ""),
            "≥ 1 of each",
            least.least >= 1.0,
        ),
        Check::gate(
            "obstructed columns of rocks and trunks that stay lethal",
            rigid.text(1, " %"),
            format!("≥ {:.0} %", 100.0 * RIGID_MIN),
            rigid.least >= 100.0 * RIGID_MIN,
        ),
        Check::gate(
            "obstructed columns of grass and twigs that are traversable",
            gives_way.text(1, " %"),
            format!("≥ {:.0} %", 100.0 * GIVES_WAY_MIN),
            gives_way.least >= 100.0 * GIVES_WAY_MIN,
        ),
    ]);
    let from_afar = drives.iter().flat_map(|drive| {
        let columns = objects
            .names(Class::FarTwigs)
            .filter_map(|name| drive.get(name));
        columns.map(|columns| 100.0 * columns.traversable_share())
    });
    checks.push(Check::shown(
        "the same of twigs at 6.4 m to 8 m",
        Spread::of(from_afar).text(1, " %"),
    ));
    checks
}

/// Each object.
fn by_object(objects: &Objects, drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        "",
        "obstructed columns",
        "rigid, %",
        "traversable, %",
        "lethal, no metric, %",
        "passable columns",
    ]);
    for class in Class::ALL {
        for name in objects.names(class) {
            let median = |figure: &dyn Fn(Columns) -> f64| {
                let each = drives.iter().filter_map(|drive| drive.get(name));
                Spread::of(each.map(|columns| figure(*columns))).median
            };
            table.push([
                name.to_owned(),
                format!("{:.0}", median(&|all| all.obstructed() as f64)),
                format!("{:.0}", median(&|all| 100.0 * all.rigid_share())),
                format!("{:.0}", median(&|all| 100.0 * all.traversable_share())),
                format!("{:.0}", median(&|all| 100.0 * all.unlabelled_share())),
                format!("{:.0}", median(&|all| all.passable as f64)),
            ]);
        }
    }
    table
}

fn pictures(meadow: &LandWorld) -> Result<Vec<Part>, ExperimentError> {
    let slopes_alone = ["mapping.rigidity.enabled=false"];
    let slopes = meadow.run_with(SEED, SimulationOptions::default(), &slopes_alone)?;
    let slopes = slopes.finish()?;
    let pipeline = meadow.run(SEED)?.finish()?;
    let (octree, cost) = octree_and_cost(&pipeline)?;
    let of = |store: &_, layer: LayerId, name: &str, caption: &str| {
        let palette: Palette = layer.default_palette();
        Picture::of_layer(store, palette, None, name, caption)
    };
    let mut maps = voxel_views::from_above(
        octree,
        "h3-octree",
        "meadow, highest occupied voxels no higher than 2 m",
        2.0,
    )?;
    let store = slopes.publisher().store();
    maps.extend(of(&store, LayerId::Cost, "h3-slopes", "slope cost alone")?);
    let store = pipeline.publisher().store();
    let mut verdicts = Vec::new();
    verdicts.extend(of(
        &store,
        LayerId::Cost,
        "h3-cost",
        "cost with what gives way",
    )?);
    verdicts.extend(of(&store, LayerId::Rigidity, "h3-rigidity", "rigidity")?);
    let voxels = cost.obstacle_voxels(octree);
    let thresholds = &meadow.config.mapping.rigidity;
    let metrics = [
        metric(
            &voxels,
            |voxel| voxel.intra,
            [thresholds.intra_threshold, 0.2],
            "h3-intra",
            "IntraScan, greatest of a column: white below the threshold, the wider the redder",
        ),
        metric(
            &voxels,
            |voxel| voxel.inter.map(|change| 1.0 - change),
            [1.0 - thresholds.inter_threshold, 1.0],
            "h3-inter",
            "InterScan, least of a column: white above the threshold, the steadier the redder",
        ),
    ];
    Ok(vec![
        Part::Pictures(maps),
        Part::Pictures(verdicts),
        Part::Pictures(metrics.into_iter().flatten().collect()),
    ])
}

/// The most telling value of every column of obstacle voxels: from white to red between two values.
fn metric(
    voxels: &[ObstacleVoxel],
    value: impl Fn(&ObstacleVoxel) -> Option<f32>,
    [low, high]: [f64; 2],
    name: &str,
    caption: &str,
) -> Option<Picture> {
    const COLORS: [[u8; 3]; 6] = [
        [180, 192, 206],
        [255, 255, 255],
        [252, 200, 180],
        [240, 130, 100],
        [200, 50, 40],
        [110, 0, 20],
    ];
    let mut columns: BTreeMap<Cell, f64> = BTreeMap::new();
    for voxel in voxels {
        if let Some(value) = value(voxel) {
            let cell = [voxel.voxel.x.into(), voxel.voxel.y.into()];
            let most = columns.entry(cell).or_insert(f64::NEG_INFINITY);
            *most = most.max(value.into());
        }
    }
    let axis = |axis: usize| columns.keys().map(move |cell| cell[axis]);
    let first = [axis(0).min()?, axis(1).min()?];
    let last = [axis(0).max()?, axis(1).max()?];
    let mut canvas = Canvas::new(first, last, &COLORS);
    for (&cell, &value) in &columns {
        let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
        let shade = if value <= low {
            1
        } else {
            2 + libm::floor(3.0 * share) as u8
        };
        canvas.set(cell, shade.min(5));
    }
    Some(canvas.picture(name, caption))
}
