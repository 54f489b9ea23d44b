//! What the operator did not expect, in words; of a lease that was lost, why.

use protocol::keys::OperatorId;
use protocol::message::Event;

use super::labels;
use crate::panels::formatting::capitalised;
use crate::teleop_client::{TeleopClientState, TeleopNotification};

/// What is said of it; `events` of the robot, the oldest first.
pub(super) fn notice<'a>(
    teleop_client: &TeleopClientState,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<String> {
    let note = teleop_client.notice.as_ref()?;
    let (words, _) = labels::note(note);
    let words = capitalised(&words);
    match note {
        // The panel says so all the time.
        TeleopNotification::ObserverOnly => None,
        TeleopNotification::LeaseLost => Some(match why_ended(&teleop_client.operator, events) {
            Some(why) => format!("{words}: {why}"),
            None => words,
        }),
        TeleopNotification::Answered(..)
        | TeleopNotification::RequestTimedOut(_)
        | TeleopNotification::NotSent(..)
        | TeleopNotification::LeaseGained(_)
        | TeleopNotification::LeaseReleased
        | TeleopNotification::LeaseEndedByReset
        | TeleopNotification::EStopPressed
        | TeleopNotification::EStopAcknowledged(_)
        | TeleopNotification::EStopRefused(_)
        | TeleopNotification::EStopNotInForce
        | TeleopNotification::NotDrivable
        | TeleopNotification::InputLocked(_) => Some(words),
    }
}

/// Why this operator no longer drives, in the robot's words. `None` where the newest that it told of them is a grant:
/// events are heard once or never, and that one's end was not.
fn why_ended<'a>(
    operator: &OperatorId,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<&'a str> {
    let newest = events.rev().find_map(|event| {
        let told = event.message.strip_prefix(operator.as_str())?;
        match event.kind.as_str() {
            "lease_granted" => told.starts_with(" drives: ").then_some(None),
            "lease_ended" => told.strip_prefix(" no longer drives: ").map(Some),
            _ => None,
        }
    });
    newest.flatten()
}
