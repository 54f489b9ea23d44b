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

/// Least score of a place.
const MIN_SCORE: f64 = 0.5;
/// Least share of inliers of a place.
const MIN_INLIERS: f64 = 0.6;
/// Another place with more than this share of the best score makes it ambiguous.
const AMBIGUOUS_SHARE: f64 = 0.85;
/// Two poses this near are one place: metres and radians.
const SAME_PLACE: (f64, f64) = (1.0, 0.35);
/// The vehicle may be this far off the way of a submap, metres.
pub(super) const BESIDE_M: f64 = 3.0;

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
    let mut found: Vec<(f64, u32, Isometry2<f64>)> = Vec::new();
    for index in (0..map.submap_count()).filter(|index| !map.submap(*index).is_empty()) {
        let window = if let Some((pose, (half_m, half_rad))) = near {
            let Some(middle) = map.expected_near(index, pose, half_m) else {
                continue;
            };
            (middle, half_m, half_rad)
        } else {
            let (middle, half_m) = map.extent(index);
            (middle, half_m + BESIDE_M, std::f64::consts::PI)
        };
        let grid = map.submap(index).search_grid();
        let mut except = None;
        loop {
            let best = found.iter().map(|(score, ..)| *score).fold(0.0, f64::max);
            let window = SearchWindow {
                middle: window.0,
                half_m: window.1,
                half_rad: window.2,
                min_score: (AMBIGUOUS_SHARE * best).max(MIN_SCORE),
                prior: None,
                except,
            };
            let mut search = Search::new(&positions, window);
            search.advance(&grid, usize::MAX);
            let Some(place) = search.best() else {
                break;
            };
            found.push((place.score, index, place.pose));
            if except.is_some() {
                break;
            }
            except = Some((place.pose, SAME_PLACE.0, SAME_PLACE.1));
        }
    }
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

/// Middle and half the extent of points, metres.
pub(super) fn extent(points: impl Iterator<Item = Point2<f64>>) -> (Point2<f64>, f64) {
    let empty = (
        Point2::new(f64::MAX, f64::MAX),
        Point2::new(f64::MIN, f64::MIN),
    );
    let (low, high) = points.fold(empty, |(low, high), point| {
        (low.inf(&point), high.sup(&point))
    });
    (nalgebra::center(&low, &high), 0.5 * (high - low).max())
}
