//! Poses from scans, on top of what other sensors say about the motion (docs/methods.md, section 0, pose source (d)).
//!
//! Scan matching is planar. It moves the frame of the other sensors' poses in the plane, so that height, roll and pitch, and the
//! motion between two scans, are theirs.

use std::collections::VecDeque;

use mapping::registered_scan::SensorId;
use measurement::FrameId;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::{self, Pose};
use measurement::scan::Scan;
use measurement::time::RobotTime;
use nalgebra::{Isometry2, Vector3};

use crate::scan_matching::slam::{ClosureCounts, Confidence, ScanInput, ScanPose, ScanSlam};
use crate::scan_matching::slam_settings::SlamSettings;

/// What the other sensors say about the motion from scan to scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionPrior {
    /// Nothing: the velocity is assumed to be constant.
    None,
    /// The turn.
    Heading,
    /// Way and turn.
    Full,
}

/// Settings of [`ScanLocalization`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanLocalizationSettings {
    /// The sensor whose scans are matched.
    pub sensor: SensorId,
    /// What else is known about the motion.
    pub prior: MotionPrior,
    /// Of scan matching and loop closure.
    pub slam: SlamSettings,
}

/// Matches the scans of one sensor.
#[derive(Clone, Debug)]
pub(crate) struct ScanLocalization {
    pub(crate) settings: ScanLocalizationSettings,
    pub(crate) waiting: VecDeque<WaitingScan>,
    slam: ScanSlam,
    /// Stamp of each keyframe, and its pose in `odom`.
    keyframes: Vec<(RobotTime, Isometry2<f64>)>,
    is_corrected: bool,
    begins_map: bool,
    monitor: ConfidenceMonitor,
    report: ScanLocalizationReport,
}

/// A scan that waits for the other sensors' pose at its stamp.
#[derive(Clone, Debug)]
pub(crate) struct WaitingScan {
    /// Of the first beam.
    pub(crate) stamp: RobotTime,
    pub(crate) frame: FrameId,
    pub(crate) scan: Scan,
}

/// What scan matching did, and how sure it is now.
#[derive(Clone, Debug, Default)]
pub struct ScanLocalizationReport {
    /// The newest pose and its stamp.
    pub newest: Option<(RobotTime, ScanPose)>,
    /// Scans whose pose is fully determined by the map.
    pub full: u64,
    /// Scans whose pose is not determined along one direction, as in a corridor.
    pub uncertain_along: u64,
    /// Scans that do not fit the map, whose pose is that of odometry.
    pub odometry_only: u64,
    /// Scans whose pose is not known.
    pub lost: u64,
    /// Scans that were not matched, by reason.
    pub dropped: DropCounts,
    /// Closures of loops.
    pub closures: ClosureCounts,
}

/// How far the scans determine the poses now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoseConfidence {
    /// In all directions.
    #[default]
    Determined,
    /// Not along one direction, as in a corridor.
    UncertainAlong,
    /// They do not fit the map: the poses are those of odometry.
    OdometryOnly,
    /// Not at all.
    Lost,
}

/// The poses became more or less certain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfidenceChange {
    /// Of the first scan.
    pub stamp: RobotTime,
    /// From then on.
    pub confidence: PoseConfidence,
}

/// Says so when a few scans in sequence agree.
#[derive(Clone, Copy, Debug, Default)]
struct ConfidenceMonitor {
    now: PoseConfidence,
    next: PoseConfidence,
    since: RobotTime,
    scans: u32,
}

impl ConfidenceMonitor {
    const SCANS: u32 = 5;

    fn update(&mut self, stamp: RobotTime, confidence: PoseConfidence) -> Option<ConfidenceChange> {
        if confidence != self.next || self.scans == 0 {
            (self.next, self.since, self.scans) = (confidence, stamp, 0);
        }
        self.scans = (self.scans + 1).min(Self::SCANS);
        if self.next == self.now || self.scans < Self::SCANS {
            return None;
        }
        self.now = self.next;
        Some(ConfidenceChange {
            stamp: self.since,
            confidence,
        })
    }
}

/// The pose of `odom` in the map over time: it changes where a loop is closed. Poses are planar.
///
/// Where the vehicle was lost, a new map begins; the places before are in it once a closure says how they lie to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapFromOdom {
    steps: Vec<Step>,
    /// A new map begins here.
    pub begins_map: bool,
}

/// From a keyframe to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    begin: RobotTime,
    odom_from_keyframe: Pose,
    /// `None` where the place is not in the map.
    map_from_odom: Option<Pose>,
}

impl MapFromOdom {
    /// At `stamp`; `None` where the place of the vehicle is not in the map.
    pub fn at(&self, stamp: RobotTime) -> Option<Pose> {
        let after = self.steps.partition_point(|step| step.begin <= stamp);
        match self.steps.get(after.saturating_sub(1)) {
            Some(step) => step.map_from_odom,
            None => Some(Pose::identity()),
        }
    }

    /// Of now.
    pub fn newest(&self) -> Pose {
        let step = self.steps.last().and_then(|step| step.map_from_odom);
        step.unwrap_or_else(Pose::identity)
    }

    /// How far a place of the vehicle in the map is from that by `other`, metres at most; infinite where only one has it.
    pub fn distance_m(&self, other: &Self) -> f64 {
        let distances_m = self.steps.iter().map(|step| {
            let poses = [step.map_from_odom, other.at(step.begin)];
            match poses.map(|pose| Some(pose? * step.odom_from_keyframe)) {
                [Some(own), Some(others)] => {
                    (own.translation.vector - others.translation.vector).norm()
                }
                [None, None] => 0.0,
                _ => f64::INFINITY,
            }
        });
        distances_m.fold(0.0, f64::max)
    }
}

/// Scans that wait for a pose of the other sensors at most; beyond it the oldest is dropped.
const MAX_WAITING: usize = 64;

impl ScanLocalization {
    pub(crate) fn new(settings: ScanLocalizationSettings) -> Self {
        Self {
            slam: ScanSlam::new(settings.slam),
            settings,
            waiting: VecDeque::new(),
            keyframes: Vec::new(),
            is_corrected: false,
            begins_map: false,
            monitor: ConfidenceMonitor::default(),
            report: ScanLocalizationReport::default(),
        }
    }

    /// Queues a scan. One that is not newer than the last is dropped.
    pub(crate) fn enqueue(&mut self, scan: WaitingScan) {
        let newest = self.waiting.back().map(|waiting| waiting.stamp);
        let newest = newest.or(self.report.newest.map(|(stamp, _)| stamp));
        if newest.is_some_and(|newest| scan.stamp <= newest) {
            return self.report.dropped.add(DropReason::Late);
        }
        if self.waiting.len() >= MAX_WAITING {
            self.waiting.pop_front();
            self.report.dropped.add(DropReason::QueueFull);
        }
        self.waiting.push_back(scan);
    }

    pub(crate) fn count_dropped(&mut self, reason: DropReason) {
        self.report.dropped.add(reason);
    }

    /// Matches a scan. `prior_from_base`: pose by the other sensors. Returns the pose of their frame in `odom`, and whether poses
    /// became more or less certain.
    pub(crate) fn take(
        &mut self,
        waiting: &WaitingScan,
        base_from_sensor: &Pose,
        prior_from_base: &Pose,
    ) -> (Pose, Option<ConfidenceChange>) {
        let (scan, base_from_sensor) = seen_from_above(&waiting.scan, base_from_sensor);
        let prior = planar(prior_from_base);
        let pose = self.slam.push(&ScanInput {
            stamp: waiting.stamp,
            scan: &scan,
            base_from_sensor,
            odom_from_base: (self.settings.prior != MotionPrior::None).then_some(prior),
            is_heading_only: self.settings.prior == MotionPrior::Heading,
        });
        if pose.keyframe as usize >= self.keyframes.len() {
            let odom_from_keyframe = pose.local_from_base * pose.keyframe_from_base.inverse();
            let new = (waiting.stamp, odom_from_keyframe);
            self.keyframes.resize(pose.keyframe as usize + 1, new);
            if pose.confidence == Confidence::Lost {
                let pieces = self.slam.map().pieces();
                self.begins_map |= pieces.last() == Some(&pose.keyframe);
                self.is_corrected |= self.begins_map;
            }
        }
        let report = &mut self.report;
        report.newest = Some((waiting.stamp, pose));
        let (count, confidence) = match pose.confidence {
            Confidence::Full => (&mut report.full, PoseConfidence::Determined),
            Confidence::UncertainAlong(_) => {
                (&mut report.uncertain_along, PoseConfidence::UncertainAlong)
            }
            Confidence::OdometryOnly => (&mut report.odometry_only, PoseConfidence::OdometryOnly),
            Confidence::Lost => (&mut report.lost, PoseConfidence::Lost),
        };
        *count += 1;
        self.is_corrected |= pose.is_corrected;
        let change = self.monitor.update(waiting.stamp, confidence);
        (in_space(&(pose.local_from_base * prior.inverse())), change)
    }

    /// Optimizes the map to the end, after the last scan.
    pub(crate) fn finish(&mut self) {
        if !self.keyframes.is_empty() {
            self.slam.finish();
            self.is_corrected = true;
        }
    }

    /// The way of `odom` in the map, if it changed since the last call.
    pub(crate) fn take_correction(&mut self) -> Option<MapFromOdom> {
        if !std::mem::take(&mut self.is_corrected) {
            return None;
        }
        let way = self.map_from_odom();
        self.begins_map = false;
        Some(way)
    }

    /// The way of `odom` in the map so far.
    pub(crate) fn map_from_odom(&self) -> MapFromOdom {
        let map = self.slam.map();
        let pieces = map.pieces();
        let keyframes = self.keyframes.iter().zip(map.keyframes()).zip(&pieces);
        let steps = keyframes.map(
            |(((stamp, odom_from_keyframe), map_from_keyframe), piece)| {
                let map_from_odom = in_space(&(map_from_keyframe * odom_from_keyframe.inverse()));
                Step {
                    begin: *stamp,
                    odom_from_keyframe: in_space(odom_from_keyframe),
                    map_from_odom: (Some(piece) == pieces.last()).then_some(map_from_odom),
                }
            },
        );
        MapFromOdom {
            steps: steps.collect(),
            begins_map: self.begins_map,
        }
    }

    pub(crate) fn report(&self) -> ScanLocalizationReport {
        ScanLocalizationReport {
            closures: self.slam.closures(),
            ..self.report.clone()
        }
    }
}

/// The heading and the place, seen from above.
fn planar(pose: &Pose) -> Isometry2<f64> {
    Isometry2::new(pose.translation.vector.xy(), pose::yaw_rad(pose))
}

fn in_space(pose: &Isometry2<f64>) -> Pose {
    pose::planar(
        pose.translation.vector.x,
        pose.translation.vector.y,
        pose.rotation.angle(),
    )
}

/// A scan and its mounting, seen from above: a sensor that hangs upside down turns the other way round.
pub(crate) fn seen_from_above(scan: &Scan, base_from_sensor: &Pose) -> (Scan, Isometry2<f64>) {
    let ahead = base_from_sensor.rotation * Vector3::x();
    let is_upside_down = (base_from_sensor.rotation * Vector3::z()).z < 0.0;
    let sign = if is_upside_down { -1.0 } else { 1.0 };
    let mut scan = scan.clone();
    scan.angle_min_rad *= sign;
    scan.angle_increment_rad *= sign;
    let yaw_rad = libm::atan2(ahead.y, ahead.x);
    (
        scan,
        Isometry2::new(base_from_sensor.translation.vector.xy(), yaw_rad),
    )
}
