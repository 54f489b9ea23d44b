//! Jumps of poses that the scans before them have not passed yet.

use crate::pose_jump::PoseJump;
use measurement::FrameId;
use measurement::time::RobotTime;

/// Jumps that wait at most: more than that between two scans are as one.
const MAX_PENDING: usize = 64;

/// Jumps and the frames whose poses they are in, in the order in which they came.
#[derive(Clone, Debug, Default)]
pub(super) struct PendingJumps(Vec<(FrameId, PoseJump)>);

impl PendingJumps {
    /// Keeps them until the scans before them are placed; where too many pending, the newest is replaced.
    pub(super) fn extend(&mut self, jumps: impl IntoIterator<Item = (FrameId, PoseJump)>) {
        self.0.extend(jumps);
        if let Some(newest) = self.0.len().checked_sub(1)
            && newest >= MAX_PENDING
        {
            self.0.swap_remove(MAX_PENDING - 1);
        }
    }

    /// Takes those up to `stamp`, in stamp order.
    pub(super) fn take_until(&mut self, stamp: RobotTime) -> Vec<(FrameId, PoseJump)> {
        let mut due: Vec<_> = self
            .0
            .extract_if(.., |(_, jump)| jump.stamp <= stamp)
            .collect();
        due.sort_by_key(|(_, jump)| jump.stamp);
        due
    }
}
