//! Finding the vehicle in a map: branch and bound over all submaps, refused where another place is about as good.

use nalgebra::{Isometry2, Matrix3, Point2};

use super::loop_closure::{ClosureSettings, search_points, with_noise};
use super::scan_points::ScanPoint;
use super::search_grid::{Search, SearchWindow};
use super::slam_map::SlamMap;
use super::submap::difference;

/// Result of [`locate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Location {
    /// The place, and no other is nearly as good.
    Found(Place),
    /// More than one place is about as good.
    Ambiguous,
    /// No place is good enough.
    Unknown,
}

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
    /// Mean likelihood of the points, 0 to 1.
    pub score: f64,
    /// Share of the points that lie on surfaces of the submap.
    pub inliers: f64,
}

/// Least score of a place: at first, and where there is none. The first search is quick.
const MIN_SCORES: [f64; 2] = [0.75, 0.5];
/// Least share of inliers of a place.
const MIN_INLIERS: f64 = 0.75;
/// Another place with more than this share of the best score makes it ambiguous.
const AMBIGUOUS_SHARE: f64 = 0.85;
/// Two poses this near are one place: metres and radians.
const SAME_PLACE: (f64, f64) = (1.0, 0.35);
/// The vehicle may be this far off the way of a submap, metres.
pub(super) const BESIDE_M: f64 = 3.0;

/// Finds a vehicle that drives, by places that agree over some metres: a part of the world that is not in the map may look like one
/// that is.
#[derive(Clone, Debug, Default)]
pub struct Relocalizer {
    driven_m: f64,
    next_m: f64,
    last: Option<Isometry2<f64>>,
    /// Where the frame of the driven poses lies in the map, by a place, and the way driven when it was found.
    agreed: Option<(Isometry2<f64>, f64)>,
}

/// Way from search to search, metres.
const SEARCH_M: f64 = 1.0;
/// Places must agree over this way, metres; over half of it once the points show twice this way, …
const AGREE_M: f64 = 4.0;
/// …and to this difference: metres and radians.
const AGREEMENT: (f64, f64) = (0.3, 0.06);

impl Relocalizer {
    /// The vehicle is at `local_from_base`; `points` gives what it has seen in the last metres, in its frame. Returns a place once it is
    /// sure. `near`: as for [`locate`]; there one place suffices.
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
        self.next_m = self.driven_m + SEARCH_M;
        let place = match locate(map, &points(), near, settings) {
            Location::Found(place) => place,
            Location::Ambiguous => return None,
            Location::Unknown => {
                self.agreed = None;
                return None;
            }
        };
        if near.is_some() {
            return Some(place);
        }
        let agrees = |(map_from_local, _): &(Isometry2<f64>, f64)| {
            let step = difference(&(map_from_local * local_from_base), &place.map_from_base);
            step.xy().norm() < AGREEMENT.0 && step.z.abs() < AGREEMENT.1
        };
        let map_from_local = place.map_from_base * local_from_base.inverse();
        let agreed = self.agreed.filter(agrees);
        let since_m = agreed.map_or(self.driven_m, |(_, since_m)| since_m);
        self.agreed = Some((map_from_local, since_m));
        let is_long = self.driven_m >= 2.0 * AGREE_M;
        let agree_m = if is_long { 0.5 * AGREE_M } else { AGREE_M };
        (self.driven_m - since_m >= agree_m).then_some(place)
    }
}

/// Finds the vehicle by points in its frame, best those of some metres of driving
/// ([`ScanSlam::surroundings`](super::slam::ScanSlam::surroundings)): in the whole map, or near a pose (with half the
/// size of the region: metres and radians).
pub fn locate(
    map: &SlamMap,
    points: &[ScanPoint],
    near: Option<(&Isometry2<f64>, (f64, f64))>,
    settings: &ClosureSettings,
) -> Location {
    let positions = search_points(points);
    let found = MIN_SCORES
        .iter()
        .map(|min_score| places(map, &positions, near, *min_score))
        .find(|found| !found.is_empty());
    let found = found.unwrap_or_default();
    let in_map = |(_, index, pose): &(f64, u32, Isometry2<f64>)| map.anchor(*index) * pose;
    let Some(best) = found.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Location::Unknown;
    };
    let is_elsewhere = |other: &(f64, u32, Isometry2<f64>)| {
        let step = difference(&in_map(best), &in_map(other));
        step.xy().norm() > SAME_PLACE.0 || step.z.abs() > SAME_PLACE.1
    };
    if found
        .iter()
        .any(|other| other.0 > AMBIGUOUS_SHARE * best.0 && is_elsewhere(other))
    {
        return Location::Ambiguous;
    }
    let (score, submap, pose) = *best;
    let registered = map.submap(submap).register(points, &pose, None);
    if registered.inliers < MIN_INLIERS {
        return Location::Unknown;
    }
    if registered.degenerate > 0 {
        return Location::Ambiguous;
    }
    Location::Found(Place {
        map_from_base: map.anchor(submap) * registered.submap_from_base,
        submap,
        submap_from_base: registered.submap_from_base,
        information: with_noise(&registered.information, settings.noise),
        score,
        inliers: registered.inliers,
    })
}

/// Score, index of the submap and pose in it, of the best place of each submap and of another one in it, as far as they
/// are above the least score and about as good as the best of all.
fn places(
    map: &SlamMap,
    positions: &[Point2<f64>],
    near: Option<(&Isometry2<f64>, (f64, f64))>,
    min_score: f64,
) -> Vec<(f64, u32, Isometry2<f64>)> {
    let mut found: Vec<(f64, u32, Isometry2<f64>)> = Vec::new();
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
        let grid = map.submap(index).search_grid();
        let best = found.iter().map(|(score, ..)| *score).fold(0.0, f64::max);
        let window = SearchWindow {
            middle,
            half_m,
            half_rad,
            min_score: (AMBIGUOUS_SHARE * best).max(min_score),
            prior: None,
        };
        let mut search = Search::new(positions, window);
        for _ in 0..2 {
            search.advance(&grid, usize::MAX);
            found.extend(search.best().map(|place| (place.score, index, place.pose)));
            search.search_elsewhere(AMBIGUOUS_SHARE, SAME_PLACE);
        }
    }
    found
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
