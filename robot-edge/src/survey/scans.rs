//! What the scans of one stream are like.

use super::max_range::MaxRangeSurvey;
use super::stamps::StampSurvey;
use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{FrameId, StreamId};

/// The scans of one stream.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanSurvey {
    /// Which stream.
    pub stream: StreamId,
    /// Frame of the first scan.
    pub frame: FrameId,
    /// Their stamps; their number is the number of scans.
    pub stamps: StampSurvey,
    /// Fewest and most beams.
    pub beams: (usize, usize),
    /// Angle of beam 0 of the first scan, radians.
    pub angle_min_rad: f32,
    /// Angle from beam to beam in the first scan, radians.
    pub angle_increment_rad: f32,
    /// Time from beam to beam in the first scan, seconds.
    pub time_increment_s: f32,
    /// Smallest range that is a measurement, of the first scan, metres.
    pub range_min_m: f32,
    /// Range from which on there is none, of the first scan, metres.
    pub range_max_m: f32,
    /// The longest ranges.
    pub max_range: MaxRangeSurvey,
    /// Whether every scan brings its own pose.
    pub has_own_poses: bool,
}

impl ScanSurvey {
    pub(super) fn new(stream: StreamId, frame: FrameId, scan: &Scan) -> Self {
        Self {
            stream,
            frame,
            stamps: StampSurvey::default(),
            beams: (usize::MAX, 0),
            angle_min_rad: scan.angle_min_rad,
            angle_increment_rad: scan.angle_increment_rad,
            time_increment_s: scan.time_increment_s,
            range_min_m: scan.range_min_m,
            range_max_m: scan.range_max_m,
            max_range: MaxRangeSurvey::default(),
            has_own_poses: true,
        }
    }

    pub(super) fn add(&mut self, stamp: RobotTime, scan: &Scan, has_own_pose: bool) {
        self.stamps.add(stamp);
        let beams = scan.ranges_m.len();
        self.beams = (self.beams.0.min(beams), self.beams.1.max(beams));
        self.max_range.add(&scan.ranges_m);
        self.has_own_poses &= has_own_pose;
    }

    /// Angle of the last beam of the longest scan, taking the first scan's start and step, radians.
    pub fn angle_max_rad(&self) -> f32 {
        let steps = self.beams.1.saturating_sub(1) as f32;
        self.angle_min_rad + steps * self.angle_increment_rad
    }

    /// The range from which on this laser sees nothing although its messages do not say so, metres.
    pub fn inferred_miss_range_m(&self) -> Option<f32> {
        self.max_range
            .miss_range_m()
            .filter(|&range| range < self.range_max_m)
    }
}
