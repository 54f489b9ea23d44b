//! Drops, counted by reason: no loss is silent.

use std::collections::BTreeMap;
use std::fmt;

/// Reason for a drop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DropReason {
    // Recordings.
    /// A line, record or chunk that could not be read.
    Damaged,
    /// The recording ends in the middle of a record.
    CutOff,
    /// A message whose bytes do not fit its type.
    Undecodable,
    /// A packet that a sensor sent, by its numbers or times, and that did not come.
    Lost,
    /// A stamp that is not finite or out of range.
    BadStamp,
    /// A pose that is not finite or whose quaternion is not a rotation.
    BadPose,
    /// Older than the data already delivered, by more than the reordering window.
    Late,

    // Wheels and attitude.
    /// Wheel angles that are not finite, or an impossible turn: a counter that wrapped or was
    /// reset.
    WheelJump,

    // Satellite positions.
    /// The receiver reports no fix.
    NoFix,
    /// A latitude, longitude or altitude that is not finite or not on Earth.
    BadFix,
    /// A GNSS outlier: farther from the previous fixes than the vehicle can drive, and not
    /// confirmed by later ones.
    GnssOutlier,

    // Scans.
    /// No beams, or angles or times that are not finite.
    BadScan,
    /// No pose yet, or no transform between the sensor's frame and the map's.
    NoPose,
    /// Before the first pose.
    BeforeFirstPose,
    /// Between two poses that are farther apart than `localization.max_gap_s`.
    PoseGap,
    /// Between two poses whose step exceeds `localization.jump_m` and the possible motion.
    PoseJump,
    /// Farther past the newest pose than `localization.max_extrapolation_s`.
    AfterLastPose,
    /// The queue for poses was full, or a scan waited too long for mapping.
    QueueFull,

    // Beams.
    /// NaN, negative, zero or below the sensor's smallest range.
    InvalidRange,
    /// A hit on the vehicle itself.
    OwnBody,
    /// A point of a cloud beside one that was kept, in the same cube of `thin_m`.
    Thinned,
    /// A hit without confirming neighbours (radial filter).
    Isolated,
    /// Too far from the origin of `odom` for the map's index range.
    OutOfBounds,
    /// A hit outside of a rolling map's window.
    OutsideWindow,
}

impl DropReason {
    /// Name in `--summary` and on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Damaged => "damaged",
            Self::CutOff => "cut_off",
            Self::Undecodable => "undecodable",
            Self::Lost => "lost",
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
            Self::Thinned => "thinned",
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

/// Counts by reason.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DropCounts(BTreeMap<DropReason, u64>);

impl DropCounts {
    /// Counts one drop.
    pub fn add(&mut self, reason: DropReason) {
        self.add_many(reason, 1);
    }

    /// Counts `n` drops; zero leaves no entry.
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

    /// Count of `reason`.
    pub fn get(&self, reason: DropReason) -> u64 {
        self.0.get(&reason).copied().unwrap_or(0)
    }

    /// Sum of all counts.
    pub fn total(&self) -> u64 {
        self.0.values().sum()
    }

    /// Reasons that occurred, in a fixed order.
    pub fn iter(&self) -> impl Iterator<Item = (DropReason, u64)> + '_ {
        self.0.iter().map(|(&reason, &n)| (reason, n))
    }
}
