//! What everybody must see of driving: who drives, how old commands are, what is asked, what is done and why the two
//! differ.

use serde::{Deserialize, Serialize};

use super::refusal::Refusal;
use crate::name::OperatorId;

/// Driving, as it is at the moment of a [`Status`](super::Status).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TeleopStatus {
    /// What the vehicle is doing.
    pub state: TeleopState,
    /// Why it stopped last; `None` before the first time.
    pub last_stop: Option<StopReason>,
    /// Nothing holds the vehicle where it is: a boat without thrust.
    pub is_drifting: bool,
    /// Who drives.
    pub lease: LeaseStatus,
    /// Whether a key that goes down now would count.
    pub arming: Arming,
    /// An upper bound on the age of the last command, ms; `None` where there is none under this grant.
    pub age_ms: Option<u32>,
    /// The greatest of that within the last second.
    pub peak_age_ms: Option<u32>,
    /// The speed that this age allows, m/s; at most the vehicle's greatest.
    pub speed_allowed_mps: f32,
    /// What the holder asks for.
    pub requested: Velocity,
    /// What the motors are told.
    pub applied: Velocity,
    /// What makes the one differ from the other now: of several, the tightest; on the way to any limit, `Ramp`.
    pub clamp: Option<Clamp>,
    /// What the collision monitor says.
    pub collision_monitor: CollisionMonitorState,
    /// The emergency stop in force.
    pub estop: Option<EStopStatus>,
    /// What was obeyed and what was not, since the boot.
    pub counters: CommandCounters,
    /// What `set` can change, as it is.
    pub settings: Settings,
    /// The nearest thing, or ground, that makes the guard bound the motion that is asked for; `None` where it bounds
    /// nothing, or is not on.
    pub barrier: Option<Barrier>,
    /// How long ago the ground just outside of the footprint was looked at last, ms: ahead, to the left, behind, to the
    /// right; `None` where nobody has looked, or the guard is not on.
    pub ground_age_ms: [Option<u32>; 4],
}

/// What the vehicle is doing. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TeleopState {
    /// The self-test runs.
    SafeBoot,
    /// Nobody drives.
    Idle,
    /// Somebody holds the lease, and the vehicle stands.
    Held,
    /// Somebody drives.
    Driving,
    /// It brakes.
    Stopping(StopReason),
    /// Somebody stopped it for good, until a reset.
    EStop,
    /// It cannot be trusted, until somebody at the vehicle resets it.
    Fault(FaultReason),
}

/// Why a vehicle that was driven stops. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StopReason {
    /// Nothing is pressed any more.
    Released,
    /// The last command is too old.
    Age,
    /// A command asked for what is no number.
    NotFinite,
    /// The collision monitor knows too little, or says nothing.
    CollisionMonitorStale,
    /// Who drove no longer holds the lease.
    LeaseEnded(LeaseEnd),
}

/// Why somebody lost the lease. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LeaseEnd {
    /// They gave it back.
    Released,
    /// No command renewed it.
    Expired,
    /// They asked for it anew, as a console does that was restarted.
    Renewed,
    /// They handed it over.
    HandedOver,
    /// A supervisor took it.
    TakenOver,
    /// They are no longer an operator.
    Revoked,
    /// An emergency stop was reset, after which everybody starts anew.
    Reset,
    /// The vehicle is at fault.
    Fault,
}

/// Why a vehicle cannot be trusted. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultReason {
    /// The self-test failed.
    SelfTest,
    /// The motors do not do what they are told, or cannot be told.
    Actuator,
}

/// Who drives, and who wants to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeaseStatus {
    /// Grows with every grant; 0 before the first.
    pub epoch: u64,
    /// Who holds the lease.
    pub holder: Option<OperatorId>,
    /// Who gets it as soon as the vehicle stands.
    pub next: Option<OperatorId>,
    /// Who waits for the holder's consent.
    pub waiting: Option<OperatorId>,
}

/// What must be seen before anything moves. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Arming {
    /// A key that is down has no effect: all must be let go first.
    Locked,
    /// All were let go.
    Neutral,
    /// A key went down after that.
    Pressed,
}

/// How fast, in `base_link`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Velocity {
    /// Along x, m/s: negative backwards.
    pub linear_mps: f32,
    /// About z, rad/s: positive to the left.
    pub angular_radps: f32,
}

/// What keeps the applied velocity from the requested one. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Clamp {
    /// The vehicle's greatest speed.
    Speed,
    /// The limits of acceleration and jerk.
    Ramp,
    /// The age of commands.
    Age,
    /// The collision monitor.
    CollisionMonitor,
    /// The state: the vehicle stops or must stand.
    Stop,
}

/// What the collision monitor says. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum CollisionMonitorState {
    /// Nothing: it has not spoken, or too long ago. Nothing moves.
    Silent,
    /// Somebody switched it off.
    Off,
    /// It sees, and allows this.
    On(SpeedLimits),
    /// Where the vehicle would go it sees nothing, or what it saw is too old: no faster than creeping.
    UnknownSpace(SpeedLimits),
    /// What it saw is too old, and the configuration says to stop then.
    Stale,
}

/// The greatest speed in each direction, none negative; infinite where there is no limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedLimits {
    /// m/s.
    pub forward_mps: f32,
    /// m/s, backwards.
    pub reverse_mps: f32,
    /// rad/s.
    pub left_radps: f32,
    /// rad/s.
    pub right_radps: f32,
}

/// What bounds the motion that is asked for, by the collision monitor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Barrier {
    /// Where it is, in `odom`, metres.
    pub position_m: [f32; 2],
    /// What it is.
    pub kind: BarrierKind,
}

/// How the guard knows of what bounds a motion. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BarrierKind {
    /// A beam of the last sweeps hit it.
    Detected,
    /// An obstacle on the map that no beam hits now.
    Mapped,
    /// Ground that nobody has seen, or seen too long ago.
    Unknown,
    /// The water is too shallow there, by a beam of the last sweeps.
    Shallow,
    /// Ground that only beams without an echo call free.
    NoReturn,
}

/// An emergency stop in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EStopStatus {
    /// Its number, which a reset must name.
    pub number: u64,
    /// It would be found after a restart; only then it can be reset from afar.
    pub is_stored: bool,
}

/// What was obeyed and what was not, since the boot.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandCounters {
    /// Commands of holders that were taken, neutral ones too.
    pub accepted: u64,
    /// Times that a moving vehicle stopped without its operator having asked for it.
    pub involuntary_stops: u64,
    /// Commands and requests that were refused, by rising reason, each reason at most once.
    pub refused: Vec<RefusedCount>,
}

/// How often something was refused for a reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusedCount {
    /// Why.
    pub reason: Refusal,
    /// How often.
    pub count: u64,
}

/// What `set` can change, as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// Bytes for tiles, kbit/s.
    pub budget_kbps: u32,
    /// Whether the collision monitor is on.
    pub collision_monitor: bool,
    /// Whether a recording runs.
    pub recording: bool,
}
