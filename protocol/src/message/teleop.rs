//! Messages of driving: status, commands and requests of operators, answers and refusals.
//!
//! [`Drive`], [`EStop`], [`Reset`], [`LeaseRequest`] and [`Setting`] are bodies of signed messages
//! ([`crate::signed`]), whose envelope has the token, the lease epoch and the sequence number.
//! Answers are unsigned.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::ShoreClass;
use crate::keys::OperatorId;

/// State of driving, in [`Status`](super::Status).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TeleopStatus {
    /// State of the vehicle.
    pub state: TeleopState,
    /// Reason of the last stop; `None` before the first.
    pub last_stop: Option<StopReason>,
    /// A boat without thrust, which nothing holds in place.
    pub is_drifting: bool,
    /// The lease.
    pub lease: LeaseStatus,
    /// Whether a key press would have an effect.
    pub arming: Arming,
    /// Upper bound of the age of the last command, ms; `None` without a command under this grant.
    pub age_ms: Option<u32>,
    /// Greatest age within the last second, ms.
    pub peak_age_ms: Option<u32>,
    /// Speed that this age allows, m/s, at most the vehicle's greatest.
    pub speed_allowed_mps: f32,
    /// Velocity in the last command.
    pub requested: Velocity,
    /// Velocity sent to the motors.
    pub applied: Velocity,
    /// Reason for a difference between the two: of several, the tightest; on the way to any limit,
    /// `Ramp`.
    pub clamp: Option<Clamp>,
    /// State of the collision monitor.
    pub collision_monitor: CollisionMonitorState,
    /// Emergency stop in force.
    pub estop: Option<EStopStatus>,
    /// Accepted and refused commands since the boot.
    pub counters: CommandCounters,
    /// Current settings.
    pub settings: Settings,
    /// The nearest obstacle or ground for which the collision monitor limits the requested motion;
    /// `None` without limit, or if it is off.
    pub barrier: Option<Barrier>,
    /// Age of the last observation of the ground just outside of the footprint, ms: ahead, left,
    /// behind, right; `None` if never observed, or if the collision monitor is off.
    pub ground_age_ms: [Option<u32>; 4],
    /// Voltage of the battery, volts; `None` if the motor controller does not report it.
    pub battery_v: Option<f32>,
    /// The docking site whose vegetation is no obstacle now, by the last command.
    pub docking: Option<DockingChoice>,
    /// Why the motors obey no velocity now.
    pub motor_hold: Option<MotorHold>,
    /// Goals for a planner on the vehicle.
    pub goal: GoalStatus,
}

/// State of the vehicle. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TeleopState {
    /// The self-test runs.
    SafeBoot,
    /// No lease.
    Idle,
    /// The lease is granted, and the vehicle is stationary.
    Held,
    /// The vehicle is driven.
    Driving,
    /// The vehicle brakes.
    Stopping(StopReason),
    /// Emergency stop, latched until a reset.
    EStop,
    /// Fault, latched until it is cleared at the vehicle.
    Fault(FaultReason),
}

/// Reason of a stop. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum StopReason {
    /// No key is pressed.
    Released,
    /// The last command is too old.
    Age,
    /// A command, or a planner's velocity, that is not finite.
    NotFinite,
    /// The data of the collision monitor is too old or missing.
    CollisionMonitorStale,
    /// The holder lost the lease.
    LeaseEnded(LeaseEnd),
    /// The motors obey no velocity.
    MotorsHeld,
    /// The planner of the goal sent no velocity for too long.
    PlannerSilent,
    /// The planner of the goal sent too many velocities.
    PlannerFloods,
}

impl StopReason {
    /// Whether the operator asked for it.
    pub const fn is_voluntary(self) -> bool {
        match self {
            Self::Released => true,
            Self::Age
            | Self::NotFinite
            | Self::CollisionMonitorStale
            | Self::MotorsHeld
            | Self::PlannerSilent
            | Self::PlannerFloods => false,
            Self::LeaseEnded(why) => match why {
                LeaseEnd::Released | LeaseEnd::Renewed | LeaseEnd::HandedOver | LeaseEnd::Reset => {
                    true
                }
                LeaseEnd::Expired | LeaseEnd::TakenOver | LeaseEnd::Revoked | LeaseEnd::Fault => {
                    false
                }
            },
        }
    }
}

/// Reason for the end of a lease. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum LeaseEnd {
    /// Released by the holder.
    Released,
    /// No command renewed it.
    Expired,
    /// Requested again by the holder, as by a restarted console.
    Renewed,
    /// Handed over by the holder.
    HandedOver,
    /// Taken over by a supervisor.
    TakenOver,
    /// The holder is no longer in the operator list.
    Revoked,
    /// An emergency stop was reset.
    Reset,
    /// The vehicle has a fault.
    Fault,
}

/// Reason of a fault. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum FaultReason {
    /// The self-test failed.
    SelfTest,
    /// The motors do not follow commands, or cannot be commanded.
    Actuator,
}

/// Why motors behind an autopilot obey no velocity. It ends by itself with its cause. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MotorHold {
    /// The link with the autopilot cannot be opened, or was lost.
    NoLink,
    /// The autopilot sends no heartbeat.
    NoHeartbeat,
    /// What sends heartbeats is no `ArduPilot` of a rover or boat.
    NotARover,
    /// Disarmed: arming is up to the vehicle.
    Disarmed,
    /// The autopilot is in another mode than GUIDED, by its number.
    Mode(u32),
    /// The autopilot has a failsafe in force.
    Failsafe,
}

impl fmt::Display for MotorHold {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::NoLink => "there is no link with the autopilot",
            Self::NoHeartbeat => "the autopilot sends no heartbeat",
            Self::NotARover => "the autopilot is no ArduPilot of a rover or boat",
            Self::Disarmed => "the autopilot is disarmed",
            Self::Failsafe => "the autopilot has a failsafe in force",
            Self::Mode(number) => {
                // ArduPilot, Rover/mode.h.
                let name = match number {
                    0 => "MANUAL",
                    1 => "ACRO",
                    3 => "STEERING",
                    4 => "HOLD",
                    5 => "LOITER",
                    6 => "FOLLOW",
                    7 => "SIMPLE",
                    8 => "DOCK",
                    9 => "CIRCLE",
                    10 => "AUTO",
                    11 => "RTL",
                    12 => "SMART_RTL",
                    16 => "INITIALISING",
                    _ => return write!(formatter, "the autopilot is in mode {number}, not GUIDED"),
                };
                return write!(formatter, "the autopilot is in mode {name}, not GUIDED");
            }
        })
    }
}

/// Goals for a planner on the vehicle, which drives under the lease of the operator who sets one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GoalStatus {
    /// Whether a planner is there that takes goals.
    pub has_planner: bool,
    /// The goal that the planner may drive to now.
    pub running: Option<MapPose>,
    /// Why the last goal ended; `None` before the first end.
    pub last_end: Option<GoalEnd>,
}

/// Why a goal ended. The planner alone knows whether it was reached: then it falls silent. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum GoalEnd {
    /// The operator drives.
    TakenOver,
    /// The operator's commands no longer name it.
    Cancelled,
    /// The operator lost the lease.
    LeaseEnded,
    /// The operator's last command is too old.
    Age,
    /// The planner sent no velocity for too long: it is there, or has failed.
    PlannerSilent,
    /// A velocity was not finite.
    NotFinite,
    /// Emergency stop.
    EStop,
    /// The data of the collision monitor is too old or missing.
    CollisionMonitorStale,
    /// The motors obey no velocity, or have a fault.
    Motors,
    /// The planner sent too many velocities.
    PlannerFloods,
}

impl GoalEnd {
    /// In wire order.
    pub const ALL: [Self; 10] = [
        Self::TakenOver,
        Self::Cancelled,
        Self::LeaseEnded,
        Self::Age,
        Self::PlannerSilent,
        Self::NotFinite,
        Self::EStop,
        Self::CollisionMonitorStale,
        Self::Motors,
        Self::PlannerFloods,
    ];
}

impl fmt::Display for GoalEnd {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::TakenOver => "the operator drives",
            Self::Cancelled => "cancelled",
            Self::LeaseEnded => "the lease ended",
            Self::Age => "the operator's last command is too old",
            Self::PlannerSilent => "the planner is silent: it is there, or it failed",
            Self::NotFinite => "a velocity is not a finite number",
            Self::EStop => "emergency stop",
            Self::CollisionMonitorStale => "the collision monitor cannot judge",
            Self::Motors => "the motors do not obey",
            Self::PlannerFloods => "the planner sends too many velocities",
        })
    }
}

/// State of the lease.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeaseStatus {
    /// Increases with every grant; 0 before the first.
    pub epoch: u64,
    /// Operator that holds the lease.
    pub holder: Option<OperatorId>,
    /// Operator that gets it when the vehicle is stationary.
    pub next: Option<OperatorId>,
    /// Operator that waits for the holder's consent.
    pub waiting: Option<OperatorId>,
}

/// State of arming: keys must be released before they have an effect. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Arming {
    /// Pressed keys have no effect until all are released.
    Locked,
    /// All keys are released.
    Neutral,
    /// A key was pressed after that.
    Pressed,
}

/// Velocity in `base_link`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Velocity {
    /// Along x, m/s, negative backwards.
    pub linear_mps: f32,
    /// Along y, m/s, positive to the left.
    pub lateral_mps: f32,
    /// About z, rad/s, positive to the left.
    pub angular_radps: f32,
}

/// Reason why the applied velocity differs from the requested one. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Clamp {
    /// Greatest speed of the vehicle.
    Speed,
    /// Limits of acceleration and jerk.
    Ramp,
    /// Age of commands.
    Age,
    /// The collision monitor.
    CollisionMonitor,
    /// The vehicle stops or must stay stationary.
    Stop,
    /// Locomotion modes: the vehicle stands while its wheels are set for another motion, or it cannot do a part of what
    /// is requested.
    Locomotion,
}

/// State of the collision monitor. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum CollisionMonitorState {
    /// No or too old output; the vehicle stops.
    Silent,
    /// Switched off by an operator.
    Off,
    /// Speed limits.
    On(SpeedLimits),
    /// Unknown space in the direction of travel: creeping speed.
    UnknownSpace(SpeedLimits),
    /// Its data is too old, and the configuration demands a stop.
    Stale,
}

/// Greatest speed in each direction, not negative; infinite without limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedLimits {
    /// m/s.
    pub forward_mps: f32,
    /// m/s, backwards.
    pub reverse_mps: f32,
    /// m/s along y; zero unless it goes or is to go sideways.
    pub left_mps: f32,
    /// m/s; zero as `left_mps`.
    pub right_mps: f32,
    /// rad/s.
    pub left_radps: f32,
    /// rad/s.
    pub right_radps: f32,
}

/// What limits the requested motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Barrier {
    /// Position in `odom`, metres.
    pub position_m: [f32; 2],
    /// Its kind.
    pub kind: BarrierKind,
}

/// Kind of a barrier. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum BarrierKind {
    /// Hit by a beam of the last sweeps.
    Detected,
    /// An obstacle on the map that no beam hits now.
    Mapped,
    /// Ground that was never observed, or too long ago.
    Unknown,
    /// Too shallow water, by a beam of the last sweeps.
    Shallow,
    /// Ground that is free only by beams without a return.
    NoReturn,
    /// A bumper touches it.
    Contact,
    /// Vegetation of the chosen docking site: creeping speed.
    Vegetation,
}

/// Emergency stop in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EStopStatus {
    /// Number, which a reset must contain.
    pub number: u64,
    /// Whether it is stored and survives a restart; required for a reset over the network.
    pub is_stored: bool,
}

/// Accepted and refused commands since the boot.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandCounters {
    /// Accepted commands of lease holders, including neutral ones.
    pub accepted: u64,
    /// Involuntary stops: the vehicle stopped although its operator did not ask for it.
    pub involuntary_stops: u64,
    /// Refused commands and requests, by ascending reason, each reason at most once.
    pub refused: Vec<RefusedCount>,
}

/// Number of refusals for a reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusedCount {
    /// The reason.
    pub reason: Refusal,
    /// Number of refusals.
    pub count: u64,
}

/// Current values of [`Setting`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// Budget for tiles, kbit/s.
    pub budget_kbps: u32,
    /// Whether the collision monitor is on.
    pub collision_monitor: bool,
    /// Whether a recording runs.
    pub recording: bool,
}

/// `op/<operator>/drive`: velocity by the pressed keys, once per iteration of the console's input
/// loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// Along x of `base_link`, m/s, negative backwards.
    pub linear_mps: f32,
    /// Along y of `base_link`, m/s, positive to the left.
    pub lateral_mps: f32,
    /// About z of `base_link`, rad/s, positive to the left.
    pub angular_radps: f32,
    /// Unacknowledged emergency stop, repeated here in case `estop` does not arrive.
    pub estop: Option<EStop>,
    /// The docking site into whose vegetation the operator steers on purpose, while it has this
    /// class.
    pub docking: Option<DockingChoice>,
    /// The goal that a planner on the vehicle is to drive to while nothing is pressed. It starts as a press does, after
    /// commands without goal and motion, and runs as long as each command names one.
    pub goal: Option<MapPose>,
}

/// A docking site in vegetation, as its driver knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct DockingChoice {
    /// Number of the site.
    pub site: u32,
    /// Its vegetation. If the robot calls it another class, the choice has no effect.
    pub vegetation: ShoreClass,
}

/// `op/<operator>/estop`: emergency stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EStop {
    /// Random number of this press, the same in all repetitions. It distinguishes a late repetition
    /// after a reset from a new press.
    pub press: u64,
}

/// `op/<operator>/reset`: reset of an emergency stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reset {
    /// Number of the emergency stop, from the status.
    pub estop: u64,
}

/// `op/<operator>/lease`: requests for the lease. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LeaseRequest {
    /// Request the lease. If another operator holds it, wait for consent.
    Request,
    /// Release it, or cancel a request.
    Release,
    /// Hand over to this waiting operator.
    HandOver(OperatorId),
    /// Refuse the request of this waiting operator.
    Refuse(OperatorId),
    /// Take over from the current holder; for supervisors.
    TakeOver,
}

/// `op/<operator>/set`: a setting. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Setting {
    /// Budget for tiles, kbit/s.
    BudgetKbps(u32),
    /// Collision monitor on or off.
    CollisionMonitor(bool),
    /// Recording on or off.
    Recording(bool),
    /// Save the map of matched scans under this name, which obeys the rules of names of robots.
    SaveMap(String),
    /// The vehicle is about at this pose in the saved map that it is searched for in.
    Locate(MapPose),
}

/// A pose in the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct MapPose {
    /// Millimetres.
    pub x_mm: i32,
    /// Millimetres.
    pub y_mm: i32,
    /// Counter-clockwise from x of the map, milliradians.
    pub yaw_mrad: i32,
}

/// Answer to `estop`, `reset`, `lease` and `set`. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Answer {
    /// Done.
    Done,
    /// The lease is granted; commands must contain this epoch.
    Granted(u64),
    /// The lease will be granted when the vehicle is stationary, or when its holder consents.
    Waiting,
    /// The vehicle is stopped, and the emergency stop with this number is stored.
    EStopped(u64),
    /// Refused.
    Refused(Refusal),
}

impl Drive {
    /// Velocities below this are neutral, m/s and rad/s.
    pub const NEUTRAL_BELOW: f32 = 1e-3;

    /// Whether the velocity is zero. NaN is not neutral.
    pub fn is_neutral(&self) -> bool {
        [self.linear_mps, self.lateral_mps, self.angular_radps]
            .iter()
            .all(|speed| speed.abs() < Self::NEUTRAL_BELOW)
    }
}

/// Reason why a command or request was refused. Append-only.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    thiserror::Error,
)]
pub enum Refusal {
    /// Not readable.
    #[error("it could not be read")]
    Malformed,
    /// More messages than one operator may send.
    #[error("there were too many a second")]
    TooMany,
    /// Not in the operator list.
    #[error("its sender is not in the operator list")]
    UnknownOperator,
    /// Invalid signature for this operator, key, robot and time.
    #[error("its signature is wrong")]
    Signature,
    /// Not allowed for the sender's role.
    #[error("the sender's role does not allow it")]
    Role,
    /// Token of another run, or of another robot.
    #[error("its token is from another run of the robot")]
    OtherBoot,
    /// Token that was never issued, or long ago.
    #[error("its token is not known")]
    UnknownToken,
    /// Token with a wrong nonce.
    #[error("its token's nonce is wrong")]
    WrongNonce,
    /// Older than commands may be.
    #[error("it is too old")]
    TooOld,
    /// The sender does not hold the lease.
    #[error("its sender does not hold the lease")]
    NotHolder,
    /// Another grant of the lease.
    #[error("it relies on another grant of the lease")]
    OtherEpoch,
    /// Sequence number not increasing: repeated or late.
    #[error("its sequence number does not grow")]
    OldSequence,
    /// Velocity that is not finite.
    #[error("its speed is not a finite number")]
    NotFinite,
    /// The robot's state does not allow it.
    #[error("the robot is not ready for it")]
    NotReady,
    /// Another request for the lease is waiting.
    #[error("another operator already waits for the lease")]
    Busy,
    /// No request for the lease, or of another operator.
    #[error("that operator does not wait for the lease")]
    NotWaiting,
    /// No emergency stop in force.
    #[error("there is no emergency stop")]
    NoEStop,
    /// Another emergency stop is in force.
    #[error("another emergency stop is active")]
    OtherEStop,
    /// The emergency stop is not stored yet.
    #[error("the emergency stop is not stored yet")]
    EStopNotStored,
    /// The reset was requested before the latest emergency stop was known.
    #[error("an emergency stop was requested since")]
    EStopSince,
    /// Value out of range.
    #[error("the value is out of range")]
    OutOfRange,
    /// Not supported by this robot.
    #[error("it is not available on this robot")]
    Unavailable,
}

impl Refusal {
    /// In wire order.
    pub const ALL: [Self; 22] = [
        Self::Malformed,
        Self::TooMany,
        Self::UnknownOperator,
        Self::Signature,
        Self::Role,
        Self::OtherBoot,
        Self::UnknownToken,
        Self::WrongNonce,
        Self::TooOld,
        Self::NotHolder,
        Self::OtherEpoch,
        Self::OldSequence,
        Self::NotFinite,
        Self::NotReady,
        Self::Busy,
        Self::NotWaiting,
        Self::NoEStop,
        Self::OtherEStop,
        Self::EStopNotStored,
        Self::EStopSince,
        Self::OutOfRange,
        Self::Unavailable,
    ];
}
