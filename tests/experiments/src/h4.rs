//! H4 [HYB §8.4.2]: shores of scattered canes, cane fields, and bushes with trunks.

use std::collections::BTreeSet;

use super::ExperimentError;
use super::outcome::{Check, Outcome, Part, Table};
use super::run::vehicle_config;
use super::session::{SEED, Session};
use super::shores::cluster_match::{MatchedCluster, found_label, true_label};
use super::shores::{WaterWorld, views};
use super::spread::Spread;
use mapping::shore::ShoreClass;

/// Share of the clusters that must be right.
const RIGHT_MIN: f64 = 0.95;
/// Clusters that there must be.
const CLUSTERS_MIN: f64 = 12.0;
/// Parts of the drive after which the columns of the pictures are gathered.
const SAMPLES: u32 = 4;

/// One drive along the lake: its clusters, by number.
type Drive = Vec<MatchedCluster>;

pub(super) fn run(session: &Session<'_>) -> Result<Outcome, ExperimentError> {
    let lake = WaterWorld::load("lake")?;
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

fn drive(lake: &WaterWorld, seed: u64) -> Result<Drive, ExperimentError> {
    let pipeline = lake.run(seed)?.finish()?;
    let maps = lake.maps(&pipeline)?;
    let cell_m = maps.voxels.octree().cell_m();
    let clusters = maps.shore.clusters();
    Ok(clusters
        .map(|cluster| MatchedCluster::of(lake, cell_m, cluster))
        .collect())
}

/// The cluster of a stretch that most of its voxels are in.
fn main_cluster(drive: &Drive, stretch: usize) -> Option<&MatchedCluster> {
    let of_stretch = drive
        .iter()
        .filter(|matched| matched.shore == Some(stretch));
    of_stretch.max_by_key(|matched| matched.cluster.voxels)
}

fn checks(lake: &WaterWorld, drives: &[Drive]) -> Vec<Check> {
    let all: Vec<_> = drives.iter().flatten().collect();
    let right = all.iter().filter(|matched| matched.is_right()).count();
    let worst = all
        .iter()
        .filter(|matched| matched.is_solid_called_sparse())
        .count();
    let strays = all.iter().filter(|matched| matched.shore.is_none()).count();
    let count = Spread::of(drives.iter().map(|drive| drive.len() as f64));
    let stretches = lake.world.shores().len();
    let found = |drive: &Drive| {
        let found: BTreeSet<_> = drive.iter().filter_map(|matched| matched.shore).collect();
        found.len() as f64
    };
    let found = Spread::of(drives.iter().map(found));
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
        Check::gate(
            "clusters of a drive",
            count.text(0, ""),
            format!("≥ {CLUSTERS_MIN}"),
            count.least >= CLUSTERS_MIN,
        ),
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
            found_label(cluster.class).to_owned(),
            matched.truth.map_or("none", true_label).to_owned(),
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
        let parts = drives.iter().map(|drive| {
            let parts = drive.iter().filter(|matched| matched.shore == Some(number));
            parts.count() as f64
        });
        let of_class = |class: ShoreClass| main.iter().filter(|c| c.class == class).count();
        let voxels = Spread::of(main.iter().map(|cluster| f64::from(cluster.voxels)));
        let ratio = Spread::of(main.iter().map(|cluster| cluster.ratio));
        table.push([
            shore.name.clone(),
            true_label(shore.class).to_owned(),
            Spread::of(parts).text(0, ""),
            voxels.text(0, ""),
            ratio.text(2, ""),
            of_class(ShoreClass::Sparse).to_string(),
            of_class(ShoreClass::Dense).to_string(),
            of_class(ShoreClass::Solid).to_string(),
        ]);
    }
    table
}

fn pictures(lake: &WaterWorld) -> Result<Vec<Part>, ExperimentError> {
    let shore = vehicle_config(&lake.world, &[])?.mapping.shore;
    let mut run = lake.run(SEED)?;
    let mut metrics = views::MetricColumns::default();
    let mut parts = Vec::new();
    for sample in 1..=SAMPLES {
        run.advance_to(run.duration_s() * f64::from(sample) / f64::from(SAMPLES))?;
        metrics.gather(&lake.maps(run.pipeline())?, &shore);
        if 2 * sample == SAMPLES {
            let maps = views::octree_and_cost(lake, run.pipeline(), "h4")?;
            parts.push(Part::Pictures(maps));
        }
    }
    let pipeline = run.finish()?;
    let cell_m = lake.maps(&pipeline)?.voxels.octree().cell_m();
    parts.push(Part::Pictures(metrics.pictures(cell_m, "h4")?));
    let caption = "classes and numbers of clusters";
    let shores = views::shores(lake, &pipeline, "h4-shores", caption)?;
    parts.push(Part::Pictures(shores));
    Ok(parts)
}
