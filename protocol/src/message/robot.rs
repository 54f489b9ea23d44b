//! What a robot says of itself.

use serde::{Deserialize, Serialize};

use super::recording::RecordingStatus;
use super::sensors::{SensorInfo, SensorStatus};
use super::teleop::TeleopStatus;
use crate::layer::LayerId;

/// `info`: who the robot is, what it maps and what with. Rarely changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Name of the vehicle's configuration.
    pub vehicle: String,
    /// What it replays or simulates; empty on a real vehicle.
    pub source: String,
    /// Extent along x and y, metres; its middle is [`Self::footprint_offset_m`] ahead of `base_link`.
    pub footprint_m: [f32; 2],
    /// Greatest speed, m/s, and turn rate, rad/s.
    pub limits: [f32; 2],
    /// The layers it maps.
    pub layers: Vec<LayerInfo>,
    /// Counts what was found out since the boot; [`Status::info_revision`] tells of the newest.
    pub revision: u32,
    /// Version of the program that it runs.
    pub program: String,
    /// It floats: without thrust it drifts on.
    pub is_boat: bool,
    /// How hard it brakes when nobody tells it where to go any more, m/s².
    pub stop_decel_mps2: f32,
    /// The same of turning, rad/s².
    pub stop_decel_radps2: f32,
    /// The oldest command that moves it, ms.
    pub max_command_age_ms: u32,
    /// Whether operators can start and stop recordings.
    pub can_record: bool,
    /// What it measures with, at most [`MAX_SENSORS`](super::MAX_SENSORS).
    pub sensors: Vec<SensorInfo>,
    /// From `base_link`'s origin forward to the middle of the footprint, metres.
    pub footprint_offset_m: f32,
}

/// One layer of [`Info`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayerInfo {
    /// Which.
    pub layer: LayerId,
    /// Side of a cell, metres.
    pub cell_m: f64,
}

/// `pose`: where the vehicle is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position of `base_link` in `odom`, metres.
    pub position_m: [f64; 3],
    /// Orientation: x, y, z, w.
    pub quaternion_xyzw: [f32; 4],
    /// Speed along the vehicle's x axis, m/s: positive forward.
    pub speed_mps: f32,
    /// Turn rate about the vehicle's z axis, rad/s: positive to the left.
    pub turn_rate_radps: f32,
    /// The newest token; `None` where the robot cannot be driven.
    pub token: Option<AgeToken>,
}

/// How a robot knows the age of a command without trusting any clock but its own: a command carries the newest token
/// that its console has seen, and the robot remembers when it issued which. The run that issued it is the
/// [`boot`](crate::wire::Header::boot) of the message that brought it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct AgeToken {
    /// Counts the tokens of a boot, from 0.
    pub n: u64,
    /// Random, so that no token can be guessed before it is issued.
    #[serde(with = "postcard::fixint::le")]
    pub nonce: u64,
}

/// `status`: how the robot is doing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Time of the data since the run began, nanoseconds.
    pub data_time_ns: i64,
    /// Scans that came in.
    pub scans_in: u64,
    /// Scans that are in the map.
    pub scans_mapped: u64,
    /// What was dropped, by reason: scans, beams, and losses of the source.
    pub drops: Vec<DropCount>,
    /// Messages with tiles that were pushed, and their bytes.
    pub tiles: [u64; 2],
    /// Tiles that wait for their turn.
    pub tiles_waiting: u32,
    /// Consoles that look at the robot.
    pub consoles: u16,
    /// Messages that made no sense and were refused.
    pub refused: u64,
    /// The source has ended: nothing new will come.
    pub has_ended: bool,
    /// Driving; `None` where the robot cannot be driven.
    pub teleop: Option<TeleopStatus>,
    /// [`Info::revision`] as it is now: whoever holds an older one asks again.
    pub info_revision: u32,
    /// How the sensors are doing, in the order of [`Info::sensors`].
    pub sensors: Vec<SensorStatus>,
    /// The recording; `None` where operators cannot start one.
    pub recording: Option<RecordingStatus>,
}

/// A count and what it counts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DropCount {
    /// The reason's name, as in `--summary`.
    pub name: String,
    /// How often.
    pub count: u64,
}

/// `event`: something happened.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// What, in one word.
    pub kind: String,
    /// How much it matters.
    pub severity: Severity,
    /// What, in a sentence.
    pub message: String,
}

/// How much something matters to who watches. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Severity {
    /// Good to know.
    Info,
    /// Something is not as it should be; nothing has to be done at once.
    Warning,
    /// Somebody should look at it now.
    Alarm,
}

/// `ping`'s answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pong;
