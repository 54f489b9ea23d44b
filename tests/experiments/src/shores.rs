//! What the experiments on water share: a world, where `odom` lies in it, how clusters are judged, and pictures as in \[HYB\] figures 8.11 and 8.20.

use std::collections::BTreeMap;

use anyhow::Context as _;
use nalgebra::{Point2, Point3, Vector3};
use protocol::export::Label;
use protocol::layer::LayerId;

use super::pictures::{Image, Picture, elevation, store_of};
use super::run::SimulatedRun;
use super::run::config_by;
use super::session::Rules;
use edge::config::Config;
use edge::runtime::Pipeline;
use mapping::cost_map::CostMap;
use mapping::grid::CellIndex;
use mapping::rigidity::Rigidity;
use mapping::shore::{ShoreClass as Found, ShoreCluster, ShoreConfig};
use mapping::shore_layer::ShoreLayer;
use mapping::voxel_layers::VoxelLayers;
use simulation::world::ShoreClass as Truth;
use simulation::{Motion, SimulationOptions, World};

/// A world with water.
pub(super) struct WaterWorld {
    pub(super) world: World,
    pub(super) config: Config,
    /// Where `odom` has its origin: at the antenna's first fix. Both frames point east and north.
    origin_in_world: Vector3<f64>,
}

/// What is farther from all shores and docks is not shown, metres.
const SHOWN_M: f64 = 20.0;

/// The layers of a boat.
pub(super) struct BoatMaps<'a> {
    pub(super) voxels: &'a VoxelLayers,
    pub(super) cost: &'a CostMap,
    pub(super) shore: &'a ShoreLayer,
}

impl WaterWorld {
    /// The built-in world `name`.
    pub(super) fn load(name: &str, rules: Rules) -> anyhow::Result<Self> {
        Self::of(World::load(name)?, rules)
    }

    pub(super) fn of(world: World, rules: Rules) -> anyhow::Result<Self> {
        let receiver = world.simulated_vehicle().gps.with_context(|| {
            let name = world.name();
            format!("the vehicle of the world `{name}` has no satellite receiver")
        })?;
        let world_from_base = Motion::new(&world).world_from_base(0.0);
        let origin_in_world = (world_from_base * receiver.antenna_m).coords;
        Ok(Self {
            config: config_by(&world, rules, &[])?,
            world,
            origin_in_world,
        })
    }

    /// A run with the vehicle's own configuration: poses from satellites and IMU.
    pub(super) fn run(&self, seed: u64) -> anyhow::Result<SimulatedRun> {
        let options = SimulationOptions {
            seed,
            ..SimulationOptions::default()
        };
        SimulatedRun::new(&self.world, options, &self.config)
    }

    /// Where a point of `odom` is in the world.
    pub(super) fn in_world(&self, in_odom: Point2<f64>) -> Point2<f64> {
        in_odom + self.origin_in_world.xy()
    }

    pub(super) fn point_in_world(&self, in_odom: Point3<f64>) -> Point3<f64> {
        in_odom + self.origin_in_world
    }

    /// Whether a point of the world is near a shore or a dock.
    pub(super) fn is_near(&self, in_world: Point2<f64>) -> bool {
        let shores = self.world.shores().iter().map(|shore| &shore.polygon_m);
        let docks = self.world.docks().iter().map(|dock| &dock.polygon_m);
        let mut corners = shores.chain(docks).flatten();
        corners.any(|corner| (corner - in_world).norm() <= SHOWN_M)
    }

    /// Where a point of the world is in `odom`.
    pub(super) fn in_odom(&self, in_world: Point3<f64>) -> Point3<f64> {
        in_world - self.origin_in_world
    }

    /// The centre of a cell in the world.
    pub(super) fn cell_in_world(&self, cell: CellIndex, cell_m: f64) -> Point2<f64> {
        self.in_world(cell.centre(cell_m))
    }

    /// The layers that a boat maps.
    pub(super) fn maps<'a>(&self, pipeline: &'a Pipeline) -> anyhow::Result<BoatMaps<'a>> {
        let maps = pipeline.mapper().voxels().and_then(|voxels| {
            Some(BoatMaps {
                voxels,
                cost: voxels.cost()?,
                shore: voxels.shore()?,
            })
        });
        maps.with_context(|| {
            let name = self.world.name();
            format!("the vehicle of the world `{name}` maps no shores")
        })
    }
}

/// A cluster and the stretch of shore that most of its columns stand in.
#[derive(Clone, Debug)]
pub(super) struct MatchedCluster {
    pub(super) cluster: ShoreCluster,
    /// Which of the world's shores; `None` where most columns stand in none.
    pub(super) shore: Option<usize>,
    /// What grows there.
    pub(super) truth: Option<Truth>,
}

impl MatchedCluster {
    pub(super) fn of(world: &WaterWorld, cell_m: f64, cluster: &ShoreCluster) -> Self {
        let shores = world.world.shores();
        let mut columns: BTreeMap<Option<usize>, usize> = BTreeMap::new();
        for &cell in &cluster.columns {
            let at = world.cell_in_world(cell, cell_m);
            let shore = shores.iter().position(|shore| shore.contains(at));
            *columns.entry(shore).or_default() += 1;
        }
        let most = columns.into_iter().max_by_key(|(_, columns)| *columns);
        let shore = most.and_then(|(shore, _)| shore);
        Self {
            cluster: cluster.clone(),
            shore,
            truth: shore
                .and_then(|shore| shores.get(shore))
                .map(|shore| shore.class),
        }
    }

    /// Whether it has the class of what grows there.
    pub(super) fn is_right(&self) -> bool {
        let found = match self.cluster.class {
            Found::Sparse => Truth::Sparse,
            Found::Dense => Truth::Dense,
            Found::Solid => Truth::Solid,
        };
        self.truth == Some(found)
    }

    /// The mistake that must never be made.
    pub(super) fn is_solid_called_sparse(&self) -> bool {
        self.truth == Some(Truth::Solid) && self.cluster.class == Found::Sparse
    }
}

/// The cluster of a stretch that most of its voxels are in.
pub(super) fn main_cluster(drive: &[MatchedCluster], stretch: usize) -> Option<&MatchedCluster> {
    let of_stretch = drive
        .iter()
        .filter(|matched| matched.shore == Some(stretch));
    of_stretch.max_by_key(|matched| matched.cluster.voxels)
}

/// What the metrics say of columns of obstacles, gathered while the boat drives: its window leaves them behind.
#[derive(Default)]
pub(super) struct MetricColumns {
    intra: BTreeMap<CellIndex, i32>,
    inter: BTreeMap<CellIndex, i32>,
}

impl MetricColumns {
    /// Takes what is in the window now, in place of what was there.
    pub(super) fn gather(&mut self, maps: &BoatMaps<'_>, shore: &ShoreConfig) {
        let mut votes = Self::default();
        for obstacle in maps.cost.obstacle_voxels(maps.voxels.octree()) {
            let column = obstacle.voxel.column();
            for (votes, label) in [
                (&mut votes.intra, obstacle.by_intra(shore.intra_threshold)),
                (&mut votes.inter, obstacle.by_inter(shore.inter_threshold)),
            ] {
                match label {
                    Rigidity::Rigid => *votes.entry(column).or_default() += 1,
                    Rigidity::Traversable => *votes.entry(column).or_default() -= 1,
                    Rigidity::Unlabelled => {}
                }
            }
        }
        self.intra.extend(votes.intra);
        self.inter.extend(votes.inter);
    }

    /// Of each metric the columns most of whose voxels it calls rigid, and the others.
    pub(super) fn pictures(&self, cell_m: f64, name: &str) -> anyhow::Result<Vec<Picture>> {
        let mut pictures = Vec::new();
        for (votes, metric, caption) in [
            (&self.intra, "intra", "columns by IntraScan alone"),
            (&self.inter, "inter", "columns by InterScan alone"),
        ] {
            let cells = votes.iter().map(|(&cell, &balance)| {
                let code = if balance > 0 { 2 } else { 1 };
                (index(cell), code)
            });
            let store = store_of(LayerId::Rigidity, cell_m, cells)?;
            let palette = LayerId::Rigidity.default_palette();
            let name = format!("{name}-{metric}");
            pictures.extend(Picture::of_layer(&store, palette, None, &name, caption)?);
        }
        Ok(pictures)
    }
}

/// The octree from above, its columns as high as their highest voxel, and the published cost map.
pub(super) fn octree_and_cost(
    world: &WaterWorld,
    pipeline: &Pipeline,
    name: &str,
) -> anyhow::Result<Vec<Picture>> {
    let maps = world.maps(pipeline)?;
    let octree = maps.voxels.octree();
    let mut tops: BTreeMap<CellIndex, i32> = BTreeMap::new();
    for (voxel, _) in octree.occupied() {
        let top = tops.entry(voxel.column()).or_insert(voxel.z);
        *top = (*top).max(voxel.z);
    }
    let near = |cell: CellIndex| {
        let at = world.cell_in_world(cell, octree.cell_m());
        world.is_near(at)
    };
    let water_m = world.in_odom(nalgebra::Point3::origin()).z;
    let quantisation = LayerId::Elevation.quantisation();
    let cells = tops.into_iter().filter(|(cell, _)| near(*cell));
    let cells = cells.map(|(cell, z)| {
        let top_m = f64::from(z + 1) * octree.cell_m() - water_m;
        (index(cell), quantisation.encode(top_m as f32))
    });
    let store = store_of(LayerId::Elevation, octree.cell_m(), cells)?;
    let vehicle = pipeline.mapper().vehicle_in_odom();
    let vehicle_m = Some([vehicle.x, vehicle.y]);
    let palette = elevation().fitted(-3.0, 3.0);
    let octree = Picture::of_layer(
        &store,
        palette,
        vehicle_m,
        &format!("{name}-octree"),
        "the octree from above, heights above the water",
    )?;

    let mut window = Vec::new();
    let (first, width) = maps.cost.cells(&mut window, |cell| *cell);
    let width = i32::try_from(width).unwrap_or(i32::MAX);
    let quantisation = LayerId::Cost.quantisation();
    let cells = (0..).zip(&window).map(|(place, cell)| {
        let at = CellIndex {
            x: first.x + place % width,
            y: first.y + place / width,
        };
        (at, cell)
    });
    let cell_m = maps.voxels.octree().cell_m();
    let cells = cells
        .filter(|(at, cell)| !cell.cost.is_nan() && near(*at))
        .map(|(at, cell)| (index(at), quantisation.encode(cell.cost)));
    let store = store_of(LayerId::Cost, cell_m, cells)?;
    let cost = Picture::of_layer(
        &store,
        LayerId::Cost.default_palette(),
        vehicle_m,
        &format!("{name}-cost"),
        "slope cost around the boat",
    )?;
    Ok(octree.into_iter().chain(cost).collect())
}

/// Classes of clusters and their numbers, and docking sites, as published.
pub(super) fn picture(
    world: &WaterWorld,
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> anyhow::Result<Vec<Picture>> {
    let maps = world.maps(pipeline)?;
    let vehicle = pipeline.mapper().vehicle_in_odom();
    let store = pipeline.publisher().store();
    let mut picture = Picture::of_layer(
        &store,
        LayerId::Shore.default_palette(),
        Some([vehicle.x, vehicle.y]),
        name,
        caption,
    )?;
    if let Some(Picture {
        image: Image::Layer { labels, .. },
        ..
    }) = &mut picture
    {
        labels.extend(maps.shore.clusters().map(|cluster| Label {
            text: cluster.number.to_string(),
            at_m: [cluster.centre_in_odom.x, cluster.centre_in_odom.y],
        }));
    }
    Ok(picture.into_iter().collect())
}

fn index(cell: CellIndex) -> [i64; 2] {
    [cell.x.into(), cell.y.into()]
}

#[cfg(test)]
mod tests {
    use super::super::session::SEED;
    use super::*;
    use mapping::registered_scan::{BeamOutcome, SensorId};
    use mapping::scan_metrics::IntraScan;

    /// Why sonars have no metrics (docs/methods.md, section 5).
    #[test]
    fn a_sonar_hits_only_what_no_hull_meets_and_all_of_it_is_wide() {
        let lake = WaterWorld::load("lake", Rules::Own).unwrap();
        let sonar = SensorId(1);
        let intra = IntraScan::new(&lake.config.mapping.metrics);
        let (mut depths_m, mut values, mut of_scan) = (Vec::new(), Vec::new(), Vec::new());
        let mut run = lake.run(SEED).unwrap();
        run.advance_with(10.0, |_, scan| {
            if scan.sensor == sonar {
                intra.measure(scan, 0.0, &mut of_scan);
                values.extend(of_scan.iter().copied().filter(|value| !value.is_nan()));
                let hits = scan.beams.iter();
                let hits = hits.filter(|beam| beam.outcome == BeamOutcome::Hit);
                depths_m.extend(hits.map(|beam| -lake.point_in_world(beam.end_in_odom).z));
            }
        })
        .unwrap();
        let least_m = depths_m.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(depths_m.len() > 20_000, "{}", depths_m.len());
        assert!(least_m > -lake.config.vehicle.bottom_z_m, "{least_m}");
        let threshold = lake.config.mapping.shore.intra_threshold as f32;
        let rigid = values.iter().filter(|value| **value > threshold).count();
        let share = rigid as f64 / values.len() as f64;
        assert!(share > 0.99, "{share}");
    }
}
