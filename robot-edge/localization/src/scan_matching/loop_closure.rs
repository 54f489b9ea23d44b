//! Loop closure: which submaps may show the place where the vehicle is, whether they do, and when to believe it.
//!
//! Candidates come from the estimated position and its drift since the submap was made. One is matched by branch and
//! bound (Hess et al. 2016) and refined. Where the drift is small, a good match is a closure. Where it is
//! large, a match must be better than every other one in the window, and several matches along the way must agree
//! (as in E. Olson, "Recognizing Places using Spectrally Clustered Local Matches", RAS 2009, here by pairs) before
//! they become closures together.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};

use nalgebra::{Isometry2, Matrix3, Point2, Vector2, Vector3};

use super::scan_points::ScanPoint;
use super::search_grid::{Search, SearchGrid, SearchWindow};
use super::submap::{Registered, Submap, difference};

/// Settings of loop closure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosureSettings {
    /// A submap is a candidate within this distance of one of its keyframes, beyond the drift, metres.
    pub place_m: f64,
    /// Growth of the window: metres per metre driven, and radians per metre.
    pub drift_per_m: (f64, f64),
    /// Half of the least window: metres and radians.
    pub least_window: (f64, f64),
    /// Half of the greatest window: metres and radians.
    pub greatest_window: (f64, f64),
    /// A window up to this is small: a good match in it is a closure, metres.
    pub small_window_m: f64,
    /// Least share of inliers of a closure, in small and in large windows.
    pub min_inliers: (f64, f64),
    /// Least score of a correlative match, in small and in large windows.
    pub min_score: (f64, f64),
    /// Another pose with more than this share of the best score makes a match ambiguous.
    pub ambiguous_share: f64,
    /// Matches that must agree in a large window, and the least way between the first and the last, metres: within a piece of the map,
    /// and to join two pieces, since nothing else says that the vehicle is at this place and not at another like it.
    pub agreement: (usize, [f64; 2]),
    /// Standard deviations of a closure beside its noise: metres and radians.
    pub noise: (f64, f64),
    /// Drift that is left after a closure in a large window, until one in a small window confirms it: metres and radians.
    pub large_drift: (f64, f64),
    /// Candidates per keyframe.
    pub per_keyframe: usize,
    /// Blocks that are scored per scan, in large windows.
    pub blocks_per_scan: usize,
}

impl Default for ClosureSettings {
    fn default() -> Self {
        Self {
            place_m: 3.0,
            drift_per_m: (0.04, 0.04_f64.to_radians()),
            least_window: (0.3, 3.0_f64.to_radians()),
            greatest_window: (40.0, 180.0_f64.to_radians()),
            small_window_m: 0.75,
            min_inliers: (0.5, 0.5),
            min_score: (0.22, 0.5),
            ambiguous_share: 0.9,
            agreement: (3, [2.0, 8.0]),
            noise: (0.03, 0.3_f64.to_radians()),
            large_drift: (0.3, 4.0_f64.to_radians()),
            per_keyframe: 2,
            blocks_per_scan: 6_000,
        }
    }
}

/// A match of a keyframe with a submap.
#[derive(Clone, Copy, Debug)]
pub struct Closure {
    /// The keyframe.
    pub keyframe: u32,
    /// The submap.
    pub submap: u32,
    /// Pose of the vehicle at the keyframe.
    pub submap_from_base: Isometry2<f64>,
    /// Inverse covariance of the pose in the frame of the vehicle.
    pub information: Matrix3<f64>,
}

impl Closure {
    /// Of a keyframe that was found in a submap.
    pub const fn new(keyframe: u32, submap: u32, found: &Registered) -> Self {
        Self {
            keyframe,
            submap,
            submap_from_base: found.submap_from_base,
            information: found.information,
        }
    }
}

/// Half the size of a search: metres and radians.
pub type Window = (f64, f64);

/// A match under way: of points, in the frame of the vehicle, with a submap.
#[derive(Clone, Debug)]
pub struct SubmapMatch {
    points: Vec<ScanPoint>,
    is_small: bool,
    search: Search,
    /// Found; the search for another pose as good is under way.
    best: Option<Isometry2<f64>>,
}

impl SubmapMatch {
    /// Around an expected pose, and near the way of the submap, which lies between two corners in its frame (metres): a place beside
    /// it another submap shows better.
    pub fn new(
        points: Vec<ScanPoint>,
        expected: Isometry2<f64>,
        (half_m, half_rad): Window,
        way: [Vector2<f64>; 2],
        settings: &ClosureSettings,
    ) -> Self {
        let is_small = half_m <= settings.small_window_m;
        let at = expected.translation.vector;
        let low = at
            .add_scalar(-half_m)
            .sup(&way[0].add_scalar(-settings.place_m));
        let high = at
            .add_scalar(half_m)
            .inf(&way[1].add_scalar(settings.place_m));
        let (low, high) = (low.inf(&high), low.sup(&high));
        let (of_small, of_large) = settings.min_score;
        let window = SearchWindow {
            middle: Isometry2::from_parts((0.5 * (low + high)).into(), expected.rotation),
            half_m: (0.5 * (high - low)).into(),
            half_rad,
            min_score: if is_small { of_small } else { of_large },
            prior: None,
        };
        Self {
            search: Search::new(&search_points(&points), window),
            points,
            is_small,
            best: None,
        }
    }

    /// Goes on by about `max_blocks` blocks. `None` if it is not finished; else what was found, if it matches and is
    /// not ambiguous.
    pub fn advance(
        &mut self,
        submap: &Submap,
        grid: &SearchGrid,
        max_blocks: usize,
        settings: &ClosureSettings,
    ) -> Option<Option<Registered>> {
        if !self.search.advance(grid, max_blocks) {
            return None;
        }
        let pose = match (self.best, self.search.best()) {
            (None, Some(found)) if !self.is_small => {
                self.best = Some(found.pose);
                self.search
                    .search_elsewhere(settings.ambiguous_share, (0.7, 15_f64.to_radians()));
                return None;
            }
            (None, Some(found)) => found.pose,
            (Some(best), None) => best,
            (None, None) | (Some(_), Some(_)) => return Some(None),
        };
        let registered = submap.register(&self.points, &pose, None);
        let step = difference(&pose, &registered.submap_from_base);
        let is_near = step.xy().norm() < 0.3 && step.z.abs() < 0.1;
        let is_determined =
            registered.degenerate == 0 || (self.is_small && registered.degenerate == 1);
        let (of_small, of_large) = settings.min_inliers;
        let min_inliers = if self.is_small { of_small } else { of_large };
        let is_good = registered.inliers >= min_inliers && is_near && is_determined;
        let information = with_noise(&registered.information, settings.noise);
        Some(is_good.then_some(Registered {
            information,
            ..registered
        }))
    }
}

/// Information of a measurement whose noise has a further part: metres and radians.
pub fn with_noise(information: &Matrix3<f64>, noise: (f64, f64)) -> Matrix3<f64> {
    // (Σ + N)⁻¹ = (I + ΛN)⁻¹ Λ, which needs no inverse of a degenerate Λ.
    let noise = Vector3::new(noise.0, noise.0, noise.1).map(|sigma| sigma * sigma);
    let both = Matrix3::identity() + information * Matrix3::from_diagonal(&noise);
    let noisy = both.try_inverse().unwrap_or_else(Matrix3::zeros) * information;
    0.5 * (noisy + noisy.transpose())
}

/// At most this many points are searched with.
const MAX_SEARCH_POINTS: usize = 150;

/// Points for a search: evenly taken from all.
pub fn search_points(points: &[ScanPoint]) -> Vec<Point2<f64>> {
    let step = points.len().div_ceil(MAX_SEARCH_POINTS).max(1);
    points
        .iter()
        .step_by(step)
        .map(|point| point.position)
        .collect()
}

/// Drift between submaps, along the shortest way through the graph.
#[derive(Clone, Debug, Default)]
pub struct DriftGraph {
    /// Of each submap, its neighbours and the drift to them: metres and radians.
    pub(super) links: Vec<BTreeMap<u32, Window>>,
}

impl DriftGraph {
    /// Whether its links are between so many submaps.
    pub(super) fn is_of(&self, submaps: usize) -> bool {
        let mut linked = self.links.iter().flat_map(BTreeMap::keys);
        self.links.len() <= submaps && linked.all(|other| (*other as usize) < self.links.len())
    }

    /// Links two submaps; of two drifts the lesser holds.
    pub fn link(&mut self, a: u32, b: u32, drift: Window) {
        let size = self.links.len().max(1 + a.max(b) as usize);
        self.links.resize_with(size, BTreeMap::new);
        for (from, to) in [(a, b), (b, a)] {
            let known = self.links[from as usize].entry(to).or_insert(drift);
            if drift.0 < known.0 {
                *known = drift;
            }
        }
    }

    /// Whether there is a link between two submaps.
    pub fn are_linked(&self, a: u32, b: u32) -> bool {
        self.links
            .get(a as usize)
            .is_some_and(|links| links.contains_key(&b))
    }

    /// Whether a submap has a closure with a newer one.
    pub fn is_closed(&self, submap: u32) -> bool {
        let links = self.links.get(submap as usize);
        links.is_some_and(|links| links.range(submap + 2..).next().is_some())
    }

    /// Drift of every submap from this one: metres and radians. Errors of heading are independent of each other: of many, three
    /// standard deviations of their sum are less than the sum of all.
    pub fn from(&self, submap: u32) -> Vec<Window> {
        let mut drifts = vec![[f64::INFINITY; 3]; self.links.len()];
        let mut next = BinaryHeap::new();
        // Micrometres, which have an order.
        let key = |drift: f64| Reverse((drift.min(1e6) * 1e6) as u64);
        if let Some(own) = drifts.get_mut(submap as usize) {
            *own = [0.0; 3];
            next.push((key(0.0), submap));
        }
        while let Some((at_key, at)) = next.pop() {
            let [m, rad, rad2] = drifts[at as usize];
            if at_key != key(m) {
                continue;
            }
            for (&to, link) in &self.links[at as usize] {
                let way = [m + link.0, rad + link.1, rad2 + link.1 * link.1];
                if way[0] < drifts[to as usize][0] {
                    drifts[to as usize] = way;
                    next.push((key(way[0]), to));
                }
            }
        }
        let window = |[m, rad, rad2]: [f64; 3]| (m, rad.min(3.0 * libm::sqrt(rad2)));
        drifts.into_iter().map(window).collect()
    }
}

/// Matches in large windows that wait for others to agree.
#[derive(Clone, Debug, Default)]
pub struct PendingClosures(VecDeque<Pending>);

#[derive(Clone, Copy, Debug)]
struct Pending {
    closure: Closure,
    /// Pose of the vehicle by the driving alone.
    local_from_base: Isometry2<f64>,
    driven_m: f64,
}

/// Limit of the waiting matches; beyond it the oldest is dropped.
const MAX_PENDING: usize = 32;
/// A match waits for this way, metres.
const MAX_WAY_M: f64 = 30.0;

impl PendingClosures {
    /// Adds a match with the pose of its keyframe by the driving alone; returns it with those that agree with it, if they
    /// are enough. `joins_pieces`: it is between two pieces of the map. `anchor` gives the pose of a submap in the map.
    pub fn add(
        &mut self,
        (closure, joins_pieces): (Closure, bool),
        (local_from_base, driven_m): (Isometry2<f64>, f64),
        anchor: impl Fn(u32) -> Isometry2<f64>,
        settings: &ClosureSettings,
    ) -> Vec<Closure> {
        self.0
            .retain(|pending| pending.driven_m >= driven_m - MAX_WAY_M);
        let own = Pending {
            closure,
            local_from_base,
            driven_m,
        };
        let place = |closure: &Closure| anchor(closure.submap) * closure.submap_from_base;
        let own_place = place(&closure);
        let agrees = |other: &Pending| {
            let by_closure = place(&other.closure).inv_mul(&own_place);
            let by_driving = other.local_from_base.inv_mul(&own.local_from_base);
            let step = difference(&by_driving, &by_closure);
            let way_m = own.driven_m - other.driven_m;
            step.xy().norm() < 0.2 + 0.02 * way_m && step.z.abs() < 0.05 + 0.002 * way_m
        };
        let (agreeing, others): (Vec<_>, Vec<_>) = self.0.iter().copied().partition(agrees);
        let first_m = agreeing
            .iter()
            .map(|other| other.driven_m)
            .fold(driven_m, f64::min);
        let (number, ways_m) = settings.agreement;
        let way_m = ways_m[usize::from(joins_pieces)];
        if agreeing.len() + 1 >= number && driven_m - first_m >= way_m {
            self.0 = others.into();
            return agreeing
                .iter()
                .map(|other| other.closure)
                .chain([closure])
                .collect();
        }
        self.0.push_back(own);
        if self.0.len() > MAX_PENDING {
            self.0.pop_front();
        }
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drift_of_heading_grows_with_the_root_of_many_links() {
        let mut drifts = DriftGraph::default();
        for submap in 0..100 {
            drifts.link(submap, submap + 1, (0.3, 0.02));
        }
        let from = drifts.from(0);
        for (submap, expected) in [(4, (1.2, 0.08)), (100, (30.0, 0.6))] {
            let (m, rad) = from[submap];
            assert!(
                (m - expected.0).abs() < 1e-9 && (rad - expected.1).abs() < 1e-9,
                "{m} {rad}"
            );
        }
    }
}
