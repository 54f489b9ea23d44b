//! Nothing is lost silently: every loss is counted by reason.

use std::collections::BTreeMap;
use std::fmt;

/// Why something that came in did not reach the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DropReason {
    // Recordings.
    /// A line, record or chunk that could not be read.
    Damaged,
    /// The recording ends in the middle of a record.
    CutOff,
    /// A message whose bytes do not fit its type.
    Undecodable,
    /// A stamp that is not finite or out of range.
    BadStamp,
    /// A pose that is not finite or whose quaternion is not a rotation.
    BadPose,
    /// Older than what its source already yielded, by more than the reordering window.
    Late,

    // Wheels and attitude.
    /// Wheel angles that are not finite, or that turned farther than the vehicle drives: a counter that
    /// wrapped or was reset.
    WheelJump,

    // Satellite positions.
    /// The receiver says that it has no fix.
    NoFix,
    /// A latitude, longitude or altitude that is not finite or not on Earth.
    BadFix,
    /// Farther from the fixes before than the vehicle drives, and not borne out by those behind.
    GnssOutlier,

    // Scans.
    /// No beams, or angles or times that are not finite.
    BadScan,
    /// No pose has come yet, or none connects the sensor's frame with the map's.
    NoPose,
    /// Before the first pose.
    BeforeFirstPose,
    /// Between two poses that are farther apart than `localization.max_gap_s`.
    PoseGap,
    /// Between two poses that are farther apart than `localization.jump_m` and driving explain.
    PoseJump,
    /// Farther past the newest pose than `localization.max_extrapolation_s`.
    AfterLastPose,
    /// More scans waited for a pose than fit the queue, or one waited for mapping for too long.
    QueueFull,

    // Beams.
    /// Not-a-number, negative, zero or below the sensor's smallest range.
    InvalidRange,
    /// A hit on the vehicle itself.
    OwnBody,
    /// A hit that nothing beside it confirms.
    Isolated,
    /// So far from `odom`'s origin that the map has no cell for it.
    OutOfBounds,
    /// A hit beyond the window of a map that moves with the vehicle.
    OutsideWindow,
}

impl DropReason {
    /// The name in `--summary`, in messages and on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Damaged => "damaged",
            Self::CutOff => "cut_off",
            Self::Undecodable => "undecodable",
            Self::BadStamp => "bad_stamp",
            Self::BadPose => "bad_pose",
            Self::Late => "late",
            Self::WheelJump => "wheel_jump",
            Self::NoFix => "no_fix",
            Self::BadFix => "bad_fix",
            Self::GnssOutlier => "gnss_outlier",
            Self::BadScan => "bad_scan",
            Self::NoPose => "no_pose",
            Self::BeforeFirstPose => "before_first_pose",
            Self::PoseGap => "pose_gap",
            Self::PoseJump => "pose_jump",
            Self::AfterLastPose => "after_last_pose",
            Self::QueueFull => "queue_full",
            Self::InvalidRange => "invalid_range",
            Self::OwnBody => "own_body",
            Self::Isolated => "isolated",
            Self::OutOfBounds => "out_of_bounds",
            Self::OutsideWindow => "outside_window",
        }
    }
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// How many were dropped, by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DropCounts(BTreeMap<DropReason, u64>);

impl DropCounts {
    /// Counts one.
    pub fn add(&mut self, reason: DropReason) {
        self.add_many(reason, 1);
    }

    /// Counts `n`; zero leaves no entry.
    pub fn add_many(&mut self, reason: DropReason, n: u64) {
        if n > 0 {
            *self.0.entry(reason).or_default() += n;
        }
    }

    /// Adds all of `other`.
    pub fn merge(&mut self, other: &Self) {
        for (&reason, &n) in &other.0 {
            self.add_many(reason, n);
        }
    }

    /// How many for `reason`.
    pub fn get(&self, reason: DropReason) -> u64 {
        self.0.get(&reason).copied().unwrap_or(0)
    }

    /// How many in all.
    pub fn total(&self) -> u64 {
        self.0.values().sum()
    }

    /// Reasons that occurred, in a fixed order.
    pub fn iter(&self) -> impl Iterator<Item = (DropReason, u64)> + '_ {
        self.0.iter().map(|(&reason, &n)| (reason, n))
    }
}
