//! How driving goes, in a line.

use protocol::message::TeleopStatus;

use crate::panels::driving::words::state;

/// State, lease, what is asked for, what is applied, and the age of the last command.
pub(super) fn status(status: &TeleopStatus) -> String {
    let holder = status.lease.holder.as_ref();
    let holder = holder.map_or_else(|| "nobody".to_owned(), ToString::to_string);
    let age = status
        .age_ms
        .map_or_else(|| "–".to_owned(), |age_ms| format!("{age_ms} ms"));
    format!(
        "{}, lease of {holder}, asked {:.2} m/s {:.2} rad/s, applied {:.2} m/s {:.2} rad/s, age {age}",
        state(status.state),
        status.requested.linear_mps,
        status.requested.angular_radps,
        status.applied.linear_mps,
        status.applied.angular_radps,
    )
}
