//! The map of [`ScanSlam`](super::slam::ScanSlam): submaps, and the graph of their keyframes.

use std::collections::BTreeMap;

use nalgebra::{Isometry2, Point2, Vector2};

use super::loop_closure::{ClosureSettings, DriftGraph, SubmapMatch, Window};
use super::pose_graph::{Edge, PoseGraph};
use super::position_fixes::{PositionFix, alignment};
use super::relocalization::{self, BESIDE_M};
use super::scan_points::ScanPoint;
use super::submap::Submap;

/// Submaps and the graph of their keyframes: all that is kept of a map.
#[derive(Clone, Debug, Default)]
pub struct SlamMap {
    pub(super) graph: PoseGraph,
    pub(super) submaps: Vec<SubmapRecord>,
    pub(super) drifts: DriftGraph,
}

/// A submap and its keyframes, which are consecutive.
#[derive(Clone, Debug)]
pub(super) struct SubmapRecord {
    /// Its first keyframe.
    pub(super) anchor: u32,
    /// Behind its last keyframe.
    pub(super) end: u32,
    /// Empty where it was dropped.
    pub(super) submap: Submap,
}

/// All of a map but the poses of its keyframes, for a file.
#[derive(Clone, Debug)]
pub struct SlamMapParts {
    /// Between keyframes.
    pub edges: Vec<Edge>,
    /// Of each submap its first keyframe, the one behind its last, and of each of its surfels: number of points, mean (m),
    /// sums of squares xx, xy, yy (m²), direction of view.
    pub submaps: Vec<(u32, u32, Vec<[f32; 8]>)>,
    /// Of each submap its neighbours and the drift to them: metres and radians.
    pub drifts: Vec<BTreeMap<u32, (f64, f64)>>,
    /// Positions on Earth.
    pub fixes: Vec<PositionFix>,
}

/// Distance, metres; index of the submap; window.
pub(super) type Candidate = (f64, u32, Window);

/// An edge of less information about any translation does not join two pieces, 1/m².
const JOINED_INFORMATION: f64 = 0.1;
/// Surroundings are searched for up to this distance, metres, with at most this many points.
const AROUND_M: f64 = 14.0;
const MAX_AROUND: usize = 400;

impl SlamMap {
    /// Whether all numbers are finite, and all indices those of parts that it has, as in every map that was made here.
    fn is_consistent(&self) -> bool {
        let keyframes = self.graph.poses.len();
        let is_keyframe = |index: u32| (index as usize) < keyframes;
        let mut edges = self.graph.edges.iter();
        let is_pose = |pose: &Isometry2<f64>| pose.to_homogeneous().iter().all(|n| n.is_finite());
        self.graph.poses.iter().all(is_pose)
            && edges.all(|edge| {
                is_keyframe(edge.from)
                    && is_keyframe(edge.to)
                    && is_pose(&edge.from_from_to)
                    && edge.information.iter().all(|n| n.is_finite())
            })
            && self
                .submaps
                .iter()
                .all(|record| record.anchor < record.end && is_keyframe(record.end - 1))
            && self.drifts.is_of(self.submaps.len())
            && self.graph.fixes.iter().all(|fix| {
                let numbers = [fix.keyframe_from_antenna, fix.antenna].map(|at| at.coords.sum());
                is_keyframe(fix.keyframe)
                    && numbers.iter().all(|number| number.is_finite())
                    && fix.sigma_m > 0.0
            })
    }

    /// As numbers, but for the poses of the keyframes.
    pub(crate) fn to_parts(&self) -> SlamMapParts {
        let submaps = self.submaps.iter();
        SlamMapParts {
            edges: self.graph.edges.clone(),
            submaps: submaps
                .map(|record| (record.anchor, record.end, record.submap.to_numbers()))
                .collect(),
            drifts: self.drifts.links.clone(),
            fixes: self.graph.fixes.clone(),
        }
    }

    /// None where the parts do not fit together.
    pub(crate) fn from_parts(poses: Vec<Isometry2<f64>>, parts: SlamMapParts) -> Option<Self> {
        let submaps = parts.submaps.iter().map(|(anchor, end, surfels)| {
            Some(SubmapRecord {
                anchor: *anchor,
                end: *end,
                submap: Submap::from_numbers(surfels)?,
            })
        });
        let map = Self {
            submaps: submaps.collect::<Option<_>>()?,
            graph: PoseGraph {
                poses,
                edges: parts.edges,
                fixes: parts.fixes,
            },
            drifts: DriftGraph {
                links: parts.drifts,
            },
        };
        (map.is_consistent() && !map.submaps.is_empty()).then_some(map)
    }

    /// Poses of the keyframes, in the order of time.
    pub fn keyframes(&self) -> &[Isometry2<f64>] {
        &self.graph.poses
    }

    /// Measured differences between keyframes.
    pub fn edges(&self) -> &[Edge] {
        &self.graph.edges
    }

    /// Of each keyframe, the first keyframe of its piece of the map. Where the vehicle was lost, a new piece begins: how
    /// pieces lie to each other is not known, until a closure or positions on Earth join them.
    pub fn pieces(&self) -> Vec<u32> {
        fn first(pieces: &mut [u32], mut at: u32) -> u32 {
            while pieces[at as usize] != at {
                let before = pieces[at as usize];
                pieces[at as usize] = pieces[before as usize];
                at = before;
            }
            at
        }
        fn join(pieces: &mut [u32], a: u32, b: u32) {
            let [a, b] = [a, b].map(|at| first(pieces, at));
            pieces[a.max(b) as usize] = a.min(b);
        }
        let mut pieces: Vec<u32> = (0..self.graph.poses.len() as u32).collect();
        for edge in &self.graph.edges {
            if edge.information.diagonal().xy().max() < JOINED_INFORMATION {
                continue;
            }
            join(&mut pieces, edge.from, edge.to);
        }
        // All in the frame of the positions.
        let aligned = self.graph.fixes.iter().filter(|fix| fix.is_aligned);
        let aligned: Vec<_> = aligned.map(|fix| fix.keyframe).collect();
        for pair in aligned.windows(2) {
            join(&mut pieces, pair[0], pair[1]);
        }
        (0..pieces.len() as u32)
            .map(|at| first(&mut pieces, at))
            .collect()
    }

    /// Whether the frame of its newest piece is that of the positions: metres east and north of the datum.
    pub fn is_on_earth(&self) -> bool {
        let pieces = self.pieces();
        let newest = pieces.last();
        let mut aligned = self.graph.fixes.iter().filter(|fix| fix.is_aligned);
        aligned.any(|fix| pieces.get(fix.keyframe as usize) == newest)
    }

    /// Turns and moves the newest piece to the frame of the positions, if it is not there and they determine how; returns the motion.
    pub(super) fn align_newest(&mut self) -> Option<Isometry2<f64>> {
        let pieces = self.pieces();
        let newest = *pieces.last()?;
        let PoseGraph { poses, fixes, .. } = &mut self.graph;
        let is_newest = |fix: &PositionFix| pieces[fix.keyframe as usize] == newest;
        let own = fixes.iter().filter(|fix| is_newest(fix));
        let motion = if own.clone().any(|fix| fix.is_aligned) {
            None
        } else {
            let pairs = own.map(|fix| {
                let pose = poses[fix.keyframe as usize];
                (pose * fix.keyframe_from_antenna, fix.antenna, fix.sigma_m)
            });
            Some(alignment(&pairs.collect::<Vec<_>>())?)
        };
        for fix in fixes.iter_mut().filter(|fix| is_newest(fix)) {
            fix.is_aligned = true;
        }
        let motion = motion?;
        for (pose, piece) in poses.iter_mut().zip(&pieces) {
            if *piece == newest {
                *pose = motion * *pose;
            }
        }
        Some(motion)
    }

    /// Number of submaps.
    pub fn submap_count(&self) -> u32 {
        self.submaps.len() as u32
    }

    /// A submap, in the frame of its anchor.
    pub fn submap(&self, index: u32) -> &Submap {
        &self.submaps[index as usize].submap
    }

    /// Pose of a submap's anchor.
    pub fn anchor(&self, index: u32) -> Isometry2<f64> {
        self.graph.poses[self.submaps[index as usize].anchor as usize]
    }

    /// The submap whose middle is nearest to a pose: there it shows the most around itself.
    pub fn nearest_submap(&self, map_from_base: &Isometry2<f64>) -> Option<u32> {
        let distance = |index: &u32| {
            let way = self.core(*index);
            let middle = way[way.len() / 2].translation.vector;
            (middle - map_from_base.translation.vector).norm()
        };
        let shown = (0..self.submap_count()).filter(|index| !self.submap(*index).is_empty());
        shown.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Middle of the way on which a submap shows more than its neighbours do, in its frame, and half its extents along x and y,
    /// metres.
    pub fn extent(&self, index: u32) -> (Isometry2<f64>, [f64; 2]) {
        let anchor_from_map = self.anchor(index).inverse();
        let way = self.core(index).iter();
        let (middle, half_m) = relocalization::extent(
            way.map(|pose| anchor_from_map * Point2::from(pose.translation.vector)),
        );
        (Isometry2::new(middle.coords, 0.0), half_m)
    }

    /// A match of points, in the frame of the vehicle at a keyframe, with a submap in a window around where the keyframe is.
    pub(super) fn begin_match(
        &self,
        points: Vec<ScanPoint>,
        keyframe: u32,
        (index, window): (u32, Window),
        settings: &ClosureSettings,
    ) -> SubmapMatch {
        let anchor = self.anchor(index);
        let expected = anchor.inv_mul(&self.graph.poses[keyframe as usize]);
        let anchor_from_map = anchor.inverse();
        let way = self.way(index).iter();
        let places = way.map(|pose| (anchor_from_map * pose).translation.vector);
        let corners = places.fold([Vector2::zeros(); 2], |[low, high], place| {
            [low.inf(&place), high.sup(&place)]
        });
        SubmapMatch::new(points, expected, window, corners, settings)
    }

    /// A pose in the frame of a submap, if it is within `half_m` (and some metres) of its way.
    pub fn expected_near(
        &self,
        index: u32,
        map_from_base: &Isometry2<f64>,
        half_m: f64,
    ) -> Option<Isometry2<f64>> {
        let is_near = |pose: &Isometry2<f64>| {
            let way = pose.translation.vector - map_from_base.translation.vector;
            way.norm() < half_m + BESIDE_M
        };
        let is_shown = self.way(index).iter().any(is_near);
        is_shown.then(|| self.anchor(index).inv_mul(map_from_base))
    }

    /// What a submap shows around a pose, in the frame of the vehicle.
    pub(super) fn around(&self, index: u32, anchor_from_base: &Isometry2<f64>) -> Vec<ScanPoint> {
        let base_from_anchor = anchor_from_base.inverse();
        let points = self
            .submap(index)
            .points()
            .map(|point| point.in_frame(&base_from_anchor));
        let near: Vec<_> = points
            .filter(|point| point.position.coords.norm() < AROUND_M)
            .collect();
        let step = near.len().div_ceil(MAX_AROUND).max(1);
        near.into_iter().step_by(step).collect()
    }

    /// The way of a submap without the quarters that its neighbours show better.
    pub(super) fn core(&self, index: u32) -> &[Isometry2<f64>] {
        let record = &self.submaps[index as usize];
        let shown = |index: u32| {
            let other = self.submaps.get(index as usize);
            other.filter(|other| !other.submap.is_empty())
        };
        let before = index.checked_sub(1).and_then(shown);
        let begin = before.map_or(record.anchor, |before| before.end.max(record.anchor));
        let after = shown(index + 1).map_or(record.end, |after| after.anchor.min(record.end));
        let begin = u32::midpoint(record.anchor, begin);
        let end = u32::midpoint(after, record.end).max(begin + 1);
        &self.graph.poses[begin as usize..end as usize]
    }

    fn way(&self, index: u32) -> &[Isometry2<f64>] {
        let record = &self.submaps[index as usize];
        &self.graph.poses[record.anchor as usize..record.end as usize]
    }

    /// Finished submaps that may show the place of a keyframe, in small windows and in large ones: distance, index, and
    /// window; the nearest first.
    pub(super) fn candidates(
        &self,
        keyframe: u32,
        current: u32,
        settings: &ClosureSettings,
    ) -> (Vec<Candidate>, Vec<Candidate>) {
        let drifts = self.drifts.from(current);
        let here = self.graph.poses[keyframe as usize].translation.vector;
        let mut candidates: Vec<Candidate> = Vec::new();
        for (index, record) in (0..current.saturating_sub(1)).zip(&self.submaps) {
            if record.submap.is_empty() {
                continue;
            }
            let drift = drifts.get(index as usize).copied().unwrap_or_default();
            let window = (
                (settings.least_window.0 + drift.0).min(settings.greatest_window.0),
                (settings.least_window.1 + drift.1).min(settings.greatest_window.1),
            );
            let own = self.way(index);
            let distance = |pose: &Isometry2<f64>| (pose.translation.vector - here).norm();
            let nearest = own.iter().map(distance).fold(f64::INFINITY, f64::min);
            if nearest <= settings.place_m + window.0 {
                // Its middle shows the most around itself.
                candidates.push((distance(&own[own.len() / 2]), index, window));
            }
        }
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let (small, mut large): (Vec<_>, Vec<_>) = candidates
            .into_iter()
            .partition(|candidate| candidate.2.0 <= settings.small_window_m);
        // Neighbours overlap.
        large.retain(|candidate| candidate.1 % 2 == 0);
        (small, large)
    }

    /// Keeps no more than `limit` submaps: of the oldest that a newer one shows too, else of the oldest, only the
    /// keyframes are left.
    pub(super) fn limit_submaps(&mut self, limit: usize) {
        let kept: Vec<u32> = (0..self.submap_count())
            .filter(|index| !self.submap(*index).is_empty())
            .collect();
        if kept.len() > limit {
            let is_shown = |index: &&u32| self.drifts.is_closed(**index);
            let oldest = kept.iter().find(is_shown).unwrap_or(&kept[0]);
            self.submaps[*oldest as usize].submap = Submap::default();
        }
    }
}
