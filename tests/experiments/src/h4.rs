//! H4 [HYB §8.4.2]: shores of scattered canes, cane fields, and bushes with trunks.

use std::collections::BTreeSet;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{SEED, Session};
use super::shores::{self, MatchedCluster, MetricColumns, WaterWorld, main_cluster};
use mapping::shore::ShoreClass;

/// Share of the clusters that must be right.
const RIGHT_MIN: f64 = 0.95;
/// Clusters that there must be.
const CLUSTERS_MIN: f64 = 12.0;
/// Parts of the drive after which the columns of the pictures are gathered.
const SAMPLES: u32 = 4;

/// One drive along the lake: its clusters, by number.
type Drive = Vec<MatchedCluster>;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let lake = WaterWorld::load("lake", session.rules())?;
    let drives = session.for_each_seed("H4: lake", |seed| drive(&lake, seed))?;
    let mut parts = vec![Part::text(include_str!("notes/h4.md"))];
    if let Some(first) = drives.first() {
        parts.push(Part::Table(clusters(&lake, first)));
    }
    parts.push(Part::text("Over all seeds, of each stretch of shore:"));
    parts.push(Part::Table(stretches(&lake, &drives)));
    session.step("H4: pictures")?;
    parts.extend(pictures(&lake)?);
    Ok(Outcome {
        checks: checks(&lake, &drives),
        parts,
    })
}

fn drive(lake: &WaterWorld, seed: u64) -> anyhow::Result<Drive> {
    let pipeline = lake.run(seed)?.finish()?;
    let maps = lake.maps(&pipeline)?;
    let cell_m = maps.voxels.octree().cell_m();
    let clusters = maps.shore.clusters();
    Ok(clusters
        .map(|cluster| MatchedCluster::of(lake, cell_m, cluster))
        .collect())
}

fn checks(lake: &WaterWorld, drives: &[Drive]) -> Vec<Check> {
    let all: Vec<_> = drives.iter().flatten().collect();
    let right = all.iter().filter(|matched| matched.is_right()).count();
    let worst = all
        .iter()
        .filter(|matched| matched.is_solid_called_sparse())
        .count();
    let strays = all.iter().filter(|matched| matched.shore.is_none()).count();
    let count = Spread::count(drives, Vec::len);
    let stretches = lake.world.shores().len();
    let found = Spread::count(drives, |drive| {
        let found: BTreeSet<_> = drive.iter().filter_map(|matched| matched.shore).collect();
        found.len()
    });
    let main_right = drives
        .iter()
        .flat_map(|drive| (0..stretches).filter_map(|stretch| main_cluster(drive, stretch)))
        .filter(|matched| matched.is_right())
        .count();
    let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
    let of = |part: usize, whole: usize| {
        format!("{part} of {whole}, {:.1} %", 100.0 * share(part, whole))
    };
    let required = format!("≥ {:.0} %", 100.0 * RIGHT_MIN);
    let all_stretches = stretches * drives.len();
    vec![
        Check::gate(
            "clusters of the right class",
            of(right, all.len()),
            &required,
            share(right, all.len()) >= RIGHT_MIN,
        ),
        Check::gate("Solid called Sparse", worst.to_string(), "0", worst == 0),
        Check::at_least("clusters of a drive", (count, 0, ""), CLUSTERS_MIN),
        Check::gate(
            "stretches of shore whose largest cluster is of the right class",
            of(main_right, all_stretches),
            &required,
            share(main_right, all_stretches) >= RIGHT_MIN,
        ),
        Check::gate(
            format!("stretches of shore that were found, of {stretches}"),
            found.text(0, ""),
            stretches.to_string(),
            found.least >= stretches as f64,
        ),
        Check::shown("clusters that are no shore", strays.to_string()),
    ]
}

/// The document's table 8.1.
fn clusters(lake: &WaterWorld, drive: &Drive) -> Table {
    let columns = [
        "cluster",
        "voxels",
        "ratio (ρ)",
        "classification",
        "actual class",
        "actual shore",
    ];
    let mut table = Table::new(&columns);
    for matched in drive {
        let cluster = &matched.cluster;
        let shore = matched
            .shore
            .and_then(|shore| lake.world.shores().get(shore));
        table.push([
            cluster.number.to_string(),
            cluster.voxels.to_string(),
            format!("{:.2}", cluster.ratio),
            format!("{:?}", cluster.class),
            matched
                .truth
                .map_or_else(|| "none".to_owned(), |class| format!("{class:?}")),
            shore.map_or_else(String::new, |shore| shore.name.clone()),
        ]);
    }
    table
}

fn stretches(lake: &WaterWorld, drives: &[Drive]) -> Table {
    let columns = [
        "stretch",
        "actual class",
        "clusters",
        "voxels of the largest",
        "its ρ",
        "Sparse",
        "Dense",
        "Solid",
    ];
    let mut table = Table::new(&columns);
    for (number, shore) in lake.world.shores().iter().enumerate() {
        let main: Vec<_> = drives
            .iter()
            .filter_map(|drive| main_cluster(drive, number))
            .map(|matched| &matched.cluster)
            .collect();
        let parts = Spread::count(drives, |drive| {
            let parts = drive.iter().filter(|matched| matched.shore == Some(number));
            parts.count()
        });
        let of_class = |class: ShoreClass| main.iter().filter(|c| c.class == class).count();
        let voxels = Spread::over(&main, |cluster| f64::from(cluster.voxels));
        let ratio = Spread::over(&main, |cluster| cluster.ratio);
        table.push([
            shore.name.clone(),
            format!("{:?}", shore.class),
            parts.text(0, ""),
            voxels.text(0, ""),
            ratio.text(2, ""),
            of_class(ShoreClass::Sparse).to_string(),
            of_class(ShoreClass::Dense).to_string(),
            of_class(ShoreClass::Solid).to_string(),
        ]);
    }
    table
}

fn pictures(lake: &WaterWorld) -> anyhow::Result<Vec<Part>> {
    let shore = &lake.config.mapping.shore;
    let mut run = lake.run(SEED)?;
    let mut metrics = MetricColumns::default();
    let mut parts = Vec::new();
    for sample in 1..=SAMPLES {
        run.advance_to(run.duration_s() * f64::from(sample) / f64::from(SAMPLES))?;
        metrics.gather(&lake.maps(run.pipeline())?, shore);
        if 2 * sample == SAMPLES {
            let maps = shores::octree_and_cost(lake, run.pipeline(), "h4")?;
            parts.push(Part::Pictures(maps));
        }
    }
    let pipeline = run.finish()?;
    let cell_m = lake.maps(&pipeline)?.voxels.octree().cell_m();
    parts.push(Part::Pictures(metrics.pictures(cell_m, "h4")?));
    let caption = "classes and numbers of clusters";
    let picture = shores::picture(lake, &pipeline, "h4-shores", caption)?;
    parts.push(Part::Pictures(picture));
    Ok(parts)
}
