//! Which sensors a layer is made from, and what is wrong with one of them now.
//!
//! When they measured last is not said: they have seen other places since, and it would be taken for the age of this
//! one.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::message::{SensorFault, SensorInfo, SensorKind, SensorStatus};

use crate::model::ConsoleModel;
use crate::panels::formatting::age;
use crate::panels::stale::StaleData;

/// More are counted, and not named.
const MAX_NAMED: usize = 2;

/// The sensors of `model` that feed a layer; `None` where it names none.
pub(super) fn source(model: &ConsoleModel, layer: LayerId, now: Monotonic) -> Option<String> {
    let statuses = if model.reports_ended() || StaleData::new(model, now).is_some() {
        // Whether it is so now is not known.
        &[]
    } else {
        model.sensor_statuses()
    };
    words(layer, model.sensors(), statuses, model.status_delay(now))
}

/// `since_update`: since `statuses` were told.
fn words(
    layer: LayerId,
    sensors: &[SensorInfo],
    statuses: &[SensorStatus],
    since_update: Duration,
) -> Option<String> {
    let feeding: Vec<_> = sensors
        .iter()
        .filter(|sensor| feeds(sensor.kind, layer))
        .collect();
    let mut names: Vec<_> = feeding
        .iter()
        .take(MAX_NAMED)
        .map(|sensor| sensor.name.clone())
        .collect();
    if feeding.len() > MAX_NAMED {
        names.push(format!("{} more", feeding.len() - MAX_NAMED));
    }
    let last = names.pop()?;
    let from = if names.is_empty() {
        format!("from {last}")
    } else {
        format!("from {} and {last}", names.join(", "))
    };
    // Also of those that are only counted: what is wrong is never left out.
    let faults = feeding.iter().filter_map(|sensor| {
        let status = statuses.iter().find(|status| status.name == sensor.name)?;
        Some(fault_text(status, status.fault?, since_update))
    });
    let faults: Vec<_> = faults.collect();
    Some(if faults.is_empty() {
        from
    } else {
        format!("{from} ({})", faults.join(", "))
    })
}

/// What is wrong with a sensor now, `since_update` after it was told.
fn fault_text(status: &SensorStatus, fault: SensorFault, since_update: Duration) -> String {
    let name = &status.name;
    match (fault, status.age_ms) {
        (SensorFault::Silent, Some(ms)) => {
            let since = Duration::from_millis(ms.into()).saturating_add(since_update);
            format!("{name} silent for {}", age(since))
        }
        (SensorFault::Silent, None) => format!("{name} silent from the start"),
        (SensorFault::Clock, _) => format!("{name}'s clock jumped"),
        (SensorFault::AllInvalid, _) => format!("{name} sees nothing now"),
        (SensorFault::Blocked, _) => format!("{name} blocked now"),
        (SensorFault::Slow, _) => format!("{name} slow now"),
    }
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
    use crate::test_support::{at, inject, inject_reply, scout};

    fn info(name: &str, kind: SensorKind) -> SensorInfo {
        SensorInfo {
            name: name.to_owned(),
            kind,
            mount: None,
            view: None,
            rate_hz: None,
        }
    }

    fn status(name: &str, fault: Option<SensorFault>) -> SensorStatus {
        SensorStatus {
            name: name.to_owned(),
            messages: 7,
            rate_hz: 5.0,
            age_ms: Some(10_000),
            dropped: 0,
            fault,
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
        let statuses = [status("sonar", None), status("laser", None)];
        let check = |sensors: &[SensorInfo], layer, expected: Option<&str>| {
            let words = words(layer, sensors, &statuses, Duration::ZERO);
            assert_eq!(words.as_deref(), expected);
        };
        check(&sensors, LayerId::Cost, Some("from laser and sonar"));
        check(&sensors, LayerId::Rigidity, Some("from laser"));
        check(&sensors[..1], LayerId::Cost, None);
        check(&[], LayerId::Occupancy, None);
        for name in ["left", "right"] {
            sensors.push(info(name, SensorKind::PlanarLaser));
        }
        check(
            &sensors,
            LayerId::Shore,
            Some("from laser, sonar and 2 more"),
        );
    }

    #[test]
    fn what_is_wrong_with_a_sensor_now_is_said_behind_their_names() {
        let sensors = ["laser", "sonar", "left"].map(|name| info(name, SensorKind::PlanarLaser));
        let check = |faults: &[(&str, SensorFault)], expected: &str| {
            let statuses = faults
                .iter()
                .map(|(name, fault)| status(name, Some(*fault)));
            let statuses: Vec<_> = statuses.collect();
            let told = Duration::from_secs(2);
            let words = words(LayerId::Cost, &sensors, &statuses, told);
            assert_eq!(words.as_deref(), Some(expected));
        };
        check(
            &[("laser", SensorFault::Silent)],
            "from laser, sonar and 1 more (laser silent for 12 s)",
        );
        check(
            &[
                ("sonar", SensorFault::AllInvalid),
                ("left", SensorFault::Slow),
            ],
            "from laser, sonar and 1 more (sonar sees nothing now, left slow now)",
        );
        check(
            &[("left", SensorFault::Clock)],
            "from laser, sonar and 1 more (left's clock jumped)",
        );
        let never = SensorStatus {
            age_ms: None,
            ..status("sonar", None)
        };
        let words = fault_text(&never, SensorFault::Silent, Duration::ZERO);
        assert_eq!(words, "sonar silent from the start");
    }

    #[test]
    fn nothing_is_wrong_now_where_nothing_is_heard_or_the_data_has_ended() {
        let mut model = scout();
        let described = Info {
            sensors: vec![info("laser", SensorKind::PlanarLaser)],
            ..Info::default()
        };
        inject_reply(&mut model, RequestId(0), Topic::Info, &described, at(1_000));
        let mut told = Status {
            sensors: vec![status("laser", Some(SensorFault::Slow))],
            ..Status::default()
        };
        for (has_ended, now, words) in [
            (false, 1_000, "from laser (laser slow now)"),
            (false, 61_000, "from laser"),
            (true, 62_000, "from laser"),
        ] {
            if now != 61_000 {
                told.has_ended = has_ended;
                inject(&mut model, Topic::Status, &told, at(now));
            }
            let source = source(&model, LayerId::Cost, at(now));
            assert_eq!(source.as_deref(), Some(words), "{now}");
        }
    }
}
