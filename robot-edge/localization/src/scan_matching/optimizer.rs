//! Optimization of a map's graph beside scan matching: one step each scan, or in a large graph a part of one, so that it takes effect
//! at the same scan in every run.

use std::task::Poll;

use nalgebra::Isometry2;

use super::pose_graph::{Edge, GraphStep, PoseGraph};
use super::slam_map::SlamMap;

/// State of the optimization.
#[derive(Clone, Debug, Default)]
pub(super) struct Optimizer {
    /// The graph under way.
    graph: Option<PoseGraph>,
    step: Option<GraphStep>,
    steps: u32,
    /// The kernel of closures is wider by this factor; it narrows from step to step.
    widening: f64,
    /// It may move the map far.
    was_far: bool,
    /// Closures and positions since the last one began.
    waiting: u32,
    /// Among them are some that may move the map far.
    is_far: bool,
}

/// What an optimization did.
#[derive(Clone, Copy, Debug)]
pub(super) struct Optimized {
    /// Motion of the newest keyframe in the frame of the map.
    pub(super) correction: Isometry2<f64>,
    /// Closures that it contradicted; the map has them no more.
    pub(super) removed: u64,
    /// It may have moved the map far.
    pub(super) was_far: bool,
}

/// Closures and positions that wait for an optimization, unless they may move the map far.
pub(super) const WAITING: u32 = 20;

const MAX_STEPS: u32 = 30;
/// Edges of the graph, and poses, that are worked on each scan.
const GRAPH_PART: usize = 4000;
const WIDENING: f64 = 1e4;
/// The kernel narrows once no pose moves by more, metres (and radians): else it holds for wrong what is right.
const NARROWED_M: f64 = 0.3;
/// An optimization ends when no pose moves by more, metres (and radians).
const CONVERGED: f64 = 1e-3;
/// A closure with a greater squared error after optimization is removed.
const REMOVED_CHI2: f64 = 50.0;

impl Optimizer {
    /// The graph has one more closure or position.
    pub(super) const fn add(&mut self) {
        self.waiting += 1;
    }

    /// The graph has what may move the map far.
    pub(super) const fn add_far(&mut self) {
        self.is_far = true;
    }

    /// The map was moved: an optimization under way is of the map as it lay before.
    pub(super) fn begin_anew(&mut self) {
        *self = Self {
            is_far: true,
            ..Self::default()
        };
    }

    /// Goes on by a step; begins with one if so many wait. `None` if there is nothing to do, pending before the end.
    pub(super) fn step(
        &mut self,
        map: &mut SlamMap,
        least_waiting: u32,
    ) -> Option<Poll<Optimized>> {
        if self.graph.is_none() {
            if !self.is_far && self.waiting < least_waiting {
                return None;
            }
            *self = Self {
                graph: Some(map.graph.clone()),
                widening: if self.is_far { WIDENING } else { 1.0 },
                was_far: self.is_far,
                ..Self::default()
            };
        }
        let graph = self.graph.as_mut()?;
        let chi2 = 10.0 * self.widening;
        let Some(step) = graph.advance(&mut self.step, GRAPH_PART, chi2) else {
            return Some(Poll::Pending);
        };
        // Graduated non-convexity: a long loop closes before outliers lose their weight.
        let is_wide = self.widening > 1.0;
        if step < NARROWED_M {
            self.widening = (0.2 * self.widening).max(1.0);
        }
        self.steps += 1;
        if (step > CONVERGED || is_wide) && self.steps < MAX_STEPS {
            return Some(Poll::Pending);
        }
        let graph = self.graph.take()?;
        // Keyframes since then move with the newest one.
        let newest = graph.poses.len() - 1;
        let correction = graph.poses[newest] * map.graph.poses[newest].inverse();
        for (at, pose) in map.graph.poses.iter_mut().enumerate() {
            *pose = match graph.poses.get(at) {
                Some(optimized) => *optimized,
                None => correction * *pose,
            };
        }
        let before = map.graph.edges.len();
        let wrong = |edge: &Edge| {
            edge.is_closure && (edge.to as usize) <= newest && map.graph.chi2(edge) > REMOVED_CHI2
        };
        let keep: Vec<bool> = map.graph.edges.iter().map(|edge| !wrong(edge)).collect();
        let mut keep = keep.into_iter();
        map.graph.edges.retain(|_| keep.next().unwrap_or(true));
        let removed = before - map.graph.edges.len();
        self.waiting += removed as u32;
        Some(Poll::Ready(Optimized {
            correction,
            removed: removed as u64,
            was_far: self.was_far,
        }))
    }
}
