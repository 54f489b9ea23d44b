//! Messages between the teleop client and its link, notifications, and the queue of requests.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::OperatorTopic;
use protocol::message::{
    AgeToken, Answer, DockingChoice, GoalEnd, LeaseRequest, MapPose, Refusal, Setting, TeleopStatus,
};
use protocol::tile::BootId;

use crate::teleop_input::InputLockReason;

/// What driving needs of the newest pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LatestPose {
    pub boot: BootId,
    /// `None` if the robot cannot be driven.
    pub token: Option<AgeToken>,
    /// Speed along x, m/s, and turn rate, rad/s.
    pub velocity: [f32; 3],
    pub at: Monotonic,
}

/// Number of a request, by which its answer is assigned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestNumber(pub u64);

#[derive(Clone, Debug, PartialEq)]
pub enum TeleopMessage {
    Status {
        boot: BootId,
        /// `None` if the robot cannot be driven.
        teleop: Option<Box<TeleopStatus>>,
    },
    Answer {
        request: RequestNumber,
        boot: BootId,
        answer: Answer,
    },
    NoAnswer {
        request: RequestNumber,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub enum Intent {
    EStop,
    /// Resets the emergency stop of this number.
    Reset(u64),
    Lease(LeaseRequest),
    Set(Setting),
    Step(crate::teleop_input::SpeedStep),
    /// Steer into the vegetation of this docking site, while this console has the lease.
    Dock(Option<DockingChoice>),
    /// Let the planner drive to this goal, while this console has the lease.
    Goal(Option<MapPose>),
}

/// A message to send now and once. Sending it later or twice is an error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SignedMessage {
    pub topic: OperatorTopic,
    pub key: String,
    pub payload: Vec<u8>,
    /// `Some` for a query whose answers have this number, `None` for a put.
    pub request: Option<RequestNumber>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum TeleopNotification {
    Answered(RequestKind, Answer),
    RequestTimedOut(RequestKind),
    NotSent(RequestKind, NotSentReason),
    LeaseGained(u64),
    LeaseLost,
    LeaseReleased,
    /// A reset of the emergency stop ended the lease; it must be requested again.
    LeaseEndedByReset,
    EStopPressed,
    /// The vehicle is stopped, also after a restart.
    EStopAcknowledged(u64),
    EStopRefused(Refusal),
    /// The robot knows the press, but no stop is active.
    EStopNotInForce,
    /// The emergency stop was pressed for a robot that cannot be driven.
    NotDrivable,
    /// An observer requested something that needs another role.
    ObserverOnly,
    /// The goal has ended on the robot.
    GoalEnded(Option<GoalEnd>),
    /// The robot does not start the goal.
    GoalNotStarted,
    /// Pressed keys and sticks do not count any more.
    InputLocked(InputLockReason),
}

#[derive(Clone, Debug, PartialEq)]
pub enum RequestKind {
    Lease(LeaseRequest),
    Reset(u64),
    Set(Setting),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotSentReason {
    /// No recent data from the robot, or data without tokens.
    NoToken,
    TooMany,
}

const MAX_WAITING: usize = 8;
/// Longer than the link waits for an answer.
pub(super) const LONGEST: Duration = Duration::from_secs(4);

/// Sent one at a time: the robot rejects a request that a later one has overtaken.
#[derive(Clone, Debug, Default)]
pub(super) struct Requests {
    waiting: VecDeque<RequestKind>,
    asked: Option<(RequestNumber, RequestKind, Monotonic)>,
}

impl Requests {
    pub(super) fn push(&mut self, asked: RequestKind) -> Result<(), RequestKind> {
        if self.waiting.len() >= MAX_WAITING {
            return Err(asked);
        }
        self.waiting.push_back(asked);
        Ok(())
    }

    pub(super) fn next(&mut self) -> Option<RequestKind> {
        if self.asked.is_some() {
            return None;
        }
        self.waiting.pop_front()
    }

    pub(super) fn sent(&mut self, request: RequestNumber, asked: RequestKind, now: Monotonic) {
        self.asked = Some((request, asked, now));
    }

    pub(super) fn take(&mut self, request: RequestNumber) -> Option<RequestKind> {
        let (_, asked, _) = self.asked.take_if(|(number, ..)| *number == request)?;
        Some(asked)
    }

    pub(super) fn take_overdue(&mut self, now: Monotonic) -> Option<RequestKind> {
        let (_, asked, _) = self.asked.take_if(|(_, _, at)| now.since(*at) >= LONGEST)?;
        Some(asked)
    }

    pub(super) fn due(&self, now: Monotonic) -> Option<Monotonic> {
        match &self.asked {
            Some((_, _, at)) => Some(*at + LONGEST),
            None => self.waiting.front().map(|_| now),
        }
    }

    pub(super) fn is_busy(&self) -> bool {
        self.asked.is_some() || !self.waiting.is_empty()
    }

    pub(super) fn asks_for_lease(&self) -> bool {
        let asked = self.asked.as_ref().map(|(_, asked, _)| asked);
        matches!(
            asked,
            Some(RequestKind::Lease(
                LeaseRequest::Request | LeaseRequest::TakeOver
            ))
        )
    }

    /// Ends all requests because the robot was restarted.
    pub(super) fn clear(&mut self) -> impl Iterator<Item = RequestKind> {
        let asked = self.asked.take().map(|(_, asked, _)| asked);
        asked.into_iter().chain(std::mem::take(&mut self.waiting))
    }
}
