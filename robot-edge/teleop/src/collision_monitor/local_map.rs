//! A copy of the map around the vehicle, so that the collision monitor never waits for the mapping thread.

use std::time::Duration;

use nalgebra::{Isometry2, Point2, Vector2};

use super::obstacle_scan::is_stale;
use mapping::cost_map::CostMap;
use mapping::depth::DepthMap;
use mapping::docking::DockingSite;
use mapping::elevation::CellClass;
use mapping::grid::CellIndex;
use mapping::obstacle::ObstacleMap;
use mapping::occupancy_grid::OccupancyGrid;
use mapping::shore::ShoreClass;
use measurement::time::Monotonic;
use protocol::message::{self, DockingChoice};

const MAX_SIDE: i32 = 512;

/// A square of cells, fixed in `odom`. Its buffer is reused from copy to copy.
#[derive(Clone, Debug, Default)]
pub struct LocalMap {
    measured_at: Monotonic,
    period: Duration,
    cell_m: f64,
    first: Option<CellIndex>,
    side: i32,
    /// Row by row, y upwards.
    classes: Vec<CellClass>,
    /// Places of the vegetation of each docking site that has some.
    passable: Vec<(DockingChoice, usize)>,
}

/// When a map was copied, and which part of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CopyRequest {
    /// On this machine's clock.
    pub measured_at: Monotonic,
    /// Time from copy to copy.
    pub period: Duration,
    /// The vehicle, metres in `odom`.
    pub centre: Point2<f64>,
    /// How far around it, metres: `CollisionMonitorRules::window_m`.
    pub reach_m: f64,
    /// Pose of `odom` in the map.
    pub map_from_odom: Isometry2<f64>,
}

impl CopyRequest {
    /// What a square of the copy shows: the map's cell itself or, where the map is turned or moved, the worst of those under four
    /// points, which leave out no cell.
    fn class(
        &self,
        square: CellIndex,
        cell_m: f64,
        class: impl Fn(CellIndex) -> CellClass,
    ) -> CellClass {
        if self.map_from_odom == Isometry2::identity() {
            return class(square);
        }
        let centre = square.centre(cell_m);
        let quarter_m = 0.25 * cell_m;
        let classes = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
            let point = centre + Vector2::new(x, y) * quarter_m;
            class(CellIndex::containing(self.map_from_odom * point, cell_m))
        });
        let is = |wanted| move |class: &CellClass| *class == wanted;
        if classes.iter().any(is(CellClass::Obstacle)) {
            CellClass::Obstacle
        } else if classes.iter().all(is(CellClass::Free)) {
            CellClass::Free
        } else {
            CellClass::Unknown
        }
    }
}

impl LocalMap {
    /// Copies the obstacle map, cells whose sides differ as squares of the shorter one.
    pub fn copy_obstacles(&mut self, map: &ObstacleMap, request: CopyRequest) {
        let cell_m = map.size().shorter_m();
        self.copy(cell_m, request, |square| {
            let cell = map.size().containing(square.centre(cell_m));
            map.grid().get(cell).copied().unwrap_or(CellClass::Unknown)
        });
    }

    /// Copies the cost map: what is lethal is an obstacle, and so is water that is less deep than the given metres.
    /// `cell_m` is the octree's.
    pub fn copy_costs(
        &mut self,
        map: &CostMap,
        depth: Option<(&DepthMap, f64)>,
        sites: &[DockingSite],
        cell_m: f64,
        request: CopyRequest,
    ) {
        let is_shallow = |cell| {
            depth.is_some_and(|(depth, least_m)| {
                let depth_m = depth.depth_m(cell);
                depth_m.is_some_and(|depth_m| f64::from(depth_m) < least_m)
            })
        };
        self.copy(cell_m, request, |cell| match map.cell(cell) {
            _ if is_shallow(cell) => CellClass::Obstacle,
            Some(known) if known.cost >= 1.0 => CellClass::Obstacle,
            Some(known) if known.cost.is_finite() => CellClass::Free,
            Some(_) | None => CellClass::Unknown,
        });
        for site in sites {
            let Some(choice) = choice_of(site) else {
                continue;
            };
            let cells = site.passable.iter().filter(|cell| !is_shallow(**cell));
            let odom_from_map = request.map_from_odom.inverse();
            let places =
                cells.filter_map(|cell| self.index_of(odom_from_map * cell.centre(cell_m)));
            let passable: Vec<_> = places.map(|place| (choice, place)).collect();
            self.passable.extend(passable);
        }
    }

    /// Copies the occupancy grid: what is more likely occupied than free is an obstacle.
    pub fn copy_occupancy(&mut self, map: &OccupancyGrid, request: CopyRequest) {
        self.copy(map.cell_m(), request, |cell| {
            match map.cell(cell).probability() {
                Some(p) if p > 0.5 => CellClass::Obstacle,
                Some(p) if p < 0.5 => CellClass::Free,
                Some(_) | None => CellClass::Unknown,
            }
        });
    }

    fn copy(&mut self, cell_m: f64, request: CopyRequest, class: impl Fn(CellIndex) -> CellClass) {
        self.measured_at = request.measured_at;
        self.period = request.period;
        self.cell_m = cell_m;
        self.classes.clear();
        self.passable.clear();
        let reach = libm::ceil(request.reach_m / cell_m);
        let is_sensible = reach.is_finite()
            && cell_m > 0.0
            && request.centre.x.is_finite()
            && request.centre.y.is_finite();
        if !is_sensible {
            self.first = None;
            self.side = 0;
            return;
        }
        let reach = (reach as i32).clamp(0, MAX_SIDE / 2 - 1);
        let centre = CellIndex::containing(request.centre, cell_m);
        let first = CellIndex {
            x: centre.x.saturating_sub(reach),
            y: centre.y.saturating_sub(reach),
        };
        self.first = Some(first);
        self.side = 2 * reach + 1;
        for row in 0..self.side {
            for column in 0..self.side {
                let square = CellIndex {
                    x: first.x.saturating_add(column),
                    y: first.y.saturating_add(row),
                };
                self.classes.push(request.class(square, cell_m, &class));
            }
        }
    }

    /// Whether it is too old to trust its free cells.
    pub fn is_stale(&self, now: Monotonic) -> bool {
        is_stale(self.measured_at, self.period, now)
    }

    /// Edge of a cell, metres.
    pub(super) const fn cell_m(&self) -> f64 {
        self.cell_m
    }

    pub(super) fn len(&self) -> usize {
        self.classes.len()
    }

    /// Replaces the vegetation of docking sites by the cells around these points.
    #[cfg(test)]
    pub(super) fn set_passable(
        &mut self,
        choice: DockingChoice,
        points_in_odom: impl IntoIterator<Item = Point2<f64>>,
    ) {
        let points = points_in_odom.into_iter();
        let places = points.filter_map(|point| self.index_of(point));
        self.passable = places.map(|place| (choice, place)).collect();
    }

    #[cfg(test)]
    pub(super) fn set_measured_at(&mut self, measured_at: Monotonic) {
        self.measured_at = measured_at;
    }

    #[cfg(test)]
    fn is_empty(&self) -> bool {
        self.classes.is_empty()
    }

    /// Place of the cell around a point, metres in `odom`, in the copy.
    pub(super) fn index_of(&self, point_in_odom: Point2<f64>) -> Option<usize> {
        let first = self.first?;
        let cell = CellIndex::near(point_in_odom, 1.0 / self.cell_m);
        let (x, y) = (cell.x.wrapping_sub(first.x), cell.y.wrapping_sub(first.y));
        let is_inside = (0..self.side).contains(&x) && (0..self.side).contains(&y);
        is_inside.then_some((y * self.side + x) as usize)
    }

    pub(super) fn class_at(&self, point_in_odom: Point2<f64>) -> CellClass {
        self.index_of(point_in_odom)
            .map_or(CellClass::Unknown, |index_of| self.classes[index_of])
    }

    /// Places of the vegetation of a docking site, while it is no denser than the chosen class.
    pub(super) fn passable(&self, choice: DockingChoice) -> impl Iterator<Item = usize> {
        let of_site = self
            .passable
            .iter()
            .filter(move |(now, _)| now.site == choice.site && now.vegetation <= choice.vegetation);
        of_site.map(|(_, place)| *place)
    }

    /// Places and centres, metres in `odom`, of the obstacles.
    pub(super) fn obstacles(&self) -> impl Iterator<Item = (usize, Point2<f64>)> {
        let side = self.side.max(1);
        let first = self.first.unwrap_or(CellIndex { x: 0, y: 0 });
        let places = (0_i32..).zip(&self.classes);
        places
            .filter(|(_, class)| **class == CellClass::Obstacle)
            .map(move |(index_of, _)| {
                let cell = CellIndex {
                    x: first.x.saturating_add(index_of % side),
                    y: first.y.saturating_add(index_of / side),
                };
                (index_of as usize, cell.centre(self.cell_m))
            })
    }
}

/// What a driver calls the site; `None` for a slope.
fn choice_of(site: &DockingSite) -> Option<DockingChoice> {
    let vegetation = match site.vegetation? {
        ShoreClass::Sparse => message::ShoreClass::Sparse,
        ShoreClass::Dense => message::ShoreClass::Dense,
        ShoreClass::Solid => return None,
    };
    Some(DockingChoice {
        site: site.number,
        vegetation,
    })
}

#[cfg(test)]
mod tests;
