//! Commands as they leave: with the token of this iteration, the newest grant, a number that grows, and a signature.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::operator_key;
use protocol::message::{AgeToken, Drive};
use protocol::signed::{Command, CommandHeader, Route, sign};

use super::estop::PendingEStop;
use super::messages::{RequestNumber, SignedMessage};
use super::{DriveInput, TeleopClient};

/// A token that arrived longer ago is good for nothing on any robot (greatest age that can be configured: 1 s).
const TOKEN_USELESS: Duration = Duration::from_secs(1);

impl TeleopClient {
    pub(super) fn command(&self, drive_input: DriveInput) -> Drive {
        let [speed_mps, turn_rate_radps] = self.limits;
        Drive {
            linear_mps: drive_input.forward * speed_mps,
            angular_radps: drive_input.left * turn_rate_radps,
            estop: self.estop.as_ref().map(PendingEStop::body),
        }
    }

    pub(super) fn fresh_token(&self, now: Monotonic) -> Option<AgeToken> {
        self.newest
            .filter(|newest| now.since(newest.at) <= TOKEN_USELESS)?
            .token
    }

    pub(super) fn signed<T: Command>(
        &mut self,
        token: AgeToken,
        body: &T,
        request: Option<RequestNumber>,
    ) -> Option<SignedMessage> {
        self.seq += 1;
        let operator = &self.identity.operator;
        let route = Route {
            robot: &self.robot,
            operator,
        };
        let stamp = CommandHeader {
            boot: self.boot?,
            token,
            epoch: self.epoch,
            seq: self.seq,
        };
        let payload = sign(&self.identity.key, route, &stamp, body)
            .inspect_err(|why| tracing::error!(%why, "a command was not signed"))
            .ok()?;
        Some(SignedMessage {
            topic: T::TOPIC,
            key: operator_key(&self.robot, operator, T::TOPIC),
            payload,
            request,
        })
    }

    pub(super) const fn number(&mut self) -> RequestNumber {
        self.numbers += 1;
        RequestNumber(self.numbers)
    }
}
