//! The surroundings of the vehicle as points in its base frame: hits, mapped obstacles, borders of unknown ground.

use std::time::Duration;

use nalgebra::Point2;

use super::blockage::BlockageCounts;
use super::config::CollisionMonitorRules;
use super::local_map::LocalMap;
use super::obstacle_scan::ObstacleScan;
use super::predicted_pose::PredictedPose;
use crate::collision_monitor::footprint::Footprint;
use mapping::elevation::CellClass;
use measurement::time::Monotonic;
use protocol::message::DockingChoice;

/// Greatest number of cells from the vehicle to the edge of the window for unknown ground.
const MAX_CELLS: i32 = 40;

/// Cells beyond this number are all alike: no vehicle comes there.
const MAX_CELL_NUMBER: f64 = 1e12;

/// Smallest such cell, metres.
const MIN_CELL_M: f64 = 0.05;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum GroundState {
    /// Not observed within `max_ground_age_s`.
    Unknown,
    /// Observed only by beams without an echo.
    FreeByNoReturn,
    Observed,
}

/// Time of the last observation of a cell: by a beam low enough to detect obstacles there, or by one that passed above
/// it. The latter counts only if the map knows the cell: a laser that points down at the ground ahead observed the cell
/// some time ago, and still watches this direction.
#[derive(Clone, Copy, Debug, Default)]
struct CellObservations {
    cell: [i64; 2],
    low: ObservationTimes,
    passing: ObservationTimes,
}

#[derive(Clone, Copy, Debug, Default)]
struct ObservationTimes {
    by_echo: Monotonic,
    by_miss: Monotonic,
}

impl ObservationTimes {
    fn record(&mut self, is_miss: bool, at: Monotonic) {
        let last = if is_miss {
            &mut self.by_miss
        } else {
            &mut self.by_echo
        };
        *last = at.max(*last);
    }

    fn ground(self, is_fresh: impl Fn(Monotonic) -> bool) -> GroundState {
        if is_fresh(self.by_echo) {
            GroundState::Observed
        } else if is_fresh(self.by_miss) {
            GroundState::FreeByNoReturn
        } else {
            GroundState::Unknown
        }
    }

    fn last(self) -> Monotonic {
        self.by_echo.max(self.by_miss)
    }
}

/// Points in the base frame, metres. Buffers are reused from round to round.
#[derive(Clone, Debug)]
pub(super) struct LocalEnvironment {
    /// Hits of beams; contacts first, the bottom of the water last.
    pub(super) hits: Vec<[f64; 2]>,
    /// How many of the hits are contacts of bumpers.
    pub(super) contacts: usize,
    /// How many of the hits are the bottom of the water.
    pub(super) shallows: usize,
    /// Centres of mapped obstacle cells without a hit now.
    pub(super) mapped: Vec<[f64; 2]>,
    pub(super) mapped_cell_m: f64,
    /// Hits and centres of mapped cells in vegetation that may be pushed into.
    pub(super) vegetation: Vec<[f64; 2]>,
    /// Centres of unknown cells at the border of known ones.
    pub(super) unknown: Vec<[f64; 2]>,
    /// Centres of cells without an observation by echo, at the border of cells with one.
    pub(super) unconfirmed: Vec<[f64; 2]>,
    pub(super) unknown_cell_m: f64,
    /// Age of the observation of the ground beside the vehicle, the oldest of three points: ahead, left, behind, right;
    /// absent without observation.
    pub(super) side_ground_ages: [Option<Duration>; 4],
    /// Cells from the vehicle to the edge of the window.
    reach_cells: i64,
    reach_m: f64,
    /// Of the window around the vehicle: each cell has its place by its number in `odom`, modulo the window's side.
    observations: Vec<CellObservations>,
    /// Sweeps that are in `observations`, by sensor.
    recorded: Vec<(Monotonic, BlockageCounts)>,
    ground: Vec<GroundState>,
    is_hit: Vec<bool>,
    /// Of the map: vegetation that may be pushed into.
    is_passable: Vec<bool>,
}

impl LocalEnvironment {
    pub(super) fn new(rules: &CollisionMonitorRules) -> Self {
        let reach_m = rules.reach_m();
        let cell_m = MIN_CELL_M.max(reach_m / f64::from(MAX_CELLS));
        let reach_cells = libm::ceil(reach_m / cell_m) as i64 + 1;
        let side = (2 * reach_cells + 1) as usize;
        Self {
            hits: Vec::new(),
            contacts: 0,
            shallows: 0,
            mapped: Vec::new(),
            mapped_cell_m: 0.0,
            vegetation: Vec::new(),
            unknown: Vec::new(),
            unconfirmed: Vec::new(),
            unknown_cell_m: cell_m,
            side_ground_ages: [None; 4],
            reach_cells,
            reach_m,
            observations: vec![CellObservations::default(); side * side],
            recorded: Vec::new(),
            ground: vec![GroundState::Unknown; side * side],
            is_hit: Vec::new(),
            is_passable: Vec::new(),
        }
    }

    /// Reads scans and map around the vehicle. Stale data still gives obstacles, but no free ground.
    pub(super) fn update(
        &mut self,
        rules: &CollisionMonitorRules,
        (scans, map): (&[ObstacleScan], Option<&LocalMap>),
        docking: Option<DockingChoice>,
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        let fresh_map = map.filter(|map| !map.is_stale(now));
        self.vegetation.clear();
        self.is_passable.clear();
        self.is_passable.resize(map.map_or(0, LocalMap::len), false);
        if let (Some(map), Some(docking)) = (fresh_map, docking) {
            for index in map.passable(docking) {
                self.is_passable[index] = true;
            }
        }
        self.update_hits(rules, (scans, map), vehicle, now);
        self.update_mapped(rules, (scans, map), vehicle, now);
        self.record_observations(rules, scans, vehicle, now);
        self.find_unknown(rules, fresh_map, vehicle, now);
    }

    fn is_near(&self, [x, y]: [f64; 2]) -> bool {
        x * x + y * y <= self.reach_m * self.reach_m
    }

    fn update_hits(
        &mut self,
        rules: &CollisionMonitorRules,
        (scans, map): (&[ObstacleScan], Option<&LocalMap>),
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        self.hits.clear();
        for scan in scans.iter().filter(|scan| scan.is_contact()) {
            self.add_near(scan.points_in_odom(), None, vehicle);
        }
        self.contacts = self.hits.len();
        let is_there = |scan: &&ObstacleScan| {
            !scan.is_contact() && !scan.is_forgotten(rules.max_ground_age, now)
        };
        let parts = scans.iter().filter(is_there);
        let parts = parts.map(ObstacleScan::obstacles_and_shallows);
        for (obstacles, _) in parts.clone() {
            self.add_near(obstacles, map, vehicle);
        }
        let obstacles = self.hits.len();
        for (_, shallows) in parts {
            self.add_near(shallows, None, vehicle);
        }
        self.shallows = self.hits.len() - obstacles;
    }

    /// Adds hits; those in passable vegetation of `map` count as such.
    fn add_near(
        &mut self,
        points_in_odom: &[[f64; 2]],
        map: Option<&LocalMap>,
        vehicle: PredictedPose,
    ) {
        for &[x, y] in points_in_odom {
            let in_odom = Point2::new(x, y);
            let point = vehicle.to_base(in_odom);
            if !self.is_near(point) {
                continue;
            }
            let index = map.and_then(|map| map.index_of(in_odom));
            if index.is_some_and(|index| self.is_passable[index]) {
                self.vegetation.push(point);
            } else {
                self.hits.push(point);
            }
        }
    }

    /// A hit in a mapped cell replaces the cell: it is more precise.
    fn update_mapped(
        &mut self,
        rules: &CollisionMonitorRules,
        (scans, map): (&[ObstacleScan], Option<&LocalMap>),
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        self.mapped.clear();
        let Some(map) = map else {
            return;
        };
        self.mapped_cell_m = map.cell_m();
        self.is_hit.clear();
        self.is_hit.resize(map.len(), false);
        for scan in scans.iter().filter(|scan| !scan.is_stale(now)) {
            for &[x, y] in scan.points_in_odom() {
                if let Some(index) = map.index_of(Point2::new(x, y)) {
                    self.is_hit[index] = true;
                }
            }
        }
        for (index, centre) in map.obstacles() {
            let point = vehicle.to_base(centre);
            // There is no obstacle under the vehicle.
            if self.is_hit[index] || !self.is_near(point) || rules.footprint.contains(point) {
                continue;
            }
            if self.is_passable[index] {
                self.vegetation.push(point);
            } else {
                self.mapped.push(point);
            }
        }
    }

    /// Records the time of observation of each cell: by new scans, and by the vehicle that stands on it.
    fn record_observations(
        &mut self,
        rules: &CollisionMonitorRules,
        scans: &[ObstacleScan],
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        self.recorded.resize(scans.len(), Default::default());
        for (&(_, before), scan) in self.recorded.iter().zip(scans) {
            let BlockageCounts {
                blocked,
                without_returns,
            } = scan.blockage_counts();
            for observations in &mut self.observations {
                if blocked != before.blocked {
                    *observations = CellObservations::default();
                } else if without_returns != before.without_returns {
                    observations.low.by_miss = Monotonic::default();
                    observations.passing.by_miss = Monotonic::default();
                }
            }
        }
        // A cell that contains a beam's end counts as observed, although its centre may lie behind the end.
        let slack_m = 0.75 * self.unknown_cell_m;
        let body = rules.footprint.grown(0.5 * self.unknown_cell_m);
        let mut new: Vec<_> = scans.iter().zip(&self.recorded).collect();
        new.retain(|(scan, recorded)| scan.measured_at() > recorded.0);
        let window = self.window(vehicle);
        for cell in window.cells() {
            let point = window.centre(cell);
            let observations = &mut self.observations[window.index(cell)];
            if observations.cell != cell {
                *observations = CellObservations {
                    cell,
                    ..CellObservations::default()
                };
            }
            for (scan, _) in &new {
                if let Some(observation) = scan.coverage().observation_at(point, slack_m) {
                    let times = if observation.is_low {
                        &mut observations.low
                    } else {
                        &mut observations.passing
                    };
                    times.record(observation.is_miss, scan.measured_at());
                }
            }
            if body.contains(vehicle.to_base(point)) {
                observations.low.record(false, now);
            }
        }
        for (recorded, scan) in self.recorded.iter_mut().zip(scans) {
            *recorded = (scan.measured_at(), scan.blockage_counts());
        }
    }

    fn find_unknown(
        &mut self,
        rules: &CollisionMonitorRules,
        map: Option<&LocalMap>,
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        let window = self.window(vehicle);
        let is_fresh =
            |at: Monotonic| at != Monotonic::default() && now.since(at) <= rules.max_ground_age;
        let is_mapped = |point| map.is_some_and(|map| map.class_at(point) != CellClass::Unknown);
        for cell in window.cells() {
            let index = window.index(cell);
            let CellObservations { low, passing, .. } = self.observations[index];
            let mut ground = low.ground(is_fresh);
            let by_map = passing.ground(is_fresh);
            if by_map > ground && is_mapped(window.centre(cell)) {
                ground = by_map;
            }
            self.ground[index] = ground;
        }
        self.unknown.clear();
        self.unconfirmed.clear();
        for [x, y] in window.inner_cells() {
            let index = window.index([x, y]);
            let ground = self.ground[index];
            if ground == GroundState::Observed {
                continue;
            }
            let neighbours = [[x - 1, y], [x + 1, y], [x, y - 1], [x, y + 1]];
            let best = neighbours
                .map(|cell| self.ground[window.index(cell)])
                .into_iter()
                .max();
            let point = vehicle.to_base(window.centre([x, y]));
            if best <= Some(ground) || !self.is_near(point) {
                continue;
            }
            if ground == GroundState::Unknown {
                self.unknown.push(point);
            }
            if best == Some(GroundState::Observed) {
                self.unconfirmed.push(point);
            }
        }
        self.side_ground_ages = Self::sides(rules).map(|points| {
            let ages = points.map(|point| {
                let [x, y] = vehicle.to_odom(point);
                let point = Point2::new(x, y);
                let cell = window.cell_of(point);
                let observations = self.observations[window.index(cell)];
                if observations.cell != cell {
                    return None;
                }
                let passing = Some(observations.passing.last()).filter(|_| is_mapped(point));
                let last = passing.unwrap_or_default().max(observations.low.last());
                (last != Monotonic::default()).then(|| now.since(last))
            });
            // A point without observation is older than any age.
            ages.into_iter()
                .try_fold(Duration::ZERO, |oldest, age| Some(oldest.max(age?)))
        });
    }

    /// Points on the ground just outside of the footprint and its margin, in the base frame: ahead, to the left,
    /// behind, to the right.
    fn sides(rules: &CollisionMonitorRules) -> [[[f64; 2]; 3]; 4] {
        let edge = rules.footprint.grown(rules.margins.ahead_m + MIN_CELL_M);
        let Footprint {
            front_m,
            rear_m,
            half_width_m,
        } = rules.footprint;
        let middle_m = 0.5 * (front_m + rear_m);
        let across = [-half_width_m, 0.0, half_width_m];
        let along = [rear_m, middle_m, front_m];
        [
            across.map(|y| [edge.front_m, y]),
            along.map(|x| [x, edge.half_width_m]),
            across.map(|y| [edge.rear_m, y]),
            along.map(|x| [x, -edge.half_width_m]),
        ]
    }

    fn window(&self, vehicle: PredictedPose) -> Window {
        let at = vehicle.position_in_odom();
        let reach = self.reach_cells;
        let cell_m = self.unknown_cell_m;
        let cell = |along_m: f64| (along_m / cell_m).clamp(-MAX_CELL_NUMBER, MAX_CELL_NUMBER);
        let middle = [at.x, at.y].map(|along_m| libm::floor(cell(along_m)) as i64);
        Window {
            cell_m,
            first: middle.map(|middle| middle - reach),
            side: 2 * reach + 1,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Window {
    cell_m: f64,
    first: [i64; 2],
    side: i64,
}

impl Window {
    fn cells(self) -> impl Iterator<Item = [i64; 2]> {
        self.cells_within(0)
    }

    /// Those that have cells on all four sides.
    fn inner_cells(self) -> impl Iterator<Item = [i64; 2]> {
        self.cells_within(1)
    }

    fn cells_within(self, edge: i64) -> impl Iterator<Item = [i64; 2]> {
        let [x, y] = self.first;
        let within = edge..self.side - edge;
        let row = within.clone();
        within.flat_map(move |dy| {
            let row = row.clone();
            row.map(move |dx| [x + dx, y + dy])
        })
    }

    fn index(self, [x, y]: [i64; 2]) -> usize {
        (y.rem_euclid(self.side) * self.side + x.rem_euclid(self.side)) as usize
    }

    fn centre(self, cell: [i64; 2]) -> Point2<f64> {
        let [x, y] = cell.map(|number| (number as f64 + 0.5) * self.cell_m);
        Point2::new(x, y)
    }

    fn cell_of(self, point: Point2<f64>) -> [i64; 2] {
        [point.x, point.y].map(|along_m| libm::floor(along_m / self.cell_m) as i64)
    }
}
