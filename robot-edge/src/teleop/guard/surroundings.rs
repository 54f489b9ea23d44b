//! What lies around the vehicle now, as points in its base frame.

use nalgebra::Point2;

use super::config::GuardRules;
use super::local_map::LocalMap;
use super::placement::Placement;
use super::sweep::GuardSweep;
use crate::clock::Monotonic;
use crate::mapping::elevation_cell::CellClass;

/// Cells from the vehicle to the edge of the window in which unseen ground is looked for, at most.
const MOST_CELLS: i32 = 40;

/// Smallest such cell, metres.
const LEAST_CELL_M: f64 = 0.05;

/// Points in the base frame, metres. It keeps its memory from round to round.
#[derive(Clone, Debug)]
pub(super) struct Surroundings {
    /// Where beams hit something.
    pub(super) hits: Vec<[f64; 2]>,
    /// Centres of the map's obstacles that no beam hits now.
    pub(super) mapped: Vec<[f64; 2]>,
    pub(super) mapped_cell_m: f64,
    /// Centres of cells that nobody has seen, where seen ones begin.
    pub(super) unseen: Vec<[f64; 2]>,
    pub(super) unseen_cell_m: f64,
    /// Cells from the vehicle to the edge of the window.
    reach_cells: i32,
    reach_m: f64,
    is_seen: Vec<bool>,
    is_hit: Vec<bool>,
}

impl Surroundings {
    pub(super) fn new(rules: &GuardRules) -> Self {
        let reach_m = rules.reach_m();
        let cell_m = LEAST_CELL_M.max(reach_m / f64::from(MOST_CELLS));
        let reach_cells = libm::ceil(reach_m / cell_m) as i32 + 1;
        let side = (2 * reach_cells + 1) as usize;
        Self {
            hits: Vec::new(),
            mapped: Vec::new(),
            mapped_cell_m: 0.0,
            unseen: Vec::new(),
            unseen_cell_m: cell_m,
            reach_cells,
            reach_m,
            is_seen: vec![false; side * side],
            is_hit: Vec::new(),
        }
    }

    /// Takes over what the sweeps and the map know around a vehicle. What is stale still tells of obstacles, but no longer
    /// of ground that is free.
    pub(super) fn gather(
        &mut self,
        rules: &GuardRules,
        (sweeps, map): (&[GuardSweep], Option<&LocalMap>),
        vehicle: Placement,
        now: Monotonic,
    ) {
        self.take_hits(sweeps, vehicle);
        self.take_map(rules, (sweeps, map), vehicle, now);
        let fresh_map = map.filter(|map| !map.is_stale(now));
        self.look_for_unseen(rules, (sweeps, fresh_map), vehicle, now);
    }

    fn is_near(&self, [x, y]: [f64; 2]) -> bool {
        x * x + y * y <= self.reach_m * self.reach_m
    }

    fn take_hits(&mut self, sweeps: &[GuardSweep], vehicle: Placement) {
        self.hits.clear();
        for sweep in sweeps {
            for &[x, y] in sweep.points_in_odom() {
                let point = vehicle.to_base(Point2::new(x, y));
                if self.is_near(point) {
                    self.hits.push(point);
                }
            }
        }
    }

    /// Where a beam hits what is mapped, the hit says better where it is.
    fn take_map(
        &mut self,
        rules: &GuardRules,
        (sweeps, map): (&[GuardSweep], Option<&LocalMap>),
        vehicle: Placement,
        now: Monotonic,
    ) {
        self.mapped.clear();
        let Some(map) = map else {
            return;
        };
        self.mapped_cell_m = map.cell_m();
        self.is_hit.clear();
        self.is_hit.resize(map.len(), false);
        for sweep in sweeps.iter().filter(|sweep| !sweep.is_stale(now)) {
            for &[x, y] in sweep.points_in_odom() {
                if let Some(place) = map.place(Point2::new(x, y)) {
                    self.is_hit[place] = true;
                }
            }
        }
        for (place, centre) in map.obstacles() {
            let point = vehicle.to_base(centre);
            // Where the vehicle stands, nothing does.
            if !self.is_hit[place] && self.is_near(point) && !rules.footprint.contains(point) {
                self.mapped.push(point);
            }
        }
    }

    fn look_for_unseen(
        &mut self,
        rules: &GuardRules,
        (sweeps, map): (&[GuardSweep], Option<&LocalMap>),
        vehicle: Placement,
        now: Monotonic,
    ) {
        let (cell_m, reach) = (self.unseen_cell_m, self.reach_cells);
        let side = 2 * reach + 1;
        let at = vehicle.position_in_odom();
        let first = [at.x, at.y].map(|along| libm::floor(along / cell_m) - f64::from(reach) + 0.5);
        let centre = |column: i32, row: i32| {
            Point2::new(
                (first[0] + f64::from(column)) * cell_m,
                (first[1] + f64::from(row)) * cell_m,
            )
        };
        // What the end of a beam or a map's cell lies in has been seen, though its centre may lie behind.
        let slack_m = 0.75 * cell_m;
        let body = rules.footprint.grown(0.5 * cell_m);
        for row in 0..side {
            for column in 0..side {
                let point = centre(column, row);
                let is_seen = map.is_some_and(|map| map.class_at(point) != CellClass::Unknown)
                    || body.contains(vehicle.to_base(point))
                    || sweeps.iter().any(|sweep| {
                        !sweep.is_stale(now) && sweep.coverage().has_seen(point, slack_m)
                    });
                self.is_seen[(row * side + column) as usize] = is_seen;
            }
        }
        self.unseen.clear();
        let inner = 1..side - 1;
        for row in inner.clone() {
            for column in inner.clone() {
                let place = (row * side + column) as usize;
                let side = side as usize;
                let around = [place - 1, place + 1, place - side, place + side];
                let borders_on_seen = around.iter().any(|&beside| self.is_seen[beside]);
                if !self.is_seen[place] && borders_on_seen {
                    let point = vehicle.to_base(centre(column, row));
                    if self.is_near(point) {
                        self.unseen.push(point);
                    }
                }
            }
        }
    }
}
