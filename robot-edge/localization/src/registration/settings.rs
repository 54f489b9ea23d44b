//! What placing needs to know, and what it counts.

use super::ODOMETRY_FRAME;
use crate::beam_projection::{BodyBox, SensorSettings};
use crate::dead_reckoning::DeadReckoningSettings;
use crate::gnss_positioning::GnssSettings;
use crate::pose_buffer::InterpolationLimits;
use crate::tilt::TiltSettings;
use mapping::registered_scan::SensorId;
use measurement::drops::DropCounts;
use measurement::time::RobotDuration;
use measurement::{FrameId, StreamId};

/// Where poses come from, decided before the first measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum PoseOrigin {
    /// Each scan carries its own.
    Log,
    /// The transform tree, up to this frame.
    Tf {
        /// Frame of the map.
        fixed_frame: FrameId,
    },
    /// Odometry messages.
    Odometry,
    /// Wheel encoders and an attitude sensor.
    Wheels(DeadReckoningSettings),
    /// Satellite fixes and an attitude sensor.
    Gps(GnssSettings),
    /// The vehicle stands still at the origin.
    Static,
}

/// Who says where a range sensor sits on the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MountOrigin {
    /// The transform tree, which reaches the sensor's own frame.
    Tree,
    /// The configuration; the tree reaches the vehicle only.
    Configured,
}

/// The streams that poses are taken from; where `None`, whatever stream gives such messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoseStreams {
    /// Angles of wheels.
    pub wheels: Option<StreamId>,
    /// Attitudes.
    pub attitude: Option<StreamId>,
    /// Satellite fixes.
    pub fixes: Option<StreamId>,
}

/// One range sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeSensorSettings {
    /// The stream of its scans; where `None`, every scan is its own.
    pub stream: Option<StreamId>,
    /// How its beams are read, and where it is mounted before it is tilted.
    pub beams: SensorSettings,
    /// Who says where it sits.
    pub mount: MountOrigin,
    /// The servo that tilts it, if its mounting is configured and it has one.
    pub tilt: Option<TiltSettings>,
}

/// All that placing needs to know.
#[derive(Clone, Debug)]
pub struct RegistrationSettings {
    /// Where poses come from.
    pub origin: PoseOrigin,
    /// The streams of the sensors that they are made of.
    pub pose_streams: PoseStreams,
    /// Frame of the vehicle in the transform tree.
    pub base_frame: FrameId,
    /// Limits of interpolation.
    pub limits: InterpolationLimits,
    /// How long poses are kept behind the newest stamp.
    pub pose_history: RobotDuration,
    /// How far stamps may pass a waiting scan.
    pub max_pose_wait: RobotDuration,
    /// Scans of one sensor that may wait at once; its oldest is dropped for the next.
    pub max_queued: usize,
    /// The range sensors, in the order of their ids.
    pub sensors: Vec<RangeSensorSettings>,
    /// The vehicle.
    pub body: BodyBox,
}

/// What became of scans and beams so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RegistrationCounts {
    /// Scans that came in.
    pub scans_in: u64,
    /// Scans placed.
    pub scans_registered: u64,
    /// Scans dropped, by reason.
    pub dropped_scans: DropCounts,
    /// Wheel angles, attitudes, fixes and angles of tilts left out, by reason.
    pub dropped_poses: DropCounts,
    /// Beams of the placed scans.
    pub beams_in: u64,
    /// Beams left out of placed scans, by reason.
    pub dropped_beams: DropCounts,
    /// The same of each range sensor, in the order of their ids.
    pub sensors: Vec<SensorCounts>,
}

/// What became of one sensor's scans and beams so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SensorCounts {
    /// Which sensor.
    pub sensor: SensorId,
    /// Scans that came in.
    pub scans_in: u64,
    /// Scans placed.
    pub scans_registered: u64,
    /// Scans dropped, by reason.
    pub dropped_scans: DropCounts,
    /// Beams of the placed scans.
    pub beams_in: u64,
    /// Beams left out of placed scans, by reason.
    pub dropped_beams: DropCounts,
}

impl RegistrationSettings {
    /// The frame that beams are placed in.
    pub(super) fn fixed_frame(&self) -> &str {
        match &self.origin {
            PoseOrigin::Tf { fixed_frame } => fixed_frame,
            // The vehicle stands where the map begins.
            PoseOrigin::Static => &self.base_frame,
            PoseOrigin::Odometry | PoseOrigin::Wheels(_) | PoseOrigin::Gps(_) | PoseOrigin::Log => {
                ODOMETRY_FRAME
            }
        }
    }
}

impl RegistrationCounts {
    pub(super) fn add(&mut self, sensor: SensorCounts) {
        self.scans_in += sensor.scans_in;
        self.scans_registered += sensor.scans_registered;
        self.dropped_scans.merge(&sensor.dropped_scans);
        self.beams_in += sensor.beams_in;
        self.dropped_beams.merge(&sensor.dropped_beams);
        self.sensors.push(sensor);
    }
}
