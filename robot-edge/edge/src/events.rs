//! The severity of each kind of event, and many messages alike as one line.

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
        | "localization_lost" | "operators_missing" => Severity::Alarm,
        "localization_uncertain"
        | "sensor_slow"
        | "sensor_clock"
        | "sensor_invalid"
        | "pose_jump"
        | "correction_stopped"
        | "contact"
        | "overload"
        | "voxels_evicted"
        | "involuntary_stop"
        | "motors_held"
        | "collision_monitor_off"
        | "drive_log_stopped"
        | "operators_unreadable"
        | "access_failed"
        | "router_missing"
        | "refused" => Severity::Warning,
        _other => Severity::Info,
    }
}

/// More messages alike than this become one line.
const MAX_ALIKE: usize = 3;

/// The messages, in order; of many that differ only in their numbers the first one, with the count of the others.
pub fn merge_alike<'a>(messages: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut groups: Vec<(String, Vec<&str>)> = Vec::new();
    for message in messages {
        let without_numbers = message.replace(|c: char| c.is_ascii_digit(), "");
        match groups.iter_mut().find(|(of, _)| *of == without_numbers) {
            Some((_, alike)) => alike.push(message),
            None => groups.push((without_numbers, vec![message])),
        }
    }
    let lines = groups.into_iter().flat_map(|(_, alike)| match &alike[..] {
        [first, others @ ..] if alike.len() > MAX_ALIKE => {
            vec![format!("{first} (and {} more like it)", others.len())]
        }
        few => few.iter().map(ToString::to_string).collect(),
    });
    lines.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_messages_alike_become_one_with_a_count() {
        let jumps: Vec<_> = (0..1467)
            .map(|n| format!("the poses jumped by {n}.00 m"))
            .collect();
        let merged = merge_alike(jumps.iter().map(String::as_str).chain(["a", "b"]));
        assert_eq!(
            merged,
            [
                "the poses jumped by 0.00 m (and 1466 more like it)",
                "a",
                "b"
            ]
        );
        let few = ["byte 1", "byte 20", "byte 3"];
        assert_eq!(merge_alike(few), few);
    }

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
