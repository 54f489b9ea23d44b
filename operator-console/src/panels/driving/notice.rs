//! What the operator did not expect, in words; of a lease that was lost, why.

use protocol::keys::OperatorId;
use protocol::message::Event;

use super::words;
use crate::helm::{HelmSight, Note};
use crate::panels::wording::capitalised;

/// What is said of it; `events` of the robot, the oldest first.
pub(super) fn notice<'a>(
    helm: &HelmSight,
    events: impl DoubleEndedIterator<Item = &'a Event>,
) -> Option<String> {
    let note = helm.notice.as_ref()?;
    let (words, _) = words::note(note);
    let words = capitalised(&words);
    match note {
        // The panel says so all the time.
        Note::OnlyWatches => None,
        Note::LeaseLost => Some(match why_ended(&helm.operator, events) {
            Some(why) => format!("{words}: {why}"),
            None => words,
        }),
        Note::Answered(..)
        | Note::NotAnswered(_)
        | Note::NotSent(..)
        | Note::LeaseGained(_)
        | Note::LeaseGivenBack
        | Note::ResetEndedDriving
        | Note::EStopPressed
        | Note::EStopAcknowledged(_)
        | Note::EStopRefused(_)
        | Note::EStopNotInForce
        | Note::NothingToStop
        | Note::Lost(_) => Some(words),
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
