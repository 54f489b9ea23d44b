//! Transform buffer: the tree of frames over time (REP-105).

use std::collections::BTreeMap;

use measurement::FrameId;
use measurement::drops::DropReason;
use measurement::pose::Pose;
use measurement::time::RobotTime;

use crate::pose_buffer::{InterpolationLimits, PoseBuffer, PoseJump, Segment};

/// Limit of the frames; real vehicles have tens.
const MAX_FRAMES: usize = 1024;

/// Each frame's parent, and its pose in it over time.
#[derive(Clone, Debug)]
pub(crate) struct TransformBuffer {
    limits: InterpolationLimits,
    edges: BTreeMap<FrameId, Edge>,
}

#[derive(Clone, Debug)]
struct Edge {
    parent: FrameId,
    parent_from_child: EdgeTransform,
}

#[derive(Clone, Debug)]
enum EdgeTransform {
    Static(Pose),
    Dynamic(PoseBuffer),
}

impl TransformBuffer {
    pub(crate) const fn new(limits: InterpolationLimits) -> Self {
        Self {
            limits,
            edges: BTreeMap::new(),
        }
    }

    /// Adds a pose of `child` in `parent`. A frame that changes its parent loses its earlier poses;
    /// a static transform replaces moving ones.
    ///
    /// Returns the jump from the frame's newest pose, if it is one.
    pub(crate) fn insert(
        &mut self,
        parent: &FrameId,
        child: &FrameId,
        stamp: RobotTime,
        parent_from_child: Pose,
        is_static: bool,
    ) -> Option<PoseJump> {
        let known = self.edges.contains_key(child);
        if parent == child || (!known && self.edges.len() >= MAX_FRAMES) {
            return None;
        }
        if is_static {
            let edge = Edge {
                parent: FrameId::clone(parent),
                parent_from_child: EdgeTransform::Static(parent_from_child),
            };
            self.edges.insert(FrameId::clone(child), edge);
            return None;
        }
        let edge = self
            .edges
            .entry(FrameId::clone(child))
            .or_insert_with(|| Edge::dynamic(parent));
        if edge.parent != *parent {
            *edge = Edge::dynamic(parent);
        }
        match &mut edge.parent_from_child {
            EdgeTransform::Dynamic(poses) => {
                let jump = poses.jump_to(stamp, parent_from_child, &self.limits);
                poses.insert(stamp, parent_from_child);
                jump
            }
            EdgeTransform::Static(_) => None,
        }
    }

    /// Removes moving poses before `stamp`, but never a frame's newest.
    pub(crate) fn forget_before(&mut self, stamp: RobotTime) {
        for edge in self.edges.values_mut() {
            if let EdgeTransform::Dynamic(poses) = &mut edge.parent_from_child {
                poses.forget_before(stamp);
            }
        }
    }

    pub(crate) fn clear_dynamic(&mut self) {
        for edge in self.edges.values_mut() {
            if let EdgeTransform::Dynamic(poses) = &mut edge.parent_from_child {
                *poses = PoseBuffer::default();
            }
        }
    }

    /// Frames from `source` up to its root, `source` first.
    pub(crate) fn ancestry(&self, source: &FrameId) -> Vec<FrameId> {
        let mut frames = vec![FrameId::clone(source)];
        // Bounded, because damaged data can close a loop.
        while let Some(edge) = frames.last().and_then(|frame| self.edges.get(frame)) {
            if frames.len() > MAX_FRAMES {
                break;
            }
            frames.push(FrameId::clone(&edge.parent));
        }
        frames
    }

    /// Whether poses of `frame` move `source` in `target`: it is `source` or an ancestor below
    /// `target`. `None` if `target` is no ancestor of `source`.
    pub(crate) fn is_between(
        &self,
        target: &str,
        source: &FrameId,
        frame: &FrameId,
    ) -> Option<bool> {
        let ancestors = self.ancestry(source);
        let at = ancestors.iter().position(|above| &**above == target)?;
        Some(ancestors[..at].contains(frame))
    }

    /// Links from `source` up to `target`, `source`'s first; `None` if `target` is no ancestor.
    pub(crate) fn chain<'a>(
        &'a self,
        target: &str,
        source: &FrameId,
    ) -> Option<TransformChain<'a>> {
        let mut links = Vec::new();
        let mut frame = source;
        while &**frame != target {
            let edge = self.edges.get(frame)?;
            if links.len() > MAX_FRAMES {
                return None;
            }
            links.push(&edge.parent_from_child);
            frame = &edge.parent;
        }
        Some(TransformChain {
            links,
            limits: &self.limits,
        })
    }
}

impl Edge {
    fn dynamic(parent: &FrameId) -> Self {
        Self {
            parent: FrameId::clone(parent),
            parent_from_child: EdgeTransform::Dynamic(PoseBuffer::default()),
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct TransformChain<'a> {
    links: Vec<&'a EdgeTransform>,
    limits: &'a InterpolationLimits,
}

impl TransformChain<'_> {
    /// Newest stamp up to which every moving link has poses; `None` if one has none.
    ///
    /// [`RobotTime::MAX`] if no link moves.
    pub(crate) fn newest(&self) -> Option<RobotTime> {
        self.links
            .iter()
            .try_fold(RobotTime::MAX, |newest, link| match link {
                EdgeTransform::Static(_) => Some(newest),
                EdgeTransform::Dynamic(poses) => Some(newest.min(poses.newest()?)),
            })
    }

    /// A sampler of `target_from_source` for mostly increasing stamps, such as those of beams.
    pub(crate) const fn sampler(&self) -> Sampler<'_> {
        Sampler {
            chain: self,
            segments: Vec::new(),
        }
    }
}

/// Samples a [`TransformChain`]; caches the last segment of each link.
#[derive(Clone, Debug)]
pub(crate) struct Sampler<'a> {
    chain: &'a TransformChain<'a>,
    segments: Vec<Option<Segment>>,
}

impl Sampler<'_> {
    pub(crate) fn pose_at(&mut self, stamp: RobotTime) -> Result<Pose, DropReason> {
        self.segments.resize(self.chain.links.len(), None);
        let mut target_from_source: Option<Pose> = None;
        for (link, remembered) in self.chain.links.iter().zip(&mut self.segments) {
            let parent_from_child = match link {
                EdgeTransform::Static(pose) => *pose,
                EdgeTransform::Dynamic(poses) => match remembered {
                    Some(segment) if segment.covers(stamp) => segment.pose_at(stamp),
                    Some(_) | None => {
                        let segment = poses.segment(stamp, self.chain.limits)?;
                        remembered.insert(segment).pose_at(stamp)
                    }
                },
            };
            target_from_source = Some(match target_from_source {
                Some(below) => parent_from_child * below,
                None => parent_from_child,
            });
        }
        Ok(target_from_source.unwrap_or_else(Pose::identity))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::test_data::{LIMITS, at};
    use measurement::pose::planar;

    fn buffer(edges: &[(&str, &str, f64, Pose, bool)]) -> TransformBuffer {
        let mut buffer = TransformBuffer::new(LIMITS);
        for &(parent, child, secs, pose, is_static) in edges {
            buffer.insert(&parent.into(), &child.into(), at(secs), pose, is_static);
        }
        buffer
    }

    #[test]
    fn poses_chain_from_the_sensor_to_the_map() {
        let buffer = buffer(&[
            ("base_link", "laser", 0.0, planar(0.3, 0.0, 0.0), true),
            ("odom", "base_link", 1.0, planar(10.0, 0.0, 0.0), false),
            ("odom", "base_link", 1.2, planar(10.0, 2.0, 0.0), false),
        ]);
        let chain = buffer.chain("odom", &"laser".into()).unwrap();
        assert_eq!(chain.newest(), Some(at(1.2)));
        let mut sampler = chain.sampler();
        for (secs, y) in [(1.0, 0.0), (1.1, 1.0), (1.2, 2.0), (1.25, 2.5), (1.05, 0.5)] {
            let point = sampler.pose_at(at(secs)).unwrap() * Point3::new(1.0, 0.0, 0.0);
            assert!(
                (point - Point3::new(11.3, y, 0.0)).norm() < 1e-9,
                "{secs}: {point}"
            );
        }
        assert_eq!(sampler.pose_at(at(2.0)), Err(DropReason::AfterLastPose));
        assert_eq!(sampler.pose_at(at(0.9)), Err(DropReason::BeforeFirstPose));
    }

    #[test]
    fn what_is_not_connected_has_no_path() {
        let buffer = buffer(&[("cloud", "radar", 0.0, planar(0.0, 0.0, 0.0), false)]);
        assert!(buffer.chain("odom", &"cloud".into()).is_none());
        assert_eq!(
            buffer.ancestry(&"radar".into()),
            ["radar".into(), "cloud".into()] as [FrameId; 2]
        );
    }

    #[test]
    fn a_loop_in_damaged_data_ends() {
        let pose = planar(0.0, 0.0, 0.0);
        let buffer = buffer(&[
            ("a", "b", 0.0, pose, false),
            ("b", "a", 0.0, pose, false),
            ("c", "c", 0.0, pose, true),
        ]);
        assert!(buffer.chain("odom", &"a".into()).is_none());
        assert!(buffer.ancestry(&"a".into()).len() <= MAX_FRAMES + 2);
        assert!(buffer.chain("odom", &"c".into()).is_none());
    }
}
