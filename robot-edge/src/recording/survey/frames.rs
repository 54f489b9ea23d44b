//! Which frames hang on which.

use std::collections::BTreeMap;

use crate::measurement::FrameId;
use crate::robot_time::RobotTime;

/// Edges that are told apart; more are only counted.
const MAX_EDGES: usize = 1000;

/// The transforms of a recording: for each child and parent how many there are, and when.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameSurvey {
    /// By child and parent.
    edges: BTreeMap<(FrameId, FrameId), FrameEdge>,
    /// Transforms of edges beyond the first 1000.
    pub beyond_limit: u64,
}

/// The transforms between two frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameEdge {
    /// All of them hold for all time.
    pub is_static: bool,
    /// How many.
    pub count: u64,
    /// The first stamp in file order.
    pub first: RobotTime,
    /// The last stamp in file order.
    pub last: RobotTime,
}

impl FrameSurvey {
    pub(super) fn add(
        &mut self,
        parent: &FrameId,
        child: &FrameId,
        stamp: RobotTime,
        is_static: bool,
    ) {
        let key = (child.clone(), parent.clone());
        if self.edges.len() >= MAX_EDGES && !self.edges.contains_key(&key) {
            self.beyond_limit += 1;
            return;
        }
        let edge = self.edges.entry(key).or_insert(FrameEdge {
            is_static,
            count: 0,
            first: stamp,
            last: stamp,
        });
        edge.is_static &= is_static;
        edge.count += 1;
        edge.last = stamp;
    }

    /// Parent, child and what lies between, by child.
    pub fn edges(&self) -> impl Iterator<Item = (&FrameId, &FrameId, &FrameEdge)> {
        self.edges
            .iter()
            .map(|((child, parent), edge)| (parent, child, edge))
    }

    /// Frames that have children but no parent.
    pub fn roots(&self) -> Vec<&FrameId> {
        let mut roots: Vec<_> = self
            .edges()
            .map(|(parent, ..)| parent)
            .filter(|parent| self.parent_of(parent).is_none())
            .collect();
        roots.sort_unstable();
        roots.dedup();
        roots
    }

    /// The way from `frame` up to a root: each frame with the edge to its parent. Ends where frames go in a
    /// circle, which damage can make them do.
    pub fn way_up<'a>(&'a self, frame: &'a str) -> Vec<(&'a FrameId, &'a FrameEdge)> {
        let mut way: Vec<(&FrameId, &FrameEdge)> = Vec::new();
        let mut at = frame;
        while let Some((parent, edge)) = self.parent_of(at) {
            if way.iter().any(|(known, _)| *known == parent) {
                break;
            }
            way.push((parent, edge));
            at = parent;
        }
        way
    }

    fn parent_of(&self, child: &str) -> Option<(&FrameId, &FrameEdge)> {
        let from: (FrameId, FrameId) = (child.into(), "".into());
        let ((found, parent), edge) = self.edges.range(from..).next()?;
        (&**found == child).then_some((parent, edge))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn survey(edges: &[(&str, &str, bool)]) -> FrameSurvey {
        let mut survey = FrameSurvey::default();
        for (nanos, &(parent, child, is_static)) in (0..).zip(edges) {
            let stamp = RobotTime::from_nanos(nanos);
            survey.add(&parent.into(), &child.into(), stamp, is_static);
        }
        survey
    }

    #[test]
    fn frames_are_followed_to_the_root() {
        let frames = survey(&[
            ("odom", "base_link", false),
            ("base_link", "laser", true),
            ("odom", "base_link", false),
            ("map", "odom", false),
        ]);
        let way: Vec<_> = frames
            .way_up("laser")
            .iter()
            .map(|(parent, _)| &***parent)
            .collect();
        assert_eq!(way, ["base_link", "odom", "map"]);
        assert_eq!(frames.roots(), [&FrameId::from("map")]);
        let (parent, child, edge) = frames.edges().next().unwrap();
        assert_eq!((&**parent, &**child), ("odom", "base_link"));
        assert_eq!(
            *edge,
            FrameEdge {
                is_static: false,
                count: 2,
                first: RobotTime::from_nanos(0),
                last: RobotTime::from_nanos(2),
            }
        );
        assert!(frames.way_up("elsewhere").is_empty());
    }

    #[test]
    fn circles_end() {
        let frames = survey(&[("a", "b", false), ("b", "a", false)]);
        assert_eq!(frames.way_up("a").len(), 2);
        assert!(frames.roots().is_empty());
    }

    #[test]
    fn edges_are_bounded() {
        let mut frames = FrameSurvey::default();
        for n in 0..MAX_EDGES + 5 {
            let child = n.to_string().as_str().into();
            frames.add(&"odom".into(), &child, RobotTime::default(), false);
        }
        assert_eq!((frames.edges.len(), frames.beyond_limit), (MAX_EDGES, 5));
    }
}
