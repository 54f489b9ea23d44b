//! What the loop writes into the audit log: what happened, and who was refused.

use std::time::Duration;

use protocol::keys::OperatorId as OperatorName;

use super::board::Notice;
use super::operators::Operators;
use super::words;
use crate::audit::Audit;
use crate::clock::Monotonic;
use crate::teleop::{Happening, Refusal};

/// Refusals of one reason are written this often at most; those between are counted.
const REFUSALS_PERIOD: Duration = Duration::from_secs(1);

/// Sees what happens, and tells the audit log, if there is one. It never waits.
#[derive(Debug, Default)]
pub(super) struct Witness {
    audit: Option<Audit>,
    refusals: [Refused; Refusal::ALL.len()],
}

#[derive(Clone, Copy, Debug, Default)]
struct Refused {
    told_at: Option<Monotonic>,
    since: u64,
}

impl Witness {
    pub(super) fn new(audit: Option<Audit>) -> Self {
        Self {
            audit,
            ..Self::default()
        }
    }

    /// Something happened.
    pub(super) fn saw(&mut self, notice: &Notice, operators: &Operators, now: Monotonic) {
        if self.audit.is_none() {
            return;
        }
        if let Notice::Arbiter(Happening::Refused { caller, refusal }) = *notice {
            let name = operators.names().nth(caller.operator.0 as usize).cloned();
            if let Some(name) = name {
                self.refused(&name, refusal, now);
            }
            return;
        }
        let names: Vec<_> = operators.names().cloned().collect();
        let (kind, message) = words::event(notice, &names);
        if let Some(audit) = &self.audit {
            audit.write(kind, message);
        }
    }

    /// Something that came in the name of `operator` was refused.
    pub(super) fn refused(&mut self, operator: &OperatorName, refusal: Refusal, now: Monotonic) {
        let Some(audit) = &self.audit else { return };
        let at = Refusal::ALL.iter().position(|reason| *reason == refusal);
        let Some(refused) = at.and_then(|at| self.refusals.get_mut(at)) else {
            return;
        };
        refused.since += 1;
        if refused
            .told_at
            .is_some_and(|told_at| now.since(told_at) < REFUSALS_PERIOD)
        {
            return;
        }
        let count = refused.since;
        *refused = Refused {
            told_at: Some(now),
            since: 0,
        };
        let others = match count {
            1 => String::new(),
            more => format!("; {more} since the last such line"),
        };
        audit.write(
            "refused",
            format!("in the name of {operator}: {refusal}{others}"),
        );
    }
}
