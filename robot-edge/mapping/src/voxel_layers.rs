//! The layers of \[HYB\], in their order: octree, slope cost with rigidity, shores.

use nalgebra::Point3;

use super::config::MappingConfig;
use super::cost_config::Surface;
use super::cost_map::CostMap;
use super::inter_scan::InterScan;
use super::intra_scan::IntraScan;
use super::octree::{Octree, Ray, SurfaceHit};
use super::octree_config::RangeSensorModel;
use super::radial_filter::RadialFilter;
use super::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use super::shore_layer::ShoreLayer;
use super::vehicle::VehicleShape;
use super::waterline::Waterline;
use measurement::time::{RobotDuration, RobotTime};

/// The octree of one vehicle and what is made of it.
#[derive(Clone, Debug)]
pub struct VoxelLayers {
    octree: Octree,
    sensors: Vec<RangeSensorModel>,
    filter: RadialFilter,
    isolated: Vec<bool>,
    intra: IntraScan,
    inter: InterScan,
    metrics: Metrics,
    weight: f32,
    cost: Option<CostMap>,
    cost_timer: UpdateTimer,
    shore: Option<ShoreLayer>,
    shore_timer: UpdateTimer,
    vehicle_in_odom: Point3<f64>,
    /// Of a boat.
    waterline: Option<Waterline>,
    epoch: u32,
}

/// Of each beam of the scan that is added, not-a-number where it has none.
#[derive(Clone, Debug, Default)]
struct Metrics {
    intra: Vec<f32>,
    inter: Vec<f32>,
}

/// What became of one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VoxelReport {
    /// Beams that marked a hit.
    pub hits: u32,
    /// Beams without a return.
    pub misses: u32,
    /// Hits that nothing beside them confirmed.
    pub isolated: u32,
    /// Beams for which the map has no place.
    pub out_of_bounds: u32,
    /// Bricks that were evicted to keep the memory limit.
    pub evicted_bricks: u32,
}

/// When something is done again, by the time of the data.
#[derive(Clone, Copy, Debug)]
struct UpdateTimer {
    period: RobotDuration,
    last: Option<RobotTime>,
}

impl VoxelLayers {
    /// Empty maps. The settings are taken as valid; sensors are in the order of their numbers.
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
            intra: IntraScan::new(&config.metrics),
            inter: InterScan::new(&config.metrics),
            metrics: Metrics::default(),
            weight: config.metrics.weight as f32,
            cost: cost
                .enabled
                .then(|| CostMap::new(cost, &config.rigidity, vehicle, cell_m, config.threads)),
            cost_timer: UpdateTimer::every(cost.period_s),
            shore: config
                .shore
                .enabled
                .then(|| ShoreLayer::new(&config.shore, vehicle, cell_m)),
            shore_timer: UpdateTimer::every(config.shore.period_s),
            vehicle_in_odom: Point3::origin(),
            waterline: (cost.enabled && cost.surface == Surface::Water).then(Waterline::default),
            epoch: 0,
        }
    }

    /// Adds one scan, and brings the maps made of the octree up to date where that is due.
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
        // What tells of vegetation is light; sound goes on in water.
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
        let out_of_bounds = self.octree.integrate(scan.sensor, rays);
        if self.cost.is_some() {
            self.add_surfaces(scan, model);
            if self.cost_timer.is_due(scan.stamp) {
                self.update_cost();
            }
            if self.shore_timer.is_due(scan.stamp) {
                self.update_shore();
            }
        } else {
            // Nobody reads them.
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
            evicted_bricks: self.octree.enforce_memory_limit(self.vehicle_in_odom) as u32,
        }
    }

    /// Brings every map up to date, whatever is due.
    pub fn refresh(&mut self) {
        self.update_cost();
        self.update_shore();
    }

    /// Forgets everything.
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
        self.epoch += 1;
    }

    /// How often everything was forgotten.
    pub const fn epoch(&self) -> u32 {
        self.epoch
    }

    /// The octree.
    pub const fn octree(&self) -> &Octree {
        &self.octree
    }

    /// The slope cost map, where it is mapped.
    pub const fn cost(&self) -> Option<&CostMap> {
        self.cost.as_ref()
    }

    /// The slope cost map, to take its changes.
    pub const fn cost_mut(&mut self) -> Option<&mut CostMap> {
        self.cost.as_mut()
    }

    /// The shores, where they are mapped.
    pub const fn shore(&self) -> Option<&ShoreLayer> {
        self.shore.as_ref()
    }

    /// The shores, to take their changes.
    pub const fn shore_mut(&mut self) -> Option<&mut ShoreLayer> {
        self.shore.as_mut()
    }

    fn add_surfaces(&mut self, scan: &RegisteredScan, model: RangeSensorModel) {
        let spread = libm::tan(0.5 * model.divergence_rad) as f32;
        let Metrics { intra, inter } = &mut self.metrics;
        if model.has_metrics {
            self.intra.measure(scan, intra);
            self.inter.measure(scan, inter);
        } else {
            for metric in [&mut *intra, &mut *inter] {
                metric.clear();
                metric.resize(scan.beams.len(), f32::NAN);
            }
        }
        let metrics = intra.iter().zip(inter.iter());
        for ((beam, isolated), (&intra, &inter)) in
            scan.beams.iter().zip(&self.isolated).zip(metrics)
        {
            if beam.outcome == BeamOutcome::Hit && !isolated {
                let hit = SurfaceHit {
                    point: beam.end_in_odom,
                    spot_m: beam.range_m * spread,
                    intra,
                    inter,
                };
                self.octree.add_surface(&hit, self.weight);
            }
        }
    }

    fn update_cost(&mut self) {
        if let Some(cost) = &mut self.cost {
            cost.update(&mut self.octree, self.vehicle_in_odom);
        }
    }

    fn update_shore(&mut self) {
        if let (Some(cost), Some(shore)) = (&self.cost, &mut self.shore) {
            shore.update(cost, &self.octree);
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

    /// Whether it is, and then from now on. A clock that has gone back makes everything due.
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
