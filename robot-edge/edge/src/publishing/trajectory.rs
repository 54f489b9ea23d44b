//! The pose of the vehicle at each mapped scan, for exports and consoles. Pure.

use std::sync::{Arc, Mutex, MutexGuard};

use protocol::export::{Poses, StampedPose};
use protocol::message::{TrajectoryPart, TrajectoryRequest};

use crate::lock;
use mapping::registered_scan::RegisteredScan;

/// Maximum number of poses: 11 to 23 MB. A longer trajectory keeps every second pose. Even, so that the next pose is kept.
const MAX_POSES: usize = 1_000_000;

#[derive(Clone, Debug, Default)]
pub struct SharedTrajectory(Arc<Mutex<Trajectory>>);

impl SharedTrajectory {
    pub fn lock(&self) -> MutexGuard<'_, Trajectory> {
        lock(&self.0)
    }

    /// To be read at length, while mapping goes on.
    pub fn snapshot(&self) -> Trajectory {
        self.lock().clone()
    }
}

/// The poses of mapped scans, oldest first.
#[derive(Clone, Debug)]
pub struct Trajectory {
    /// Poses after the shown ones belong to a recording that was sought back; seeking forward needs them.
    poses: Poses,
    /// Poses of the scans in a paused snapshot.
    provisional: Vec<StampedPose>,
    /// Every `stride`-th pose is kept.
    stride: u64,
    scans: u64,
    /// Increases when indices of poses change.
    number: u64,
}

impl Default for Trajectory {
    fn default() -> Self {
        Self {
            poses: Poses::default(),
            provisional: Vec::new(),
            stride: 1,
            scans: 0,
            number: 0,
        }
    }
}

impl Trajectory {
    pub fn add(&mut self, scan: &RegisteredScan) {
        self.add_pose(pose_of(scan));
    }

    /// Adds a scan of a paused snapshot, until [`Self::seek`].
    pub fn add_provisional(&mut self, scan: &RegisteredScan) {
        self.provisional.push(pose_of(scan));
    }

    fn add_pose(&mut self, pose: StampedPose) {
        if self.scans.is_multiple_of(self.stride) {
            if self.len() >= MAX_POSES {
                self.thin();
            }
            let at = self.len();
            if at < self.poses.len() {
                self.poses.replace(at, pose);
            } else {
                self.poses.push(pose);
            }
        }
        self.scans += 1;
    }

    pub fn poses(&self) -> Vec<StampedPose> {
        self.every(1, 0).collect()
    }

    /// At most `most` poses, with the same number of scans between them.
    pub fn thinned(&self, most: usize) -> Vec<StampedPose> {
        let step = self.visible_len().div_ceil(most.max(1)).max(1);
        self.every(step, 0).collect()
    }

    pub fn last(&self) -> Option<StampedPose> {
        self.every(1, self.visible_len().checked_sub(1)?).next()
    }

    /// Every `step`-th shown pose from number `from` on.
    fn every(&self, step: usize, from: usize) -> impl Iterator<Item = StampedPose> {
        let len = self.len();
        let count = len.saturating_sub(from).div_ceil(step);
        let next = from.saturating_add(count.saturating_mul(step));
        let recorded = self.poses.every(step, from).take(count);
        let behind = self.provisional.iter().skip(next.saturating_sub(len));
        recorded.chain(behind.step_by(step).copied())
    }

    pub const fn scans(&self) -> u64 {
        self.scans
    }

    /// Moves all poses.
    pub fn correct(&mut self, corrected: impl Fn(&StampedPose) -> StampedPose) {
        let corrected = self.poses.iter_from(0).map(|pose| corrected(&pose));
        self.poses = corrected.collect();
        self.number += 1;
    }

    /// Shows the trajectory after `scans` scans of the same recording.
    pub fn seek(&mut self, scans: u64) {
        if scans != self.scans || !self.provisional.is_empty() {
            self.scans = scans;
            self.provisional.clear();
            self.number += 1;
        }
    }

    /// The reply to a query, and the stamp of the newest pose, nanoseconds.
    pub fn reply(&self, request: TrajectoryRequest) -> (i64, TrajectoryPart) {
        let visible_len = self.visible_len();
        let is_this = request
            .trajectory
            .is_none_or(|number| number == self.number);
        let from = usize::try_from(request.from).unwrap_or(usize::MAX);
        let step = usize::try_from(request.step.get()).unwrap_or(usize::MAX);
        let part = self.every(step, if is_this { from } else { usize::MAX });
        let stamp_ns = self.last().map_or(0, |pose| pose.stamp_ns);
        let part = TrajectoryPart::new(self.number, visible_len as u64, part);
        (stamp_ns, part)
    }

    fn visible_len(&self) -> usize {
        self.len() + self.provisional.len()
    }

    fn len(&self) -> usize {
        let len = usize::try_from(self.scans.div_ceil(self.stride)).unwrap_or(usize::MAX);
        len.min(self.poses.len())
    }

    fn thin(&mut self) {
        self.poses = self.poses.every(2, 0).collect();
        self.stride *= 2;
        self.number += 1;
    }
}

fn pose_of(scan: &RegisteredScan) -> StampedPose {
    let q = scan.odom_from_base.rotation.quaternion();
    StampedPose::new(
        scan.stamp.as_nanos(),
        scan.odom_from_base.translation.vector.into(),
        [q.i, q.j, q.k, q.w],
    )
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use protocol::message::MAX_TRAJECTORY_POSES;

    use super::*;

    fn pose(n: i64) -> StampedPose {
        StampedPose::new(n, [0.1 * n as f64, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    }

    fn of(scans: i64) -> Trajectory {
        let mut trajectory = Trajectory::default();
        (0..scans).for_each(|n| trajectory.add_pose(pose(n)));
        trajectory
    }

    fn stamps(poses: &[StampedPose]) -> Vec<i64> {
        poses.iter().map(|pose| pose.stamp_ns).collect()
    }

    fn ask(trajectory: &Trajectory, of: Option<u64>, from: u64, step: u32) -> TrajectoryPart {
        let step = NonZeroU32::new(step).unwrap();
        let request = TrajectoryRequest {
            trajectory: of,
            from,
            step,
        };
        trajectory.reply(request).1
    }

    #[test]
    fn a_question_is_answered_with_the_poses_that_are_written() {
        let trajectory = of(1200);
        let mut fetched = Vec::new();
        while fetched.len() < 1200 {
            let part = ask(&trajectory, Some(0), fetched.len() as u64, 1);
            assert_eq!((part.trajectory, part.poses), (0, 1200));
            assert_eq!(
                part.rows.len(),
                (1200 - fetched.len()).min(MAX_TRAJECTORY_POSES)
            );
            fetched.extend(part.part());
        }
        assert_eq!(fetched, trajectory.poses());
        let coarse: Vec<_> = ask(&trajectory, None, 100, 400).part().collect();
        assert_eq!(stamps(&coarse), [100, 500, 900]);
        assert_eq!(ask(&trajectory, None, 1200, 1).rows, [[0; 8]; 0]);
        assert_eq!(ask(&trajectory, None, u64::MAX, u32::MAX).rows, [[0; 8]; 0]);
        assert_eq!(ask(&trajectory, Some(1), 0, 1).rows, [[0; 8]; 0]);
    }

    #[test]
    fn a_recording_that_is_wound_has_the_way_up_to_where_it_stands() {
        let mut trajectory = of(100);
        trajectory.seek(40);
        assert_eq!(stamps(&trajectory.poses()), (0..40).collect::<Vec<_>>());
        assert_eq!(ask(&trajectory, Some(0), 0, 1).poses, 40);
        assert_eq!(ask(&trajectory, Some(0), 0, 1).rows, [[0; 8]; 0]);
        trajectory.add_pose(pose(40));
        assert_eq!(trajectory.poses().len(), 41);
        trajectory.seek(90);
        assert_eq!(trajectory.poses(), of(90).poses());
        assert_eq!(ask(&trajectory, None, 0, 1).trajectory, 2);
        trajectory.seek(90);
        assert_eq!(ask(&trajectory, Some(2), 0, 1).rows.len(), 90);
        trajectory.seek(0);
        assert_eq!(trajectory.poses(), []);
    }

    #[test]
    fn a_long_way_is_thinned_and_keeps_its_beginning() {
        let many = i64::try_from(MAX_POSES).unwrap();
        let trajectory = of(many + 5);
        let kept = stamps(&trajectory.poses());
        assert_eq!(kept.len(), MAX_POSES / 2 + 3);
        assert_eq!(kept[..3], [0, 2, 4]);
        assert_eq!(kept[kept.len() - 3..], [many, many + 2, many + 4]);
        let part = ask(&trajectory, None, 0, 1);
        assert_eq!((part.trajectory, part.poses), (1, kept.len() as u64));
    }

    #[test]
    fn what_is_shown_for_a_standstill_changes_nothing_of_the_way() {
        let mut trajectory = of(100);
        trajectory.seek(40);
        trajectory.provisional = [1_000, 1_001].map(pose).into();
        assert_eq!(stamps(&trajectory.poses())[38..], [38, 39, 1_000, 1_001]);
        let part = ask(&trajectory, Some(1), 39, 1);
        assert_eq!((part.poses, part.rows.len()), (42, 3));
        let part = ask(&trajectory, Some(1), 37, 2);
        assert_eq!(stamps(&part.part().collect::<Vec<_>>()), [37, 39, 1_001]);
        trajectory.seek(40);
        assert_eq!(ask(&trajectory, None, 0, 1).trajectory, 2);
        trajectory.seek(90);
        assert_eq!(trajectory.poses(), of(90).poses());
    }
}
