//! Comparison of two maps of one drive with each other, and of a map and its poses with the simulated world.

use std::collections::BTreeMap;

use edge::config::Config;
use edge::runtime::Pipeline;
use experiments::run::{pipeline, vehicle_config};
use measurement::pose::Pose;
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData, Stream};
use nalgebra::{Point2, Point3, Vector3};
use protocol::layer::{LayerId, UNKNOWN};
use protocol::tile::TILE_SIDE;
use simulation::World;
use simulation::source::START;

use super::Vehicle;

/// The map of one series of measurements, and the newest pose after each of them.
pub(super) struct Mapped {
    config: Config,
    pipeline: Pipeline,
    poses: BTreeMap<RobotTime, Pose>,
}

impl Mapped {
    /// `poses` is the source of the poses.
    pub(super) fn of(
        vehicle: &Vehicle,
        streams: &[Stream],
        poses: &str,
        measurements: Vec<Measurement>,
    ) -> Self {
        let source = format!("localization.source={poses}");
        let settings: Vec<&str> = vehicle.settings.iter().copied().chain([&*source]).collect();
        let config = vehicle_config(&vehicle.world, &settings).unwrap();
        let mut pipeline = pipeline(&config, streams).unwrap();
        let mut poses = BTreeMap::new();
        for measurement in measurements {
            pipeline.push(measurement).unwrap();
            poses.extend(pipeline.registration().newest_pose());
        }
        pipeline.finish().unwrap();
        Self {
            config,
            pipeline,
            poses,
        }
    }

    fn layers(&self) -> Vec<LayerId> {
        let store = self.pipeline.publisher().store();
        store.grids().map(|grid| grid.layer).collect()
    }

    /// Values of the known cells of a layer.
    fn cells(&self, layer: LayerId) -> BTreeMap<[i64; 2], f64> {
        let value = |code: u16| f64::from(layer.quantisation().decode(code).unwrap());
        let store = self.pipeline.publisher().store();
        let mut known = BTreeMap::new();
        for (key, tile) in store.tiles(layer) {
            let (first_x, first_y) = key.first_cell();
            let Some(cells) = tile.cells() else { continue };
            for (row, y) in cells.codes().chunks_exact(TILE_SIDE).zip(first_y..) {
                let row = row
                    .iter()
                    .zip(first_x..)
                    .filter(|(code, _)| **code != UNKNOWN);
                known.extend(row.map(|(code, x)| ([x, y], value(*code))));
            }
        }
        known
    }

    /// Class and centre of every shore.
    fn shores(&self) -> Vec<(String, Point3<f64>)> {
        let mut shores = Vec::new();
        if let Some(voxels) = self.pipeline.mapper().voxels()
            && let Some(shore) = voxels.shore()
        {
            let clusters = shore.clusters();
            shores.extend(clusters.map(|it| (format!("{:?}", it.class), it.centre_in_odom)));
        }
        shores
    }
}

/// Percentage of agreeing cells among those that either map knows. Classes agree if they are the same, heights if they
/// differ by at most 10 mm, and slope costs if they differ by at most the cost of a step of 10 mm over a cell's width.
fn agreement_percent(layer: LayerId, a: &Mapped, b: &Mapped) -> f64 {
    const HEIGHT_M: f64 = 0.01;
    let cost = &a.config.mapping.cost;
    let most = match layer {
        LayerId::Elevation | LayerId::Depth => HEIGHT_M,
        LayerId::Cost => {
            HEIGHT_M
                / a.config.mapping.octree.cell_m
                / nalgebra::ComplexField::tan(cost.critical_slope_deg.to_radians())
        }
        LayerId::Occupancy
        | LayerId::Obstacle
        | LayerId::Rigidity
        | LayerId::Shore
        | LayerId::Intra
        | LayerId::Inter => 0.0,
    };
    let (a, b) = (a.cells(layer), b.cells(layer));
    let in_both = a
        .iter()
        .filter_map(|(cell, value)| Some((value - b.get(cell)?).abs()));
    let differences: Vec<f64> = in_both.collect();
    let agree = differences
        .iter()
        .filter(|difference| **difference <= most + 1e-6);
    let exact = differences.iter().filter(|difference| **difference <= 0.0);
    let union = a.len() + b.len() - differences.len();
    let percent = |count: usize| 100.0 * count as f64 / union as f64;
    let (agree, exact) = (percent(agree.count()), percent(exact.count()));
    println!(
        "{layer}: {agree:.3} % of {union} cells agree within {most:.3}, {exact:.3} % are the same, {} known in one only",
        union - differences.len()
    );
    agree
}

/// At least 99.5 % of the cells of each layer agree, and the shores have the same classes.
#[track_caller]
pub(super) fn assert_same_maps(direct: &Mapped, emulated: &Mapped) {
    let layers = direct.layers();
    assert_eq!(layers, emulated.layers());
    let percents: Vec<f64> = layers
        .iter()
        .map(|layer| agreement_percent(*layer, direct, emulated))
        .collect();
    let shores = [direct, emulated].map(Mapped::shores);
    println!("shores {shores:?}");
    for (layer, percent) in layers.iter().zip(percents) {
        assert!(percent >= 99.5, "{layer:?}: {percent} %");
    }
    let [direct, emulated] = shores.map(|shores| {
        shores
            .into_iter()
            .map(|(class, _)| class)
            .collect::<Vec<_>>()
    });
    assert_eq!(direct, emulated);
}

/// The true position at this time, interpolated.
fn truth_at(truth: &BTreeMap<RobotTime, Vector3<f64>>, at: RobotTime) -> Option<Vector3<f64>> {
    let (from, before) = truth.range(..=at).next_back()?;
    let (to, after) = truth.range(at..).next()?;
    let whole = to.since(*from).as_secs_f64();
    let share = if whole > 0.0 {
        at.since(*from).as_secs_f64() / whole
    } else {
        0.0
    };
    Some(before + share * (after - before))
}

/// How far poses are from the truth.
pub(super) struct PoseErrors {
    /// The mean error of the first 2 s. It is due to where the poses have their frame, so the other errors are without
    /// it.
    pub(super) frame_m: Vector3<f64>,
    pub(super) end_m: f64,
    pub(super) worst_m: f64,
    /// Length of the way that the vehicle drove.
    pub(super) way_m: f64,
}

/// The errors of a map's poses; the true ones are among the simulation's own measurements.
pub(super) fn pose_errors(direct: &[Measurement], mapped: &Mapped) -> PoseErrors {
    let truth: BTreeMap<_, _> = direct
        .iter()
        .filter_map(|it| match &it.data {
            MeasurementData::Odometry { odom_from_base, .. } => {
                Some((it.stamp, odom_from_base.translation.vector))
            }
            _ => None,
        })
        .collect();
    let places: Vec<_> = truth.values().collect();
    let way_m = places
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).xy().norm())
        .sum();
    let errors = mapped.poses.iter().filter_map(|(stamp, pose)| {
        let truth_m = truth_at(&truth, *stamp)?;
        Some((*stamp, pose.translation.vector - truth_m))
    });
    let errors: Vec<(RobotTime, Vector3<f64>)> = errors.collect();
    let standing = errors
        .iter()
        .filter(|(stamp, _)| stamp.since(START).as_secs_f64() < 2.0);
    let standing: Vec<_> = standing.map(|(_, error)| *error).collect();
    let frame_m = standing.iter().sum::<Vector3<f64>>() / standing.len() as f64;
    let off_m = |(_, error): &(RobotTime, Vector3<f64>)| (error - frame_m).xy().norm();
    PoseErrors {
        frame_m,
        end_m: errors.last().map(off_m).unwrap(),
        worst_m: errors.iter().map(off_m).fold(0.0, f64::max),
        way_m,
    }
}

/// Percentage of a map's occupied voxels, or of its heights if it has no voxels, that are true in the world. A point of
/// the map minus `frame_m` is the point of the world.
pub(super) fn truth_percent(world: &World, mapped: &Mapped, frame_m: Vector3<f64>) -> f64 {
    const NOISE_M: f64 = 0.03;
    let scene = world.scene();
    let (mut right, mut all) = (0_u32, 0_u32);
    if let Some(voxels) = mapped.pipeline.mapper().voxels() {
        let octree = voxels.octree();
        let cell_m = octree.cell_m();
        for (voxel, _) in octree.occupied() {
            let corner = |offset: f64| {
                let at = [voxel.x, voxel.y, voxel.z].map(|n| (f64::from(n) + offset) * cell_m);
                Point3::from(at) - frame_m
            };
            let [min, max] = [corner(-0.5), corner(1.5)];
            let grows = || {
                scene
                    .growth()
                    .is_some_and(|it| it.vegetation.standing_in(min, max).is_some())
            };
            all += 1;
            right += u32::from(scene.touches_box(min, max, 0.0) || grows());
        }
    } else {
        let store = mapped.pipeline.publisher().store();
        let cell_m = store.cell_m(LayerId::Elevation).unwrap();
        drop(store);
        for ([x, y], height_m) in mapped.cells(LayerId::Elevation) {
            // 25 points of the cell, its edges included.
            let parts = (0..5).flat_map(|j| (0..5).map(move |i| [f64::from(i), f64::from(j)]));
            let tops = parts.filter_map(|part| {
                let at = [x as f64 + 0.25 * part[0], y as f64 + 0.25 * part[1]];
                let at = Point2::new(at[0] * cell_m, at[1] * cell_m) - frame_m.xy();
                scene.height_m(at, 0.0)
            });
            let tops: Vec<f64> = tops.collect();
            let least_m = tops.iter().copied().fold(f64::INFINITY, f64::min) - NOISE_M;
            let most_m = tops.iter().copied().fold(f64::NEG_INFINITY, f64::max) + NOISE_M;
            all += 1;
            right += u32::from((least_m..=most_m).contains(&height_m));
        }
    }
    100.0 * f64::from(right) / f64::from(all)
}
