//! How driving goes, in a line.

use protocol::message::{Clamp, TeleopStatus};

use crate::panels::driving::is_stopped_by_monitor;
use crate::panels::driving::labels::{clamp, state};

/// What was said last: the same is not said again.
#[derive(Debug, Default)]
pub(super) struct StatusLine(String);

impl StatusLine {
    /// A line where the words of it are new. Figures are no news: they change all the time.
    pub(super) fn changed_line(&mut self, status: &TeleopStatus) -> Option<String> {
        let state_text = state_text(status);
        if self.0 == state_text {
            return None;
        }
        let line = format!("{state_text}, {}", figures(status));
        self.0 = state_text;
        Some(line)
    }
}

/// State, what makes it stand that is told to go, and lease.
fn state_text(status: &TeleopStatus) -> String {
    let held_back = if is_stopped_by_monitor(status) {
        format!(", limited by {}", clamp(Clamp::CollisionMonitor))
    } else {
        String::new()
    };
    let holder = status.lease.holder.as_ref();
    let holder = holder.map_or_else(|| "nobody".to_owned(), ToString::to_string);
    format!("{}{held_back}, lease of {holder}", state(status.state))
}

/// What is asked for, what is applied, and the age of the last command.
fn figures(status: &TeleopStatus) -> String {
    let age = status
        .age_ms
        .map_or_else(|| "–".to_owned(), |age_ms| format!("{age_ms} ms"));
    format!(
        "asked {:.2} m/s {:.2} rad/s, applied {:.2} m/s {:.2} rad/s, age {age}",
        status.requested.linear_mps,
        status.requested.angular_radps,
        status.applied.linear_mps,
        status.applied.angular_radps,
    )
}

#[cfg(test)]
mod tests {
    use protocol::message::{LeaseStatus, TeleopState, Velocity};

    use super::*;
    use crate::test_support::idle_teleop_status;

    /// Anna drives, and the guard lets her go so fast, m/s.
    fn driven(applied_mps: f32) -> TeleopStatus {
        let going = |linear_mps| Velocity {
            linear_mps,
            angular_radps: 0.0,
        };
        TeleopStatus {
            state: TeleopState::Driving,
            lease: LeaseStatus {
                holder: Some("anna".parse().unwrap()),
                ..LeaseStatus::default()
            },
            age_ms: Some(31),
            requested: going(0.8),
            applied: going(applied_mps),
            clamp: Some(Clamp::CollisionMonitor),
            ..idle_teleop_status()
        }
    }

    #[test]
    fn what_the_guard_makes_stand_is_said_to_be_held_back() {
        let line_for = |applied_mps| {
            StatusLine::default()
                .changed_line(&driven(applied_mps))
                .unwrap()
        };
        assert_eq!(
            line_for(0.0),
            "Driving, limited by the collision monitor, lease of anna, asked 0.80 m/s 0.00 rad/s, \
             applied 0.00 m/s 0.00 rad/s, age 31 ms"
        );
        assert_eq!(
            line_for(0.3),
            "Driving, lease of anna, asked 0.80 m/s 0.00 rad/s, applied 0.30 m/s 0.00 rad/s, age 31 ms"
        );
    }

    #[test]
    fn a_line_comes_with_other_words_and_not_with_other_figures() {
        let mut said = StatusLine::default();
        let mut is_said = |status: &TeleopStatus| said.changed_line(status).is_some();
        assert!(is_said(&driven(0.0)));
        // As much as nothing.
        assert!(!is_said(&driven(0.001)));
        assert!(!is_said(&driven(0.0)));
        assert!(is_said(&driven(0.1)));
        assert!(!is_said(&driven(0.3)));
        let mut handed_over = driven(0.3);
        handed_over.lease.holder = Some("bert".parse().unwrap());
        assert!(is_said(&handed_over));
        assert!(is_said(&idle_teleop_status()));
        assert!(!is_said(&idle_teleop_status()));
    }
}
