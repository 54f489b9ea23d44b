//! H3 [HYB 8.4.1]: rocks and trunks stay lethal, grass and twigs are traversable.

mod drawn;
pub(super) mod objects;

use std::collections::BTreeMap;

use protocol::layer::{LayerId, Palette};

use super::land::{Cell, Found, LandWorld, octree_and_cost, published};
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::known_cells;
use super::session::{SEED, Session};
use super::voxel_views::{self, Canvas, PIXELS_PER_CELL};
use mapping::rigidity::ObstacleVoxel;
use objects::{Class, Columns, Objects};
use simulation::SimulationOptions;

/// Share of all traversable objects' obstructed columns that must be traversable.
const GIVES_WAY_MIN_PERCENT: f64 = 90.0;
/// Share of all rigid objects' obstructed columns that must be rigid: no worse than by the document's rule.
const RIGID_MIN_PERCENT: f64 = 75.0;

type Drive = BTreeMap<String, Columns>;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let meadow = LandWorld::load("meadow", session.rules())?;
    session.step("H3: the truth")?;
    let objects = Objects::of(&meadow)?;
    let drives = session.for_each_seed("H3: meadow", |seed| {
        let pipeline = meadow.run(seed)?.finish()?;
        let store = pipeline.publisher().store();
        let costs = published(&store, LayerId::Cost).collect();
        let rigidity = known_cells(&store, LayerId::Rigidity).collect();
        Ok(objects.columns(&costs, &rigidity))
    })?;
    let fields = session.for_each_seed("H3: drawn field", |seed| {
        drawn::drive(seed, session.rules())
    })?;
    session.step("H3: pictures")?;
    let mut parts = vec![
        Part::text(include_str!("notes/h3.md")),
        Part::Table(by_object(&objects, &drives)),
    ];
    parts.extend(pictures(&meadow)?);
    let mut all = checks(&objects, &drives);
    all.extend(drawn_checks(&fields));
    Ok(Outcome { checks: all, parts })
}

fn checks(objects: &Objects, drives: &[Drive]) -> Vec<Check> {
    let of_class = |drive: &Drive, class| -> Vec<Columns> {
        let names = objects.names(class);
        names
            .map(|name| drive.get(name).copied().unwrap_or_default())
            .collect()
    };
    let of_classes = |drive: &Drive, are_rigid: bool| -> Vec<Columns> {
        let mut classes = Class::EVALUATED.to_vec();
        classes.retain(|class| class.is_rigid() == are_rigid);
        classes
            .into_iter()
            .flat_map(|class| of_class(drive, class))
            .collect()
    };
    let sum = |columns: Vec<Columns>| columns.into_iter().fold(Columns::default(), Columns::plus);
    let mut checks = Vec::new();
    for class in Class::EVALUATED {
        let count = objects.names(class).count();
        let right = Spread::count(drives, |drive| {
            let mut columns = of_class(drive, class);
            columns.retain(|columns| columns.verdict() == Some(class.verdict()));
            columns.len()
        });
        let (label, verdict) = (class.label(), class.verdict_label());
        checks.push(Check::gate(
            format!("{label} that are {verdict} in most columns"),
            format!("{} of {count}", right.text(0, "")),
            "all",
            right.least >= count as f64 && count > 0,
        ));
    }
    let least = drives.iter().flat_map(|drive| of_classes(drive, true));
    let least = Spread::of(least.map(|columns| columns.rigid as f64));
    let rigid = Spread::over(drives, |drive| {
        100.0 * sum(of_classes(drive, true)).rigid_share()
    });
    let gives_way = Spread::over(drives, |drive| {
        100.0 * sum(of_classes(drive, false)).traversable_share()
    });
    let from_afar = drives
        .iter()
        .flat_map(|drive| of_class(drive, Class::FarTwigs));
    let from_afar = Spread::of(from_afar.map(|columns| 100.0 * columns.traversable_share()));
    checks.extend([
        Check::gate(
            "rigid columns of a rock or trunk",
            least.text(0, ""),
            "≥ 1 of each",
            least.least >= 1.0,
        ),
        Check::at_least(
            "obstructed columns of rocks and trunks that stay lethal",
            (rigid, 1, " %"),
            RIGID_MIN_PERCENT,
        ),
        Check::at_least(
            "obstructed columns of grass and twigs that are traversable",
            (gives_way, 1, " %"),
            GIVES_WAY_MIN_PERCENT,
        ),
        Check::shown("the same of twigs at 6.4 m to 8 m", from_afar.text(1, " %")),
    ]);
    checks
}

/// All fields together, for each has a few things only.
fn drawn_checks(fields: &[drawn::Drive]) -> [Check; 3] {
    let lethal = |found: fn(&drawn::Drive) -> [Found; 2]| {
        let [slopes, rigid] = [0, 1].map(|which| {
            let sum = |sum: Found, one: Found| Found {
                seen: sum.seen + one.seen,
                lethal: sum.lethal + one.lethal,
            };
            let all = fields.iter().map(|field| found(field)[which]);
            all.fold(Found::default(), sum)
        });
        let percent = |found: Found| 100.0 * found.found_share();
        format!(
            "{:.1} % of {}, by slopes alone {:.1} %",
            percent(rigid),
            rigid.seen,
            percent(slopes)
        )
    };
    let plants = fields.iter().map(|field| field.plants);
    let plants = plants.fold(Columns::default(), Columns::plus);
    let traversable = 100.0 * plants.traversable_share();
    [
        Check::shown(
            "drawn fields: columns of boxes that are lethal",
            lethal(|field| field.boxes),
        ),
        Check::shown(
            "drawn fields: columns of low branches that are lethal",
            lethal(|field| field.branches),
        ),
        Check::shown(
            "drawn fields: obstructed columns of plants that are traversable",
            format!("{traversable:.1} % of {}", plants.obstructed()),
        ),
    ]
}

/// Each object.
fn by_object(objects: &Objects, drives: &[Drive]) -> Table {
    let mut table = Columns::table("");
    for class in Class::ALL {
        for name in objects.names(class) {
            let drives = drives.iter().filter_map(|drive| drive.get(name).copied());
            let drives: Vec<_> = drives.collect();
            table.push(Columns::row(name, &drives));
        }
    }
    table
}

fn pictures(meadow: &LandWorld) -> anyhow::Result<Vec<Part>> {
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
            [
                thresholds.rigid_above(),
                (5.0 * thresholds.rigid_above()).min(1.0),
            ],
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
    let mut canvas = Canvas::new(first, last, &COLORS, PIXELS_PER_CELL);
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
