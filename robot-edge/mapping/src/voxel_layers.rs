//! Layers from 3D sensors: octree, cost map with rigidity and metrics, depth, shores
//! (docs/methods.md, sections 3 to 6).

use std::sync::Arc;

use measurement::time::{RobotDuration, RobotTime};
use nalgebra::Point3;

use crate::MappingConfig;
use crate::cost_map::{CostMap, Surface};
use crate::depth::DepthMap;
use crate::octree::{BlockFile, LimitedBricks, Octree, RangeSensorModel, Ray, SurfaceHit};
use crate::radial_filter::RadialFilter;
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind};
use crate::scan_metrics::{InterScan, IntraScan};
use crate::shore_layer::ShoreLayer;
use crate::vehicle::VehicleShape;

/// Octree of one vehicle and the maps derived from it.
#[derive(Clone, Debug)]
pub struct VoxelLayers {
    octree: Octree,
    sensors: Vec<RangeSensorModel>,
    filter: RadialFilter,
    isolated: Vec<bool>,
    intra: IntraScan,
    inter: InterScan,
    metrics: Metrics,
    weights: [f32; 2],
    cost: Option<CostMap>,
    cost_timer: UpdateTimer,
    shore: Option<ShoreLayer>,
    shore_timer: UpdateTimer,
    /// Boats with a sonar.
    depth: Option<DepthMap>,
    vehicle_in_odom: Point3<f64>,
    /// Boats only.
    waterline: Option<Waterline>,
    epoch: u32,
    threads: usize,
}

/// Metrics of each beam of the current scan; NaN without.
#[derive(Clone, Debug, Default)]
struct Metrics {
    intra: Vec<f32>,
    inter: Vec<f32>,
}

/// Result of one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoxelReport {
    /// Beams that marked a hit.
    pub hits: u32,
    /// Beams without a return.
    pub misses: u32,
    /// Hits removed by the radial filter.
    pub isolated: u32,
    /// Beams outside of the range of the map.
    pub out_of_bounds: u32,
    /// What the memory limit did.
    pub limited: LimitedBricks,
}

/// Periodic update in time of the data.
#[derive(Clone, Copy, Debug)]
struct UpdateTimer {
    period: RobotDuration,
    last: Option<RobotTime>,
}

impl VoxelLayers {
    /// Empty maps; the settings must be valid. `sensors` are in the order of
    /// [`crate::registered_scan::SensorId`].
    pub fn new(
        config: &MappingConfig,
        vehicle: VehicleShape,
        sensors: &[RangeSensorModel],
    ) -> Self {
        let cell_m = config.octree.cell_m;
        let cost = &config.cost;
        Self {
            octree: Octree::new(&config.octree, sensors, config.threads),
            sensors: sensors.to_vec(),
            filter: RadialFilter::default(),
            isolated: Vec::new(),
            intra: config.rigidity.intra_scan(&config.metrics),
            inter: InterScan::new(&config.metrics),
            metrics: Metrics::default(),
            weights: [config.metrics.intra_weight, config.metrics.inter_weight]
                .map(|weight| weight as f32),
            cost: cost.enabled.then(|| {
                // The metrics are those of which classes are made.
                let maps_metrics = config.rigidity.enabled || config.shore.enabled;
                let cells = (cell_m, maps_metrics);
                CostMap::new(cost, &config.rigidity, vehicle, cells, config.threads)
            }),
            cost_timer: UpdateTimer::every(cost.period_s),
            shore: config
                .shore
                .enabled
                .then(|| ShoreLayer::new(&config.shore, vehicle, cell_m)),
            shore_timer: UpdateTimer::every(config.shore.period_s),
            vehicle_in_odom: Point3::origin(),
            waterline: (cost.enabled && cost.surface == Surface::Water).then(Waterline::default),
            depth: config.maps_depth(sensors).then(|| DepthMap::new(cell_m)),
            epoch: 0,
            threads: config.threads,
        }
    }

    /// Adds one scan, and updates the derived maps if they are due: shores in parts, one each scan of a laser.
    pub fn integrate(&mut self, scan: &RegisteredScan) -> VoxelReport {
        self.vehicle_in_odom = Point3::from(scan.odom_from_base.translation.vector);
        let model = self
            .sensors
            .get(usize::from(scan.sensor.0))
            .copied()
            .unwrap_or_default();
        self.filter
            .isolated(scan, model.min_neighbours, &mut self.isolated);
        if let Some(waterline) = &mut self.waterline {
            waterline.observe(self.vehicle_in_odom.z);
        }
        // Lasers have metrics, and end at the water; sonars measure in it.
        let waterline = self.waterline.filter(|_| model.has_metrics);
        let end = |beam: &RegisteredBeam| match (beam.outcome, waterline) {
            (BeamOutcome::Miss, Some(waterline)) => {
                waterline.end_of_miss(beam.origin_in_odom, beam.end_in_odom)
            }
            (BeamOutcome::Miss | BeamOutcome::Hit, _) => beam.end_in_odom,
        };
        let beams = scan.beams.iter().zip(&self.isolated);
        let rays = beams
            .filter(|(_, isolated)| !**isolated)
            .map(|(beam, _)| Ray {
                origin: beam.origin_in_odom,
                end: end(beam),
                is_hit: beam.outcome == BeamOutcome::Hit,
            });
        let octree = &mut self.octree;
        let integrate = || match scan.kind {
            ScanKind::Cloud => octree.integrate_cloud(scan.sensor, rays),
            ScanKind::Beams | ScanKind::Arc | ScanKind::Contact { .. } => {
                octree.integrate(scan.sensor, rays)
            }
        };
        // Other sensors' scans come right after a laser's: they would not spread the work over time.
        let shore = self.shore.as_mut().filter(|_| model.has_metrics);
        let out_of_bounds = match shore {
            Some(shore) if self.threads > 1 && shore.is_updating() => {
                rayon::join(integrate, || shore.continue_update()).0
            }
            Some(shore) => {
                shore.continue_update();
                integrate()
            }
            None => integrate(),
        };
        let water_m = self.waterline.and_then(|waterline| waterline.height_m);
        if let (Some(depth), Some(water_m), false) = (&mut self.depth, water_m, model.has_metrics) {
            let beams = scan.beams.iter().zip(&self.isolated);
            let hits =
                beams.filter(|(beam, isolated)| beam.outcome == BeamOutcome::Hit && !**isolated);
            let hits = hits.map(|(beam, _)| beam.end_in_odom);
            depth.add_ping(hits, water_m, self.vehicle_in_odom);
        }
        if self.cost.is_some() {
            self.add_surfaces(scan, model);
            if let (Some(shore), Some(water_m), true) =
                (&mut self.shore, water_m, model.has_metrics)
            {
                shore.add_scan(scan, model.divergence_rad, water_m);
            }
            if self.cost_timer.is_due(scan.stamp) {
                self.update_cost();
            }
            if let (Some(cost), Some(shore)) = (&self.cost, &mut self.shore)
                && self.shore_timer.is_due(scan.stamp)
            {
                shore.begin_update(cost, &self.octree, self.vehicle_in_odom.xy());
            }
        } else {
            // Discarded: no layer uses them.
            self.octree.take_changed();
        }
        let is_hit = |outcome| outcome == BeamOutcome::Hit;
        let hits = scan
            .beams
            .iter()
            .filter(|beam| is_hit(beam.outcome))
            .count() as u32;
        let isolated = self.isolated.iter().filter(|isolated| **isolated).count() as u32;
        VoxelReport {
            hits: hits - isolated,
            misses: scan.beams.len() as u32 - hits,
            isolated,
            out_of_bounds,
            limited: self.octree.enforce_memory_limit(self.vehicle_in_odom),
        }
    }

    /// Updates all derived maps, whether or not they are due.
    pub fn refresh(&mut self) {
        self.update_cost();
        if let (Some(cost), Some(shore)) = (&self.cost, &mut self.shore) {
            shore.update(cost, &self.octree, self.vehicle_in_odom.xy());
        }
    }

    /// Erases everything.
    pub fn reset(&mut self) {
        self.octree.erase();
        self.filter.reset();
        self.inter.reset();
        self.waterline = self.waterline.map(|_| Waterline::default());
        self.cost_timer.last = None;
        self.shore_timer.last = None;
        if let Some(cost) = &mut self.cost {
            cost.erase();
        }
        if let Some(shore) = &mut self.shore {
            shore.erase();
        }
        if let Some(depth) = &mut self.depth {
            depth.erase();
        }
        self.epoch += 1;
    }

    /// Number of erasures.
    pub const fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Keeps in `file` what the octree has no memory for.
    pub fn keep_on_disk(&mut self, file: &Arc<dyn BlockFile>) {
        self.octree.keep_on_disk(file);
    }

    /// The octree.
    pub const fn octree(&self) -> &Octree {
        &self.octree
    }

    /// `None` if disabled.
    pub const fn cost(&self) -> Option<&CostMap> {
        self.cost.as_ref()
    }

    /// For taking its changes.
    pub const fn cost_mut(&mut self) -> Option<&mut CostMap> {
        self.cost.as_mut()
    }

    /// Whether the metrics of the cost map's cells are layers: where a class is made of them.
    pub fn maps_metrics(&self) -> bool {
        self.cost.as_ref().is_some_and(CostMap::maps_metrics)
    }

    /// `None` on land and without a sonar.
    pub const fn depth(&self) -> Option<&DepthMap> {
        self.depth.as_ref()
    }

    /// For taking its changes.
    pub const fn depth_mut(&mut self) -> Option<&mut DepthMap> {
        self.depth.as_mut()
    }

    /// `None` if disabled.
    pub const fn shore(&self) -> Option<&ShoreLayer> {
        self.shore.as_ref()
    }

    /// For taking its changes.
    pub const fn shore_mut(&mut self) -> Option<&mut ShoreLayer> {
        self.shore.as_mut()
    }

    fn add_surfaces(&mut self, scan: &RegisteredScan, model: RangeSensorModel) {
        let spread = libm::tan(0.5 * model.divergence_rad) as f32;
        let Metrics { intra, inter } = &mut self.metrics;
        if model.has_metrics {
            self.intra.measure(scan, model.divergence_rad, intra);
            self.inter.measure(scan, inter);
        } else {
            for metric in [&mut *intra, &mut *inter] {
                metric.clear();
                metric.resize(scan.beams.len(), f32::NAN);
            }
        }
        let metrics = intra.iter().zip(inter.iter());
        let hits = scan.beams.iter().zip(&self.isolated).zip(metrics);
        let hits =
            hits.filter(|((beam, isolated), _)| beam.outcome == BeamOutcome::Hit && !**isolated);
        let hits = hits.map(|((beam, _), (&intra, &inter))| SurfaceHit {
            point: beam.end_in_odom,
            spot_m: beam.range_m * spread,
            intra,
            inter,
        });
        self.octree.add_surfaces(hits, self.weights);
    }

    fn update_cost(&mut self) {
        if let Some(cost) = &mut self.cost {
            cost.update(&mut self.octree, self.vehicle_in_odom);
        }
    }
}

impl UpdateTimer {
    fn every(period_s: f64) -> Self {
        Self {
            period: RobotDuration::from_secs_f64(period_s),
            last: None,
        }
    }

    /// Returns whether an update is due, and restarts the period if so. A clock that went back
    /// makes it due.
    fn is_due(&mut self, now: RobotTime) -> bool {
        let is_due = self
            .last
            .is_none_or(|last| now < last || now.since(last) >= self.period);
        if is_due {
            self.last = Some(now);
        }
        is_due
    }
}

/// Weight of a scan in the mean, which averages heaving.
const WEIGHT: f64 = 0.02;

/// Water level, estimated as the mean height of a boat's base frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Waterline {
    /// z of `odom`, metres.
    height_m: Option<f64>,
}

impl Waterline {
    /// Takes the height of the base frame, z of `odom`, metres.
    pub(super) fn observe(&mut self, base_m: f64) {
        let mean_m = self.height_m.unwrap_or(base_m);
        self.height_m = Some(mean_m + WEIGHT * (base_m - mean_m));
    }

    /// Shortens a miss to the water level: light that enters water does not return, so a miss says
    /// nothing about what is below.
    pub(super) fn end_of_miss(self, origin: Point3<f64>, end: Point3<f64>) -> Point3<f64> {
        match self.height_m {
            Some(height_m) if end.z < height_m && height_m < origin.z => {
                let share = (origin.z - height_m) / (origin.z - end.z);
                origin + (end - origin) * share
            }
            Some(_) | None => end,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beams_without_a_return_end_at_the_water() {
        let mut waterline = Waterline::default();
        let (mast, far) = (Point3::new(0.0, 0.0, 2.0), Point3::new(40.0, 20.0, -6.0));
        assert_eq!(waterline.end_of_miss(mast, far), far);
        for base_m in [0.1, -0.1].repeat(300) {
            waterline.observe(base_m);
        }
        let end = waterline.end_of_miss(mast, far);
        assert!((end - Point3::new(10.0, 5.0, 0.0)).norm() < 0.05, "{end}");
        let sky = Point3::new(40.0, 0.0, 3.0);
        assert_eq!(waterline.end_of_miss(mast, sky), sky);
        let under = Point3::new(0.0, 0.0, -0.5);
        assert_eq!(waterline.end_of_miss(under, far), far);
    }
}
