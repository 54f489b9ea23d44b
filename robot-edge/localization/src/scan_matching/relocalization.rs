//! Finding the vehicle in a map: branch and bound over all submaps gives places where it may be. These are followed while it drives,
//! until one of them explains nearly all that it sees and no other does about as well.

use nalgebra::{Isometry2, Matrix3, Point2};

use super::loop_closure::{ClosureSettings, search_points, with_noise};
use super::scan_points::ScanPoint;
use super::search_grid::{Search, SearchWindow};
use super::slam_map::SlamMap;
use super::submap::difference;

/// A place in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Pose of the vehicle.
    pub map_from_base: Isometry2<f64>,
    /// Index of the submap that shows it.
    pub submap: u32,
    /// Pose of the vehicle in that submap.
    pub submap_from_base: Isometry2<f64>,
    /// Inverse covariance of x, y (metres) and yaw (radians) in the frame of the vehicle.
    pub information: Matrix3<f64>,
    /// Share of the points that lie on surfaces of the map, of whichever submap of this piece.
    pub explained: f64,
    /// All directions are determined.
    is_determined: bool,
    /// Way driven when it became a hypothesis, metres.
    since_m: f64,
}

/// Finds a vehicle that drives: it follows all places where the vehicle may be, until one explains what it sees and no other does
/// nearly as well.
#[derive(Clone, Debug, Default)]
pub struct Relocalizer {
    driven_m: f64,
    next_m: f64,
    next_search_m: f64,
    last: Option<Isometry2<f64>>,
    /// Where the vehicle may be, the best first, at the driven pose of the newest update.
    places: Vec<Place>,
    at: Isometry2<f64>,
}

/// Way from update to update, and from search to search in the whole map, metres.
const UPDATE_M: f64 = 1.0;
const SEARCH_M: f64 = 2.0;
/// A place must hold over this way, metres: a part of the world that is not in the map may look like one that is.
const HOLD_M: f64 = 4.0;
/// What the vehicle sees at the next update agrees with a place to this difference: metres and radians.
const AGREEMENT: (f64, f64) = (0.3, 0.06);
/// Least score of a place in a search: at first, and where there is none. The first search is quick.
const MIN_SCORES: [f64; 2] = [0.75, 0.6];
/// A search finds places with more than this share of the best score.
const SEARCHED_SHARE: f64 = 0.8;
/// Least share of explained points, of a place that is followed and of one that is believed.
const MIN_EXPLAINED: (f64, f64) = (0.6, 0.75);
/// Another place must leave unexplained this many times what the best does, and this share of the points more: the map may be
/// outdated.
const DISTINCT: (f64, f64) = (1.5, 0.04);
/// Two poses this near are one place: metres and radians.
const SAME_PLACE: (f64, f64) = (1.0, 0.35);
/// Limit of the places that are followed.
const MAX_PLACES: usize = 32;
/// The vehicle may be this far off the way of a submap, metres.
pub(super) const BESIDE_M: f64 = 3.0;
/// Submaps whose way comes this near explain points, metres.
const EXPLAINING_M: f64 = 8.0;

impl Relocalizer {
    /// The vehicle is at `local_from_base`; `points` gives what it has seen in the last metres, in its frame. Returns a place once it is
    /// sure. `near`: only near this pose, with half the size of the region: metres and radians; there the place need not hold.
    pub fn update(
        &mut self,
        map: &SlamMap,
        local_from_base: &Isometry2<f64>,
        points: impl FnOnce() -> Vec<ScanPoint>,
        near: Option<(&Isometry2<f64>, (f64, f64))>,
        settings: &ClosureSettings,
    ) -> Option<Place> {
        let last = self.last.replace(*local_from_base);
        self.driven_m += last.map_or(0.0, |last| difference(&last, local_from_base).xy().norm());
        if self.driven_m < self.next_m {
            return None;
        }
        self.next_m = self.driven_m + UPDATE_M;
        let points = points();
        let step = self.at.inv_mul(local_from_base);
        self.at = *local_from_base;
        for place in &mut self.places {
            place.map_from_base *= step;
        }
        let followed = self.places.iter().filter_map(|place| {
            let submap = map.nearest_submap(&place.map_from_base)?;
            Some((submap, map.anchor(submap).inv_mul(&place.map_from_base)))
        });
        let mut starts: Vec<_> = followed.collect();
        if self.driven_m >= self.next_search_m {
            self.next_search_m = self.driven_m + SEARCH_M;
            for (index, pose) in search(map, &points, near) {
                let start = map.anchor(index) * pose;
                let is_same = |(other, pose): &(u32, Isometry2<f64>)| {
                    is_within(&(map.anchor(*other) * pose), &start, AGREEMENT)
                };
                if !starts.iter().any(is_same) {
                    starts.push((index, pose));
                }
            }
        }
        let pieces = map.pieces();
        let mut places: Vec<Place> = Vec::new();
        for (submap, start) in starts {
            let mut place = registered((map, &pieces), &points, submap, &start, settings);
            let before = self
                .places
                .iter()
                .filter(|before| is_within(&before.map_from_base, &place.map_from_base, AGREEMENT));
            let since_m = before.map(|before| before.since_m);
            place.since_m = since_m.fold(self.driven_m, f64::min);
            places.push(place);
        }
        places.retain(|place| place.explained >= MIN_EXPLAINED.0);
        places.sort_by(|a, b| {
            b.explained
                .total_cmp(&a.explained)
                .then(a.since_m.total_cmp(&b.since_m))
        });
        self.places.clear();
        for place in places {
            let is_new =
                |other: &Place| !is_within(&other.map_from_base, &place.map_from_base, SAME_PLACE);
            if self.places.len() < MAX_PLACES && self.places.iter().all(is_new) {
                self.places.push(place);
            }
        }
        let best = self.places.first()?;
        let hold_m = near.map_or(HOLD_M, |_| 0.0);
        let distinct = DISTINCT.0 * (1.0 - best.explained) + DISTINCT.1;
        let is_sure = best.explained >= MIN_EXPLAINED.1
            && best.is_determined
            && self.driven_m - best.since_m >= hold_m
            && self
                .places
                .get(1)
                .is_none_or(|other| 1.0 - other.explained >= distinct);
        is_sure.then_some(*best)
    }

    /// Where the vehicle may be, the best first.
    pub fn places(&self) -> &[Place] {
        &self.places
    }
}

fn is_within(a: &Isometry2<f64>, b: &Isometry2<f64>, (m, rad): (f64, f64)) -> bool {
    let step = difference(a, b);
    step.xy().norm() < m && step.z.abs() < rad
}

/// Registers points with a submap, and counts those that any submap of its piece of the map explains.
fn registered(
    (map, pieces): (&SlamMap, &[u32]),
    points: &[ScanPoint],
    submap: u32,
    start: &Isometry2<f64>,
    settings: &ClosureSettings,
) -> Place {
    let registered = map.submap(submap).register(points, start, None);
    let map_from_base = map.anchor(submap) * registered.submap_from_base;
    let piece = |index: u32| pieces[map.submaps[index as usize].anchor as usize];
    let near: Vec<_> = (0..map.submap_count())
        .filter(|index| piece(*index) == piece(submap))
        .filter_map(|index| {
            let pose = map.expected_near(index, &map_from_base, EXPLAINING_M)?;
            Some((index, pose))
        })
        .collect();
    let is_explained = |point: &&ScanPoint| {
        near.iter()
            .any(|(index, pose)| map.submap(*index).is_on_surface(&point.in_frame(pose)))
    };
    let explained = points.iter().filter(is_explained).count();
    Place {
        map_from_base,
        submap,
        submap_from_base: registered.submap_from_base,
        information: with_noise(&registered.information, settings.noise),
        explained: explained as f64 / points.len().max(1) as f64,
        is_determined: registered.degenerate == 0,
        since_m: 0.0,
    }
}

/// Submaps, and poses in them, at which points agree with them about best: two at most of each, the best first.
fn search(
    map: &SlamMap,
    points: &[ScanPoint],
    near: Option<(&Isometry2<f64>, (f64, f64))>,
) -> Vec<(u32, Isometry2<f64>)> {
    // Half of them do, since all points decide later.
    let positions: Vec<_> = search_points(points).into_iter().step_by(2).collect();
    let mut found = MIN_SCORES
        .iter()
        .map(|min_score| search_above(*min_score, map, &positions, near));
    found.find(|found| !found.is_empty()).unwrap_or_default()
}

fn search_above(
    min_score: f64,
    map: &SlamMap,
    positions: &[Point2<f64>],
    near: Option<(&Isometry2<f64>, (f64, f64))>,
) -> Vec<(u32, Isometry2<f64>)> {
    let mut found: Vec<(f64, u32, Isometry2<f64>)> = Vec::new();
    let mut best = 0.0_f64;
    for index in (0..map.submap_count()).filter(|index| !map.submap(*index).is_empty()) {
        let (middle, half_m, half_rad) = if let Some((pose, (half_m, half_rad))) = near {
            let Some(middle) = map.expected_near(index, pose, half_m) else {
                continue;
            };
            (middle, [half_m; 2], half_rad)
        } else {
            let (middle, half_m) = map.extent(index);
            let half_m = half_m.map(|half_m| half_m + BESIDE_M);
            (middle, half_m, std::f64::consts::PI)
        };
        let window = SearchWindow {
            middle,
            half_m,
            half_rad,
            min_score: (SEARCHED_SHARE * best).max(min_score),
            prior: None,
        };
        let grid = map.submap(index).search_grid();
        let mut search = Search::new(positions, window);
        for _ in 0..2 {
            search.advance(&grid, usize::MAX);
            if let Some(place) = search.best() {
                best = best.max(place.score);
                found.push((place.score, index, place.pose));
            }
            search.search_elsewhere(SEARCHED_SHARE, SAME_PLACE);
        }
    }
    found.retain(|(score, ..)| *score >= SEARCHED_SHARE * best);
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found
        .into_iter()
        .map(|(_, index, pose)| (index, pose))
        .collect()
}

/// Middle of points and half their extents along x and y, metres.
pub(super) fn extent(points: impl Iterator<Item = Point2<f64>>) -> (Point2<f64>, [f64; 2]) {
    let empty = (
        Point2::new(f64::MAX, f64::MAX),
        Point2::new(f64::MIN, f64::MIN),
    );
    let (low, high) = points.fold(empty, |(low, high), point| {
        (low.inf(&point), high.sup(&point))
    });
    (nalgebra::center(&low, &high), (0.5 * (high - low)).into())
}
