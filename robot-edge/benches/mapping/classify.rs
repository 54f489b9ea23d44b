//! What telling obstacles apart costs: votes, clusters, shores and docking sites of maps that are made up.

use mapping::clustering::euclidean_clusters;
use mapping::docking::{BoatFootprint, DockingColumn, find_docking_sites};
use mapping::grid::CellIndex;
use mapping::grid::VoxelIndex;
use mapping::rigidity::RigidityMap;
use mapping::rigidity::majority_vote;
use mapping::rigidity::{ObstacleVoxel, Rigidity};
use mapping::rigidity::{RigidityConfig, RigidityRule};
use mapping::shore::ShoreConfig;
use mapping::shore::Shores;

use crate::rounds::{ROUNDS, Rounds, timed};

/// Voxels of a map, about as many as \[HYB\] clustered.
const VOXELS: usize = 67_000;
/// Cells along an edge of riverwatch's box, 160 m.
const SIDE: i32 = 533;
const CELL_M: f64 = 0.3;

/// One row per part and map.
#[expect(clippy::unnecessary_wraps, reason = "parts of the bench may fail")]
pub(crate) fn print() -> anyhow::Result<()> {
    println!("obstacles of {VOXELS} voxels of {CELL_M} m in a box of 160 m: ms");
    println!("| part | on a shore | scattered |");
    println!("| --- | ---: | ---: |");
    let maps = [shore(), scattered()];
    row(&maps, "majority vote", |map| {
        let voted = majority_vote(&map.voxels, &map.labels);
        let rigid = voted.iter().filter(|label| **label == Rigidity::Rigid);
        rigid.count()
    });
    row(&maps, "clusters at 3 m", |map| {
        let clusters = euclidean_clusters(&map.voxels, CELL_M, 3.0);
        clusters.iter().max().map_or(0, |last| *last as usize + 1)
    });
    for (part, rule) in [
        ("rigidity by width", RigidityRule::Width),
        ("rigidity by both metrics", RigidityRule::Metrics),
    ] {
        let config = RigidityConfig {
            rule,
            ..RigidityConfig::default()
        };
        row(&maps, part, |map| {
            RigidityMap::of(&map.obstacles, &config).columns.len()
        });
    }
    row(&maps, "shores", |map| {
        Shores::new(&ShoreConfig::default(), CELL_M)
            .update(&map.obstacles)
            .clusters
            .len()
    });
    row(&maps, "docking sites", |map| {
        let first = CellIndex { x: 0, y: 0 };
        let boat = BoatFootprint {
            length_m: 4.5,
            width_m: 2.44,
        };
        find_docking_sites(first, SIDE as usize, CELL_M, &map.columns, &boat).len()
    });
    Ok(())
}

struct Map {
    voxels: Vec<VoxelIndex>,
    labels: Vec<Rigidity>,
    obstacles: Vec<ObstacleVoxel>,
    columns: Vec<DockingColumn>,
}

fn row(maps: &[Map; 2], part: &str, work: impl Fn(&Map) -> usize) {
    let figures = maps.each_ref().map(|map| {
        let round = |_| timed(|| work(map));
        let rounds: Vec<_> = (0..ROUNDS).map(round).collect();
        let found = rounds.first().map_or(0, |(found, _)| *found);
        let ms: Rounds = rounds.iter().map(|(_, seconds)| 1e3 * seconds).collect();
        format!("{ms:.1}, {found} found")
    });
    println!("| {part} | {} | {} |", figures[0], figures[1]);
}

/// The rim of a lake, 3 m deep and up to 2.7 m high, with gaps.
fn shore() -> Map {
    let middle = 0.5 * f64::from(SIDE);
    map(|x, y, height| {
        let (dx, dy) = (f64::from(x) - middle, f64::from(y) - middle);
        let radius = (dx * dx + dy * dy).sqrt();
        // Wider than the tolerance of clusters.
        let is_gap = (x + y) % 75 < 16;
        (150.0..180.0).contains(&radius) && !is_gap && height < 3.0 + (radius - 150.0) / 5.0
    })
}

/// As many anywhere in the box.
fn scattered() -> Map {
    let mut state = 1_u64;
    map(|_, _, _| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        state >> 32 < (1 << 32) / 37
    })
}

fn map(mut is_occupied: impl FnMut(i32, i32, f64) -> bool) -> Map {
    let columns = (0..SIDE).flat_map(|x| (0..SIDE).map(move |y| (x, y)));
    let all = columns.flat_map(|(x, y)| (0..9).map(move |z| VoxelIndex { x, y, z }));
    let occupied = all.filter(|voxel| is_occupied(voxel.x, voxel.y, voxel.z.into()));
    let voxels: Vec<_> = occupied.take(VOXELS).collect();
    // Patches of either label, with noise.
    let is_rigid = |voxel: &VoxelIndex| {
        let patch = (voxel.x / 30 + voxel.y / 30) % 2 == 0;
        patch != ((voxel.x * 7 + voxel.y * 13 + voxel.z * 5) % 6 == 0)
    };
    let obstacles = voxels.iter().map(|voxel| ObstacleVoxel {
        voxel: *voxel,
        intra: Some(if is_rigid(voxel) { 0.3 } else { 0.01 }),
        inter: Some(if is_rigid(voxel) { 0.1 } else { 0.9 }),
    });
    let labels = voxels.iter().map(|voxel| {
        if is_rigid(voxel) {
            Rigidity::Rigid
        } else {
            Rigidity::Traversable
        }
    });
    // Gentle ground around water, but where there are obstacles.
    let middle = SIDE / 2;
    let columns = (0..SIDE * SIDE).map(|at| {
        let (dx, dy) = (at % SIDE - middle, at / SIDE - middle);
        let is_clear_water = dx * dx + dy * dy < 150 * 150;
        let cost = if is_clear_water { 0.0 } else { 0.5 };
        DockingColumn {
            cost,
            is_clear_water,
            rises_from_water: !is_clear_water,
            vegetation: None,
        }
    });
    let mut columns: Vec<_> = columns.collect();
    for voxel in &voxels {
        let column = &mut columns[(voxel.y * SIDE + voxel.x) as usize];
        column.cost = 1.0;
        column.is_clear_water = false;
        column.rises_from_water = true;
    }
    Map {
        labels: labels.collect(),
        obstacles: obstacles.collect(),
        columns,
        voxels,
    }
}
