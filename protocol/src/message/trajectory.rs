//! The way of a vehicle, part by part: for the exports of a console, and for one that comes when much of it lies behind.

use std::num::NonZeroU32;

use serde::{Deserialize, Serialize};

use crate::export::StampedPose;

/// Poses in one [`TrajectoryPart`] at most.
pub const MAX_TRAJECTORY_POSES: usize = 500;

/// Asks `trajectory` for poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrajectoryRequest {
    /// Of this trajectory; `None` for whichever it is.
    pub trajectory: Option<u64>,
    /// The first, counted from 0.
    pub from: u64,
    /// Every so many-th from there.
    pub step: NonZeroU32,
}

/// The one reply to [`TrajectoryRequest`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrajectoryPart {
    /// Which trajectory. Another number means that poses have other indices now, and are to be asked for anew.
    pub trajectory: u64,
    /// Poses that it has.
    pub poses: u64,
    /// The poses that were asked for, as many as there are, [`MAX_TRAJECTORY_POSES`] at most; none where another trajectory
    /// was asked for. Each as the difference to the one before it, the first as it is: stamp, nanoseconds; x, y, z, 0.1 µm;
    /// quaternion x, y, z, w, 10⁻⁹.
    pub rows: Vec<[i64; 8]>,
}

impl TrajectoryPart {
    /// A part with these poses.
    pub fn new(trajectory: u64, poses: u64, part: impl Iterator<Item = StampedPose>) -> Self {
        let mut before = [0; 8];
        let rows = part
            .take(MAX_TRAJECTORY_POSES)
            .map(|pose| {
                let now = pose.to_row();
                let row = std::array::from_fn(|i| now[i].wrapping_sub(before[i]));
                before = now;
                row
            })
            .collect();
        Self {
            trajectory,
            poses,
            rows,
        }
    }

    /// The poses that are in it.
    pub fn part(&self) -> impl Iterator<Item = StampedPose> {
        let mut before = [0i64; 8];
        self.rows.iter().map(move |row| {
            before = std::array::from_fn(|i| before[i].wrapping_add(row[i]));
            StampedPose::from_row(before)
        })
    }
}
