//! Simultaneous localization and mapping by planar scans: scan to submap, submaps to a pose graph.
//!
//! The frame `local` never jumps: it goes on from scan to scan. A closure moves `map_from_local`.

use std::task::Poll;

use measurement::scan::Scan;
use measurement::time::RobotTime;
use nalgebra::{Isometry2, Matrix3, Point2, Vector2, Vector3};

use super::active_submap::ActiveSubmap;
use super::last_scan::LastScan;
use super::loop_closure::{Closure, PendingClosures, SubmapMatch, Window, search_points};
use super::optimizer::{self, Optimizer};
use super::pose_graph::{Edge, PoseGraph};
use super::position_fixes::{AntennaPosition, PendingPositions, PositionFix};
use super::relocalization::Place;
use super::scan_points::{ScanPoint, scan_points};
use super::search_grid::{Search, SearchGrid, SearchWindow};
use super::slam_map::{Candidate, SlamMap, SubmapRecord};
use super::slam_settings::SlamSettings;
use super::submap::{Prior, Registered, Submap, difference};

/// One scan and what is known about the motion.
#[derive(Clone, Copy, Debug)]
pub struct ScanInput<'a> {
    /// Of the first beam.
    pub stamp: RobotTime,
    /// The scan.
    pub scan: &'a Scan,
    /// Pose of the sensor on the vehicle.
    pub base_from_sensor: Isometry2<f64>,
    /// Pose of the vehicle by odometry at the stamp.
    pub odom_from_base: Option<Isometry2<f64>>,
    /// Only its heading is known, by an attitude sensor.
    pub is_heading_only: bool,
    /// It is by clouds, which are never late and err less than other odometry.
    pub is_by_clouds: bool,
    /// Its walls only close loops: they mislead where clouds, or stripes of them, say where the vehicle is.
    pub is_placed: bool,
    /// Place of the receiver's antenna on the vehicle, seen from above, metres.
    pub base_from_antenna: Point2<f64>,
}

impl ScanInput<'_> {
    fn has_odometry(&self) -> bool {
        self.odom_from_base.is_some() && !self.is_heading_only
    }
}

/// How far a pose is determined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Confidence {
    /// By the scan, in all directions.
    Full,
    /// Not along this direction in the frame of the vehicle: there, by the prior alone.
    UncertainAlong(Vector2<f64>),
    /// By odometry alone: the scan shows too little of the map.
    OdometryOnly,
    /// Not at all: the scan does not fit the map, and there is no odometry. A new map begins.
    Lost,
}

/// Pose of one scan.
#[derive(Clone, Copy, Debug)]
pub struct ScanPose {
    /// In the frame that never jumps.
    pub local_from_base: Isometry2<f64>,
    /// To the frame of the map, by the closures so far.
    pub map_from_local: Isometry2<f64>,
    /// Covariance of x, y (metres) and yaw (radians) relative to the current submap, in the frame of the vehicle.
    pub covariance: Matrix3<f64>,
    /// How far it is determined.
    pub confidence: Confidence,
    /// Share of the points that lie on surfaces of the map.
    pub inliers: f64,
    /// Root mean square of the points' distances from surfaces of the map, metres.
    pub residual_m: f64,
    /// The newest keyframe.
    pub keyframe: u32,
    /// Pose in the frame of that keyframe.
    pub keyframe_from_base: Isometry2<f64>,
    /// The poses of keyframes changed at this scan.
    pub is_corrected: bool,
}

/// The state of localization and mapping.
#[derive(Clone, Debug)]
pub struct ScanSlam {
    settings: SlamSettings,
    active: Vec<ActiveSubmap>,
    map: SlamMap,
    optimizer: Optimizer,
    /// Grids of finished submaps, the last used at the end.
    grids: Vec<(u32, SearchGrid)>,
    searches: ClosureSearches,
    closures: ClosureCounts,
    last: Option<LastScan>,
    map_from_local: Isometry2<f64>,
    /// Where it goes on in a map, until the first scan.
    resumed_at: Option<Place>,
    driven_m: f64,
    positions: PendingPositions,
    /// Without odometry, scans that did not determine the pose, less those since then that did.
    lost: u32,
}

/// Numbers of closures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClosureCounts {
    /// Those that were believed.
    pub added: u64,
    /// Of these, those that later evidence contradicted.
    pub removed: u64,
}

/// Searches for closures.
#[derive(Clone, Debug, Default)]
struct ClosureSearches {
    /// Matches that wait for others to agree.
    pending: PendingClosures,
    /// In a large window.
    running: Option<ClosureSearch>,
    /// Number of those that found nothing.
    failed: usize,
    /// Submap of the newest one that found something, and the way driven then, metres.
    last_match: Option<(u32, f64)>,
    /// Finished submaps up to this one were matched with others since the map moved far.
    swept: u32,
}

/// A match of a keyframe in a large window, a part of it each scan.
#[derive(Clone, Debug)]
struct ClosureSearch {
    keyframe: u32,
    submap: u32,
    local_from_base: Isometry2<f64>,
    driven_m: f64,
    search: SubmapMatch,
    grid: SearchGrid,
}

/// Limit of the blocks in which a scan is searched for in the current submap.
const MAX_BLOCKS: usize = 20_000;
/// After a match, the same submap is tried again for this way, metres.
const AGAIN_M: f64 = 6.0;
/// Scans that do not determine the pose, before the vehicle is lost: the velocity is then not known either.
const MAX_LOST: u32 = 3;
/// Without odometry, another pose with more than this share of the best score, and this far from it (metres), makes a scan
/// uncertain.
const ALIKE_SHARE: f64 = 0.95;
const ALIKE_M: f64 = 0.4;
/// Of x, y (m²) and yaw (rad²) where a new map begins.
const LOST_VARIANCE: Vector3<f64> = Vector3::new(100.0, 100.0, 10.0);
/// Limit of the grids of finished submaps.
const MAX_GRIDS: usize = 16;
/// A position with a greater squared error is contradicted by the map: of true errors along two axes less than 1 in 10,000 is.
const CONTRADICTED_CHI2: f64 = 20.0;

impl ScanSlam {
    /// With these settings, at the origin.
    pub fn new(settings: SlamSettings) -> Self {
        Self {
            settings,
            active: Vec::new(),
            map: SlamMap::default(),
            optimizer: Optimizer::default(),
            grids: Vec::new(),
            searches: ClosureSearches::default(),
            closures: ClosureCounts::default(),
            last: None,
            map_from_local: Isometry2::identity(),
            resumed_at: None,
            driven_m: 0.0,
            positions: PendingPositions::default(),
            lost: 0,
        }
    }

    /// Goes on in a map, from a place at which the vehicle was found in it.
    pub fn resume(settings: SlamSettings, map: SlamMap, place: &Place) -> Self {
        Self {
            map,
            map_from_local: place.map_from_base,
            resumed_at: Some(*place),
            ..Self::new(settings)
        }
    }

    /// Takes a position, in the order of time; it counts once a scan has passed it. Returns whether an older one was dropped for it.
    pub fn push_position(&mut self, position: AntennaPosition) -> bool {
        self.positions.push(position)
    }

    /// Takes a scan; scans come in the order of time.
    pub fn push(&mut self, input: &ScanInput<'_>) -> ScanPose {
        let growth = 1.0 + f64::from(self.lost.min(MAX_LOST));
        let (motion, motion_s, noise) = self.last.map_or_else(
            || (Isometry2::identity(), 0.0, Matrix3::identity()),
            |last| last.predict(input, growth, &self.settings),
        );
        let points = scan_points(
            input.scan,
            &input.base_from_sensor,
            (&motion, motion_s),
            &self.settings.points,
        );
        self.search_closure();
        self.sweep();
        let is_corrected = self.optimize();
        let Some(last) = self.last else {
            let local_from_base = Isometry2::identity();
            self.add_keyframe(&points, &local_from_base);
            self.begin_submap(&points, &local_from_base);
            if let Some(place) = self.resumed_at.take() {
                self.add_closure(
                    &Closure {
                        keyframe: self.map.graph.poses.len() as u32 - 1,
                        submap: place.submap,
                        submap_from_base: place.submap_from_base,
                        information: place.information,
                    },
                    self.active[0].index,
                    self.settings.closure.noise,
                );
            }
            return self.finish_scan(
                input,
                (motion, motion_s),
                local_from_base,
                None,
                is_corrected,
            );
        };
        let mut expected = last.local_from_base * motion;
        // An error of the norm would double with each scan whose pose is by odometry.
        expected.rotation.renormalize();
        for active in &mut self.active {
            active.predict(&motion, &noise);
        }
        let (registered, mut confidence) =
            self.match_scan(&points, &expected, &noise, input.has_odometry());
        if input.is_by_clouds {
            confidence = Confidence::Full;
        } else if input.is_placed {
            confidence = Confidence::OdometryOnly;
        }
        let is_determined = input.has_odometry() || confidence == Confidence::Full;
        let was_lost = self.lost > MAX_LOST;
        self.lost = if is_determined {
            self.lost.saturating_sub(1)
        } else {
            self.lost + 1
        };
        let is_matched =
            !input.is_placed && !matches!(confidence, Confidence::Lost | Confidence::OdometryOnly);
        let local_from_base = if is_matched {
            self.active[0].local_from_anchor * registered.submap_from_base
        } else {
            expected
        };
        for active in self.active.iter_mut().filter(|_| is_matched) {
            active.update(&registered.information);
        }
        let step = last.local_from_base.inv_mul(&local_from_base);
        // While odometry stands still, the next one counts from the scan at which it stopped.
        let is_new = last
            .odometry
            .is_some_and(|(before, _)| input.odom_from_base != Some(before));
        let by_odometry = input.has_odometry() && is_new;
        for active in &mut self.active {
            active.anchor_from_base_by_odometry *= if by_odometry { motion } else { step };
        }
        if confidence == Confidence::Lost || was_lost || self.lost > MAX_LOST {
            // As long as a direction is not determined, a new map would not be either.
            if confidence == Confidence::Lost && self.lost > MAX_LOST || is_determined {
                self.begin_anew(&points, &local_from_base);
            }
            let result = (registered.inliers, registered.residual_m, Confidence::Lost);
            return self.finish_scan(
                input,
                (Isometry2::identity(), motion_s),
                local_from_base,
                Some(result),
                is_corrected,
            );
        }
        self.driven_m +=
            (last.local_from_base.translation.vector - local_from_base.translation.vector).norm();
        let since = difference(&last.keyframe_local, &local_from_base);
        if since.xy().norm() >= self.settings.keyframe_m
            || since.z.abs() >= self.settings.keyframe_rad
        {
            self.take_keyframe(&points, &local_from_base);
        }
        let result = Some((registered.inliers, registered.residual_m, confidence));
        // After a scan that was lost, the step is that of a correction.
        let motion = if last.is_lost {
            Isometry2::identity()
        } else {
            last.local_from_base.inv_mul(&local_from_base)
        };
        self.finish_scan(
            input,
            (motion, motion_s),
            local_from_base,
            result,
            is_corrected,
        )
    }

    /// Searches for a scan around its expected pose in the current submap, and registers it.
    fn match_scan(
        &self,
        points: &[ScanPoint],
        expected: &Isometry2<f64>,
        noise: &Matrix3<f64>,
        has_odometry: bool,
    ) -> (Registered, Confidence) {
        let active = &self.active[0];
        let prior = Prior {
            submap_from_base: active.local_from_anchor.inv_mul(expected),
            covariance: *noise,
        };
        let sigma = [noise[(0, 0)].max(noise[(1, 1)]), noise[(2, 2)]].map(libm::sqrt);
        let window = SearchWindow {
            middle: prior.submap_from_base,
            half_m: [(3.0 * sigma[0]).clamp(0.1, 1.0); 2],
            half_rad: (3.0 * sigma[1]).clamp(0.01, 0.8),
            min_score: -1.0,
            prior: Some((0.02, sigma[0], sigma[1])),
        };
        let mut search = Search::new(&search_points(points), window);
        search.advance(&active.grid, MAX_BLOCKS);
        let found = search.best().map(|best| best.pose);
        let start = found.unwrap_or(prior.submap_from_base);
        let submap = &self.map.submaps[active.index as usize].submap;
        let registered = submap.register(points, &start, Some(&prior));
        let (with_odometry, without) = self.settings.min_inliers;
        let min_inliers = if has_odometry { with_odometry } else { without };
        if registered.inliers < min_inliers {
            let by_odometry = has_odometry.then_some(Confidence::OdometryOnly);
            return (registered, by_odometry.unwrap_or(Confidence::Lost));
        }
        if let Some(along) = registered.uncertain_along {
            return (registered, Confidence::UncertainAlong(along));
        }
        // A corridor with doors alike: the scan fits at another place too, and no odometry says which is right.
        if let (Some(found), false) = (found, has_odometry) {
            search.search_elsewhere(ALIKE_SHARE, (ALIKE_M, std::f64::consts::PI));
            search.advance(&active.grid, MAX_BLOCKS);
            if let Some(other) = search.best() {
                let way = other.pose.translation.vector - found.translation.vector;
                let along = found.rotation.inverse() * way.normalize();
                return (registered, Confidence::UncertainAlong(along));
            }
        }
        (registered, Confidence::Full)
    }

    /// Optimizes to the end, after the last scan.
    pub fn finish(&mut self) {
        for _ in 0..3 {
            self.optimizer.add_far();
            while self.optimize_step(1) == Some(false) {}
            while self.sweep() {}
        }
        while self.optimize_step(1).is_some() {}
    }

    /// The map so far.
    pub const fn map(&self) -> &SlamMap {
        &self.map
    }

    /// Positions in the graph, and those of them that the map contradicts.
    pub fn positions(&self) -> (u64, u64) {
        let PoseGraph { poses, fixes, .. } = &self.map.graph;
        let chi2 = |fix: &PositionFix| fix.error(&poses[fix.keyframe as usize]).0.norm_squared();
        let aligned = fixes.iter().filter(|fix| fix.is_aligned);
        let wrong = aligned.clone().filter(|fix| chi2(fix) > CONTRADICTED_CHI2);
        (aligned.count() as u64, wrong.count() as u64)
    }

    /// Closures so far.
    pub const fn closures(&self) -> ClosureCounts {
        self.closures
    }

    fn take_keyframe(&mut self, points: &[ScanPoint], local_from_base: &Isometry2<f64>) {
        let keyframe = self.add_keyframe(points, local_from_base);
        self.close_loops(keyframe, points, local_from_base);
        if let Some(newest) = self.active.last() {
            let own = &self.map.submaps[newest.index as usize];
            if self.driven_m - newest.begun_m >= self.settings.submap_m
                || own.end - own.anchor >= self.settings.submap_keyframes
            {
                self.begin_submap(points, local_from_base);
            }
        }
    }

    /// Begins with new submaps, of which only closures will say where they are.
    fn begin_anew(&mut self, points: &[ScanPoint], local_from_base: &Isometry2<f64>) {
        // The window is wide, as the velocity is not known.
        self.lost = 1;
        for active in &mut self.active {
            active.covariance = Matrix3::from_diagonal(&LOST_VARIANCE);
        }
        self.add_keyframe(&[], local_from_base);
        self.begin_submap(points, local_from_base);
        if self.active.len() > 1 {
            let finished = self.active.remove(0);
            self.keep_grid(finished.index, finished.grid);
        }
    }

    fn add_keyframe(&mut self, points: &[ScanPoint], local_from_base: &Isometry2<f64>) -> u32 {
        let keyframe = self.map.graph.poses.len() as u32;
        self.map
            .graph
            .poses
            .push(self.map_from_local * local_from_base);
        for active in &mut self.active {
            let record = &mut self.map.submaps[active.index as usize];
            record.end = keyframe + 1;
            let anchor_from_base = active.local_from_anchor.inv_mul(local_from_base);
            for point in points {
                let point = point.in_frame(&anchor_from_base);
                record.submap.add(&point);
                active.grid.add(&point.position);
            }
            self.map.graph.edges.push(Edge {
                from: record.anchor,
                to: keyframe,
                from_from_to: anchor_from_base,
                information: active.edge_information(&anchor_from_base, &self.settings),
                is_closure: false,
            });
        }
        keyframe
    }

    /// Begins a submap at the newest keyframe, and finishes the older one of two.
    fn begin_submap(&mut self, points: &[ScanPoint], local_from_base: &Isometry2<f64>) {
        let index = self.map.submaps.len() as u32;
        let anchor = self.map.graph.poses.len() as u32 - 1;
        let mut submap = Submap::default();
        let mut grid = SearchGrid::default();
        for point in points {
            submap.add(point);
            grid.add(&point.position);
        }
        self.map.submaps.push(SubmapRecord {
            anchor,
            end: anchor + 1,
            submap,
        });
        if let Some(before) = self.active.last() {
            let drift = before.drift(local_from_base, self.driven_m, &self.settings);
            self.map.drifts.link(before.index, index, drift);
        }
        if self.active.len() == 2 {
            let finished = self.active.remove(0);
            self.keep_grid(finished.index, finished.grid);
            self.map.limit_submaps(self.settings.max_submaps);
        }
        self.active.push(ActiveSubmap::new(
            index,
            *local_from_base,
            grid,
            self.driven_m,
        ));
    }

    fn keep_grid(&mut self, index: u32, grid: SearchGrid) {
        if self.grids.len() >= MAX_GRIDS {
            self.grids.remove(0);
        }
        self.grids.push((index, grid));
    }

    /// Adds the positions since the last scan to the graph. Returns whether they moved the map.
    fn take_positions(
        &mut self,
        last: &LastScan,
        input: &ScanInput<'_>,
        local_from_base: &Isometry2<f64>,
    ) -> bool {
        let graph = &mut self.map.graph;
        let keyframe = graph.poses.len() as u32 - 1;
        let keyframe_from_local = graph.poses[keyframe as usize].inverse() * self.map_from_local;
        let stamps = [last.stamp, input.stamp];
        let due = self.positions.take_due(stamps, self.driven_m);
        let Some((position, share)) = due else {
            return false;
        };
        let then = last.local_from_base.lerp_slerp(local_from_base, share);
        graph.fixes.push(PositionFix {
            keyframe,
            keyframe_from_antenna: keyframe_from_local * then * input.base_from_antenna,
            antenna: position.antenna,
            sigma_m: position.sigma_m,
            is_aligned: false,
        });
        if let Some(motion) = self.map.align_newest() {
            self.map_from_local = motion * self.map_from_local;
            self.optimizer.begin_anew();
            return true;
        }
        let newest = self.map.graph.fixes.last();
        if newest.is_some_and(|fix| fix.is_aligned) {
            self.optimizer.add();
        }
        false
    }

    fn finish_scan(
        &mut self,
        input: &ScanInput<'_>,
        (motion, motion_s): (Isometry2<f64>, f64),
        local_from_base: Isometry2<f64>,
        result: Option<(f64, f64, Confidence)>,
        mut is_corrected: bool,
    ) -> ScanPose {
        let (inliers, residual_m, confidence) = result.unwrap_or((1.0, 0.0, Confidence::Full));
        let is_lost = confidence == Confidence::Lost;
        if let Some(last) = self.last.filter(|last| !last.is_lost && !is_lost) {
            is_corrected |= self.take_positions(&last, input, &local_from_base);
        }
        let keyframe = self.map.graph.poses.len() as u32 - 1;
        let local_from_map = self.map_from_local.inverse();
        let keyframe_local = local_from_map * self.map.graph.poses[keyframe as usize];
        let odometry = input.odom_from_base.map(|now| {
            let before = self.last.and_then(|last| last.odometry);
            let same = before.filter(|(before, _)| *before == now);
            same.unwrap_or((now, local_from_base))
        });
        self.last = Some(LastScan {
            stamp: input.stamp,
            odometry,
            local_from_base,
            motion,
            motion_s,
            keyframe_local,
            is_lost,
        });
        ScanPose {
            local_from_base,
            map_from_local: self.map_from_local,
            covariance: self.active[0].covariance,
            confidence,
            inliers,
            residual_m,
            keyframe,
            keyframe_from_base: keyframe_local.inv_mul(&local_from_base),
            is_corrected,
        }
    }

    /// Matches a keyframe with submaps near it: at once in small windows, else in steps.
    fn close_loops(
        &mut self,
        keyframe: u32,
        points: &[ScanPoint],
        local_from_base: &Isometry2<f64>,
    ) {
        let settings = self.settings.closure;
        let (small, large) = self
            .map
            .candidates(keyframe, self.active[0].index, &settings);
        let own = self.active[0].index;
        let near = small.len().min(settings.per_keyframe);
        self.match_small(keyframe, own, points, &small[..near]);
        if self.searches.running.is_none() && small.is_empty() && !large.is_empty() {
            // Where a match was found, another may agree with it.
            let again = large.iter().find(|candidate| {
                let is_match = |&(index, driven_m): &(u32, f64)| {
                    index == candidate.1 && self.driven_m - driven_m < AGAIN_M
                };
                self.searches.last_match.as_ref().is_some_and(is_match)
            });
            // In turn, as some are of other pieces of the map, which may lie anywhere.
            let failed = self.searches.failed;
            let (unknown, near): (Vec<_>, Vec<_>) = large
                .iter()
                .partition(|candidate| candidate.2.0 >= settings.greatest_window.0);
            let is_near = unknown.is_empty() || failed.is_multiple_of(2) && !near.is_empty();
            let of = if is_near { near } else { unknown };
            let next = of[failed / 2 % of.len()];
            let (_, index, window) = *again.unwrap_or(next);
            let points = self.around(local_from_base);
            let search = self
                .map
                .begin_match(points, keyframe, (index, window), &settings);
            let grid = self.take_grid(index);
            self.searches.running = Some(ClosureSearch {
                keyframe,
                submap: index,
                local_from_base: *local_from_base,
                driven_m: self.driven_m,
                search,
                grid,
            });
        }
    }

    /// Goes on with the match in a large window.
    fn search_closure(&mut self) {
        let settings = self.settings.closure;
        let Some(mut search) = self.searches.running.take() else {
            return;
        };
        let submap = &self.map.submaps[search.submap as usize].submap;
        let blocks = settings.blocks_per_scan;
        let Some(found) = search
            .search
            .advance(submap, &search.grid, blocks, &settings)
        else {
            self.searches.running = Some(search);
            return;
        };
        let ClosureSearch {
            keyframe,
            submap,
            local_from_base,
            driven_m,
            grid,
            ..
        } = search;
        self.keep_grid(submap, grid);
        if found.is_some() {
            // A search may take longer than the way on which another is to agree.
            self.searches.last_match = Some((submap, self.driven_m));
        }
        let Some(found) = found else {
            self.searches.failed += 1;
            return;
        };
        let closure = Closure::new(keyframe, submap, &found);
        let pieces = self.map.pieces();
        let of_submap = self.map.submaps[submap as usize].anchor;
        let joins_pieces = pieces[of_submap as usize] != pieces[keyframe as usize];
        let anchor = |index: u32| self.map.anchor(index);
        let agreed = self.searches.pending.add(
            (closure, joins_pieces),
            (local_from_base, driven_m),
            anchor,
            &settings,
        );
        for closure in agreed {
            self.optimizer.add_far();
            self.add_closure(&closure, self.active[0].index, settings.large_drift);
        }
    }

    /// Matches the next finished submap with those that it came near to when the map moved far. Returns whether there
    /// was one.
    fn sweep(&mut self) -> bool {
        let settings = self.settings.closure;
        let own = self.searches.swept;
        if self.active.first().is_none_or(|active| own >= active.index) {
            return false;
        }
        self.searches.swept += 1;
        let record = &self.map.submaps[own as usize];
        let keyframe = u32::midpoint(record.anchor, record.end);
        let (small, _) = self.map.candidates(keyframe, own, &settings);
        let new = small
            .iter()
            .filter(|candidate| !self.map.drifts.are_linked(own, candidate.1));
        let new: Vec<_> = new.take(settings.per_keyframe).copied().collect();
        if !new.is_empty() {
            let pose = self.map.graph.poses[keyframe as usize];
            let points = self.map.around(own, &self.map.anchor(own).inv_mul(&pose));
            self.match_small(keyframe, own, &points, &new);
        }
        true
    }

    /// Matches a keyframe, of a submap, with candidates in small windows.
    fn match_small(
        &mut self,
        keyframe: u32,
        own: u32,
        points: &[ScanPoint],
        candidates: &[Candidate],
    ) {
        let settings = self.settings.closure;
        for &(_, index, window) in candidates {
            let points = points.to_vec();
            let mut search = self
                .map
                .begin_match(points, keyframe, (index, window), &settings);
            let grid = self.take_grid(index);
            let submap = &self.map.submaps[index as usize].submap;
            if let Some(Some(found)) = search.advance(submap, &grid, usize::MAX, &settings) {
                let closure = Closure::new(keyframe, index, &found);
                self.add_closure(&closure, own, settings.noise);
            }
            self.keep_grid(index, grid);
        }
    }

    /// What the last metres of driving showed, in the frame of the vehicle; empty before the first scan.
    pub fn surroundings(&self) -> Vec<ScanPoint> {
        self.last
            .map_or_else(Vec::new, |last| self.around(&last.local_from_base))
    }

    fn around(&self, local_from_base: &Isometry2<f64>) -> Vec<ScanPoint> {
        let active = &self.active[0];
        let anchor_from_base = active.local_from_anchor.inv_mul(local_from_base);
        self.map.around(active.index, &anchor_from_base)
    }

    /// The grid of a finished submap, out of those that are kept or made anew.
    fn take_grid(&mut self, index: u32) -> SearchGrid {
        match self.grids.iter().position(|(own, _)| *own == index) {
            Some(at) => self.grids.remove(at).1,
            None => self.map.submaps[index as usize].submap.search_grid(),
        }
    }

    /// Adds a closure of a keyframe that belongs to submap `own`, and that leaves a drift.
    fn add_closure(&mut self, closure: &Closure, own: u32, drift: Window) {
        self.map.graph.edges.push(Edge {
            from: self.map.submaps[closure.submap as usize].anchor,
            to: closure.keyframe,
            from_from_to: closure.submap_from_base,
            information: closure.information,
            is_closure: true,
        });
        self.map.drifts.link(closure.submap, own, drift);
        self.closures.added += 1;
        self.optimizer.add();
    }

    /// Does one step of optimization, if one is under way or due; returns whether poses of keyframes changed.
    fn optimize(&mut self) -> bool {
        self.optimize_step(optimizer::WAITING).unwrap_or(false)
    }

    /// `None` if there is nothing to do.
    fn optimize_step(&mut self, least_waiting: u32) -> Option<bool> {
        let Poll::Ready(optimized) = self.optimizer.step(&mut self.map, least_waiting)? else {
            return Some(false);
        };
        if optimized.was_far {
            self.searches.swept = 0;
        }
        self.map_from_local = optimized.correction * self.map_from_local;
        self.map_from_local.rotation.renormalize();
        self.closures.removed += optimized.removed;
        Some(true)
    }
}

#[cfg(test)]
mod tests;
