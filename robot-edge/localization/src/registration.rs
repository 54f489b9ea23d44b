//! Measurements in stamp order in, posed scans out: waits for poses, places beams, counts drops.

use self::pending_jumps::PendingJumps;
use self::pose_estimator::PoseEstimator;
use self::scan_queue::{QueuedScan, ScanQueue};
use super::dead_reckoning::StampedPose;
use super::geodesy::GeodeticPoint;
use super::pose_jump::PoseJump;
use super::transform_buffer::TransformBuffer;
use mapping::registered_scan::RegisteredScan;
use measurement::drops::{DropCounts, DropReason};
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, OwnPose, StreamId};

mod pending_jumps;
mod pose_estimator;
mod scan_queue;
mod settings;

pub use settings::{
    MountOrigin, PoseOrigin, PoseStreams, RangeSensorSettings, RegistrationCounts,
    RegistrationSettings, SensorCounts,
};

/// What comes out of a [`ScanRegistration`], in the order of the data.
#[derive(Clone, Debug, PartialEq)]
pub enum RegistrationOutput {
    /// A scan.
    Scan(RegisteredScan),
    /// Between the scans before and those after it, the poses jumped.
    Jump(PoseJump),
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
    /// First beam of the newest scan that came out of a queue.
    newest_out: RobotTime,
    sensors: Vec<ScanQueue>,
    pose_estimator: Option<PoseEstimator>,
    estimated_poses: Vec<StampedPose>,
    /// Angles of tilts that were left out.
    dropped_tilts: DropCounts,
    jumps: PendingJumps,
    /// Of scans that bring their own.
    last_own_pose: Option<StampedPose>,
}

/// Name under which poses of odometry, of wheels and of fixes stand in the tree, whatever their messages call
/// their frame.
pub const ODOMETRY_FRAME: &str = "odom";

impl ScanRegistration {
    /// With no poses yet.
    pub fn new(mut settings: RegistrationSettings) -> Self {
        let new = |sensor: &RangeSensorSettings| ScanQueue::new(sensor.clone(), settings.body);
        let mut sensors: Vec<_> = settings.sensors.iter().map(new).collect();
        let longest_hold = scan_queue::set_holds(&mut sensors);
        let tilts = settings.sensors.iter().filter_map(|s| s.tilt.as_ref());
        let lag = tilts.fold(pose_estimator::lag(&settings.origin), |lag, tilt| {
            lag.max(tilt.lag())
        });
        settings.max_pose_wait = settings.max_pose_wait + lag;
        settings.pose_history = settings.pose_history + lag + longest_hold;
        Self {
            tree: TransformBuffer::new(settings.limits),
            newest: RobotTime::MIN,
            newest_out: RobotTime::MIN,
            sensors,
            pose_estimator: PoseEstimator::of(&settings.origin, settings.pose_streams),
            estimated_poses: Vec::new(),
            dropped_tilts: DropCounts::default(),
            jumps: PendingJumps::default(),
            last_own_pose: None,
            settings,
        }
    }

    /// Takes one measurement; appends every scan that can be placed now to `out`, and every jump of the
    /// poses ahead of the first scan behind it.
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
                if let Some(sensor) = self.sensors.iter().position(|s| s.accepts(stream)) {
                    self.take_scan(sensor, stamp, frame, scan, own_pose, out);
                }
            }
            MeasurementData::Transform {
                child,
                parent_from_child,
                is_static,
            } => {
                if matches!(self.settings.origin, PoseOrigin::Tf { .. }) {
                    let jump =
                        self.tree
                            .insert(&frame, &child, stamp, parent_from_child, is_static);
                    self.jumps.extend(jump.map(|jump| (child, jump)));
                }
            }
            MeasurementData::Odometry { odom_from_base, .. } => {
                if self.settings.origin == PoseOrigin::Odometry {
                    self.insert_odometry((stamp, odom_from_base));
                }
            }
            MeasurementData::Joints(joints) => self.tilt(stamp, stream, &joints),
            // No scan, and if a pose, taken already.
            MeasurementData::Imu(_)
            | MeasurementData::Fix(_)
            | MeasurementData::Twist(_)
            | MeasurementData::PointCloud(_) => {}
        }
        self.register_queued(Self::is_ready, out);
        // Only now: behind a pause in the data, a scan that waited still needed its old pose.
        self.tree
            .forget_before(self.newest - self.settings.pose_history);
    }

    /// The data's clock started anew: places or drops what waits, then forgets all moving poses. The first
    /// pose after it may be anywhere: that is no jump.
    pub fn reset_clock(&mut self, out: &mut Vec<RegistrationOutput>) {
        self.finish(out);
        self.tree.clear_dynamic();
        if let Some(pose_estimator) = &mut self.pose_estimator {
            pose_estimator.reset();
        }
        self.newest = RobotTime::MIN;
        self.newest_out = RobotTime::MIN;
        self.sensors.iter_mut().for_each(ScanQueue::reset_clock);
        self.last_own_pose = None;
    }

    /// The data ended: places what waits, or drops it.
    pub fn finish(&mut self, out: &mut Vec<RegistrationOutput>) {
        if let Some(pose_estimator) = &mut self.pose_estimator {
            pose_estimator.finish(&mut self.estimated_poses);
            self.take_estimated_poses();
        }
        self.register_queued(|_, _, _| true, out);
        let base_frame = FrameId::clone(&self.settings.base_frame);
        self.emit_jumps(RobotTime::MAX, &base_frame, out);
    }

    /// What became of scans and beams so far.
    pub fn counts(&self) -> RegistrationCounts {
        let mut counts = RegistrationCounts {
            dropped_poses: self.dropped_tilts.clone(),
            ..RegistrationCounts::default()
        };
        if let Some(pose_estimator) = &self.pose_estimator {
            counts.dropped_poses.merge(pose_estimator.drops());
        }
        for sensor in &self.sensors {
            counts.add(sensor.counts());
        }
        counts
    }

    /// Where the origin of `odom` lies on Earth: the first satellite fix, where poses are made of fixes.
    pub fn datum(&self) -> Option<GeodeticPoint> {
        self.pose_estimator.as_ref()?.datum()
    }

    /// Where the vehicle is, as far as poses have come; `None` before the first and where only scans bring them.
    pub fn newest_pose(&self) -> Option<StampedPose> {
        let settings = &self.settings;
        let chain = self
            .tree
            .chain(settings.fixed_frame(), &settings.base_frame)?;
        let stamp = chain.newest()?.min(self.newest);
        let pose = chain.sampler().pose_at(stamp).ok()?;
        Some((stamp, pose))
    }

    fn take_scan(
        &mut self,
        sensor: usize,
        stamp: RobotTime,
        frame: FrameId,
        scan: Scan,
        own_pose: Option<OwnPose>,
        out: &mut Vec<RegistrationOutput>,
    ) {
        let of = &mut self.sensors[sensor];
        let Some((first_beam, last_beam)) = of.beam_times(stamp, &scan) else {
            return;
        };
        if self.settings.origin != PoseOrigin::Log {
            let waiting = QueuedScan {
                first_beam,
                last_beam,
                release_at: stamp + of.hold,
                frame,
                scan,
            };
            return of.enqueue(waiting, self.newest_out, self.settings.max_queued);
        }
        // A log's scans bring their poses, so that it does not matter when they were.
        let registered = match own_pose {
            Some(OwnPose {
                odom_from_base,
                odom_from_sensor,
            }) => {
                let own_pose = (first_beam, odom_from_base);
                let before = self.last_own_pose.replace(own_pose);
                let jump =
                    before.and_then(|before| self.settings.limits.jump.between(&before, &own_pose));
                out.extend(jump.map(RegistrationOutput::Jump));
                of.projector
                    .project(&scan, first_beam, odom_from_base, |_| Ok(odom_from_sensor))
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
                    // It turns where it is, and so it never jumps.
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

    /// Tells the jumps up to `stamp` that moved the vehicle, or the sensor where the tree does not know the
    /// vehicle.
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

    /// Of the scans that wait, the one whose first beam was first, and its sensor.
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
        let chain = self.sensors[sensor].chain(&self.tree, &self.settings, &scan.frame);
        match chain.and_then(|(chain, _)| chain.newest()) {
            Some(newest) if newest > scan.last_beam => true,
            // Of equal stamps the later wins, so wait until no other can come.
            Some(newest) if newest == scan.last_beam => passed_by(RobotDuration::ZERO),
            Some(_) | None => passed_by(self.settings.max_pose_wait),
        }
    }

    fn register(&mut self, sensor: usize, scan: &QueuedScan) -> Result<RegisteredScan, DropReason> {
        let (tree, settings, of) = (&self.tree, &self.settings, &mut self.sensors[sensor]);
        let (chain, mount) = of
            .chain(tree, settings, &scan.frame)
            .ok_or(DropReason::NoPose)?;
        let mut sampler = chain.sampler();
        let odom_from_base = match tree.chain(settings.fixed_frame(), &settings.base_frame) {
            Some(chain) => chain.sampler().pose_at(scan.first_beam)?,
            // The tree has no frame for the vehicle: the mounting says where it is.
            None => {
                sampler.pose_at(scan.first_beam)?
                    * mount
                    * of.settings.beams.base_from_sensor.inverse()
            }
        };
        of.projector
            .project(&scan.scan, scan.first_beam, odom_from_base, |stamp| {
                Ok(sampler.pose_at(stamp)? * mount)
            })
    }
}

#[cfg(test)]
mod tests;
