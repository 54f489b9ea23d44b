//! Pictures of what a boat maps, as the document shows them (\[HYB\] figures 8.11 and 8.20).

use std::collections::BTreeMap;

use protocol::export::Label;
use protocol::layer::LayerId;

use super::{BoatMaps, WaterWorld};
use crate::ExperimentError;
use crate::pictures::{Image, Picture, elevation, store_of};
use edge::runtime::Pipeline;
use mapping::grid::CellIndex;
use mapping::rigidity::Rigidity;
use mapping::shore::ShoreConfig;

/// What the metrics say of columns of obstacles, gathered while the boat drives: its window leaves them behind.
#[derive(Default)]
pub(crate) struct MetricColumns {
    intra: BTreeMap<CellIndex, i32>,
    inter: BTreeMap<CellIndex, i32>,
}

impl MetricColumns {
    /// Takes what is in the window now, in place of what was there.
    pub(crate) fn gather(&mut self, maps: &BoatMaps<'_>, shore: &ShoreConfig) {
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
    pub(crate) fn pictures(
        &self,
        cell_m: f64,
        name: &str,
    ) -> Result<Vec<Picture>, ExperimentError> {
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
pub(crate) fn octree_and_cost(
    world: &WaterWorld,
    pipeline: &Pipeline,
    name: &str,
) -> Result<Vec<Picture>, ExperimentError> {
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

    let (first, width, window) = maps.cost.cells();
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
pub(crate) fn shores(
    world: &WaterWorld,
    pipeline: &Pipeline,
    name: &str,
    caption: &str,
) -> Result<Vec<Picture>, ExperimentError> {
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
