//! The whole way of a scan on the vehicles of \[HYB\]: placing, octree, slope cost, metrics, classes, tiles.

use std::time::Duration;

use anyhow::anyhow;
use edge::export::voxels::{PublishedClasses, pack_voxels};
use experiments::run::{pipeline, vehicle_config};
use mapping::cost_map::Surface;
use mapping::height_columns::{ColumnKind, ColumnRules, read_columns};
use mapping::octree::{BrickColumn, Octree};
use mapping::voxel_layers::VoxelLayers;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, Stream};
use nalgebra::Point3;
use network::clock;
use simulation::{SimulatedSource, SimulationOptions, World};

use super::rays::pool;
use super::rounds::{Rounds, timed, timed_by_the_wall};

/// What a world's sensors say.
struct Drive {
    world: World,
    streams: Vec<Stream>,
    measurements: Vec<Measurement>,
    duration_s: f64,
}

/// What became of one run.
struct Figures {
    scans: u64,
    processor_s: f64,
    elapsed_s: f64,
    /// Elapsed time of each push that mapped a scan, microseconds.
    scan_times_us: Vec<f64>,
    map_mb: f64,
    /// Processor time of reading all columns of the box around where the drive ended.
    columns_ms: f64,
    /// Of `voxels.bt`.
    tree_mb: f64,
    /// Processor time of making and packing both files of the octree.
    files_ms: f64,
}

/// Side of the box whose columns are read, metres.
const BOX_M: f64 = 40.0;
const WORLDS: [&str; 3] = ["meadow", "yard", "lake"];

pub(crate) fn print() -> anyhow::Result<()> {
    println!("a scan's way through the pipeline: placing, octree, cost, metrics, classes, tiles");
    println!(
        "| world | vehicle | threads | scans | × real time (processor) | × real time (elapsed) | p50 ms | p99 ms | octree MB | {BOX_M} m box to columns, ms | voxels.bt MB | both files made and packed, ms |"
    );
    println!("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
    for name in WORLDS {
        let drive = Drive::through(name)?;
        for threads in [1, 2] {
            let figures = drive.map_in(threads)?;
            let scan_times: Rounds = figures.scan_times_us.iter().copied().collect();
            println!(
                "| {name} | {} | {threads} | {} | {:.1} | {:.1} | {:.2} | {:.2} | {:.1} | {:.1} | {:.1} | {:.0} |",
                drive.world.vehicle(),
                figures.scans,
                drive.duration_s / figures.processor_s,
                drive.duration_s / figures.elapsed_s,
                scan_times.median() / 1e3,
                scan_times.quantile(0.99) / 1e3,
                figures.map_mb,
                figures.columns_ms,
                figures.tree_mb,
                figures.files_ms
            );
        }
    }
    Ok(())
}

/// The same drive again and again, as one run of more than 100,000 scans.
pub(crate) fn print_endurance() -> anyhow::Result<()> {
    println!("cost of a scan in a long run: the drive through the yard, repeated");
    let drive = Drive::through("yard")?;
    let figures = drive.map(1, 81)?;
    println!("| scans | mean ms | p50 ms | p99 ms |");
    println!("| ---: | ---: | ---: | ---: |");
    // A whole drive each, so that the same scans are compared.
    let a_drive = figures.scan_times_us.len() / 81;
    for first in [0, 1, 9, 79, 80] {
        let part = &figures.scan_times_us[first * a_drive..(first + 1) * a_drive];
        let scan_times: Rounds = part.iter().copied().collect();
        let mean_us = part.iter().sum::<f64>() / part.len() as f64;
        println!(
            "| {} … {} | {:.2} | {:.2} | {:.2} |",
            first * a_drive,
            (first + 1) * a_drive,
            mean_us / 1e3,
            scan_times.median() / 1e3,
            scan_times.quantile(0.99) / 1e3
        );
    }
    println!("octree at the end: {:.1} MB", figures.map_mb);
    Ok(())
}

impl Drive {
    fn through(name: &str) -> anyhow::Result<Self> {
        let world = World::load(name)?;
        let options = SimulationOptions {
            seed: 1,
            ..SimulationOptions::default()
        };
        let mut source = SimulatedSource::new(&world, options)?;
        let measurements = std::iter::from_fn(|| source.next_measurement()).collect();
        Ok(Self {
            streams: source.streams().to_vec(),
            duration_s: source.duration_s(),
            world,
            measurements,
        })
    }

    /// In a thread that can be one of those that share the work.
    fn map_in(&self, threads: usize) -> anyhow::Result<Figures> {
        std::thread::scope(|scope| {
            let mapping = scope.spawn(|| {
                let _pool = (threads > 1).then(|| pool(threads)).transpose()?;
                self.map(threads, 1)
            });
            mapping
                .join()
                .map_err(|_panic| anyhow!("the mapping thread failed"))?
        })
    }

    fn map(&self, threads: usize, times: u32) -> anyhow::Result<Figures> {
        let threads = format!("mapping.threads={threads}");
        let config = vehicle_config(&self.world, &["localization.source=odometry", &threads])?;
        let mut pipeline = pipeline(&config, &self.streams)?;
        let (mut scan_times, mut end) = (Vec::new(), None);
        let again = RobotDuration::from_secs_f64(self.duration_s + 1.0);
        let mut late = RobotDuration::ZERO;
        let mut run = || -> anyhow::Result<()> {
            for _ in 0..times {
                for measurement in &self.measurements {
                    let mut measurement = measurement.clone();
                    measurement.stamp = measurement.stamp + late;
                    let (started, mut mapped) = (clock::now(), 0);
                    for scan in pipeline.push(measurement)? {
                        mapped += 1;
                        end = Some(Point3::from(scan.odom_from_base.translation.vector));
                    }
                    let scan_time: Duration = clock::elapsed(started);
                    if mapped > 0 {
                        scan_times.push(scan_time.as_secs_f64() * 1e6);
                    }
                }
                late = late + again;
            }
            Ok(())
        };
        let ((result, elapsed_s), processor_s) = timed(|| timed_by_the_wall(&mut run));
        result?;
        let octree = pipeline.mapper().voxels().map(VoxelLayers::octree);
        let columns_ms = octree.zip(end).map_or(f64::NAN, |(octree, end)| {
            1e3 * timed(|| read_box(octree, end)).1
        });
        let classes = PublishedClasses::of(&pipeline.publisher().store());
        let (files, files_s) =
            timed(|| octree.map(|octree| pack_voxels(RobotTime::from_nanos(0), octree, &classes)));
        let tree_bytes = files.transpose()?.map_or(0, |made| made.files[0].bytes);
        Ok(Figures {
            scans: pipeline.report().scans_mapped,
            processor_s,
            elapsed_s,
            scan_times_us: scan_times,
            map_mb: octree.map_or(0, Octree::bytes) as f64 / 1e6,
            columns_ms,
            tree_mb: tree_bytes as f64 / 1e6,
            files_ms: 1e3 * files_s,
        })
    }
}

/// Ground and top of every column of the box around a vehicle on land.
fn read_box(octree: &Octree, vehicle: Point3<f64>) -> usize {
    let [x, y, z] = [vehicle.x, vehicle.y, vehicle.z].map(|m| (m / octree.cell_m()) as i32);
    let reach = (4.0 / octree.cell_m()) as i32;
    let rules = ColumnRules {
        surface: Surface::Land,
        from_z: z - reach,
        to_z: z + reach,
        deck_z: z,
        water_z: z - reach,
        height: (0.7 / octree.cell_m()) as i32,
    };
    let half = (0.5 * BOX_M / octree.cell_m()) as i32 / 4;
    let bricks = (-half..half).flat_map(|dy| (-half..half).map(move |dx| [dx, dy]));
    bricks
        .flat_map(|[dx, dy]| {
            let at = BrickColumn {
                x: x / 4 + dx,
                y: y / 4 + dy,
            };
            read_columns(octree, at, &rules)
        })
        .filter(|column| column.kind != ColumnKind::Unknown)
        .count()
}
