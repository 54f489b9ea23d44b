//! What the helm hears of the robot, and what it wants to be told.

use measurement::time::Monotonic;
use protocol::keys::OperatorTopic;
use protocol::message::{AgeToken, Answer, LeaseRequest, Refusal, Setting, TeleopStatus};
use protocol::tile::BootId;

use crate::teleop_input::InputLockReason;

/// The newest of the robot's poses, as far as driving goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatestPose {
    /// The run of the robot's program.
    pub boot: BootId,
    /// Its token; none where the robot cannot be driven.
    pub token: Option<AgeToken>,
    /// Speed along x, m/s, and turn rate, rad/s.
    pub velocity: [f32; 2],
    /// When it arrived.
    pub at: Monotonic,
}

/// Numbers a request of this console, so that its answer finds its way back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestNumber(pub u64);

/// What the link tells the helm, in the order in which it came.
#[derive(Clone, Debug, PartialEq)]
pub enum TeleopMessage {
    /// How driving goes.
    Status {
        /// Of which run of the robot.
        boot: BootId,
        /// None where the robot cannot be driven.
        teleop: Option<Box<TeleopStatus>>,
    },
    /// A request was answered.
    Answer {
        /// Which.
        request: RequestNumber,
        /// By which run of the robot.
        boot: BootId,
        /// How.
        answer: Answer,
    },
    /// No answer will come any more.
    NoAnswer {
        /// To which request.
        request: RequestNumber,
    },
}

/// What the operator wants besides moving.
#[derive(Clone, Debug, PartialEq)]
pub enum Intent {
    /// To stop at once and to stay stopped.
    EStop,
    /// The end of the emergency stop of this number.
    Reset(u64),
    /// Something about who drives.
    Lease(LeaseRequest),
    /// Another setting of the robot.
    Set(Setting),
    /// How fast keys drive.
    Step(crate::teleop_input::SpeedStep),
}

/// A message to be sent now, once, as it is. To send it later, or twice, would be a fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SignedMessage {
    /// What kind of message.
    pub topic: OperatorTopic,
    /// Where to.
    pub key: String,
    /// The message.
    pub payload: Vec<u8>,
    /// None: it is put. Else it is a query, and its answers have this number.
    pub request: Option<RequestNumber>,
}

/// Something that happened at the helm, for logs, scripts and the panel.
#[derive(Clone, Debug, PartialEq)]
pub enum TeleopNotification {
    /// A request was answered.
    Answered(RequestKind, Answer),
    /// A request was not answered in time.
    RequestTimedOut(RequestKind),
    /// A request was not even sent.
    NotSent(RequestKind, NotSentReason),
    /// This console drives, by this grant.
    LeaseGained(u64),
    /// This console drives no more.
    LeaseLost,
    /// The same, because whoever drove wanted it so.
    LeaseReleased,
    /// The same, because the emergency stop was reset: who drives next asks for it.
    LeaseEndedByReset,
    /// The emergency stop is being sent.
    EStopPressed,
    /// The vehicle is stopped for good, and will be after a restart.
    EStopAcknowledged(u64),
    /// The robot refuses to stop for this operator.
    EStopRefused(Refusal),
    /// It knows the emergency stop and says that none is in force: which of the two reasons it has, it does not tell.
    EStopNotInForce,
    /// The emergency stop was pressed for a robot that cannot be driven: nothing there would hear it.
    NotDrivable,
    /// Something was asked for that observers may not.
    ObserverOnly,
    /// What was held down counts no more.
    InputLocked(InputLockReason),
}

/// A request in the log: what was asked.
#[derive(Clone, Debug, PartialEq)]
pub enum RequestKind {
    /// Who drives.
    Lease(LeaseRequest),
    /// The end of an emergency stop.
    Reset(u64),
    /// A setting.
    Set(Setting),
}

/// Why a request was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotSentReason {
    /// No data from the robot, or gives no tokens.
    NoToken,
    /// Too many wait already.
    TooMany,
}
