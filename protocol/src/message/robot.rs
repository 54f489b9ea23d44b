//! Messages about the robot: info, pose, status, events, sensors and recording.

use serde::{Deserialize, Serialize};

use crate::layer::LayerId;
use crate::message::teleop::TeleopStatus;

/// `info`: identity, layers and sensors of the robot. It rarely changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Info {
    /// Name of the vehicle's configuration.
    pub vehicle: String,
    /// Recording or simulated world; empty on a real vehicle.
    pub source: String,
    /// Extent along x and y, metres; its middle is [`Self::footprint_offset_m`] ahead of `base_link`.
    pub footprint_m: [f32; 2],
    /// Greatest speed along x and along y (0 where it cannot go sideways), m/s, and turn rate, rad/s.
    pub limits: [f32; 3],
    /// Enabled layers.
    pub layers: Vec<LayerInfo>,
    /// Number of changes since the boot; [`Status::info_revision`] has the newest.
    pub revision: u32,
    /// Version of the program.
    pub program: String,
    /// Whether it floats: without thrust it drifts.
    pub is_boat: bool,
    /// Deceleration without commands, m/s².
    pub stop_decel_mps2: f32,
    /// Angular deceleration without commands, rad/s².
    pub stop_decel_radps2: f32,
    /// Greatest age of a command that moves it, ms.
    pub max_command_age_ms: u32,
    /// Whether operators can start and stop recordings.
    pub can_record: bool,
    /// Sensors, at most [`MAX_SENSORS`].
    pub sensors: Vec<SensorInfo>,
    /// From `base_link`'s origin forward to the middle of the footprint, metres.
    pub footprint_offset_m: f32,
}

/// One layer of [`Info`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LayerInfo {
    /// The layer.
    pub layer: LayerId,
    /// Side of a cell, metres.
    pub cell_m: f64,
}

/// `pose`: pose of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position of `base_link` in `odom`, metres.
    pub position_m: [f64; 3],
    /// Orientation: x, y, z, w.
    pub quaternion_xyzw: [f32; 4],
    /// Along the vehicle's x axis, m/s, positive forward.
    pub speed_mps: f32,
    /// Along the vehicle's y axis, m/s, positive to the left; 0 for a vehicle that cannot go sideways on command.
    pub lateral_mps: f32,
    /// About the vehicle's z axis, rad/s, positive to the left.
    pub turn_rate_radps: f32,
    /// Newest token; `None` if the robot cannot be driven.
    pub token: Option<AgeToken>,
}

impl Pose {
    /// Speed over ground, m/s, negative backwards.
    pub fn ground_speed_mps(&self) -> f32 {
        let towards = if self.speed_mps < 0.0 { -1.0 } else { 1.0 };
        self.speed_mps.hypot(self.lateral_mps) * towards
    }
}

/// Measures the age of a command with the robot's clock only: a command carries the newest token
/// that its console has received, and the robot stores when it issued each token. The
/// [`boot`](crate::wire::Header::boot) of the message that carries a token is the run that issued
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct AgeToken {
    /// Number of the token in a boot, from 0.
    pub n: u64,
    /// Random, so that no token can be guessed before it is issued.
    #[serde(with = "postcard::fixint::le")]
    pub nonce: u64,
}

/// `status`: state of the robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Time of the data since the run began, nanoseconds.
    pub data_time_ns: i64,
    /// Received scans.
    pub scans_in: u64,
    /// Mapped scans.
    pub scans_mapped: u64,
    /// Drops by reason: scans, beams, and losses of the source.
    pub drops: Vec<DropCount>,
    /// Published tile messages, and their bytes.
    pub tiles: [u64; 2],
    /// Tiles in the queue.
    pub tiles_waiting: u32,
    /// Connected consoles.
    pub consoles: u16,
    /// Refused messages.
    pub refused: u64,
    /// Whether the source has ended.
    pub has_ended: bool,
    /// `None` if the robot cannot be driven.
    pub teleop: Option<TeleopStatus>,
    /// Current [`Info::revision`]: request `info` again if it is newer.
    pub info_revision: u32,
    /// State of the sensors, in the order of [`Info::sensors`].
    pub sensors: Vec<SensorStatus>,
    /// `None` if operators cannot record.
    pub recording: Option<RecordingStatus>,
    /// Of a boat: from its lowest point down to the highest part of the bed under it that the sonar measured in the
    /// last two minutes, metres; `None` if it measured none.
    pub depth_under_keel_m: Option<f32>,
    /// Devices that are read without a middleware, at most [`MAX_DEVICES`], in the order of their names.
    pub devices: Vec<DeviceStatus>,
}

/// Limit of the devices in one [`Status`].
pub const MAX_DEVICES: usize = 16;

/// Connection with one device, in [`Status`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceStatus {
    /// Its name in the vehicle's configuration.
    pub name: String,
    /// State of the connection.
    pub state: DeviceState,
    /// Why it does not measure; empty while it does.
    pub trouble: String,
    /// Which device it says it is; empty if it has not said it.
    pub identity: String,
    /// Measurements per second, over the last second.
    pub rate_hz: f32,
    /// Time since the last measurement; `None` before the first.
    pub age_ms: Option<u32>,
    /// Connections that ended after it had measured, since the boot.
    pub reconnects: u32,
    /// What was received and not used, since the boot.
    pub lost: u64,
    /// Its clock; `None` if it has none.
    pub clock: Option<DeviceClock>,
}

/// State of the connection with a device. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceState {
    /// The robot waits until it answers.
    Connecting,
    /// It answers, and is configured or starts to measure.
    Configuring,
    /// It measures.
    Measuring,
}

/// Clock of a device against that of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceClock {
    /// What is added to its time to give the robot's, seconds.
    pub offset_s: f64,
    /// Greatest delay of the last messages over the promptest one, seconds.
    pub spread_s: f32,
    /// How often it was set or started again, since the boot.
    pub resets: u32,
}

/// A count and what it counts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DropCount {
    /// Name of the reason, as in `--summary`.
    pub name: String,
    /// Number of drops.
    pub count: u64,
}

/// `localization`: how well the scans determine the pose, where scans are matched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Localization {
    /// How far the newest scan determines the pose.
    pub confidence: PoseConfidence,
    /// The vehicle was not found yet in the saved map that it goes on in.
    pub is_searching: bool,
    /// Covariance of the position in the map around it: xx, xy and yy, m².
    pub covariance_m2: [f32; 3],
    /// Standard deviation of the heading, radians.
    pub heading_sigma_rad: f32,
    /// Share of the scan's points that lie on surfaces of the map.
    pub inliers: f32,
    /// Root mean square of their distances from these surfaces, metres.
    pub residual_m: f32,
    /// Number of closures of loops, and of those that later evidence contradicted.
    pub closures: [u32; 2],
    /// The newest closures, at most [`MAX_CLOSURES`]: x and y of the vehicle at one end and at the other, metres. `None`: as
    /// before.
    pub closures_m: Option<Vec<[f32; 4]>>,
}

/// Limit of the closures in one message.
pub const MAX_CLOSURES: usize = 48;

/// How far a scan determines the pose. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PoseConfidence {
    /// In all directions.
    Determined,
    /// Not along one direction, as in a corridor.
    UncertainAlong,
    /// It does not fit the map: the pose is that of odometry.
    OdometryOnly,
    /// Not at all: nothing says where the vehicle is.
    Lost,
}

/// `plan`: the path of the planner to the goal, thinned.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Its points in the map, at most [`MAX_PLAN_POINTS`], millimetres; none where no goal runs.
    pub points_mm: Vec<[i32; 2]>,
}

/// Limit of the points in one [`Plan`].
pub const MAX_PLAN_POINTS: usize = 128;

/// `event`: an event.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// Kind, one word.
    pub kind: String,
    /// Its severity.
    pub severity: Severity,
    /// One sentence.
    pub message: String,
}

/// Severity of an event. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Severity {
    /// Information.
    Info,
    /// Something is wrong; no immediate action.
    Warning,
    /// Immediate attention needed.
    Alarm,
}

/// Answer to `ping`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pong;

/// Limit of the sensors of a robot.
pub const MAX_SENSORS: usize = 16;

/// One sensor of [`Info`](super::Info).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorInfo {
    /// Its name in the vehicle's configuration.
    pub name: String,
    /// Its type.
    pub kind: SensorKind,
    /// Mounting of a range sensor; of a tilting one at zero tilt.
    pub mount: Option<SensorMount>,
    /// Swept sector; `None` for other sensors, and while unknown.
    pub view: Option<FieldOfView>,
    /// Nominal rate, 1/s.
    pub rate_hz: Option<f32>,
}

/// Type of a sensor. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SensorKind {
    /// A laser that sweeps a plane of the vehicle.
    PlanarLaser,
    /// A laser that sweeps a plane and is tilted by a servo.
    TiltingLaser,
    /// A sonar that sweeps a plane.
    Sonar,
    /// Encoders on wheels.
    WheelEncoders,
    /// An attitude sensor.
    Attitude,
    /// A GNSS receiver.
    SatelliteReceiver,
    /// Odometry messages.
    Odometry,
    /// Transforms of the vehicle.
    Transforms,
    /// The encoder of a servo that tilts another sensor.
    TiltEncoder,
    /// An ultrasonic or infrared sensor that gives the nearest range in a cone.
    Ultrasonic,
    /// A bumper.
    Bumper,
    /// A three-dimensional lidar.
    Lidar,
}

/// Mounting of a sensor in `base_link`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorMount {
    /// Forward, left and up, metres.
    pub position_m: [f32; 3],
    /// Direction of its x axis in plan view, counter-clockwise from x of `base_link`.
    pub yaw_rad: f32,
}

/// Swept sector in plan view, about the sensor's x axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldOfView {
    /// Least and greatest angle, counter-clockwise.
    pub angles_rad: [f32; 2],
    /// Least and greatest range, metres.
    pub range_m: [f32; 2],
}

/// State of one sensor, in [`Status`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorStatus {
    /// Its name, as in [`SensorInfo`].
    pub name: String,
    /// Messages since the boot.
    pub messages: u64,
    /// Messages per second over the last 5 s, in a replay of the recording's time.
    pub rate_hz: f32,
    /// Time since the last message, in the same time; `None` before the first.
    pub age_ms: Option<u32>,
    /// Dropped measurements since the boot.
    pub dropped: u64,
    /// Fault; of several, the first in this list.
    pub fault: Option<SensorFault>,
}

/// Fault of a sensor. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SensorFault {
    /// No message for 1 s, or for five of its periods if these are longer; at first, for 3 s.
    Silent,
    /// Its stamps jumped against the receive time within the last 5 s.
    Clock,
    /// No valid measurement in the messages of the last second, or of its last three periods: it is
    /// covered or broken, or a receiver has no fix.
    AllInvalid,
    /// Less than half of its rate.
    Slow,
    /// Beams without return point at objects that returned beams within the last 5 s: the window
    /// seems blocked.
    Blocked,
}

/// State of the recording, in [`Status`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingStatus {
    /// Whether it runs, or the reason why not.
    pub state: RecordingState,
    /// Name of the current or last file, without its folder; empty before the first.
    pub file: String,
    /// Number of files; a file ends after a minute.
    pub files: u32,
    /// Duration of the current or last recording, s.
    pub duration_s: u32,
    /// Bytes of all its files.
    pub bytes: u64,
    /// Free bytes on its disk; `None` if unknown.
    pub free_bytes: Option<u64>,
    /// Measurements lost because the disk was too slow.
    pub lost: u64,
}

/// State of a recording. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RecordingState {
    /// Not started, or stopped by an operator.
    Stopped,
    /// Running.
    Recording,
    /// Ended or not started because the disk is nearly full.
    StoppedDiskLow,
    /// Ended by a write error.
    Failed,
}
