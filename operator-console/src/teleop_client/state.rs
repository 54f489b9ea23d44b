//! What the operator is to see of the helm itself.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::OperatorId;
use protocol::message::Refusal;
use teleop::Role;

use super::{Lease, TeleopClient, TeleopNotification};
use crate::role;
use crate::teleop_input::{DriveInput, DriveKey, InputLockReason, SpeedStep};

/// How long something that was not expected is shown.
const NOTICE: Duration = Duration::from_secs(10);

/// The helm as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct TeleopClientState {
    /// Who drives from this console.
    pub operator: OperatorId,
    /// What they are proven to be.
    pub role: Option<Role>,
    /// Whether they do.
    pub lease: Lease,
    /// The newest grant that was this console's since the robot began: a status that still tells of it may be older than
    /// its end here.
    pub last_grant: Option<u64>,
    /// How fast keys drive.
    pub step: SpeedStep,
    /// What it asks for at most: speed, m/s, and turn rate, rad/s.
    pub limits: [f32; 2],
    /// What the hands ask for.
    pub drive_input: DriveInput,
    /// The keys that are held and count.
    pub keys: Vec<DriveKey>,
    /// Why what is held down counts for nothing.
    pub ignored: Option<InputLockReason>,
    /// Whether a press would count.
    pub is_ready: bool,
    /// Since when the last token is here; `None` before the first.
    pub token_age: Option<Duration>,
    /// Whether a request waits for its answer.
    pub is_asking: bool,
    /// What the operator did not expect, lately.
    pub notice: Option<TeleopNotification>,
    /// The emergency stop, as far as this console is concerned.
    pub estop: EStopState,
}

/// An emergency stop of this console.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EStopState {
    /// None is on its way.
    Quiet,
    /// It was pressed so long ago and is not acknowledged; it is sent ten times a second.
    Sending(Duration),
    /// It was pressed so long ago, and the robot was never heard: nobody can be told.
    Unsendable(Duration),
    /// The robot has refused to stop for this operator, and nothing has shown since that it would.
    Refused(Refusal),
}

impl TeleopClientState {
    /// Whether its operator is proven to be an observer.
    pub const fn is_observer(&self) -> bool {
        role::is_observer(self.role)
    }

    /// Whether its operator is proven to be no supervisor.
    pub const fn cannot_take_over(&self) -> bool {
        role::cannot_take_over(self.role)
    }
}

impl TeleopClient {
    /// The helm as it is at `now`.
    pub fn state(&self, now: Monotonic) -> TeleopClientState {
        let estop = match (&self.estop, self.estop_refused) {
            (Some(pending), _) if pending.is_sent() => {
                EStopState::Sending(now.since(pending.since))
            }
            (Some(pending), _) => EStopState::Unsendable(now.since(pending.since)),
            (None, Some(refusal)) => EStopState::Refused(refusal),
            (None, None) => EStopState::Quiet,
        };
        let token = self.newest.filter(|newest| newest.token.is_some());
        TeleopClientState {
            operator: self.identity.operator.clone(),
            role: self.identity.role,
            lease: self.lease,
            last_grant: self.last_grant,
            step: self.input.step(),
            limits: self.limits,
            drive_input: self.input.drive_input(),
            keys: self.input.keys().collect(),
            ignored: self.input.lock_reason(),
            is_ready: self.input.is_ready(),
            token_age: token.map(|newest| now.since(newest.at)),
            is_asking: self.requests.is_busy(),
            notice: self
                .notice
                .as_ref()
                .filter(|(at, _)| now.since(*at) < NOTICE)
                .map(|(_, note)| note.clone()),
            estop,
        }
    }
}
