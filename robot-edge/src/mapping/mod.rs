//! The mapping core: posed scans in, map cells out.
//!
//! Everything here is a pure function of its inputs: no clock, file, socket, thread or channel, and
//! nothing of the wire. The same scans give the same cells, bit for bit, at any speed and on any platform.

pub mod config;
pub mod occupancy_config;
pub mod posed_scan;

pub mod grid;
pub mod log_odds;
pub mod occupancy_grid;
pub mod ray;
pub mod scan_marks;

use nalgebra::Point3;

use crate::drops::{DropCounts, DropReason};
use grid::TileIndex;
use occupancy_config::OccupancyConfig;
use occupancy_grid::OccupancyGrid;
use posed_scan::PosedScan;

/// All map layers of one vehicle.
#[derive(Clone, Debug)]
pub struct Mapper {
    occupancy: OccupancyGrid,
    vehicle_in_odom: Point3<f64>,
}

/// What became of one scan.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapReport {
    /// Beams that marked a hit.
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    /// Beams that did not reach a layer, by reason.
    pub dropped_beams: DropCounts,
}

impl Mapper {
    /// Empty maps.
    pub fn new(occupancy: &OccupancyConfig) -> Self {
        Self {
            occupancy: OccupancyGrid::new(occupancy),
            vehicle_in_odom: Point3::origin(),
        }
    }

    /// Adds one scan to every layer.
    pub fn integrate(&mut self, scan: &PosedScan) -> MapReport {
        self.vehicle_in_odom = Point3::from(scan.odom_from_base.translation.vector);
        let occupancy = self.occupancy.integrate(scan);

        let mut report = MapReport {
            hits: u64::from(occupancy.hits),
            misses: u64::from(occupancy.misses),
            dropped_beams: DropCounts::default(),
        };
        report
            .dropped_beams
            .add_many(DropReason::OutOfBounds, u64::from(occupancy.out_of_bounds));
        report
    }

    /// Where the vehicle was at the last scan, metres.
    pub const fn vehicle_in_odom(&self) -> Point3<f64> {
        self.vehicle_in_odom
    }

    /// The occupancy grid.
    pub const fn occupancy(&self) -> &OccupancyGrid {
        &self.occupancy
    }

    /// Tiles of the occupancy grid touched since the last call, in tile order.
    pub fn take_changed_occupancy(&mut self) -> Vec<TileIndex> {
        self.occupancy.take_changed()
    }

    /// Keeps every layer within its memory limit; says how many tiles were evicted.
    ///
    /// Call it after the changes were taken and published.
    pub fn keep_limits(&mut self) -> usize {
        self.occupancy.keep_limit(&self.vehicle_in_odom)
    }
}
