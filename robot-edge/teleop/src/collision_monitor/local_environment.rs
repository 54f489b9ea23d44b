//! What lies around the vehicle now, as points in its base frame.

use std::time::Duration;

use nalgebra::Point2;

use super::blockage::BlockageCounts;
use super::clearance::Footprint;
use super::config::CollisionMonitorRules;
use super::local_map::LocalMap;
use super::obstacle_scan::ObstacleScan;
use super::predicted_pose::PredictedPose;
use mapping::elevation_cell::CellClass;
use measurement::time::Monotonic;

/// Cells from the vehicle to the edge of the window in which unseen ground is looked for, at most.
const MAX_CELLS: i32 = 40;

/// Cells beyond this number are all alike: no vehicle comes there.
const MAX_CELL_NUMBER: f64 = 1e12;

/// Smallest such cell, metres.
const MIN_CELL_M: f64 = 0.05;

/// What is known of a cell of ground around the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum GroundState {
    /// Nobody has looked at it in time.
    Unknown,
    /// Only beams without an echo say that it is free.
    FreeByNoReturn,
    Observed,
}

/// When a cell was looked at last: by a beam low enough to see what stands there, or by one that passed above it. The
/// latter counts where a map knows the cell: a laser that looks down at the ground ahead has seen what it passes over now
/// some time ago, and is still what watches that direction.
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

/// Points in the base frame, metres. It keeps its memory from round to round.
#[derive(Clone, Debug)]
pub(super) struct LocalEnvironment {
    /// Where beams hit something; the bottom of the water last.
    pub(super) hits: Vec<[f64; 2]>,
    /// How many of the hits are the bottom of the water.
    pub(super) shallows: usize,
    /// Centres of the map's obstacles that no beam hits now.
    pub(super) mapped: Vec<[f64; 2]>,
    pub(super) mapped_cell_m: f64,
    /// Centres of cells that nobody has seen in time, where others begin.
    pub(super) unknown: Vec<[f64; 2]>,
    /// Centres of cells that no beam with an echo has seen in time, where those begin that one has.
    pub(super) unconfirmed: Vec<[f64; 2]>,
    pub(super) unknown_cell_m: f64,
    /// How long ago the ground beside the vehicle was looked at last, where that is least recent: ahead, to the left,
    /// behind, to the right; absent where nobody has looked since the vehicle came there.
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
}

impl LocalEnvironment {
    pub(super) fn new(rules: &CollisionMonitorRules) -> Self {
        let reach_m = rules.reach_m();
        let cell_m = MIN_CELL_M.max(reach_m / f64::from(MAX_CELLS));
        let reach_cells = libm::ceil(reach_m / cell_m) as i64 + 1;
        let side = (2 * reach_cells + 1) as usize;
        Self {
            hits: Vec::new(),
            shallows: 0,
            mapped: Vec::new(),
            mapped_cell_m: 0.0,
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
        }
    }

    /// Takes over what the sweeps and the map know around a vehicle. What is stale still tells of obstacles, but no longer
    /// of ground that is free.
    pub(super) fn update(
        &mut self,
        rules: &CollisionMonitorRules,
        (obstacle_scans, map): (&[ObstacleScan], Option<&LocalMap>),
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        self.update_hits(obstacle_scans, vehicle);
        self.update_mapped(rules, (obstacle_scans, map), vehicle, now);
        let fresh_map = map.filter(|map| !map.is_stale(now));
        self.record_observations(rules, obstacle_scans, vehicle, now);
        self.find_unknown(rules, fresh_map, vehicle, now);
    }

    fn is_near(&self, [x, y]: [f64; 2]) -> bool {
        x * x + y * y <= self.reach_m * self.reach_m
    }

    fn update_hits(&mut self, obstacle_scans: &[ObstacleScan], vehicle: PredictedPose) {
        self.hits.clear();
        let parts = obstacle_scans
            .iter()
            .map(ObstacleScan::obstacles_and_shallows);
        for (obstacles, _) in parts.clone() {
            self.add_near(obstacles, vehicle);
        }
        let obstacles = self.hits.len();
        for (_, shallows) in parts {
            self.add_near(shallows, vehicle);
        }
        self.shallows = self.hits.len() - obstacles;
    }

    fn add_near(&mut self, points_in_odom: &[[f64; 2]], vehicle: PredictedPose) {
        for &[x, y] in points_in_odom {
            let point = vehicle.to_base(Point2::new(x, y));
            if self.is_near(point) {
                self.hits.push(point);
            }
        }
    }

    /// Where a beam hits what is mapped, the hit says better where it is.
    fn update_mapped(
        &mut self,
        rules: &CollisionMonitorRules,
        (obstacle_scans, map): (&[ObstacleScan], Option<&LocalMap>),
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
        for obstacle_scan in obstacle_scans
            .iter()
            .filter(|obstacle_scan| !obstacle_scan.is_stale(now))
        {
            for &[x, y] in obstacle_scan.points_in_odom() {
                if let Some(index) = map.index_of(Point2::new(x, y)) {
                    self.is_hit[index] = true;
                }
            }
        }
        for (index, centre) in map.obstacles() {
            let point = vehicle.to_base(centre);
            // Where the vehicle stands, nothing does.
            if !self.is_hit[index] && self.is_near(point) && !rules.footprint.contains(point) {
                self.mapped.push(point);
            }
        }
    }

    /// Notes when each cell was looked at last: by the sweeps that are new, and by the vehicle that stands on it.
    fn record_observations(
        &mut self,
        rules: &CollisionMonitorRules,
        obstacle_scans: &[ObstacleScan],
        vehicle: PredictedPose,
        now: Monotonic,
    ) {
        self.recorded
            .resize(obstacle_scans.len(), Default::default());
        for (&(_, before), obstacle_scan) in self.recorded.iter().zip(obstacle_scans) {
            let BlockageCounts {
                blocked,
                without_echo,
            } = obstacle_scan.blockage_counts();
            for observations in &mut self.observations {
                if blocked != before.blocked {
                    *observations = CellObservations::default();
                } else if without_echo != before.without_echo {
                    observations.low.by_miss = Monotonic::default();
                    observations.passing.by_miss = Monotonic::default();
                }
            }
        }
        // What the end of a beam or a map's cell lies in has been seen, though its centre may lie behind.
        let slack_m = 0.75 * self.unknown_cell_m;
        let body = rules.footprint.grown(0.5 * self.unknown_cell_m);
        let with_noted = obstacle_scans.iter().zip(&self.recorded);
        let new: Vec<_> = with_noted
            .filter(|(obstacle_scan, recorded)| obstacle_scan.measured_at() > recorded.0)
            .map(|(obstacle_scan, _)| obstacle_scan)
            .collect();
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
            for obstacle_scan in &new {
                if let Some(observation) = obstacle_scan.coverage().observation_at(point, slack_m) {
                    let times = if observation.is_low {
                        &mut observations.low
                    } else {
                        &mut observations.passing
                    };
                    times.record(observation.is_miss, obstacle_scan.measured_at());
                }
            }
            if body.contains(vehicle.to_base(point)) {
                observations.low.record(false, now);
            }
        }
        for (recorded, obstacle_scan) in self.recorded.iter_mut().zip(obstacle_scans) {
            *recorded = (obstacle_scan.measured_at(), obstacle_scan.blockage_counts());
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
            // Unseen is older than any age.
            ages.into_iter()
                .try_fold(Duration::ZERO, |oldest, age| Some(oldest.max(age?)))
        });
    }

    /// Points on the ground just outside of the footprint and its margin, in the base frame: ahead, to the left, behind, to
    /// the right.
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

/// The cells around the vehicle, by their numbers in `odom`.
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
