//! Sensors: rate, last message and faults; and the connections with devices.

use std::time::Duration;

use eframe::egui::{Grid, Label, RichText, ScrollArea, Ui};
use measurement::time::Monotonic;
use protocol::message::{
    DeviceState, DeviceStatus, SensorFault, SensorInfo, SensorKind, SensorStatus,
};

use super::data_age::DataAge;
use super::formatting::{age, count};
use crate::model::{ConsoleModel, LinkState};
use crate::playback::is_recording;
use crate::theme::{Tone, state_ui};

/// Below this width each sensor has two lines, points.
const NARROW: f32 = 640.0;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SensorsData {
    pub note: Option<String>,
    pub sensors: Vec<SensorLine>,
    pub devices: Vec<DeviceLine>,
}

/// The connection with a device that the robot reads without a middleware.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceLine {
    pub tone: Tone,
    pub state: &'static str,
    pub trouble: String,
    pub name: String,
    pub rate: String,
    pub last_seen: String,
    pub reconnects: String,
    pub clock: String,
    pub lost: String,
    pub identity: String,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SensorLine {
    pub tone: Tone,
    pub state: String,
    pub advice: &'static str,
    pub name: String,
    pub kind: &'static str,
    pub rate: String,
    pub last_seen: String,
    pub dropped: String,
}

impl SensorsData {
    pub fn new(model: &ConsoleModel, now: Monotonic) -> Self {
        let since_update = model.status().map(|(_, at)| now.since(*at));
        // A recording has no link; its ages refer to the shown time.
        let is_recording = is_recording(model.robot());
        let is_silent = !is_recording && model.connection().state(now) == LinkState::Silent;
        let data_state = match (is_silent, model.reports_ended()) {
            (true, _) => DataState::Silent,
            (false, true) => DataState::Ended,
            (false, false) => DataState::Live,
        };
        let described = model.sensors();
        let status_delay = if is_recording {
            Duration::ZERO
        } else {
            model.status_delay(now)
        };
        let lines = model.sensor_statuses().iter().map(|status| {
            let info = described.iter().find(|info| info.name == status.name);
            line(status, info, status_delay, data_state)
        });
        let sensors: Vec<_> = lines.collect();
        let note = match (sensors.is_empty(), since_update) {
            (true, None) => Some("No sensor data yet.".to_owned()),
            (true, Some(_)) => Some("It reports no sensors.".to_owned()),
            (false, Some(since)) if is_silent => Some(format!("As of {} ago", age(since))),
            (false, _) => None,
        };
        let devices = model.device_statuses().iter();
        let devices = devices.map(|status| DeviceLine::new(status, status_delay, is_silent));
        Self {
            note,
            sensors,
            devices: devices.collect(),
        }
    }
}

impl DeviceLine {
    fn new(status: &DeviceStatus, since_update: Duration, is_silent: bool) -> Self {
        let (tone, state) = match status.state {
            DeviceState::Measuring if is_silent => (Tone::Waiting, "Was measuring"),
            DeviceState::Measuring => (Tone::Good, "Measuring"),
            DeviceState::Configuring => (Tone::Waiting, "Starting"),
            DeviceState::Connecting => (Tone::Warning, "Not connected"),
        };
        let last_seen = status.age_ms.map(|ms| {
            let before = Duration::from_millis(ms.into());
            format!("{} ago", age(before.saturating_add(since_update)))
        });
        let clock = status.clock.map(|clock| {
            let spread_ms = 1e3 * clock.spread_s;
            format!("{:+.3} s, late by up to {spread_ms:.0} ms", clock.offset_s)
        });
        Self {
            tone,
            state,
            trouble: status.trouble.clone(),
            name: status.name.clone(),
            rate: format!("{:.1} Hz", status.rate_hz),
            last_seen: last_seen.unwrap_or_else(|| "never".to_owned()),
            reconnects: count(status.reconnects.into()),
            clock: clock.unwrap_or_else(|| "–".to_owned()),
            lost: count(status.lost),
            identity: status.identity.clone(),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DataState {
    Live,
    Silent,
    Ended,
}

fn line(
    status: &SensorStatus,
    info: Option<&SensorInfo>,
    since_update: Duration,
    data_state: DataState,
) -> SensorLine {
    let kind = info.map(|info| info.kind);
    let (tone, state, advice) = match (status.fault, status.messages) {
        (Some(fault), _) => fault_text(fault, kind),
        (None, 0) => (Tone::Waiting, "Waiting", "Nothing has come from it yet."),
        // A good state may have changed since the link was lost.
        (None, _) if data_state == DataState::Silent => {
            (Tone::Waiting, "Was good", "State at the last contact.")
        }
        (None, _) if data_state == DataState::Ended => (
            Tone::Waiting,
            "Was good",
            "State when the robot's data ended.",
        ),
        (None, _) => (Tone::Good, "Good", "It measures as it should."),
    };
    let nominal = info.and_then(|info| info.rate_hz);
    let last_seen = status.age_ms.map_or_else(
        || "never".to_owned(),
        |ms| {
            let before = Duration::from_millis(ms.into());
            match data_state {
                DataState::Ended => DataAge::BeforeEnd(before).words(),
                DataState::Live | DataState::Silent => {
                    format!("{} ago", age(before.saturating_add(since_update)))
                }
            }
        },
    );
    SensorLine {
        tone,
        state: state.to_owned(),
        advice,
        name: status.name.clone(),
        kind: kind.map_or("–", kind_label),
        rate: rate(status.rate_hz, nominal),
        last_seen,
        dropped: count(status.dropped),
    }
}

fn rate(rate_hz: f32, nominal_hz: Option<f32>) -> String {
    match nominal_hz {
        Some(nominal_hz) => format!("{rate_hz:.1} of {nominal_hz:.0} Hz"),
        None => format!("{rate_hz:.1} Hz"),
    }
}

pub fn fault_text(
    fault: SensorFault,
    kind: Option<SensorKind>,
) -> (Tone, &'static str, &'static str) {
    let (state, advice) = match fault {
        SensorFault::Silent => (
            "Silent",
            "It sends no data. Check its power, its cable and its driver.",
        ),
        SensorFault::Clock => (
            "Clock jump",
            "Its stamps jumped: its data may be mapped in the wrong place.",
        ),
        SensorFault::AllInvalid if kind == Some(SensorKind::SatelliteReceiver) => (
            "No fix",
            "It receives too few satellites: the position is unknown.",
        ),
        SensorFault::AllInvalid if kind == Some(SensorKind::Sonar) => (
            "Sees nothing",
            "None of its measurements is valid. It is nearer to the bottom than it measures, covered or broken.",
        ),
        SensorFault::AllInvalid => (
            "Sees nothing",
            "None of its measurements is valid. It is covered, dirty or broken.",
        ),
        SensorFault::Blocked => (
            "Blocked",
            "It has no return where it had one just now. Check its window for dirt or a cover.",
        ),
        SensorFault::Slow => (
            "Slow",
            "Less than half of its measurements come. Look at its driver and the vehicle's load.",
        ),
    };
    (Tone::Warning, state, advice)
}

pub const fn kind_label(kind: SensorKind) -> &'static str {
    match kind {
        SensorKind::PlanarLaser => "Laser",
        SensorKind::TiltingLaser => "Tilting laser",
        SensorKind::Sonar => "Sonar",
        SensorKind::WheelEncoders => "Wheel encoders",
        SensorKind::Attitude => "Attitude",
        SensorKind::SatelliteReceiver => "Satellite receiver",
        SensorKind::Odometry => "Odometry",
        SensorKind::Transforms => "Transforms",
        SensorKind::TiltEncoder => "Tilt encoder",
        SensorKind::Ultrasonic => "Ultrasonic",
        SensorKind::Bumper => "Bumper",
        SensorKind::Lidar => "Lidar",
    }
}

pub fn sensors_ui(ui: &mut Ui, data: &SensorsData) {
    if let Some(note) = &data.note {
        ui.strong(note);
    }
    let is_narrow = ui.available_width() < NARROW;
    ScrollArea::both()
        .id_salt("sensors")
        .auto_shrink([false, true])
        .show(ui, |ui| {
            if is_narrow {
                data.sensors
                    .iter()
                    .for_each(|line| narrow_sensor_ui(ui, line));
                data.devices
                    .iter()
                    .for_each(|line| narrow_device_ui(ui, line));
                return;
            }
            if !data.sensors.is_empty() {
                table(ui, "sensors", &HEADINGS, &data.sensors, sensor_ui);
            }
            if !data.devices.is_empty() {
                ui.separator();
                table(ui, "devices", &DEVICE_HEADINGS, &data.devices, device_ui);
            }
        });
}

fn table<T>(
    ui: &mut Ui,
    id: &str,
    headings: &[(&str, &str)],
    lines: &[T],
    line_ui: fn(&mut Ui, &T),
) {
    Grid::new(id)
        .num_columns(headings.len())
        .min_row_height(22.0)
        .spacing([18.0, 4.0])
        .show(ui, |ui| {
            for (heading, hint) in headings {
                let weak = ui.visuals().weak_text_color();
                ui.label(RichText::new(*heading).small().color(weak))
                    .on_hover_text(*hint);
            }
            ui.end_row();
            for line in lines {
                line_ui(ui, line);
                ui.end_row();
            }
        });
}

const DEVICE_HEADINGS: [(&str, &str); 8] = [
    ("State", "The robot's connection with the device"),
    ("Device", "Its name in the vehicle's configuration"),
    ("Rate", "Measurements a second over the last second"),
    ("Last seen", "When its last measurement came"),
    (
        "Reconnects",
        "Connections that ended after it had measured, since the robot started",
    ),
    (
        "Clock",
        "What its clock lacks of the robot's, and the delay of its slowest recent message",
    ),
    (
        "Lost",
        "What was received and not used: damaged, late or repeated",
    ),
    ("Identity", "Which device it says it is"),
];

fn device_ui(ui: &mut Ui, device: &DeviceLine) {
    device_state_ui(ui, device);
    for text in [
        &device.name,
        &device.rate,
        &device.last_seen,
        &device.reconnects,
        &device.clock,
        &device.lost,
        &device.identity,
    ] {
        ui.add(Label::new(text).extend());
    }
}

fn device_state_ui(ui: &mut Ui, device: &DeviceLine) {
    let state = ui.scope(|ui| state_ui(ui, device.tone, device.state, 15.0));
    state.response.on_hover_text(match device.trouble.as_str() {
        "" => "The robot is connected with it.",
        trouble => trouble,
    });
}

/// Two lines: name and state, then the trouble or values.
fn narrow_device_ui(ui: &mut Ui, device: &DeviceLine) {
    let weak = ui.visuals().weak_text_color();
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        ui.spacing_mut().interact_size.y = 0.0;
        ui.horizontal_wrapped(|ui| {
            device_state_ui(ui, device);
            let name = Label::new(RichText::new(&device.name).strong());
            ui.add(name).on_hover_text(&device.identity);
        });
        let values = format!(
            "{}, seen {}, {} reconnects, clock {}",
            device.rate, device.last_seen, device.reconnects, device.clock
        );
        let text = if device.trouble.is_empty() {
            &values
        } else {
            &device.trouble
        };
        ui.add(Label::new(RichText::new(text).small().color(weak)).wrap());
    });
}

const HEADINGS: [(&str, &str); 6] = [
    ("State", "How the sensor is"),
    ("Sensor", "Its name in the vehicle's configuration"),
    ("Kind", "What it is"),
    (
        "Rate",
        "Measurements a second over the last 5 s, and how many it should make",
    ),
    ("Last seen", "When its last measurement came"),
    (
        "Messages dropped",
        "Scans, positions and turns of wheels that could not be used since the robot started. Losses counts single beams, \
         too",
    ),
];

/// Two lines: name and state, then values. Zero drops are omitted.
fn narrow_sensor_ui(ui: &mut Ui, sensor: &SensorLine) {
    let weak = ui.visuals().weak_text_color();
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        ui.spacing_mut().interact_size.y = 0.0;
        ui.horizontal_wrapped(|ui| {
            ui.scope(|ui| state_ui(ui, sensor.tone, &sensor.state, 15.0))
                .response
                .on_hover_text(sensor.advice);
            let name = Label::new(RichText::new(&sensor.name).strong());
            ui.add(name).on_hover_text(sensor.kind);
        });
        ui.horizontal_wrapped(|ui| {
            for (words, hint) in sensor.figures() {
                ui.label(RichText::new(words).small().color(weak))
                    .on_hover_text(hint);
            }
        });
    });
}

impl SensorLine {
    fn figures(&self) -> Vec<(String, &'static str)> {
        let [_, _, _, (_, rate), (_, seen), (_, dropped)] = HEADINGS;
        let mut figures = vec![
            (format!("{},", self.rate), rate),
            (format!("seen {}", self.last_seen), seen),
        ];
        if self.dropped != "0" {
            figures[1].0.push(',');
            let what = if self.dropped == "1" {
                "message"
            } else {
                "messages"
            };
            figures.push((format!("{} {what} dropped", self.dropped), dropped));
        }
        figures
    }
}

fn sensor_ui(ui: &mut Ui, sensor: &SensorLine) {
    ui.scope(|ui| state_ui(ui, sensor.tone, &sensor.state, 15.0))
        .response
        .on_hover_text(sensor.advice);
    for text in [
        &sensor.name,
        sensor.kind,
        &sensor.rate,
        &sensor.last_seen,
        &sensor.dropped,
    ] {
        ui.add(Label::new(text).extend());
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;
    use protocol::keys::Topic;
    use protocol::message::{DeviceClock, Info, Status};

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
                line.tone,
                line.state,
                line.name,
                line.kind,
                line.rate,
                line.last_seen,
                line.dropped
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
    fn device_states() {
        let device = |name: &str, state, trouble: &str| DeviceStatus {
            name: name.to_owned(),
            state,
            trouble: trouble.to_owned(),
            identity: "LMS111".to_owned(),
            rate_hz: 25.04,
            age_ms: Some(40),
            reconnects: 2,
            lost: 1234,
            clock: Some(DeviceClock {
                offset_s: -1.25,
                spread_s: 0.0125,
                resets: 1,
            }),
        };
        let reported = Status {
            devices: vec![
                device("laser", DeviceState::Measuring, ""),
                device("imu", DeviceState::Configuring, "no reply"),
                DeviceStatus {
                    age_ms: None,
                    clock: None,
                    ..device("gps", DeviceState::Connecting, "nothing answers")
                },
            ],
            ..Status::default()
        };
        let mut model = scout();
        inject(&mut model, Topic::Status, &reported, at(1_000));
        let data = SensorsData::new(&model, at(1_100));
        let lines: Vec<_> = data
            .devices
            .iter()
            .map(|line| {
                [
                    line.state,
                    &line.name,
                    &line.trouble,
                    &line.rate,
                    &line.last_seen,
                    &line.reconnects,
                    &line.clock,
                    &line.lost,
                ]
                .join(" | ")
            })
            .collect();
        assert_eq!(
            lines,
            [
                "Measuring | laser |  | 25.0 Hz | 0.0 s ago | 2 | -1.250 s, late by up to 12 ms | 1\u{a0}234",
                "Starting | imu | no reply | 25.0 Hz | 0.0 s ago | 2 | -1.250 s, late by up to 12 ms | 1\u{a0}234",
                "Not connected | gps | nothing answers | 25.0 Hz | never | 2 | – | 1\u{a0}234",
            ]
        );
        let silent = SensorsData::new(&model, at(6_000));
        assert_eq!(silent.devices[0].state, "Was measuring");
        for (width, labels) in [
            (300.0, ["laser", "nothing answers"]),
            (900.0, ["Reconnects", "LMS111"]),
        ] {
            let data = SensorsData::new(&model, at(1_100));
            let mut panel = Harness::builder()
                .with_size(vec2(width, 400.0))
                .build_ui(move |ui| sensors_ui(ui, &data));
            panel.run_steps(3);
            for label in labels {
                assert!(
                    panel.query_all_by_label(label).next().is_some(),
                    "{width}, {label}"
                );
            }
        }
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
}
