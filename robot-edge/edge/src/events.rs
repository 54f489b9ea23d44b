//! The severity of each kind of event.

use protocol::message::{Event, Severity};

pub fn event(kind: &str, message: String) -> Event {
    Event {
        kind: kind.to_owned(),
        severity: severity(kind),
        message,
    }
}

/// The severity of a kind; a kind that is not listed is information.
pub fn severity(kind: &str) -> Severity {
    match kind {
        "estop" | "fault" | "motors" | "recording_stopped" | "sensor_silent"
        | "operators_missing" => Severity::Alarm,
        "sensor_slow"
        | "sensor_clock"
        | "sensor_invalid"
        | "pose_jump"
        | "overload"
        | "voxels_evicted"
        | "involuntary_stop"
        | "collision_monitor_off"
        | "drive_log_stopped"
        | "operators_unreadable"
        | "access_failed"
        | "refused" => Severity::Warning,
        _other => Severity::Info,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_is_no_alarm() {
        assert_eq!(severity("estop"), Severity::Alarm);
        assert_eq!(severity("pose_jump"), Severity::Warning);
        assert_eq!(severity("setup"), Severity::Info);
        let event = event("sensor_silent", "laser: silent for 1.2 s".to_owned());
        assert_eq!(event.severity, Severity::Alarm);
        assert_eq!(event.kind, "sensor_silent");
    }
}
