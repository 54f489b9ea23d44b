//! What the loop writes into the audit log: what happened, and who was refused what.

use std::time::Duration;

use protocol::keys::OperatorId as OperatorName;

use super::board::Notice;
use super::operators::Operators;
use super::words;
use crate::audit::Audit;
use crate::clock::Monotonic;
use crate::teleop::{Happening, Refusal, Wish};

/// Refusals of one wish for one reason are written this often at most; those between are counted.
const REFUSALS_PERIOD: Duration = Duration::from_secs(1);

/// Sees what happens, and tells the audit log, if there is one. It never waits.
#[derive(Debug, Default)]
pub(super) struct Witness {
    audit: Option<Audit>,
    /// By wish and by reason, so that no flood of commands hides an emergency stop.
    refusals: [[Refused; Refusal::ALL.len()]; Wish::ALL.len()],
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
        if let Notice::Arbiter(Happening::Refused {
            wish,
            caller,
            refusal,
        }) = *notice
        {
            let name = operators.names().nth(caller.operator.0 as usize).cloned();
            if let Some(name) = name {
                self.refused(&name, wish, refusal, now);
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
    pub(super) fn refused(
        &mut self,
        operator: &OperatorName,
        wish: Wish,
        refusal: Refusal,
        now: Monotonic,
    ) {
        let Some(audit) = &self.audit else { return };
        let row = Wish::ALL.iter().position(|known| *known == wish);
        let at = Refusal::ALL.iter().position(|reason| *reason == refusal);
        let (Some(row), Some(at)) = (row, at) else {
            return;
        };
        let refused = &mut self.refusals[row][at];
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
        let (what, wish) = told(wish);
        audit.write_refused(
            what,
            format!("{wish} in the name of {operator}: {refusal}{others}"),
        );
    }
}

/// What was refused, for programs and for people.
const fn told(wish: Wish) -> (&'static str, &'static str) {
    match wish {
        Wish::Drive => ("drive", "a driving command"),
        Wish::EStop => ("estop", "an emergency stop"),
        Wish::Reset => ("reset", "a reset"),
        Wish::Lease => ("lease", "a request of the lease"),
        Wish::Setting => ("setting", "a setting"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::AuditLog;
    use crate::teleop::{Caller, RequestId, Role};

    const fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    fn anna() -> OperatorName {
        "anna".parse().unwrap()
    }

    /// The lines that come of it: what was refused, for programs and in words.
    fn written(tell: impl FnOnce(&mut Witness)) -> Vec<(String, String)> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let log = AuditLog::open(&path, "run".to_owned()).unwrap();
        tell(&mut Witness::new(Some(log.audit())));
        drop(log);
        let text = std::fs::read_to_string(&path).unwrap();
        let line = |line: &str| {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            assert_eq!(line["kind"], "refused");
            let field = |name: &str| line[name].as_str().unwrap().to_owned();
            (field("what"), field("message"))
        };
        text.lines().map(line).collect()
    }

    #[test]
    fn each_line_says_what_was_refused() {
        let lines = written(|witness| {
            for wish in Wish::ALL {
                witness.refused(&anna(), wish, Refusal::TooOld, at(0));
            }
        });
        let expected = [
            ("drive", "a driving command"),
            ("estop", "an emergency stop"),
            ("reset", "a reset"),
            ("lease", "a request of the lease"),
            ("setting", "a setting"),
        ]
        .map(|(what, words)| {
            let message = format!("{words} in the name of anna: it is too old");
            (what.to_owned(), message)
        });
        assert_eq!(lines, expected);
    }

    #[test]
    fn a_refused_stop_has_its_own_line_among_commands_that_are_counted() {
        let lines = written(|witness| {
            for (wish, ms) in [
                (Wish::Drive, 0),
                (Wish::Drive, 20),
                (Wish::EStop, 40),
                (Wish::Drive, 60),
                (Wish::EStop, 140),
                (Wish::Drive, 1000),
            ] {
                witness.refused(&anna(), wish, Refusal::TooOld, at(ms));
            }
        });
        let drive = "a driving command in the name of anna: it is too old";
        let expected = [
            ("drive", drive.to_owned()),
            (
                "estop",
                "an emergency stop in the name of anna: it is too old".to_owned(),
            ),
            ("drive", format!("{drive}; 3 since the last such line")),
        ]
        .map(|(what, message)| (what.to_owned(), message));
        assert_eq!(lines, expected);
    }

    #[test]
    fn what_the_arbiter_refused_is_told_with_what_it_was() {
        let mut operators = Operators::open();
        let (operator, _) = operators.find(&anna()).unwrap();
        let notice = Notice::Arbiter(Happening::Refused {
            wish: Wish::Reset,
            caller: Caller {
                operator,
                role: Role::Operator,
                request: RequestId(1),
            },
            refusal: Refusal::NotHolder,
        });
        let lines = written(|witness| witness.saw(&notice, &operators, at(0)));
        let message = "a reset in the name of anna: its sender does not hold the lease";
        assert_eq!(lines, [("reset".to_owned(), message.to_owned())]);
    }
}
