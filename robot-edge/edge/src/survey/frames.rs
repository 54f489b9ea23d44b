//! The transform tree of a recording.

use std::collections::BTreeMap;

use measurement::FrameId;
use measurement::time::RobotTime;

/// Maximum number of edges; further ones are only counted.
const MAX_EDGES: usize = 1000;

/// Number and stamps of the transforms between each pair of frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameSurvey {
    /// By child and parent.
    edges: BTreeMap<(FrameId, FrameId), FrameEdge>,
    pub beyond_limit: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameEdge {
    /// All of them are static.
    pub is_static: bool,
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

    /// Parent, child and edge, by child.
    pub fn edges(&self) -> impl Iterator<Item = (&FrameId, &FrameId, &FrameEdge)> {
        self.edges
            .iter()
            .map(|((child, parent), edge)| (parent, child, edge))
    }

    /// Frames with children and without a parent.
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

    /// The path from `frame` up to a root: each frame with the edge to its parent. Ends at a cycle, which damage
    /// can produce.
    pub fn ancestors<'a>(&'a self, frame: &'a str) -> Vec<(&'a FrameId, &'a FrameEdge)> {
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

    /// The fixed frame above `start` in which it moves: `wanted`, or else `odom`, `map`, the root. The vehicle's
    /// own frame is excluded: a laser that only moves relative to the vehicle does not give the position of the
    /// vehicle.
    pub fn fixed_ancestor(
        &self,
        start: &str,
        base_frame: &str,
        wanted: Option<&str>,
    ) -> Option<FrameId> {
        let way = self.ancestors(start);
        let first_moving = way.iter().position(|(_, edge)| !edge.is_static)?;
        let vehicle = way.iter().position(|(frame, _)| ***frame == *base_frame);
        let from = vehicle.map_or(first_moving, |vehicle| first_moving.max(vehicle + 1));
        let still = way.get(from..)?;
        let find = |wanted: &str| still.iter().find(|(frame, _)| ***frame == *wanted);
        let chosen = match wanted {
            Some(wanted) => find(wanted),
            None => find("odom")
                .or_else(|| find("map"))
                .or_else(|| still.last()),
        };
        chosen.map(|(frame, _)| FrameId::clone(frame))
    }

    /// Whether `start` moves in `base_frame`, or in any ancestor if that is not one.
    pub fn moves_in(&self, start: &str, base_frame: &str) -> bool {
        let way = self.ancestors(start);
        let at_base = way.iter().position(|(frame, _)| ***frame == *base_frame);
        let below = at_base.map_or(&way[..], |at_base| &way[..=at_base]);
        below.iter().any(|(_, edge)| !edge.is_static)
    }

    /// Whether `target` is `start` or an ancestor of it.
    pub fn is_ancestor(&self, target: &str, start: &str) -> bool {
        target == start
            || self
                .ancestors(start)
                .iter()
                .any(|(frame, _)| ***frame == *target)
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
            .ancestors("laser")
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
        assert!(frames.ancestors("elsewhere").is_empty());
    }

    #[test]
    fn the_vehicle_is_no_frame_to_map_in() {
        let tree = survey(&[
            ("base_link", "laser", false),
            ("odom", "base_link", false),
            ("map", "odom", false),
        ]);
        let fixed = |frames: &FrameSurvey, start, wanted| {
            frames
                .fixed_ancestor(start, "base_link", wanted)
                .map(|frame| frame.to_string())
        };
        assert_eq!(fixed(&tree, "laser", None).as_deref(), Some("odom"));
        assert_eq!(fixed(&tree, "laser", Some("map")).as_deref(), Some("map"));
        assert_eq!(fixed(&tree, "laser", Some("base_link")), None);
        assert_eq!(fixed(&tree, "odom", None).as_deref(), Some("map"));
        // If a node publishes the mounting repeatedly, only odometry gives the position.
        let mount_only = survey(&[("base_link", "laser", false)]);
        assert_eq!(fixed(&mount_only, "laser", None), None);
        let still = survey(&[("odom", "base_link", true), ("base_link", "laser", true)]);
        assert_eq!(fixed(&still, "laser", None), None);
    }

    #[test]
    fn a_moving_mounting_is_recognised() {
        let tree = survey(&[
            ("odom", "base_link", false),
            ("base_link", "mast", true),
            ("mast", "sonar", true),
            ("mast", "laser", false),
        ]);
        assert!(tree.moves_in("laser", "base_link"));
        assert!(!tree.moves_in("sonar", "base_link"));
        assert!(tree.moves_in("sonar", "nowhere"));
        assert!(!tree.moves_in("nothing", "base_link"));
        assert!(tree.is_ancestor("odom", "sonar") && tree.is_ancestor("odom", "odom"));
        assert!(!tree.is_ancestor("laser", "sonar"));
    }

    #[test]
    fn circles_end() {
        let frames = survey(&[("a", "b", false), ("b", "a", false)]);
        assert_eq!(frames.ancestors("a").len(), 2);
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
