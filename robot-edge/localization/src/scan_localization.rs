//! Poses from scans, on top of what other sensors say about the motion (docs/methods.md, section 0, pose source (d)).
//!
//! Scan matching is planar. It moves the frame of the other sensors' poses in the plane, so that height, roll and pitch, and the
//! motion between two scans, are theirs. Clouds are matched in space before ([`crate::cloud_matching`]): the poses are then theirs.

use std::collections::VecDeque;
use std::sync::Arc;

use mapping::registered_scan::SensorId;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::{self, Pose};
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, GeodeticFix};
use nalgebra::{Isometry2, Matrix3, Point2, Point3, Vector3};
use protocol::geodesy::{GeodeticPoint, LocalTangentPlane};

use crate::beam_projection::BodyBox;
use crate::cloud_matching::scan_collector::ScanCollector;
use crate::cloud_matching::{CloudMatcher, Revolution};
use crate::cloud_walls::walls;
use crate::dead_reckoning::StampedPose;
use crate::gnss_positioning::geodetic_point;
use crate::registration::scan_queue::Sweep;
use crate::scan_matching::position_fixes::AntennaPosition;
use crate::scan_matching::relocalization::{Place, Relocalizer};
use crate::scan_matching::slam::{ClosureCounts, Confidence, ScanInput, ScanPose, ScanSlam};
use crate::scan_matching::slam_map::{SlamMap, SlamMapParts};
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

/// Settings of matched scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanLocalizationSettings {
    /// The sensor whose scans are matched.
    pub sensor: SensorId,
    /// It is a planar laser that is tilted or tilts: its scans are matched in space, as clouds.
    pub is_tilted: bool,
    /// What else is known about the motion.
    pub prior: MotionPrior,
    /// Whether roll and pitch of the other sensors' poses are those of an attitude sensor.
    pub has_gravity: bool,
    /// Whether their heights are those of a receiver.
    pub has_height: bool,
    /// The receiver whose positions hold the map where it is on Earth.
    pub receiver: Option<ReceiverSettings>,
    /// Of scan matching and loop closure.
    pub slam: SlamSettings,
}

/// Settings of a satellite receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceiverSettings {
    /// Added to the stamps of fixes.
    pub time_offset: RobotDuration,
    /// Position of the antenna on the vehicle, metres.
    pub antenna_in_base: Vector3<f64>,
}

/// Matches the scans of one sensor.
#[derive(Clone, Debug)]
pub(crate) struct ScanLocalization {
    pub(crate) settings: ScanLocalizationSettings,
    pub(crate) waiting: VecDeque<WaitingScan>,
    clouds: CloudMatcher,
    pub(crate) collector: Option<ScanCollector>,
    slam: ScanSlam,
    odom_from_local: Isometry2<f64>,
    keyframes: Vec<Keyframe>,
    /// Number of the run, of those that made the map.
    session: u32,
    /// The map that the vehicle is searched for in.
    searched: Option<Searched>,
    is_corrected: bool,
    begins_map: bool,
    monitor: ConfidenceMonitor,
    covariances: Vec<PoseCovariance>,
    /// At the datum of the map: the first fix, of the first run that had one.
    plane: Option<LocalTangentPlane>,
    report: ScanLocalizationReport,
}

/// A scan that waits for the other sensors' pose at its stamp.
#[derive(Clone, Debug)]
pub(crate) struct WaitingScan {
    /// Of the first beam.
    pub(crate) stamp: RobotTime,
    /// When poses are known, it is matched: of the last point of a cloud, of the first beam of a planar scan.
    pub(crate) known_at: RobotTime,
    pub(crate) frame: FrameId,
    pub(crate) sweep: Sweep,
}

/// A pose from which scans are matched.
#[derive(Clone, Copy, Debug)]
pub struct Keyframe {
    /// Number of the run.
    pub session: u32,
    /// Stamp of its scan.
    pub stamp_ns: i64,
    /// Its pose in `odom` of that run.
    pub odom_from_keyframe: Isometry2<f64>,
}

/// A map to go on in.
#[derive(Clone, Debug)]
pub struct SavedMap {
    map: SlamMap,
    keyframes: Vec<Keyframe>,
    datum: Option<GeodeticPoint>,
}

impl SavedMap {
    /// Its keyframes with their poses in the map, and all else, for a file.
    pub fn to_parts(&self) -> (Vec<(Keyframe, Isometry2<f64>)>, SlamMapParts) {
        let poses = self.map.keyframes().iter().copied();
        let keyframes = self.keyframes.iter().copied().zip(poses);
        (keyframes.collect(), self.map.to_parts())
    }

    /// Of its positions on Earth.
    pub const fn datum(&self) -> Option<GeodeticPoint> {
        self.datum
    }

    /// The opposite of [`SavedMap::to_parts`]; none where the parts do not fit together.
    pub fn from_parts(
        keyframes: Vec<(Keyframe, Isometry2<f64>)>,
        parts: SlamMapParts,
        datum: Option<GeodeticPoint>,
    ) -> Option<Self> {
        let (keyframes, poses): (Vec<_>, _) = keyframes.into_iter().unzip();
        let is_ordered = keyframes.is_sorted_by_key(|keyframe| keyframe.session);
        let map = SlamMap::from_parts(poses, parts)?;
        is_ordered.then_some(Self {
            map,
            keyframes,
            datum,
        })
    }

    /// Where `odom` of its runs lies in it.
    pub fn map_from_odom(&self) -> MapFromOdom {
        let last = self.keyframes.last();
        MapFromOdom {
            steps: steps(&self.keyframes, &self.map),
            session: last.map_or(0, |keyframe| keyframe.session),
            begins_map: false,
        }
    }

    /// Runs that made it.
    pub fn sessions(&self) -> u32 {
        let last = self.keyframes.last();
        last.map_or(0, |keyframe| keyframe.session + 1)
    }
}

/// Where a map is gone on in.
#[derive(Clone, Debug)]
pub struct Continuation {
    /// The map.
    pub saved: Arc<SavedMap>,
    /// About where the vehicle is in it; the whole map is searched otherwise.
    pub near: Option<Isometry2<f64>>,
}

#[derive(Clone, Debug)]
struct Searched {
    continuation: Continuation,
    relocalizer: Relocalizer,
}

/// The vehicle is within this of the pose where it is said to be: metres and radians.
const NEAR: (f64, f64) = (3.0, 0.8);

impl Searched {
    fn locate(
        &mut self,
        slam: &ScanSlam,
        local_from_base: &Isometry2<f64>,
        settings: &SlamSettings,
    ) -> Option<Place> {
        let Continuation { saved, near } = &self.continuation;
        // Where it was when it began to search, and how it has moved since.
        let near = near.map(|start| start * local_from_base);
        let near = near.as_ref().map(|pose| (pose, NEAR));
        let points = || slam.surroundings();
        let closure = &settings.closure;
        self.relocalizer
            .update(&saved.map, local_from_base, points, near, closure)
    }
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
    /// Fixes that were not used, by reason.
    pub dropped_fixes: DropCounts,
    /// Positions on Earth in the map, and those of them that it contradicts.
    pub positions: (u64, u64),
    /// Closures of loops.
    pub closures: ClosureCounts,
    /// The vehicle was not found yet in the map that it was to go on in.
    pub is_searching: bool,
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
    session: u32,
    /// A new map begins here.
    pub begins_map: bool,
}

/// From a keyframe to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    session: u32,
    begin: RobotTime,
    odom_from_keyframe: Pose,
    /// `None` where the place is not in the map.
    map_from_odom: Option<Pose>,
}

impl MapFromOdom {
    /// At `stamp` of a run; `None` where the place of the vehicle is not in the map.
    pub fn at(&self, (session, stamp): (u32, RobotTime)) -> Option<Pose> {
        let begin = self.steps.partition_point(|step| step.session < session);
        let after = self
            .steps
            .partition_point(|step| (step.session, step.begin) <= (session, stamp));
        match self.steps.get(after.saturating_sub(1).max(begin)) {
            Some(step) if step.session == session => step.map_from_odom,
            _ => (session == self.session).then(Pose::identity),
        }
    }

    /// The present run, of those that made the map.
    pub const fn session(&self) -> u32 {
        self.session
    }

    /// Of now.
    pub fn newest(&self) -> Pose {
        let step = self.steps.last().and_then(|step| step.map_from_odom);
        step.unwrap_or_else(Pose::identity)
    }

    /// How far a place of the vehicle in the map is from that by `other`, metres at most; infinite where only one has it.
    pub fn distance_m(&self, other: &Self) -> f64 {
        let distances_m = self.steps.iter().map(|step| {
            let poses = [step.map_from_odom, other.at((step.session, step.begin))];
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

/// Stamp of a scan, and covariance of x, y (metres) and yaw (radians) of its pose by the map around it, in the frame of the vehicle.
pub type PoseCovariance = (RobotTime, Matrix3<f64>);

/// Where there are more covariances (20 MB), every second is left out.
const MAX_COVARIANCES: usize = 1 << 18;

/// Standard deviation of a fix whose receiver does not state it, and the least one, as stamps are not exact: metres.
const UNSTATED_SIGMA_M: f64 = 2.0;
const LEAST_SIGMA_M: f64 = 0.05;

/// Scans that wait for a pose of the other sensors at most; beyond it the oldest is dropped.
const MAX_WAITING: usize = 64;

impl ScanLocalization {
    /// `continuation`: the vehicle goes on in this map once it is found there.
    pub(crate) fn new(
        settings: &ScanLocalizationSettings,
        collector: Option<ScanCollector>,
        continuation: Option<Continuation>,
    ) -> Self {
        Self {
            slam: ScanSlam::new(settings.slam),
            odom_from_local: Isometry2::identity(),
            session: continuation.as_ref().map_or(0, |of| of.saved.sessions()),
            searched: continuation.map(|continuation| Searched {
                continuation,
                relocalizer: Relocalizer::default(),
            }),
            settings: *settings,
            waiting: VecDeque::new(),
            clouds: CloudMatcher::default(),
            collector,
            keyframes: Vec::new(),
            is_corrected: false,
            begins_map: false,
            monitor: ConfidenceMonitor::default(),
            covariances: Vec::new(),
            plane: None,
            report: ScanLocalizationReport::default(),
        }
    }

    /// Begins anew after a clock reset, as a run of its own: stamps repeat, and the vehicle may be elsewhere.
    pub(crate) fn reset(&mut self, continuation: Option<Continuation>) {
        let session = self.session + 1;
        let plane = self.plane.take();
        let collector = self.collector.take().map(ScanCollector::emptied);
        *self = Self {
            session,
            plane,
            begins_map: true,
            is_corrected: true,
            ..Self::new(&self.settings, collector, continuation)
        };
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

    /// Takes a fix.
    pub(crate) fn take_fix(&mut self, stamp: RobotTime, fix: &GeodeticFix) {
        let Some(receiver) = self.settings.receiver else {
            return;
        };
        match geodetic_point(fix) {
            Ok(place) => {
                let plane = self
                    .plane
                    .get_or_insert_with(|| LocalTangentPlane::new(place));
                let sigma_m = fix.sigma_m.unwrap_or(UNSTATED_SIGMA_M);
                let is_older_dropped = self.slam.push_position(AntennaPosition {
                    stamp: stamp + receiver.time_offset,
                    antenna: Point3::from(plane.enu_from_geodetic(&place)).xy(),
                    sigma_m: sigma_m.max(LEAST_SIGMA_M),
                });
                if is_older_dropped {
                    self.report.dropped_fixes.add(DropReason::QueueFull);
                }
            }
            Err(reason) => self.report.dropped_fixes.add(reason),
        }
    }

    /// Origin of the map on Earth, as soon as its frame is metres east and north of it.
    pub(crate) fn datum(&self) -> Option<GeodeticPoint> {
        let plane = self.plane.as_ref()?;
        (self.searched.is_none() && self.slam.map().is_on_earth()).then(|| plane.datum())
    }

    pub(crate) fn count_dropped(&mut self, reason: DropReason) {
        self.report.dropped.add(reason);
    }

    /// The vehicle is about at this pose in the map that it is searched for in. Returns whether it is searched for.
    pub(crate) fn locate(&mut self, map_from_base: &Isometry2<f64>) -> bool {
        let newest = self.report.newest.as_ref();
        let Some(searched) = &mut self.searched else {
            return false;
        };
        let local_from_base = newest.map_or_else(Isometry2::identity, |(_, of)| of.local_from_base);
        searched.continuation.near = Some(map_from_base * local_from_base.inverse());
        searched.relocalizer = Relocalizer::default();
        true
    }

    /// While the vehicle is searched for in a map: where `odom` lies there as far as is known. What was said, else where the last run
    /// ended.
    pub(crate) fn supposed_map_from_odom(&self) -> Option<Pose> {
        let Continuation { saved, near } = &self.searched.as_ref()?.continuation;
        let ended = saved.map.keyframes().last().copied();
        let map_from_local = near.or(ended).unwrap_or_else(Isometry2::identity);
        Some(in_space(&(map_from_local * self.odom_from_local.inverse())))
    }

    /// Matches a scan. `prior`: poses by the other sensors at its stamp and when they are known. Returns the pose of their frame in `odom`,
    /// and whether poses became more or less certain.
    pub(crate) fn take(
        &mut self,
        waiting: &WaitingScan,
        base_from_sensor: &Pose,
        prior: [StampedPose; 2],
        body: &BodyBox,
    ) -> (Pose, Option<ConfidenceChange>) {
        let mut motion = self.settings.prior;
        let (mut is_by_clouds, mut is_placed) = (false, false);
        // By the other sensors, or by the cloud.
        let mut reckoned = prior[0].1;
        if let Sweep::Cloud(cloud, stamp) = &waiting.sweep {
            let revolution = Revolution {
                cloud,
                stamp: *stamp,
                base_from_sensor: *base_from_sensor,
                prior,
                motion,
                has_gravity: self.settings.has_gravity,
                is_stripe: self.collector.is_some(),
            };
            let pose = self.clouds.push(&revolution, |point| body.contains(point));
            reckoned = pose.odom_from_base;
            if self.settings.has_height {
                reckoned.translation.z = prior[0].1.translation.z;
            }
            is_by_clouds = pose.is_determined();
            is_placed = is_by_clouds || self.collector.is_some();
            if is_placed {
                motion = MotionPrior::Full;
            }
        }
        let level_from_base = in_space(&planar(&reckoned)).rotation.inverse() * reckoned.rotation;
        let (scan, base_from_sensor) = match &waiting.sweep {
            Sweep::Planar(scan) => seen_from_above(scan, base_from_sensor),
            Sweep::Cloud(cloud, _) => {
                // The vehicle with its roll and pitch, heading ahead.
                let level_from_sensor = level_from_base * base_from_sensor;
                let is_own = |point: &Point3<f64>| body.contains(&(base_from_sensor * point));
                let place = level_from_sensor.translation.vector.xy();
                let collector = self.collector.as_mut();
                let surroundings =
                    collector.map(|of| of.surroundings(cloud, waiting.stamp, &reckoned));
                let cloud = surroundings.as_ref().unwrap_or(cloud);
                let scan = walls(cloud, &level_from_sensor, is_own);
                (scan, Isometry2::new(place, 0.0))
            }
        };
        let prior_from_base = prior[0].1;
        let prior = planar(&reckoned);
        let input = ScanInput {
            stamp: waiting.stamp,
            scan: &scan,
            base_from_sensor,
            odom_from_base: (motion != MotionPrior::None).then_some(prior),
            is_heading_only: motion == MotionPrior::Heading,
            is_by_clouds,
            is_placed,
            base_from_antenna: self
                .settings
                .receiver
                .map_or_else(Point2::origin, |receiver| {
                    (level_from_base * receiver.antenna_in_base).xy().into()
                }),
        };
        let mut pose = self.slam.push(&input);
        if let Some(searched) = &mut self.searched
            && let Some(place) =
                searched.locate(&self.slam, &pose.local_from_base, &self.settings.slam)
        {
            let saved = &searched.continuation.saved;
            self.keyframes.clone_from(&saved.keyframes);
            self.slam = ScanSlam::resume(self.settings.slam, saved.map.clone(), &place);
            // Without one, the datum of this run is that of the map.
            self.plane = saved
                .datum
                .map(LocalTangentPlane::new)
                .or(self.plane.take());
            self.odom_from_local = pose.local_from_base;
            self.searched = None;
            self.is_corrected = true;
            pose = self.slam.push(&input);
        }
        let odom_from_base = self.odom_from_local * pose.local_from_base;
        if pose.keyframe as usize >= self.keyframes.len() {
            let new = Keyframe {
                session: self.session,
                stamp_ns: waiting.stamp.as_nanos(),
                odom_from_keyframe: odom_from_base * pose.keyframe_from_base.inverse(),
            };
            self.keyframes.resize(pose.keyframe as usize + 1, new);
            if pose.confidence == Confidence::Lost {
                let pieces = self.slam.map().pieces();
                self.begins_map |= pieces.last() == Some(&pose.keyframe);
                self.is_corrected |= self.begins_map;
            }
        }
        if self.covariances.len() >= MAX_COVARIANCES {
            let mut place = 0_u32;
            self.covariances.retain(|_| {
                place += 1;
                place % 2 == 1
            });
        }
        self.covariances.push((waiting.stamp, pose.covariance));
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
        let odom_from_reckoned = in_space(&(odom_from_base * prior.inverse()));
        let reckoned_from_prior = reckoned * prior_from_base.inverse();
        (odom_from_reckoned * reckoned_from_prior, change)
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
        MapFromOdom {
            steps: steps(&self.keyframes, self.slam.map()),
            session: self.session,
            begins_map: self.begins_map,
        }
    }

    /// The map so far, to go on in.
    pub(crate) fn saved(&self) -> SavedMap {
        SavedMap {
            map: self.slam.map().clone(),
            keyframes: self.keyframes.clone(),
            datum: self.plane.as_ref().map(LocalTangentPlane::datum),
        }
    }

    /// Fixes that were not used, by reason.
    pub(crate) const fn dropped_fixes(&self) -> &DropCounts {
        &self.report.dropped_fixes
    }

    /// Of the poses of the scans.
    pub(crate) fn covariances(&self) -> &[PoseCovariance] {
        &self.covariances
    }

    /// The newest closures: positions of the vehicle at both ends in the map, metres.
    pub(crate) fn newest_closures(&self, count: usize) -> Vec<[Point2<f64>; 2]> {
        let map = self.slam.map();
        let place = |at: u32| Point2::from(map.keyframes()[at as usize].translation.vector);
        let closures = map.edges().iter().rev().filter(|edge| edge.is_closure);
        let ends = closures.map(|edge| [edge.from, edge.to].map(place));
        ends.take(count).collect()
    }

    pub(crate) fn report(&self) -> ScanLocalizationReport {
        ScanLocalizationReport {
            closures: self.slam.closures(),
            positions: self.slam.positions(),
            is_searching: self.searched.is_some(),
            ..self.report.clone()
        }
    }
}

fn steps(keyframes: &[Keyframe], map: &SlamMap) -> Vec<Step> {
    let pieces = map.pieces();
    let keyframes = keyframes.iter().zip(map.keyframes()).zip(&pieces);
    let steps = keyframes.map(|((keyframe, map_from_keyframe), piece)| {
        let odom_from_keyframe = keyframe.odom_from_keyframe;
        let map_from_odom = in_space(&(map_from_keyframe * odom_from_keyframe.inverse()));
        Step {
            session: keyframe.session,
            begin: RobotTime::from_nanos(keyframe.stamp_ns),
            odom_from_keyframe: in_space(&odom_from_keyframe),
            map_from_odom: (Some(piece) == pieces.last()).then_some(map_from_odom),
        }
    });
    steps.collect()
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
