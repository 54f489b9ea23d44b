//! Ultrasonic sensors and bumpers.

use super::*;
use measurement::RangeReading;

/// A laser, an ultrasonic sensor and a bumper at x = 1 m of a vehicle that stands still.
fn three_sensors() -> RegistrationSettings {
    let mut settings = settings(PoseOrigin::Static);
    let laser = settings.sensors[0].clone();
    let kinds = [
        ScanKind::Beams,
        ScanKind::Arc,
        ScanKind::Contact { width_m: 0.6 },
    ];
    settings.sensors = (0..)
        .zip(kinds)
        .map(|(id, kind)| {
            let mut sensor = laser.clone();
            sensor.beams.id = SensorId(id);
            sensor.beams.kind = kind;
            sensor
        })
        .collect();
    settings
}

fn cone(range_m: f32) -> RangeReading {
    RangeReading {
        radiation_type: 0,
        field_of_view_rad: 0.5,
        range_min_m: 0.25,
        range_max_m: 3.0,
        range_m,
    }
}

fn scans_of(data: MeasurementData) -> (Vec<RegisteredScan>, RegistrationCounts) {
    let (out, counts) = registered(three_sensors(), vec![measurement(1.0, "", data)]);
    (out.iter().map(registered_scan).cloned().collect(), counts)
}

#[test]
fn a_reading_is_an_arc_at_its_range_and_no_echo_is_an_arc_without_hits() {
    for (range_m, expected_m) in [
        (2.0, Some(2.0)),
        (0.25, Some(0.25)),
        // REP 117: nearer than it measures.
        (f32::NEG_INFINITY, Some(0.0)),
        (f32::INFINITY, None),
        (3.0, None),
        (7.5, None),
    ] {
        let (scans, counts) = scans_of(MeasurementData::Range(cone(range_m)));
        let [scan] = &scans[..] else {
            panic!("{range_m}: {scans:?}")
        };
        assert_eq!((scan.sensor, scan.kind), (SensorId(1), ScanKind::Arc));
        assert_eq!(scan.beams.is_empty(), expected_m.is_none(), "{range_m}");
        let Some(expected_m) = expected_m else {
            continue;
        };
        // 0.5 rad is 28.6°: 30 points at most 1° apart.
        assert_eq!(scan.beams.len(), 30);
        let angles = scan.beams.iter().map(|beam| {
            let along = beam.end_in_odom - Point3::new(1.0, 0.0, 0.0);
            assert!((along.norm() - expected_m).abs() < 1e-6, "{range_m}");
            libm::atan2(along.y, along.x)
        });
        let angles: Vec<_> = angles.collect();
        assert!(
            expected_m <= 0.0
                || (angles[0] + 0.25).abs() < 1e-6 && (angles[29] - 0.25).abs() < 1e-6
        );
        assert_eq!(counts.beams_in, 0, "an arc is no beams");
    }
}

#[test]
fn a_reading_that_is_none_is_dropped_and_counted() {
    for range_m in [f32::NAN, -1.0, 0.0, 0.2] {
        let (scans, counts) = scans_of(MeasurementData::Range(cone(range_m)));
        assert!(scans.is_empty(), "{range_m}");
        assert_eq!(
            reasons(&counts.dropped_scans),
            [(DropReason::InvalidRange, 1)]
        );
    }
}

#[test]
fn what_a_fixed_distance_ranger_detects_may_touch_it() {
    let fixed = |range_m| RangeReading {
        range_min_m: 0.8,
        range_max_m: 0.8,
        field_of_view_rad: 0.0,
        ..cone(range_m)
    };
    let (detected, _) = scans_of(MeasurementData::Range(fixed(f32::NEG_INFINITY)));
    let ends: Vec<_> = detected[0]
        .beams
        .iter()
        .map(|beam| beam.end_in_odom.x)
        .collect();
    assert!(ends.iter().all(|x| (x - 1.0).abs() < 1e-6), "{ends:?}");
    assert_eq!(ends.len(), 2);
    let (clear, _) = scans_of(MeasurementData::Range(fixed(f32::INFINITY)));
    assert!(clear[0].beams.is_empty());
}

#[test]
fn a_pressed_bumper_touches_along_its_width_and_a_released_one_nothing() {
    let (pressed, _) = scans_of(MeasurementData::Bool(true));
    let [scan] = &pressed[..] else {
        panic!("{pressed:?}")
    };
    assert_eq!(scan.sensor, SensorId(2));
    let ends: Vec<_> = scan.beams.iter().map(|beam| beam.end_in_odom).collect();
    let (first, last) = (ends[0], ends[ends.len() - 1]);
    assert!(
        (first - Point3::new(1.0, -0.3, 0.0)).norm() < 1e-6,
        "{first}"
    );
    assert!((last - Point3::new(1.0, 0.3, 0.0)).norm() < 1e-6, "{last}");
    assert!(ends.windows(2).all(|two| (two[1] - two[0]).norm() < 0.01));
    let (released, _) = scans_of(MeasurementData::Bool(false));
    assert!(released[0].beams.is_empty());
}

#[test]
fn each_kind_of_message_goes_to_its_own_kind_of_sensor() {
    let (scans, counts) = registered(three_sensors(), vec![scan(1.0, 0.0, &[2.0])]);
    assert_eq!(registered_scan(&scans[0]).sensor, SensorId(0));
    assert_eq!(counts.scans_in, 1);
    let mut only_laser = three_sensors();
    only_laser.sensors.truncate(1);
    for data in [
        MeasurementData::Range(cone(1.0)),
        MeasurementData::Bool(true),
    ] {
        let (out, counts) = registered(only_laser.clone(), vec![measurement(1.0, "", data)]);
        assert!(out.is_empty() && counts.scans_in == 0);
    }
}
