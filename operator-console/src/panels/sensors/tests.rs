use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use protocol::keys::Topic;
use protocol::message::{Info, Status};

use super::*;
use crate::model::RequestId;
use crate::test_support::{at, console, inject, inject_reply, scout};

fn info(name: &str, kind: SensorKind, rate_hz: Option<f32>) -> SensorInfo {
    SensorInfo {
        name: name.to_owned(),
        kind,
        mount: None,
        view: None,
        rate_hz,
    }
}

fn status(name: &str, rate_hz: f32, fault: Option<SensorFault>) -> SensorStatus {
    SensorStatus {
        name: name.to_owned(),
        messages: 1234,
        rate_hz,
        age_ms: Some(40),
        dropped: 0,
        fault,
    }
}

/// A boat whose sensors have one fault each at 1 s.
fn boat() -> ConsoleModel {
    let mut model = scout();
    let described = Info {
        sensors: vec![
            info("laser", SensorKind::TiltingLaser, Some(5.0)),
            info("sonar", SensorKind::Sonar, Some(10.0)),
            info("gps", SensorKind::SatelliteReceiver, None),
            info("imu", SensorKind::Attitude, None),
        ],
        ..Info::default()
    };
    let silent = SensorStatus {
        age_ms: Some(1_300),
        dropped: 12_345,
        ..status("sonar", 4.2, Some(SensorFault::Silent))
    };
    let reported = Status {
        sensors: vec![
            status("laser", 5.0, None),
            silent,
            status("gps", 5.0, Some(SensorFault::AllInvalid)),
            status("imu", 49.96, Some(SensorFault::Clock)),
            SensorStatus {
                messages: 0,
                age_ms: None,
                ..status("not described", 0.0, None)
            },
        ],
        ..Status::default()
    };
    inject_reply(&mut model, RequestId(0), Topic::Info, &described, at(1_000));
    inject(&mut model, Topic::Status, &reported, at(1_000));
    model
}

fn text(data: &SensorsData) -> String {
    let line = |line: &SensorLine| {
        format!(
            "{:?} {} | {} | {} | {} | {} | {}",
            line.tone, line.state, line.name, line.kind, line.rate, line.last_seen, line.dropped
        )
    };
    let lines: Vec<_> = data
        .note
        .iter()
        .cloned()
        .chain(data.sensors.iter().map(line))
        .collect();
    lines.join("\n")
}

#[test]
fn sensor_states() {
    assert_eq!(
        text(&SensorsData::new(&boat(), at(1_100))),
        "Good Good | laser | Tilting laser | 5.0 of 5 Hz | 0.0 s ago | 0\n\
         Warning Silent | sonar | Sonar | 4.2 of 10 Hz | 1.3 s ago | 12\u{a0}345\n\
         Warning No fix | gps | Satellite receiver | 5.0 Hz | 0.0 s ago | 0\n\
         Warning Clock jump | imu | Attitude | 50.0 Hz | 0.0 s ago | 0\n\
         Waiting Waiting | not described | – | 0.0 Hz | never | 0"
    );
}

#[test]
fn sensor_states_of_a_silent_link_are_not_good() {
    let text = text(&SensorsData::new(&boat(), at(6_000)));
    assert!(
        text.starts_with("As of 5.0 s ago\nWaiting Was good | laser"),
        "{text}"
    );
    assert!(
        text.contains("Warning Silent | sonar | Sonar | 4.2 of 10 Hz | 6.3 s ago"),
        "{text}"
    );
}

#[test]
fn a_robot_without_sensor_data_has_a_note() {
    let data = SensorsData::new(&scout(), at(1_000));
    assert_eq!(text(&data), "No sensor data yet.");
}

#[test]
fn sensor_states_of_ended_data_are_not_good() {
    let mut model = boat();
    let ended = Status {
        sensors: vec![status("laser", 5.0, None)],
        has_ended: true,
        ..Status::default()
    };
    inject(&mut model, Topic::Status, &ended, at(2_000));
    let data = SensorsData::new(&model, at(2_300));
    let line = "Waiting Was good | laser | Tilting laser | 5.0 of 5 Hz | as of the end | 0";
    assert_eq!(text(&data), line);
}

#[test]
fn sensors_fit_a_narrow_panel() {
    for width in [250.0, 400.0, 560.0] {
        let data = SensorsData::new(&boat(), at(1_100));
        let mut panel = Harness::builder()
            .with_size(vec2(width, 400.0))
            .build_ui(move |ui| sensors_ui(ui, &data));
        crate::theme::set(&panel.ctx);
        panel.run_steps(3);
        for label in [
            "Silent",
            "sonar",
            "4.2 of 10 Hz,",
            "seen 1.3 s ago,",
            "12\u{a0}345 messages dropped",
            "Clock jump",
            "not described",
            "seen never",
        ] {
            let rect = panel.get_by_label(label).rect();
            assert!(
                rect.left() >= 0.0 && rect.right() <= width,
                "{width}, {label}: {rect}"
            );
        }
        let top = |label| panel.get_by_label(label).rect().top();
        assert!(top("4.2 of 10 Hz,") > top("sonar"), "{width}");
        assert!(top("No fix") > top("4.2 of 10 Hz,"), "{width}");
        assert!(panel.query_by_label("0 messages dropped").is_none());
        assert!(panel.query_by_label("Last seen").is_none(), "{width}");
    }
}

#[test]
fn sensors_of_a_paused_recording_do_not_age() {
    let mut model = console("recording-1a2b3c", &[]);
    let reported = Status {
        sensors: vec![status("laser", 5.0, None)],
        ..Status::default()
    };
    inject(&mut model, Topic::Status, &reported, at(1_000));
    let [then, later] = [1_100, 61_000].map(|ms| SensorsData::new(&model, at(ms)));
    assert_eq!(later, then);
    assert_eq!((then.note, &*then.sensors[0].state), (None, "Good"));
}

#[test]
fn sonar_without_valid_ranges_has_its_own_advice() {
    let inject = |kind| fault_text(SensorFault::AllInvalid, Some(kind)).2;
    assert!(inject(SensorKind::Sonar).contains("nearer to the bottom"));
    assert!(!inject(SensorKind::TiltingLaser).contains("bottom"));
}
