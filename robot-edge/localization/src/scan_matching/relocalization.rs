//! Finding the vehicle in a map: branch and bound over all submaps gives places where it may be. These are followed while it drives,
//! until one of them explains nearly all that it sees and no other does about as well.

use nalgebra::{Isometry2, Matrix3, Point2};

use super::loop_closure::{ClosureSettings, search_points, with_noise};
use super::scan_points::ScanPoint;
use super::search_grid::{Search, SearchGrid, SearchWindow};
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
/// nearly as well. The whole map is searched meanwhile, a part of it each scan.
#[derive(Clone, Debug, Default)]
pub struct Relocalizer {
    driven_m: f64,
    next_m: f64,
    next_search_m: f64,
    last: Option<Isometry2<f64>>,
    /// Where the vehicle may be, the best first, at the driven pose of the newest update.
    places: Vec<Place>,
    at: Isometry2<f64>,
    search: Option<MapSearch>,
    /// Way driven when the last search that has ended began, metres.
    searched_m: f64,
}

/// A search in the whole map for what the vehicle saw at one pose.
#[derive(Clone, Debug)]
struct MapSearch {
    local_from_base: Isometry2<f64>,
    driven_m: f64,
    points: Vec<ScanPoint>,
    positions: Vec<Point2<f64>>,
    /// Only near this pose, with half the size of the region: metres and radians.
    near: Option<Near>,
    min_score: f64,
    /// Submaps before this one were begun.
    next: u32,
    running: Option<SubmapSearch>,
    /// Score, submap, and pose in it.
    found: Vec<(f64, u32, Isometry2<f64>)>,
    /// Those of `found` that were registered.
    places: Vec<Place>,
}

type Near = (Isometry2<f64>, (f64, f64));

/// A search in one submap.
#[derive(Clone, Debug)]
struct SubmapSearch {
    submap: u32,
    grid: SearchGrid,
    search: Search,
    /// The best place was found, and another is searched for.
    is_elsewhere: bool,
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
/// Parts of a search in the whole map that a scan has: blocks, and places that are registered.
const BLOCKS_PER_SCAN: usize = 60_000;
/// What a search in one submap and its grid take at least.
const BLOCKS_PER_SEARCH: usize = 5_000;
const REGISTERED_PER_SCAN: usize = 4;
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
        points: impl Fn() -> Vec<ScanPoint>,
        near: Option<(&Isometry2<f64>, (f64, f64))>,
        settings: &ClosureSettings,
    ) -> Option<Place> {
        let last = self.last.replace(*local_from_base);
        self.driven_m += last.map_or(0.0, |last| difference(&last, local_from_base).xy().norm());
        if self.search.is_none() && self.driven_m >= self.next_search_m {
            self.next_search_m = self.driven_m + SEARCH_M;
            let near = near.map(|(pose, half)| (*pose, half));
            let search = MapSearch::new(points(), (*local_from_base, self.driven_m), near);
            self.search = Some(search);
        }
        if let Some(mut search) = self.search.take() {
            if search.advance(map, settings) {
                self.searched_m = search.driven_m;
                let step = search.local_from_base.inv_mul(&self.at);
                let found = search.places.into_iter().map(|mut place| {
                    place.map_from_base *= step;
                    place
                });
                self.places.extend(found);
            } else {
                self.search = Some(search);
            }
        }
        if self.driven_m < self.next_m {
            return None;
        }
        self.next_m = self.driven_m + UPDATE_M;
        self.follow(map, local_from_base, &points(), settings);
        let best = self.places.first()?;
        let hold_m = near.map_or(HOLD_M, |_| 0.0);
        let distinct = DISTINCT.0 * (1.0 - best.explained) + DISTINCT.1;
        let is_sure = best.explained >= MIN_EXPLAINED.1
            && best.is_determined
            // Then the whole map was searched again, for places that look like it.
            && self.searched_m - best.since_m >= hold_m
            && self
                .places
                .get(1)
                .is_none_or(|other| 1.0 - other.explained >= distinct);
        is_sure.then_some(*best)
    }

    /// Registers what the vehicle sees now at each place.
    fn follow(
        &mut self,
        map: &SlamMap,
        local_from_base: &Isometry2<f64>,
        points: &[ScanPoint],
        settings: &ClosureSettings,
    ) {
        let step = self.at.inv_mul(local_from_base);
        self.at = *local_from_base;
        let pieces = map.pieces();
        let mut places: Vec<Place> = Vec::new();
        for before in std::mem::take(&mut self.places) {
            let expected = before.map_from_base * step;
            let Some(submap) = map.nearest_submap(&expected) else {
                continue;
            };
            let start = map.anchor(submap).inv_mul(&expected);
            let place = registered((map, &pieces), points, submap, &start, settings);
            let holds = is_within(&expected, &place.map_from_base, AGREEMENT);
            places.push(Place {
                since_m: if holds { before.since_m } else { self.driven_m },
                ..place
            });
        }
        places.retain(|place| place.explained >= MIN_EXPLAINED.0);
        places.sort_by(|a, b| {
            b.explained
                .total_cmp(&a.explained)
                .then(a.since_m.total_cmp(&b.since_m))
        });
        for place in places {
            let is_full = self.places.len() >= MAX_PLACES;
            let same = self
                .places
                .iter_mut()
                .find(|other| is_within(&other.map_from_base, &place.map_from_base, SAME_PLACE));
            match same {
                Some(other) if is_within(&other.map_from_base, &place.map_from_base, AGREEMENT) => {
                    other.since_m = other.since_m.min(place.since_m);
                }
                None if !is_full => self.places.push(place),
                Some(_) | None => {}
            }
        }
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

impl MapSearch {
    fn new(
        points: Vec<ScanPoint>,
        (local_from_base, driven_m): (Isometry2<f64>, f64),
        near: Option<Near>,
    ) -> Self {
        Self {
            // Half of them do, since all points decide later.
            positions: search_points(&points).into_iter().step_by(2).collect(),
            points,
            local_from_base,
            driven_m,
            near,
            min_score: MIN_SCORES[0],
            next: 0,
            running: None,
            found: Vec::new(),
            places: Vec::new(),
        }
    }

    /// Goes on by the part of one scan, near a pose to the end; whether it is finished.
    fn advance(&mut self, map: &SlamMap, settings: &ClosureSettings) -> bool {
        let (mut blocks, registered_most) = match self.near {
            Some(_) => (usize::MAX, usize::MAX),
            None => (BLOCKS_PER_SCAN, REGISTERED_PER_SCAN),
        };
        while self.running.is_some() || self.next < map.submap_count() {
            if blocks == 0 {
                return false;
            }
            blocks = self.search(map, blocks);
            if self.running.is_none() && self.next == map.submap_count() {
                let best = self.best();
                self.found
                    .retain(|(score, ..)| *score >= SEARCHED_SHARE * best);
                self.found.sort_by(|a, b| a.0.total_cmp(&b.0));
                if self.found.is_empty() && self.min_score > MIN_SCORES[1] {
                    (self.min_score, self.next) = (MIN_SCORES[1], 0);
                }
            }
        }
        let pieces = map.pieces();
        for _ in 0..registered_most {
            let Some((_, submap, start)) = self.found.pop() else {
                return true;
            };
            let place = registered((map, &pieces), &self.points, submap, &start, settings);
            if place.explained >= MIN_EXPLAINED.0 {
                self.places.push(Place {
                    since_m: self.driven_m,
                    ..place
                });
            }
        }
        self.found.is_empty()
    }

    fn best(&self) -> f64 {
        let scores = self.found.iter().map(|(score, ..)| *score);
        scores.fold(0.0, f64::max)
    }

    /// Goes on in the present submap, or begins with the next; returns what is left of the blocks.
    fn search(&mut self, map: &SlamMap, blocks: usize) -> usize {
        let running = self.running.take().or_else(|| self.begin(map));
        let Some(mut running) = running else {
            return blocks;
        };
        if !running.search.advance(&running.grid, blocks) {
            self.running = Some(running);
            return 0;
        }
        if let Some(place) = running.search.best() {
            self.found.push((place.score, running.submap, place.pose));
        }
        if !running.is_elsewhere {
            running.is_elsewhere = true;
            running.search.search_elsewhere(SEARCHED_SHARE, SAME_PLACE);
            self.running = Some(running);
        }
        blocks.saturating_sub(BLOCKS_PER_SEARCH)
    }

    /// The search in the next submap, if it shows anything, near the pose.
    fn begin(&mut self, map: &SlamMap) -> Option<SubmapSearch> {
        let submap = self.next;
        self.next += 1;
        if map.submap(submap).is_empty() {
            return None;
        }
        let (middle, half_m, half_rad) = if let Some((pose, (half_m, half_rad))) = &self.near {
            let middle = map.expected_near(submap, pose, *half_m)?;
            (middle, [*half_m; 2], *half_rad)
        } else {
            let (middle, half_m) = map.extent(submap);
            let half_m = half_m.map(|half_m| half_m + BESIDE_M);
            (middle, half_m, std::f64::consts::PI)
        };
        let window = SearchWindow {
            middle,
            half_m,
            half_rad,
            min_score: (SEARCHED_SHARE * self.best()).max(self.min_score),
            prior: None,
        };
        Some(SubmapSearch {
            submap,
            grid: map.submap(submap).search_grid(),
            search: Search::new(&self.positions, window),
            is_elsewhere: false,
        })
    }
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
