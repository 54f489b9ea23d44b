//! What is decided before the first measurement.

use measurement::time::RobotDuration;
use measurement::{FrameId, StreamId};

use super::ODOMETRY_FRAME;
use crate::attitude::AttitudeSettings;
use crate::beam_projection::{BodyBox, SensorSettings};
use crate::dead_reckoning::DeadReckoningSettings;
use crate::gnss_positioning::GnssSettings;
use crate::pose_buffer::InterpolationLimits;
use crate::scan_localization::{Continuation, ScanLocalizationSettings};
use crate::tilt::TiltSettings;

/// `odom` where scans are matched: the frame of the other sensors' poses moves in it. Frames of recordings never begin with a slash.
pub(super) const MATCHED_FRAME: &str = "/odom of matched scans";

/// Source of poses, decided before the first measurement.
#[derive(Clone, Debug, PartialEq)]
pub enum PoseOrigin {
    /// Each scan carries its own.
    Log,
    /// The transform tree.
    Tf {
        /// Frame of the map.
        fixed_frame: FrameId,
    },
    /// Odometry messages.
    Odometry,
    /// Wheel encoders and an attitude sensor.
    Wheels(DeadReckoningSettings),
    /// GNSS fixes and an attitude sensor.
    Gps(GnssSettings),
    /// An attitude sensor alone: the vehicle turns at the origin.
    Attitude(AttitudeSettings),
    /// The vehicle stays at the origin.
    Static,
    /// Scans are matched, and loops are closed.
    Scans {
        /// Source of what is known besides; [`Self::Static`] if nothing is.
        prior: Box<PoseOrigin>,
        /// Settings of scan matching.
        scans: Box<ScanLocalizationSettings>,
    },
}

impl PoseOrigin {
    /// Source of the poses that scans are matched on; itself if none are.
    pub fn prior(&self) -> &Self {
        match self {
            Self::Scans { prior, .. } => prior,
            own => own,
        }
    }

    fn frame<'a>(&'a self, base_frame: &'a FrameId) -> &'a str {
        match self {
            Self::Scans { .. } => MATCHED_FRAME,
            Self::Tf { fixed_frame } => fixed_frame,
            // The vehicle stays at the origin of the map.
            Self::Static => base_frame,
            Self::Odometry | Self::Wheels(_) | Self::Gps(_) | Self::Attitude(_) | Self::Log => {
                ODOMETRY_FRAME
            }
        }
    }
}

/// Source of a range sensor's mounting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MountOrigin {
    /// The transform tree contains the sensor's frame.
    Tree,
    /// The configuration; the tree ends at the vehicle.
    Configured,
}

/// Streams for poses; `None` accepts any stream.
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
    /// Stream of its scans; `None` accepts every scan.
    pub stream: Option<StreamId>,
    /// Range limits, and the mounting before it is tilted.
    pub beams: SensorSettings,
    /// Source of the mounting.
    pub mount: MountOrigin,
    /// The servo that tilts it; only with a configured mounting.
    pub tilt: Option<TiltSettings>,
}

/// Settings of [`ScanRegistration`](super::ScanRegistration).
#[derive(Clone, Debug)]
pub struct RegistrationSettings {
    /// Source of poses.
    pub origin: PoseOrigin,
    /// Streams of the pose sensors.
    pub pose_streams: PoseStreams,
    /// Frame of the vehicle in the transform tree.
    pub base_frame: FrameId,
    /// Limits of interpolation.
    pub limits: InterpolationLimits,
    /// Time that poses are kept behind the newest stamp.
    pub pose_history: RobotDuration,
    /// Time that a scan waits for a pose after its last beam.
    pub max_pose_wait: RobotDuration,
    /// Limit of queued scans per sensor; beyond it the oldest is dropped.
    pub max_queued: usize,
    /// Range sensors, in the order of their ids.
    pub sensors: Vec<RangeSensorSettings>,
    /// Box of the vehicle.
    pub body: BodyBox,
    /// The map that matched scans go on in.
    pub continuation: Option<Continuation>,
}

impl RegistrationSettings {
    pub(super) fn fixed_frame(&self) -> &str {
        self.origin.frame(&self.base_frame)
    }

    /// Frame of the poses that scans are matched on.
    pub(super) fn prior_frame(&self) -> &str {
        self.origin.prior().frame(&self.base_frame)
    }
}
