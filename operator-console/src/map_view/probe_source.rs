//! Which sensors a layer is made from, and when each of them measured last.

use std::time::Duration;

use protocol::layer::LayerId;
use protocol::message::{SensorInfo, SensorKind, SensorStatus};
use robot_edge::clock::Monotonic;

use crate::model::ConsoleModel;
use crate::panels::wording::age;

/// More are counted, and not named.
const MAX_NAMED: usize = 2;

/// The sensors of `model` that feed a layer; `None` where it names none.
pub(super) fn source(model: &ConsoleModel, layer: LayerId, now: Monotonic) -> Option<String> {
    let statuses = if model.says_ended() {
        // It measures no more.
        &[]
    } else {
        model.sensor_statuses()
    };
    words(layer, model.sensors(), statuses, model.since_statuses(now))
}

/// `since_told`: since `statuses` were told.
fn words(
    layer: LayerId,
    sensors: &[SensorInfo],
    statuses: &[SensorStatus],
    since_told: Duration,
) -> Option<String> {
    let feeding: Vec<_> = sensors
        .iter()
        .filter(|sensor| feeds(sensor.kind, layer))
        .collect();
    let mut parts: Vec<_> = feeding
        .iter()
        .take(MAX_NAMED)
        .map(|sensor| {
            let status = statuses.iter().find(|status| status.name == sensor.name);
            let measured = status.and_then(|status| status.age_ms).map(|ms| {
                let since = Duration::from_millis(ms.into()).saturating_add(since_told);
                format!(" {} ago", age(since))
            });
            format!("{}{}", sensor.name, measured.unwrap_or_default())
        })
        .collect();
    if feeding.len() > MAX_NAMED {
        parts.push(format!("{} more", feeding.len() - MAX_NAMED));
    }
    let last = parts.pop()?;
    Some(if parts.is_empty() {
        last
    } else {
        format!("{} and {last}", parts.join(", "))
    })
}

/// Every sweep goes into every layer that is mapped. What tells vegetation from what is rigid is light: sound goes on in
/// water.
const fn feeds(kind: SensorKind, layer: LayerId) -> bool {
    match kind {
        SensorKind::PlanarLaser | SensorKind::TiltingLaser => true,
        SensorKind::Sonar => !matches!(layer, LayerId::Rigidity),
        SensorKind::WheelEncoders
        | SensorKind::Attitude
        | SensorKind::SatelliteReceiver
        | SensorKind::Odometry
        | SensorKind::Transforms
        | SensorKind::TiltEncoder => false,
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{Info, Status};

    use super::*;
    use crate::model::RequestId;
    use crate::pretend::{answers, at, says, scout};

    fn info(name: &str, kind: SensorKind) -> SensorInfo {
        SensorInfo {
            name: name.to_owned(),
            kind,
            mount: None,
            view: None,
            rate_hz: None,
        }
    }

    fn status(name: &str, age_ms: Option<u32>) -> SensorStatus {
        SensorStatus {
            name: name.to_owned(),
            messages: 7,
            rate_hz: 5.0,
            age_ms,
            dropped: 0,
            fault: None,
        }
    }

    #[test]
    fn layers_name_the_sensors_that_feed_them() {
        let mut sensors = vec![
            info("gps", SensorKind::SatelliteReceiver),
            info("laser", SensorKind::TiltingLaser),
            info("laser tilt", SensorKind::TiltEncoder),
            info("sonar", SensorKind::Sonar),
        ];
        let statuses = [
            status("sonar", None),
            status("laser", Some(150)),
            status("gps", Some(10)),
        ];
        let check = |sensors: &[SensorInfo], layer, expected: Option<&str>| {
            let words = words(layer, sensors, &statuses, Duration::from_millis(50));
            assert_eq!(words.as_deref(), expected);
        };
        check(&sensors, LayerId::Cost, Some("laser 0.2 s ago and sonar"));
        check(&sensors, LayerId::Rigidity, Some("laser 0.2 s ago"));
        check(&sensors[..1], LayerId::Cost, None);
        check(&[], LayerId::Occupancy, None);
        for name in ["left", "right"] {
            sensors.push(info(name, SensorKind::PlanarLaser));
        }
        check(
            &sensors,
            LayerId::Shore,
            Some("laser 0.2 s ago, sonar and 2 more"),
        );
    }

    #[test]
    fn a_sensor_whose_data_has_ended_measured_at_no_time() {
        let mut model = scout();
        let described = Info {
            sensors: vec![info("laser", SensorKind::PlanarLaser)],
            ..Info::default()
        };
        answers(&mut model, RequestId(0), Topic::Info, &described, at(1_000));
        let mut told = Status {
            sensors: vec![status("laser", Some(200))],
            ..Status::default()
        };
        for (has_ended, words) in [(false, "laser 0.2 s ago"), (true, "laser")] {
            told.has_ended = has_ended;
            says(&mut model, Topic::Status, &told, at(1_000));
            let source = source(&model, LayerId::Cost, at(1_000));
            assert_eq!(source.as_deref(), Some(words));
        }
    }
}
