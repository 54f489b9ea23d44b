//! Measurements in stamp order in, posed scans out: waits for poses, places beams, counts drops.

use std::collections::VecDeque;

use self::jumps::WaitingJumps;
use super::beam_projection::BeamProjector;
use super::dead_reckoning::{DeadReckoning, StampedPose};
use super::pose_jump::PoseJump;
use super::transform_buffer::{Path, TransformBuffer};
use crate::drops::{DropCounts, DropReason};
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::{FrameId, Measurement, MeasurementData, OwnPose};
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::scan::Scan;

mod jumps;
mod settings;

pub use settings::{MountOrigin, PlacerCounts, PlacerSettings, PoseOrigin};

/// What comes out of a [`BeamPlacer`], in the order of the data.
#[derive(Clone, Debug, PartialEq)]
pub enum Placed {
    /// A scan.
    Scan(PosedScan),
    /// Between the scans before and those after it, the poses jumped.
    Jump(PoseJump),
}

/// Places scans. A scan waits until there is a pose after its last beam, or until the stamps of the data
/// have passed it by `wait`: time of the data only, never of a clock, so that any replay speed gives the
/// same map.
#[derive(Debug)]
pub struct BeamPlacer {
    settings: PlacerSettings,
    tree: TransformBuffer,
    newest: RobotTime,
    waiting: VecDeque<WaitingScan>,
    projector: BeamProjector,
    scans_in: u64,
    scans_placed: u64,
    dropped_scans: DropCounts,
    reckoning: Option<DeadReckoning>,
    reckoned: Vec<StampedPose>,
    jumps: WaitingJumps,
    newest_scan: RobotTime,
    /// Of scans that bring their own.
    last_own_pose: Option<StampedPose>,
}

#[derive(Debug)]
struct WaitingScan {
    first_beam: RobotTime,
    last_beam: RobotTime,
    frame: FrameId,
    scan: Scan,
}

/// Name under which poses of odometry and of wheels stand in the tree, whatever its messages call their frame.
pub const ODOMETRY_FRAME: &str = "odom";

impl BeamPlacer {
    /// With no poses yet.
    pub fn new(mut settings: PlacerSettings) -> Self {
        let reckoning = match &settings.origin {
            PoseOrigin::Wheels(sensors) => {
                settings.wait = settings.wait + sensors.lag();
                settings.keep = settings.keep + sensors.lag();
                Some(DeadReckoning::new(sensors.clone()))
            }
            PoseOrigin::Log | PoseOrigin::Tf { .. } | PoseOrigin::Odometry | PoseOrigin::Static => {
                None
            }
        };
        Self {
            tree: TransformBuffer::new(settings.reach),
            newest: RobotTime::MIN,
            waiting: VecDeque::new(),
            projector: BeamProjector::new(settings.sensor.clone(), settings.footprint),
            scans_in: 0,
            scans_placed: 0,
            dropped_scans: DropCounts::default(),
            reckoning,
            reckoned: Vec::new(),
            jumps: WaitingJumps::default(),
            newest_scan: RobotTime::MIN,
            last_own_pose: None,
            settings,
        }
    }

    /// Takes one measurement; appends every scan that can be placed now to `out`, and every jump of the
    /// poses ahead of the first scan behind it.
    pub fn push(&mut self, measurement: Measurement, out: &mut Vec<Placed>) {
        if !measurement.is_timeless() {
            self.newest = self.newest.max(measurement.stamp);
        }
        let Measurement {
            stamp, frame, data, ..
        } = measurement;
        match data {
            MeasurementData::Scan { scan, own_pose } => {
                self.take_scan(stamp, frame, scan, own_pose, out);
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
            MeasurementData::Imu(sample) => {
                if let Some(reckoning) = &mut self.reckoning {
                    reckoning.push_attitude(stamp, &sample, &mut self.reckoned);
                    self.take_reckoned();
                }
            }
            MeasurementData::Joints(joints) => {
                if let Some(reckoning) = &mut self.reckoning {
                    reckoning.push_joints(stamp, &joints, &mut self.reckoned);
                    self.take_reckoned();
                }
            }
            // Neither a pose nor a scan.
            MeasurementData::Fix(_)
            | MeasurementData::Twist(_)
            | MeasurementData::PointCloud(_) => {}
        }
        self.place_waiting(Self::is_ready, out);
        // Only now: behind a pause in the data, a scan that waited still needed its old pose.
        self.tree.forget_before(self.newest - self.settings.keep);
    }

    /// The data's clock started anew: places or drops what waits, then forgets all moving poses. The first
    /// pose after it may be anywhere: that is no jump.
    pub fn reset_clock(&mut self, out: &mut Vec<Placed>) {
        self.finish(out);
        self.tree.forget_motion();
        if let Some(reckoning) = &mut self.reckoning {
            reckoning.reset();
        }
        self.newest = RobotTime::MIN;
        self.newest_scan = RobotTime::MIN;
        self.last_own_pose = None;
    }

    /// The data ended: places what waits, or drops it.
    pub fn finish(&mut self, out: &mut Vec<Placed>) {
        if let Some(reckoning) = &mut self.reckoning {
            reckoning.finish(&mut self.reckoned);
            self.take_reckoned();
        }
        self.place_waiting(|_, _| true, out);
        let base_frame = FrameId::clone(&self.settings.base_frame);
        self.tell_jumps(RobotTime::MAX, &base_frame, out);
    }

    /// What became of scans and beams so far.
    pub fn counts(&self) -> PlacerCounts {
        PlacerCounts {
            scans_in: self.scans_in,
            scans_placed: self.scans_placed,
            dropped_scans: self.dropped_scans.clone(),
            dropped_poses: self
                .reckoning
                .as_ref()
                .map(|reckoning| reckoning.drops().clone())
                .unwrap_or_default(),
            beams_in: self.projector.beams_in(),
            dropped_beams: self.projector.dropped_beams().clone(),
        }
    }

    fn take_scan(
        &mut self,
        stamp: RobotTime,
        frame: FrameId,
        scan: Scan,
        own_pose: Option<OwnPose>,
        out: &mut Vec<Placed>,
    ) {
        self.scans_in += 1;
        let Some(sweep) = scan.sweep_duration() else {
            return self.dropped_scans.add(DropReason::BadScan);
        };
        let first_beam = stamp + self.settings.sensor.time_offset;
        let base_from_sensor = self.settings.sensor.base_from_sensor;
        // A log's scans bring their poses, so that it does not matter when they were.
        if self.settings.origin != PoseOrigin::Log {
            if first_beam < self.newest_scan {
                return self.dropped_scans.add(DropReason::Late);
            }
            self.newest_scan = first_beam;
        }
        let posed = match (&self.settings.origin, own_pose) {
            (
                PoseOrigin::Log,
                Some(OwnPose {
                    odom_from_base,
                    odom_from_sensor,
                }),
            ) => {
                let own_pose = (first_beam, odom_from_base);
                let before = self.last_own_pose.replace(own_pose);
                let jump =
                    before.and_then(|before| self.settings.reach.jump.between(&before, &own_pose));
                out.extend(jump.map(Placed::Jump));
                self.projector
                    .project(&scan, first_beam, odom_from_base, |_| Ok(odom_from_sensor))
            }
            (PoseOrigin::Log, None) => Err(DropReason::NoPose),
            (PoseOrigin::Static, _) => {
                self.projector
                    .project(&scan, first_beam, Pose::identity(), |_| {
                        Ok(base_from_sensor)
                    })
            }
            (PoseOrigin::Tf { .. } | PoseOrigin::Odometry | PoseOrigin::Wheels(_), _) => {
                let last_beam = first_beam + sweep;
                return self.wait(WaitingScan {
                    first_beam,
                    last_beam,
                    frame,
                    scan,
                });
            }
        };
        self.settle(posed, out);
    }

    fn wait(&mut self, scan: WaitingScan) {
        if self.waiting.len() >= self.settings.max_waiting.max(1) {
            self.waiting.pop_front();
            self.dropped_scans.add(DropReason::QueueFull);
        }
        self.waiting.push_back(scan);
    }

    fn insert_odometry(&mut self, (stamp, odom_from_base): StampedPose) {
        let base = &self.settings.base_frame;
        let jump = self
            .tree
            .insert(&ODOMETRY_FRAME.into(), base, stamp, odom_from_base, false);
        self.jumps
            .extend(jump.map(|jump| (FrameId::clone(base), jump)));
    }

    fn take_reckoned(&mut self) {
        let mut reckoned = std::mem::take(&mut self.reckoned);
        for pose in reckoned.drain(..) {
            self.insert_odometry(pose);
        }
        self.reckoned = reckoned;
    }

    /// Tells the jumps up to `stamp` that moved the vehicle, or the sensor where the tree does not know the
    /// vehicle.
    fn tell_jumps(&mut self, stamp: RobotTime, sensor_frame: &FrameId, out: &mut Vec<Placed>) {
        let fixed_frame = fixed_frame(&self.settings.origin);
        for (frame, jump) in self.jumps.take_until(stamp) {
            let moves = |source| self.tree.is_between(fixed_frame, source, &frame);
            if moves(&self.settings.base_frame)
                .or_else(|| moves(sensor_frame))
                .unwrap_or(false)
            {
                out.push(Placed::Jump(jump));
            }
        }
    }

    fn settle(&mut self, posed: Result<PosedScan, DropReason>, out: &mut Vec<Placed>) {
        match posed {
            Ok(posed) => {
                self.scans_placed += 1;
                out.push(Placed::Scan(posed));
            }
            Err(reason) => self.dropped_scans.add(reason),
        }
    }

    fn place_waiting(
        &mut self,
        ready: impl Fn(&Self, &WaitingScan) -> bool,
        out: &mut Vec<Placed>,
    ) {
        while self.waiting.front().is_some_and(|scan| ready(self, scan)) {
            if let Some(scan) = self.waiting.pop_front() {
                self.tell_jumps(scan.first_beam, &scan.frame, out);
                let posed = self.place_from_tree(&scan);
                self.settle(posed, out);
            }
        }
    }

    fn is_ready(&self, scan: &WaitingScan) -> bool {
        let passed_by = |wait| self.newest > scan.last_beam + wait;
        match self
            .sensor_path(&scan.frame)
            .and_then(|(path, _)| path.newest())
        {
            Some(newest) if newest > scan.last_beam => true,
            // Of equal stamps the later wins, so wait until no other can come.
            Some(newest) if newest == scan.last_beam => passed_by(RobotDuration::ZERO),
            Some(_) | None => passed_by(self.settings.wait),
        }
    }

    fn place_from_tree(&mut self, scan: &WaitingScan) -> Result<PosedScan, DropReason> {
        let fixed_frame = fixed_frame(&self.settings.origin);
        let tree = &self.tree;
        let (path, mount) = sensor_path(tree, fixed_frame, &scan.frame, &self.settings)
            .ok_or(DropReason::NoPose)?;
        let mut sensor = path.sampler();
        let odom_from_base = match tree.path(fixed_frame, &self.settings.base_frame) {
            Some(path) => path.sampler().pose_at(scan.first_beam)?,
            // The tree has no frame for the vehicle: the mounting says where it is.
            None => {
                sensor.pose_at(scan.first_beam)?
                    * mount
                    * self.settings.sensor.base_from_sensor.inverse()
            }
        };
        self.projector
            .project(&scan.scan, scan.first_beam, odom_from_base, |stamp| {
                Ok(sensor.pose_at(stamp)? * mount)
            })
    }

    fn sensor_path(&self, sensor_frame: &FrameId) -> Option<(Path<'_>, Pose)> {
        let fixed_frame = fixed_frame(&self.settings.origin);
        sensor_path(&self.tree, fixed_frame, sensor_frame, &self.settings)
    }
}

fn fixed_frame(origin: &PoseOrigin) -> &str {
    match origin {
        PoseOrigin::Tf { fixed_frame, .. } => fixed_frame,
        PoseOrigin::Odometry | PoseOrigin::Wheels(_) | PoseOrigin::Log | PoseOrigin::Static => {
            ODOMETRY_FRAME
        }
    }
}

/// The way from the sensor to the map: `fixed_from_sensor = path · mount`, where the mounting is the identity
/// if the tree reaches the sensor.
fn sensor_path<'a>(
    tree: &'a TransformBuffer,
    fixed_frame: &str,
    sensor_frame: &FrameId,
    settings: &PlacerSettings,
) -> Option<(Path<'a>, Pose)> {
    match settings.origin {
        PoseOrigin::Tf {
            mount: MountOrigin::Tree,
            ..
        } => Some((tree.path(fixed_frame, sensor_frame)?, Pose::identity())),
        PoseOrigin::Tf {
            mount: MountOrigin::Configured,
            ..
        }
        | PoseOrigin::Odometry
        | PoseOrigin::Wheels(_)
        | PoseOrigin::Log
        | PoseOrigin::Static => {
            let path = tree.path(fixed_frame, &settings.base_frame)?;
            Some((path, settings.sensor.base_from_sensor))
        }
    }
}

#[cfg(test)]
mod tests;
