//! Measurements in stamp order in, posed scans out: waits for poses, places beams, counts drops.

use std::collections::VecDeque;

use super::beam_projection::{BeamProjector, Footprint, SensorSettings};
use super::pose_track::Reach;
use super::transform_buffer::{Path, TransformBuffer};
use crate::drops::{DropCounts, DropReason};
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::{FrameId, Measurement, MeasurementData, OwnPose};
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::scan::Scan;

/// Where poses come from, decided before the first measurement.
#[derive(Clone, Debug, PartialEq, Eq)]
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
    /// Beams of the placed scans.
    pub beams_in: u64,
    /// Beams left out of placed scans, by reason.
    pub dropped_beams: DropCounts,
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
}

#[derive(Debug)]
struct WaitingScan {
    first_beam: RobotTime,
    last_beam: RobotTime,
    frame: FrameId,
    scan: Scan,
}

/// Name under which odometry's poses stand in the tree, whatever its messages call their frame.
const ODOMETRY_FRAME: &str = "odom";

impl BeamPlacer {
    /// With no poses yet.
    pub fn new(settings: PlacerSettings) -> Self {
        Self {
            tree: TransformBuffer::new(settings.reach),
            newest: RobotTime::MIN,
            waiting: VecDeque::new(),
            projector: BeamProjector::new(settings.sensor.clone(), settings.footprint),
            scans_in: 0,
            scans_placed: 0,
            dropped_scans: DropCounts::default(),
            settings,
        }
    }

    /// Takes one measurement; appends every scan that can be placed now to `out`.
    pub fn push(&mut self, measurement: Measurement, out: &mut Vec<PosedScan>) {
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
                    self.tree
                        .insert(&frame, &child, stamp, parent_from_child, is_static);
                }
            }
            MeasurementData::Odometry { odom_from_base, .. } => {
                if self.settings.origin == PoseOrigin::Odometry {
                    let base = &self.settings.base_frame;
                    self.tree
                        .insert(&ODOMETRY_FRAME.into(), base, stamp, odom_from_base, false);
                }
            }
            // Neither a pose nor a scan.
            MeasurementData::Imu(_)
            | MeasurementData::Joints(_)
            | MeasurementData::Fix(_)
            | MeasurementData::Twist(_)
            | MeasurementData::PointCloud(_) => {}
        }
        self.place_waiting(Self::is_ready, out);
        // Only now: behind a pause in the data, a scan that waited still needed its old pose.
        self.tree.forget_before(self.newest - self.settings.keep);
    }

    /// The data's clock started anew: places or drops what waits, then forgets all moving poses.
    pub fn reset_clock(&mut self, out: &mut Vec<PosedScan>) {
        self.finish(out);
        self.tree.forget_motion();
        self.newest = RobotTime::MIN;
    }

    /// The data ended: places what waits, or drops it.
    pub fn finish(&mut self, out: &mut Vec<PosedScan>) {
        self.place_waiting(|_, _| true, out);
    }

    /// What became of scans and beams so far.
    pub fn counts(&self) -> PlacerCounts {
        PlacerCounts {
            scans_in: self.scans_in,
            scans_placed: self.scans_placed,
            dropped_scans: self.dropped_scans.clone(),
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
        out: &mut Vec<PosedScan>,
    ) {
        self.scans_in += 1;
        let Some(sweep) = scan.sweep_duration() else {
            return self.dropped_scans.add(DropReason::BadScan);
        };
        let first_beam = stamp + self.settings.sensor.time_offset;
        let base_from_sensor = self.settings.sensor.base_from_sensor;
        let posed = match (&self.settings.origin, own_pose) {
            (
                PoseOrigin::Log,
                Some(OwnPose {
                    odom_from_base,
                    odom_from_sensor,
                }),
            ) => self
                .projector
                .project(&scan, first_beam, odom_from_base, |_| Ok(odom_from_sensor)),
            (PoseOrigin::Log, None) => Err(DropReason::NoPose),
            (PoseOrigin::Static, _) => {
                self.projector
                    .project(&scan, first_beam, Pose::identity(), |_| {
                        Ok(base_from_sensor)
                    })
            }
            (PoseOrigin::Tf { .. } | PoseOrigin::Odometry, _) => {
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

    fn settle(&mut self, posed: Result<PosedScan, DropReason>, out: &mut Vec<PosedScan>) {
        match posed {
            Ok(posed) => {
                self.scans_placed += 1;
                out.push(posed);
            }
            Err(reason) => self.dropped_scans.add(reason),
        }
    }

    fn place_waiting(
        &mut self,
        ready: impl Fn(&Self, &WaitingScan) -> bool,
        out: &mut Vec<PosedScan>,
    ) {
        while self.waiting.front().is_some_and(|scan| ready(self, scan)) {
            if let Some(scan) = self.waiting.pop_front() {
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
        PoseOrigin::Odometry | PoseOrigin::Log | PoseOrigin::Static => ODOMETRY_FRAME,
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
        | PoseOrigin::Log
        | PoseOrigin::Static => {
            let path = tree.path(fixed_frame, &settings.base_frame)?;
            Some((path, settings.sensor.base_from_sensor))
        }
    }
}

#[cfg(test)]
mod tests;
