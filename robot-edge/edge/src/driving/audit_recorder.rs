//! Writes events and refusals of the loop to the audit log.

use std::time::Duration;

use protocol::keys::{OperatorId as OperatorName, OperatorTopic};
use protocol::message::Refusal;

use super::operators::Operators;
use super::shared_drive_state::DriveEvent;
use super::status_message;
use measurement::time::Monotonic;
use network::audit::Audit;
use teleop::ArbiterEvent;

/// Refusals of one topic for one reason are written at most this often; others are counted.
const REFUSALS_PERIOD: Duration = Duration::from_secs(1);

/// Records to the audit log, if there is one. It never waits.
#[derive(Debug, Default)]
pub(super) struct AuditRecorder {
    audit: Option<Audit>,
    /// By topic and reason, so that a flood of commands does not hide an emergency stop.
    refusals: [[RefusalCounter; Refusal::ALL.len()]; OperatorTopic::ALL.len()],
}

#[derive(Clone, Copy, Debug, Default)]
struct RefusalCounter {
    written_at: Option<Monotonic>,
    since: u64,
}

impl AuditRecorder {
    pub(super) fn new(audit: Option<Audit>) -> Self {
        Self {
            audit,
            ..Self::default()
        }
    }

    pub(super) fn record(
        &mut self,
        drive_event: &DriveEvent,
        operators: &Operators,
        now: Monotonic,
    ) {
        if self.audit.is_none() {
            return;
        }
        if let DriveEvent::Arbiter(ArbiterEvent::Refused {
            request_kind,
            caller,
            refusal,
        }) = drive_event.clone()
        {
            let name = operators.names().nth(caller.operator.0 as usize).cloned();
            if let Some(name) = name {
                self.record_refusal(&name, request_kind, refusal, now);
            }
            return;
        }
        let names: Vec<_> = operators.names().cloned().collect();
        let (kind, message) = status_message::event_text(drive_event, &names);
        if let Some(audit) = &self.audit {
            audit.write(kind, message);
        }
    }

    pub(super) fn record_refusal(
        &mut self,
        operator: &OperatorName,
        request_kind: OperatorTopic,
        refusal: Refusal,
        now: Monotonic,
    ) {
        let Some(audit) = &self.audit else { return };
        let row = OperatorTopic::ALL
            .iter()
            .position(|known| *known == request_kind);
        let at = Refusal::ALL.iter().position(|reason| *reason == refusal);
        let (Some(row), Some(at)) = (row, at) else {
            return;
        };
        let refused = &mut self.refusals[row][at];
        refused.since += 1;
        if refused
            .written_at
            .is_some_and(|written_at| now.since(written_at) < REFUSALS_PERIOD)
        {
            return;
        }
        let count = refused.since;
        *refused = RefusalCounter {
            written_at: Some(now),
            since: 0,
        };
        let others = match count {
            1 => String::new(),
            more => format!("; {more} since the last such line"),
        };
        let (what, request_kind) = refusal_labels(request_kind);
        audit.write_refused(
            what,
            format!("{request_kind} in the name of {operator}: {refusal}{others}"),
        );
    }
}

const fn refusal_labels(request_kind: OperatorTopic) -> (&'static str, &'static str) {
    match request_kind {
        OperatorTopic::Drive => ("drive", "a driving command"),
        OperatorTopic::EStop => ("estop", "an emergency stop"),
        OperatorTopic::Reset => ("reset", "a reset"),
        OperatorTopic::Lease => ("lease", "a request of the lease"),
        OperatorTopic::Set => ("setting", "a setting"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use network::audit::AuditLog;
    use teleop::{Caller, RequestId, Role};

    const fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    fn anna() -> OperatorName {
        "anna".parse().unwrap()
    }

    /// The lines that come of it: what was refused, for programs and in words.
    fn written(tell: impl FnOnce(&mut AuditRecorder)) -> Vec<(String, String)> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit.jsonl");
        let log = AuditLog::open(&path, "run".to_owned()).unwrap();
        tell(&mut AuditRecorder::new(Some(log.audit())));
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
        let lines = written(|audit_recorder| {
            for request_kind in OperatorTopic::ALL {
                audit_recorder.record_refusal(&anna(), request_kind, Refusal::TooOld, at(0));
            }
        });
        let expected = [
            ("drive", "a driving command"),
            ("estop", "an emergency stop"),
            ("reset", "a reset"),
            ("lease", "a request of the lease"),
            ("setting", "a setting"),
        ]
        .map(|(what, label)| {
            let message = format!("{label} in the name of anna: it is too old");
            (what.to_owned(), message)
        });
        assert_eq!(lines, expected);
    }

    #[test]
    fn a_refused_stop_has_its_own_audit_line() {
        let lines = written(|audit_recorder| {
            for (request_kind, ms) in [
                (OperatorTopic::Drive, 0),
                (OperatorTopic::Drive, 20),
                (OperatorTopic::EStop, 40),
                (OperatorTopic::Drive, 60),
                (OperatorTopic::EStop, 140),
                (OperatorTopic::Drive, 1000),
            ] {
                audit_recorder.record_refusal(&anna(), request_kind, Refusal::TooOld, at(ms));
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
    fn refusals_of_the_arbiter_are_reported_with_the_request() {
        let mut operators = Operators::open();
        let (operator, _) = operators.find(&anna()).unwrap();
        let drive_event = DriveEvent::Arbiter(ArbiterEvent::Refused {
            request_kind: OperatorTopic::Reset,
            caller: Caller {
                operator,
                role: Role::Operator,
                request: RequestId(1),
            },
            refusal: Refusal::NotHolder,
        });
        let lines =
            written(|audit_recorder| audit_recorder.record(&drive_event, &operators, at(0)));
        let message = "a reset in the name of anna: its sender does not hold the lease";
        assert_eq!(lines, [("reset".to_owned(), message.to_owned())]);
    }
}
