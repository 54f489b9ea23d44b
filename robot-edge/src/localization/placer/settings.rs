//! What placing needs to know, and what it counts.

use crate::drops::DropCounts;
use crate::localization::beam_projection::{Footprint, SensorSettings};
use crate::localization::dead_reckoning::DeadReckoningSettings;
use crate::localization::pose_track::Reach;
use crate::measurement::FrameId;
use crate::robot_time::RobotDuration;

/// Where poses come from, decided before the first measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum PoseOrigin {
    /// Each scan carries its own.
    Log,
    /// The transform tree, up to this frame.
    Tf {
        /// Frame of the map.
        fixed_frame: FrameId,
        /// Where the laser sits on the vehicle.
        mount: MountOrigin,
    },
    /// Odometry messages.
    Odometry,
    /// Wheel encoders and an attitude sensor.
    Wheels(DeadReckoningSettings),
    /// The vehicle stands still at the origin.
    Static,
}

/// Who says where the laser sits on the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MountOrigin {
    /// The transform tree, which reaches the laser's own frame.
    Tree,
    /// The configuration; the tree reaches the vehicle only.
    Configured,
}

/// All that placing needs to know.
#[derive(Clone, Debug)]
pub struct PlacerSettings {
    /// Where poses come from.
    pub origin: PoseOrigin,
    /// Frame of the vehicle in the transform tree.
    pub base_frame: FrameId,
    /// Limits of interpolation.
    pub reach: Reach,
    /// How long poses are kept behind the newest stamp.
    pub keep: RobotDuration,
    /// How far stamps may pass a waiting scan.
    pub wait: RobotDuration,
    /// Scans that may wait at once; the oldest is dropped for the next.
    pub max_waiting: usize,
    /// The sensor.
    pub sensor: SensorSettings,
    /// The vehicle.
    pub footprint: Footprint,
}

/// What became of scans and beams so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PlacerCounts {
    /// Scans that came in.
    pub scans_in: u64,
    /// Scans placed.
    pub scans_placed: u64,
    /// Scans dropped, by reason.
    pub dropped_scans: DropCounts,
    /// Wheel angles and attitudes left out, by reason.
    pub dropped_poses: DropCounts,
    /// Beams of the placed scans.
    pub beams_in: u64,
    /// Beams left out of placed scans, by reason.
    pub dropped_beams: DropCounts,
}
