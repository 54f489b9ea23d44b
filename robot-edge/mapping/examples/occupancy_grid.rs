//! Adds one synthetic scan of a square room to an occupancy grid and prints the grid.
//!
//! `cargo run -p mapping --example occupancy_grid`
#![expect(clippy::print_stdout, reason = "the output of the example")]

use mapping::grid::CellIndex;
use mapping::occupancy_grid::{OccupancyConfig, OccupancyGrid};
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use measurement::{pose, time::RobotTime};
use nalgebra::Point3;

fn main() {
    let beams = (0..360).map(|index: u32| {
        let (sin, cos) = libm::sincos(f64::from(index).to_radians());
        let range_m = 2.1 / sin.abs().max(cos.abs()); // four walls at 2.1 m
        RegisteredBeam {
            origin_in_odom: Point3::origin(),
            end_in_odom: Point3::new(range_m * cos, range_m * sin, 0.0),
            outcome: BeamOutcome::Hit,
            index,
            range_m: range_m as f32,
        }
    });
    let scan = RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: f64::to_radians(1.0),
        odom_from_base: pose::planar(0.0, 0.0, 0.0),
        kind: ScanKind::Beams,
        own_body_hits: 0,
        beams: beams.collect(),
    };
    let mut grid = OccupancyGrid::new(&OccupancyConfig {
        cell_m: 0.2,
        ..OccupancyConfig::default()
    });
    grid.integrate(&scan);
    for y in (-12..12).rev() {
        let symbol = |x| match grid.cell(CellIndex { x, y }).probability() {
            None => ' ',
            Some(p) if p > 0.5 => '#',
            Some(_) => '.',
        };
        println!("{}", (-12..12).map(symbol).collect::<String>());
    }
}
