//! Registers scans: takes measurements in stamp order, waits for poses, projects beams to `odom`, counts drops
//! (docs/methods.md, section 0).

mod pose_estimator;
pub(crate) mod scan_queue;
mod settings;

use std::sync::Arc;

use mapping::registered_scan::{RegisteredScan, ScanKind, SensorId};
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, OwnPose, StreamId};
use nalgebra::{Isometry2, Point2};
use protocol::geodesy::GeodeticPoint;

use crate::cloud_matching::scan_collector::{STRIPE, ScanCollector};
use crate::dead_reckoning::StampedPose;
use crate::pose_buffer::PoseJump;
use crate::registration::pose_estimator::{PoseEstimator, lag};
use crate::registration::scan_queue::{QueuedScan, ScanQueue, Sweep};
use crate::registration::settings::MATCHED_FRAME;
pub use crate::registration::settings::{
    MountOrigin, PoseOrigin, PoseStreams, RangeSensorSettings, RegistrationSettings,
};
use crate::scan_localization::{
    ConfidenceChange, MapFromOdom, PoseCovariance, SavedMap, ScanLocalization,
    ScanLocalizationReport, WaitingScan,
};
use crate::transform_buffer::{TransformBuffer, TransformChain};

/// Output of a [`ScanRegistration`], in the order of the data.
#[derive(Clone, Debug, PartialEq)]
pub enum RegistrationOutput {
    /// A registered scan.
    Scan(RegisteredScan),
    /// The poses jumped between the scans before and after it.
    Jump(PoseJump),
    /// A loop was closed: `odom` lies elsewhere in the map, for the scans before it, too.
    Corrected(Arc<MapFromOdom>),
    /// The poses from matched scans became more or less certain.
    Confidence(ConfidenceChange),
}

/// Places scans. A scan waits until there is a pose after its last beam, or until the stamps of the data
/// have passed it by `max_pose_wait`: time of the data only, never of a clock, so that any replay speed gives the
/// same map.
///
/// The scans of all sensors come out in the order of their first beams, time offsets applied; of equal ones in
/// the order of the sensors' ids as far as both wait. A scan therefore waits for an earlier one of another
/// sensor that has no pose yet (it too waits no longer than `max_pose_wait`), and for as long as a smaller time offset
/// could bring an earlier one; it never waits for a sensor that is silent. Each sensor has a queue of its
/// own, so that many scans of a fast one push out none of a slow one. A scan that is older than one that
/// came out already is late.
#[derive(Clone, Debug)]
pub struct ScanRegistration {
    settings: RegistrationSettings,
    tree: TransformBuffer,
    newest: RobotTime,
    /// First beam of the newest scan that left a queue.
    newest_out: RobotTime,
    sensors: Vec<ScanQueue>,
    pose_estimator: Option<PoseEstimator>,
    scan_localization: Option<Box<ScanLocalization>>,
    estimated_poses: Vec<StampedPose>,
    dropped_tilts: DropCounts,
    jumps: PendingJumps,
    /// Pose of the newest scan that has its own.
    last_own_pose: Option<StampedPose>,
}

/// Frame of the poses from odometry, wheels and fixes, whatever their messages name it.
pub const ODOMETRY_FRAME: &str = "odom";

impl ScanRegistration {
    /// With these settings.
    pub fn new(mut settings: RegistrationSettings) -> Self {
        let new = |sensor: &RangeSensorSettings| ScanQueue::new(sensor.clone(), settings.body);
        let mut sensors: Vec<_> = settings.sensors.iter().map(new).collect();
        let longest_hold = scan_queue::set_holds(&mut sensors);
        let tilts = settings.sensors.iter().filter_map(|s| s.tilt.as_ref());
        let lag = tilts.fold(lag(&settings.origin), |lag, tilt| lag.max(tilt.lag()));
        let lag = match &settings.origin {
            // Its last scan begins when the time is over.
            PoseOrigin::Scans { scans, .. } if scans.is_tilted => lag + STRIPE + STRIPE,
            _ => lag,
        };
        settings.max_pose_wait = settings.max_pose_wait + lag;
        settings.pose_history = settings.pose_history + lag + longest_hold;
        Self {
            tree: TransformBuffer::new(settings.limits),
            newest: RobotTime::MIN,
            newest_out: RobotTime::MIN,
            sensors,
            pose_estimator: PoseEstimator::of(settings.origin.prior(), settings.pose_streams),
            scan_localization: match &settings.origin {
                PoseOrigin::Scans { scans, .. } => {
                    let mut sensors = settings.sensors.iter();
                    let matched = sensors.find(|of| of.beams.id == scans.sensor);
                    let collector = matched
                        .filter(|_| scans.is_tilted)
                        .map(|of| ScanCollector::new(of.beams.clone(), settings.body));
                    let continuation = settings.continuation.clone();
                    let localization = ScanLocalization::new(scans, collector, continuation);
                    Some(Box::new(localization))
                }
                _ => None,
            },
            estimated_poses: Vec::new(),
            dropped_tilts: DropCounts::default(),
            jumps: PendingJumps::default(),
            last_own_pose: None,
            settings,
        }
    }

    /// Takes one measurement; appends every scan that can be registered now to `out`, and each pose
    /// jump before the first scan after it.
    pub fn push(&mut self, measurement: Measurement, out: &mut Vec<RegistrationOutput>) {
        if !measurement.is_static_transform() {
            self.newest = self.newest.max(measurement.stamp);
        }
        if let Some(pose_estimator) = &mut self.pose_estimator {
            pose_estimator.push(&measurement, &mut self.estimated_poses);
            self.take_estimated_poses();
        }
        let Measurement {
            stamp,
            stream,
            frame,
            data,
        } = measurement;
        match data {
            MeasurementData::Scan { scan, own_pose } => {
                if let Some(sensor) = self.sensor_of(stream, |kind| kind == ScanKind::Beams) {
                    let sweep = Sweep::Planar(scan);
                    self.take_scan(sensor, stamp, frame, sweep, own_pose, out);
                }
            }
            MeasurementData::Range(reading) => {
                if let Some(sensor) = self.sensor_of(stream, |kind| kind == ScanKind::Arc) {
                    let sweep = Sweep::Planar(reading.arc());
                    self.take_scan(sensor, stamp, frame, sweep, None, out);
                }
            }
            MeasurementData::Bool(is_pressed) => {
                let is_bumper = |kind| matches!(kind, ScanKind::Contact { .. });
                if let Some(sensor) = self.sensor_of(stream, is_bumper) {
                    let sweep = Sweep::Planar(contact(is_pressed));
                    self.take_scan(sensor, stamp, frame, sweep, None, out);
                }
            }
            MeasurementData::Transform {
                child,
                parent_from_child,
                is_static,
            } => {
                if self.takes_transform(&child) {
                    let jump =
                        self.tree
                            .insert(&frame, &child, stamp, parent_from_child, is_static);
                    self.jumps.extend(jump.map(|jump| (child, jump)));
                }
            }
            MeasurementData::Odometry { odom_from_base, .. } => {
                if *self.settings.origin.prior() == PoseOrigin::Odometry {
                    self.insert_odometry((stamp, odom_from_base));
                }
            }
            MeasurementData::Joints(joints) => self.tilt(stamp, stream, &joints),
            MeasurementData::Cloud(cloud) => {
                if let Some(sensor) = self.sensor_of(stream, |kind| kind == ScanKind::Cloud) {
                    let offset = self.sensors[sensor].settings.beams.time_offset;
                    let sweep = Sweep::Cloud(cloud, stamp + offset);
                    self.take_scan(sensor, stamp, frame, sweep, None, out);
                }
            }
            MeasurementData::Fix(fix) => {
                let own = self.settings.pose_streams.fixes;
                if let Some(scan_localization) = &mut self.scan_localization
                    && own.is_none_or(|own| own == stream)
                {
                    scan_localization.take_fix(stamp, &fix);
                }
            }
            // No scan; poses were taken above.
            MeasurementData::Imu(_) | MeasurementData::Twist(_) => {}
        }
        self.match_scans(false, out);
        self.register_queued(Self::is_ready, out);
        // After registration: after a pause in the data, a queued scan still needs its old pose.
        self.tree
            .forget_before(self.newest - self.settings.pose_history);
    }

    /// Clock reset: registers or drops the queued scans, then forgets all moving poses. The next
    /// pose is no jump.
    pub fn reset_clock(&mut self, out: &mut Vec<RegistrationOutput>) {
        self.finish(out);
        self.tree.clear_dynamic();
        if let Some(pose_estimator) = &mut self.pose_estimator {
            pose_estimator.reset();
        }
        if let Some(scan_localization) = &mut self.scan_localization {
            scan_localization.reset(self.settings.continuation.clone());
            self.emit_correction(out);
        }
        self.newest = RobotTime::MIN;
        self.newest_out = RobotTime::MIN;
        self.sensors.iter_mut().for_each(ScanQueue::reset_clock);
        self.last_own_pose = None;
    }

    /// End of the data: registers or drops the queued scans.
    pub fn finish(&mut self, out: &mut Vec<RegistrationOutput>) {
        if let Some(pose_estimator) = &mut self.pose_estimator {
            pose_estimator.finish(&mut self.estimated_poses);
            self.take_estimated_poses();
        }
        self.match_scans(true, out);
        self.register_queued(|_, _, _| true, out);
        let base_frame = FrameId::clone(&self.settings.base_frame);
        self.emit_jumps(RobotTime::MAX, &base_frame, out);
        if let Some(scan_localization) = &mut self.scan_localization {
            scan_localization.finish();
            self.emit_correction(out);
        }
    }

    /// Counts of scans and beams.
    pub fn counts(&self) -> RegistrationCounts {
        let mut counts = RegistrationCounts {
            dropped_poses: self.dropped_tilts.clone(),
            ..RegistrationCounts::default()
        };
        if let Some(pose_estimator) = &self.pose_estimator {
            counts.dropped_poses.merge(pose_estimator.drops());
        }
        if let Some(scan_localization) = &self.scan_localization {
            counts
                .dropped_poses
                .merge(scan_localization.dropped_fixes());
        }
        for sensor in &self.sensors {
            counts.add(sensor.counts());
        }
        counts
    }

    /// Origin of the map on Earth, if poses are made from GNSS fixes, or as soon as these say how the map of matched scans lies.
    pub fn datum(&self) -> Option<GeodeticPoint> {
        match &self.scan_localization {
            Some(scan_localization) => scan_localization.datum(),
            None => self.pose_estimator.as_ref()?.datum(),
        }
    }

    /// What scan matching did; `None` if scans are not matched.
    pub fn scan_localization(&self) -> Option<ScanLocalizationReport> {
        Some(self.scan_localization.as_ref()?.report())
    }

    /// Of the poses of matched scans, in the order of time.
    pub fn covariances(&self) -> &[PoseCovariance] {
        let scans = self.scan_localization.as_ref();
        scans.map_or(&[], |scans| scans.covariances())
    }

    /// The newest closures of loops: positions of the vehicle at both ends in the map, metres.
    pub fn newest_closures(&self, count: usize) -> Vec<[Point2<f64>; 2]> {
        let scans = self.scan_localization.as_ref();
        scans.map_or_else(Vec::new, |scans| scans.newest_closures(count))
    }

    /// Where `odom` lies in the map.
    pub fn map_from_odom(&self) -> MapFromOdom {
        let scans = self.scan_localization.as_ref();
        scans.map_or_else(MapFromOdom::default, |scans| scans.map_from_odom())
    }

    /// The map of the matched scans, to go on in; `None` if scans are not matched.
    pub fn saved_map(&self) -> Option<SavedMap> {
        Some(self.scan_localization.as_ref()?.saved())
    }

    /// The vehicle is about at this pose in the saved map that it is searched for in. Returns whether it is searched for.
    pub fn locate(&mut self, map_from_base: &Isometry2<f64>) -> bool {
        let scan_localization = self.scan_localization.as_mut();
        scan_localization.is_some_and(|scans| scans.locate(map_from_base))
    }

    /// While the vehicle is searched for in a saved map: where `odom` is supposed to lie there.
    pub fn supposed_map_from_odom(&self) -> Option<Pose> {
        self.scan_localization.as_ref()?.supposed_map_from_odom()
    }

    /// Newest pose of the vehicle; `None` before the first.
    pub fn newest_pose(&self) -> Option<StampedPose> {
        let settings = &self.settings;
        let chain = self
            .tree
            .chain(settings.fixed_frame(), &settings.base_frame)?;
        let stamp = chain.newest()?.min(self.newest);
        let pose = chain.sampler().pose_at(stamp).ok()?;
        Some((stamp, pose))
    }

    /// Pose of the vehicle at `stamp` by the source that scans are matched on, or that is used alone; `None` where it has none.
    pub fn prior_pose_at(&self, stamp: RobotTime) -> Option<Pose> {
        self.prior_chain()?.sampler().pose_at(stamp).ok()
    }

    fn sensor_of(&self, stream: StreamId, is_kind: impl Fn(ScanKind) -> bool) -> Option<usize> {
        let mut sensors = self.sensors.iter();
        sensors.position(|sensor| is_kind(sensor.kind()) && sensor.accepts(stream))
    }

    fn take_scan(
        &mut self,
        sensor: usize,
        stamp: RobotTime,
        frame: FrameId,
        sweep: Sweep,
        own_pose: Option<OwnPose>,
        out: &mut Vec<RegistrationOutput>,
    ) {
        let of = &mut self.sensors[sensor];
        let Some((first_beam, last_beam)) = of.beam_times(stamp, &sweep) else {
            return;
        };
        if let Some(scan_localization) = &mut self.scan_localization
            && scan_localization.settings.sensor == of.settings.beams.id
        {
            scan_localization.enqueue(WaitingScan {
                stamp: first_beam,
                known_at: match sweep {
                    Sweep::Planar(_) if !scan_localization.settings.is_tilted => first_beam,
                    _ => last_beam,
                },
                frame: FrameId::clone(&frame),
                sweep: sweep.clone(),
            });
        }
        if self.settings.origin != PoseOrigin::Log {
            let own_pose = own_pose.filter(|_| *self.settings.origin.prior() == PoseOrigin::Log);
            if let Some(own) = own_pose {
                of.settings.beams.base_from_sensor =
                    own.odom_from_base.inv_mul(&own.odom_from_sensor);
            }
            let waiting = QueuedScan {
                first_beam,
                last_beam,
                release_at: stamp + of.hold,
                frame,
                sweep,
            };
            of.enqueue(waiting, self.newest_out, self.settings.max_queued);
            if let Some(own) = own_pose {
                self.insert_odometry((first_beam, own.odom_from_base));
            }
            return;
        }
        // The scans of a log carry their poses.
        let registered = match own_pose {
            Some(OwnPose {
                odom_from_base,
                odom_from_sensor,
            }) => {
                let own_pose = (first_beam, odom_from_base);
                let before = self.last_own_pose.replace(own_pose);
                // Stamps that repeat say nothing of the speed: keyframes may lie a metre apart.
                let jump = before
                    .filter(|before| before.0 < first_beam)
                    .and_then(|before| self.settings.limits.jump.between(&before, &own_pose));
                out.extend(jump.map(RegistrationOutput::Jump));
                of.project(&sweep, first_beam, odom_from_base, |_| Ok(odom_from_sensor))
            }
            None => Err(DropReason::NoPose),
        };
        of.finish_scan(registered, out);
    }

    /// Takes the angles of tilting sensors.
    fn tilt(&mut self, stamp: RobotTime, stream: StreamId, joints: &[(String, f64)]) {
        for sensor in &self.sensors {
            let Some(tilt) = sensor
                .settings
                .tilt
                .as_ref()
                .filter(|t| t.uses_stream(stream))
            else {
                continue;
            };
            match tilt.pose(stamp, joints, &sensor.settings.beams.base_from_sensor) {
                Some(Ok((stamp, base_from_sensor))) => {
                    let (base, frame) = (&self.settings.base_frame, &sensor.tilted_frame);
                    // It turns in place, so it never jumps.
                    self.tree
                        .insert(base, frame, stamp, base_from_sensor, false);
                }
                Some(Err(reason)) => self.dropped_tilts.add(reason),
                None => {}
            }
        }
    }

    fn insert_odometry(&mut self, (stamp, odom_from_base): StampedPose) {
        let base = &self.settings.base_frame;
        let jump = self
            .tree
            .insert(&ODOMETRY_FRAME.into(), base, stamp, odom_from_base, false);
        self.jumps
            .extend(jump.map(|jump| (FrameId::clone(base), jump)));
    }

    fn take_estimated_poses(&mut self) {
        let mut estimated_poses = std::mem::take(&mut self.estimated_poses);
        for pose in estimated_poses.drain(..) {
            self.insert_odometry(pose);
        }
        self.estimated_poses = estimated_poses;
    }

    /// Whether a transform of a frame is one of the sensors' poses.
    fn takes_transform(&self, child: &FrameId) -> bool {
        let is_root = self.scan_localization.is_some() && **child == *self.settings.prior_frame();
        matches!(self.settings.origin.prior(), PoseOrigin::Tf { .. }) && !is_root
    }

    /// Matches the scans for which the other sensors' poses are known, or whose time has come; `is_end`: all.
    fn match_scans(&mut self, is_end: bool, out: &mut Vec<RegistrationOutput>) {
        let Some(mut scan_localization) = self.scan_localization.take() else {
            return;
        };
        let sensor = scan_localization.settings.sensor;
        while let Some(waiting) = scan_localization.waiting.front() {
            let newest = self
                .prior_chain()
                .and_then(|chain| chain.newest())
                .unwrap_or(RobotTime::MIN);
            let newest = match scan_localization.collector {
                Some(_) => self
                    .mount_chain(sensor, &waiting.frame)
                    .and_then(|(chain, _)| chain.newest())
                    .map_or(RobotTime::MIN, |angles| angles.min(newest)),
                None => newest,
            };
            let is_late = self.newest > waiting.known_at + self.settings.max_pose_wait;
            if !is_end && newest < waiting.known_at && !is_late {
                break;
            }
            let Some(waiting) = scan_localization.waiting.pop_front() else {
                break;
            };
            let collected = match &mut scan_localization.collector {
                Some(collector) => self.collect(collector, &waiting, sensor),
                None => Ok(Some(waiting)),
            };
            let matched = collected.and_then(|waiting| match waiting {
                Some(waiting) => self.match_scan(&mut scan_localization, &waiting, out),
                None => Ok(()),
            });
            if let Err(reason) = matched {
                scan_localization.count_dropped(reason);
            }
        }
        let collector = scan_localization.collector.as_mut();
        if let Some(stripe) = collector.filter(|_| is_end).and_then(ScanCollector::stripe)
            && let Err(reason) = self.match_scan(&mut scan_localization, &stripe, out)
        {
            scan_localization.count_dropped(reason);
        }
        self.scan_localization = Some(scan_localization);
    }

    /// Adds a scan to a stripe; returns the stripe if it is complete.
    fn collect(
        &self,
        collector: &mut ScanCollector,
        waiting: &WaitingScan,
        sensor: SensorId,
    ) -> Result<Option<WaitingScan>, DropReason> {
        let mount = self.mount_chain(sensor, &waiting.frame);
        let (chain, mount) = mount.ok_or(DropReason::NoPose)?;
        let mut sampler = chain.sampler();
        let base_from_sensor_at = |stamp| Ok(sampler.pose_at(stamp)? * mount);
        collector.push(waiting, base_from_sensor_at)?;
        Ok(collector
            .is_complete()
            .then(|| collector.stripe())
            .flatten())
    }

    /// Matches a scan, with `base_from_sensor` at its stamp and the vehicle's poses by the other sensors then and when it is matched.
    fn match_scan(
        &mut self,
        scan_localization: &mut ScanLocalization,
        waiting: &WaitingScan,
        out: &mut Vec<RegistrationOutput>,
    ) -> Result<(), DropReason> {
        let is_stripe = scan_localization.collector.is_some();
        let base_from_sensor = if is_stripe {
            Pose::identity()
        } else {
            let mount = self.mount_chain(scan_localization.settings.sensor, &waiting.frame);
            let (chain, mount) = mount.ok_or(DropReason::NoPose)?;
            chain.sampler().pose_at(waiting.stamp)? * mount
        };
        let chain = self.prior_chain().ok_or(DropReason::NoPose)?;
        let mut sampler = chain.sampler();
        let mut prior_at = |stamp| Ok((stamp, sampler.pose_at(stamp)?));
        let prior = [prior_at(waiting.stamp)?, prior_at(waiting.known_at)?];
        let body = &self.settings.body;
        let (odom_from_prior, change) =
            scan_localization.take(waiting, &base_from_sensor, prior, body);
        out.extend(change.map(RegistrationOutput::Confidence));
        let (matched_frame, prior_frame) =
            (MATCHED_FRAME.into(), self.settings.prior_frame().into());
        let chain = self.tree.chain(MATCHED_FRAME, &prior_frame);
        let is_first = chain.and_then(|chain| chain.newest()).is_none();
        // The scans of a stripe wait for its end, not for the next one.
        for (stamp, is_known) in [
            (waiting.stamp, is_first || !is_stripe),
            (waiting.known_at, is_stripe),
        ] {
            if is_known {
                self.tree
                    .insert(&matched_frame, &prior_frame, stamp, odom_from_prior, false);
            }
        }
        let corrected = scan_localization.take_correction();
        out.extend(corrected.map(|way| RegistrationOutput::Corrected(Arc::new(way))));
        Ok(())
    }

    fn emit_correction(&mut self, out: &mut Vec<RegistrationOutput>) {
        let scan_localization = self.scan_localization.as_mut();
        let corrected = scan_localization.and_then(|of| of.take_correction());
        out.extend(corrected.map(|way| RegistrationOutput::Corrected(Arc::new(way))));
    }

    /// The chain of the other sensors' poses.
    fn prior_chain(&self) -> Option<TransformChain<'_>> {
        let base = &self.settings.base_frame;
        self.tree.chain(self.settings.prior_frame(), base)
    }

    /// Chain from a sensor to the vehicle: `base_from_sensor = chain · mount`.
    fn mount_chain(&self, sensor: SensorId, frame: &FrameId) -> Option<(TransformChain<'_>, Pose)> {
        let mut sensors = self.sensors.iter();
        let of = sensors.find(|of| of.settings.beams.id == sensor)?;
        of.chain(&self.tree, &self.settings.base_frame, &self.settings, frame)
    }

    /// Emits the jumps up to `stamp` that moved the vehicle, or the sensor if the tree does not
    /// contain the vehicle.
    fn emit_jumps(
        &mut self,
        stamp: RobotTime,
        sensor_frame: &FrameId,
        out: &mut Vec<RegistrationOutput>,
    ) {
        let fixed_frame = self.settings.fixed_frame();
        for (frame, jump) in self.jumps.take_until(stamp) {
            let moves = |source| self.tree.is_between(fixed_frame, source, &frame);
            if moves(&self.settings.base_frame)
                .or_else(|| moves(sensor_frame))
                .unwrap_or(false)
            {
                out.push(RegistrationOutput::Jump(jump));
            }
        }
    }

    fn register_queued(
        &mut self,
        ready: impl Fn(&Self, usize, &QueuedScan) -> bool,
        out: &mut Vec<RegistrationOutput>,
    ) {
        while let Some((sensor, scan)) = self.next_queued()
            && ready(self, sensor, scan)
            && let Some(scan) = self.sensors[sensor].take_next()
        {
            self.newest_out = scan.first_beam;
            self.emit_jumps(scan.first_beam, &scan.frame, out);
            let registered = self.register(sensor, &scan);
            self.sensors[sensor].finish_scan(registered, out);
        }
    }

    /// The queued scan with the earliest first beam, and its sensor.
    fn next_queued(&self) -> Option<(usize, &QueuedScan)> {
        let heads = self.sensors.iter().enumerate();
        heads
            .filter_map(|(sensor, waiting)| Some((sensor, waiting.next()?)))
            .min_by_key(|(_, scan)| scan.first_beam)
    }

    fn is_ready(&self, sensor: usize, scan: &QueuedScan) -> bool {
        if self.newest < scan.release_at {
            return false;
        }
        let passed_by = |max_pose_wait| self.newest > scan.last_beam + max_pose_wait;
        let (fixed_frame, of) = (self.settings.fixed_frame(), &self.sensors[sensor]);
        let chain = of.chain(&self.tree, fixed_frame, &self.settings, &scan.frame);
        match chain.and_then(|(chain, _)| chain.newest()) {
            Some(newest) if newest > scan.last_beam => true,
            // Of equal stamps the later wins, so wait until no other can arrive.
            Some(newest) if newest == scan.last_beam => passed_by(RobotDuration::ZERO),
            Some(_) | None => passed_by(self.settings.max_pose_wait),
        }
    }

    fn register(&mut self, sensor: usize, scan: &QueuedScan) -> Result<RegisteredScan, DropReason> {
        let (tree, settings, of) = (&self.tree, &self.settings, &mut self.sensors[sensor]);
        let (chain, mount) = of
            .chain(tree, settings.fixed_frame(), settings, &scan.frame)
            .ok_or(DropReason::NoPose)?;
        let mut sampler = chain.sampler();
        let odom_from_base = match tree.chain(settings.fixed_frame(), &settings.base_frame) {
            Some(chain) => chain.sampler().pose_at(scan.first_beam)?,
            // Without a vehicle frame in the tree, the mounting gives its pose.
            None => {
                sampler.pose_at(scan.first_beam)?
                    * mount
                    * of.settings.beams.base_from_sensor.inverse()
            }
        };
        of.project(&scan.sweep, scan.first_beam, odom_from_base, |stamp| {
            Ok(sampler.pose_at(stamp)? * mount)
        })
    }
}

/// Points along a pressed bumper, so many that no cell between two is left out.
const CONTACT_POINTS: usize = 64;

/// The state of a bumper as that of a fixed-distance ranger (REP 117).
fn contact(is_pressed: bool) -> Scan {
    let range_m = if is_pressed {
        f32::NEG_INFINITY
    } else {
        f32::INFINITY
    };
    Scan {
        range_max_m: f32::MIN_POSITIVE,
        ranges_m: vec![range_m; CONTACT_POINTS],
        ..Scan::default()
    }
}

/// Counts of scans and beams.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RegistrationCounts {
    /// Received scans.
    pub scans_in: u64,
    /// Registered scans.
    pub scans_registered: u64,
    /// Dropped scans, by reason.
    pub dropped_scans: DropCounts,
    /// Dropped wheel angles, attitudes, fixes and tilt angles, by reason.
    pub dropped_poses: DropCounts,
    /// Beams of the registered scans.
    pub beams_in: u64,
    /// Dropped beams of registered scans, by reason.
    pub dropped_beams: DropCounts,
    /// Counts per range sensor, in the order of their ids.
    pub sensors: Vec<SensorCounts>,
}

/// Counts of one sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SensorCounts {
    /// The sensor.
    pub sensor: SensorId,
    /// Received scans.
    pub scans_in: u64,
    /// Registered scans.
    pub scans_registered: u64,
    /// Dropped scans, by reason.
    pub dropped_scans: DropCounts,
    /// Beams of the registered scans.
    pub beams_in: u64,
    /// Dropped beams of registered scans, by reason.
    pub dropped_beams: DropCounts,
}

impl RegistrationCounts {
    fn add(&mut self, sensor: SensorCounts) {
        self.scans_in += sensor.scans_in;
        self.scans_registered += sensor.scans_registered;
        self.dropped_scans.merge(&sensor.dropped_scans);
        self.beams_in += sensor.beams_in;
        self.dropped_beams.merge(&sensor.dropped_beams);
        self.sensors.push(sensor);
    }
}

/// Limit of pending jumps; further ones between two scans replace the newest.
const MAX_PENDING: usize = 64;

/// Jumps and the frames of their poses, in the order of arrival, that no scan has passed yet.
#[derive(Clone, Debug, Default)]
struct PendingJumps(Vec<(FrameId, PoseJump)>);

impl PendingJumps {
    /// Adds jumps; beyond the limit they replace the newest.
    fn extend(&mut self, jumps: impl IntoIterator<Item = (FrameId, PoseJump)>) {
        self.0.extend(jumps);
        if let Some(newest) = self.0.len().checked_sub(1)
            && newest >= MAX_PENDING
        {
            self.0.swap_remove(MAX_PENDING - 1);
        }
    }

    /// Takes those up to `stamp`, in stamp order.
    fn take_until(&mut self, stamp: RobotTime) -> Vec<(FrameId, PoseJump)> {
        let mut due: Vec<_> = self
            .0
            .extract_if(.., |(_, jump)| jump.stamp <= stamp)
            .collect();
        due.sort_by_key(|(_, jump)| jump.stamp);
        due
    }
}

#[cfg(test)]
mod tests;
