//! Active and past alerts, and their acknowledgement.

use eframe::egui::{Align, Button, Layout, RichText, Ui};
use measurement::time::Monotonic;
use protocol::keys::RobotId;

use super::formatting::age;
use crate::alerts::{Alarm, FleetAlerts};
use crate::command::Command;
use crate::shortcuts::Action;
use crate::theme::{Tone, long_state_ui};

/// Below this width the buttons are below the text, points.
const NARROW: f32 = 300.0;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlertsData {
    pub lines: Vec<AlertLine>,
    pub unacknowledged: usize,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlertLine {
    pub robot: RobotId,
    pub alarm: Alarm,
    pub text: String,
    pub detail: String,
    pub is_active: bool,
    pub is_acknowledged: bool,
}

impl AlertsData {
    pub fn new(alerts: &FleetAlerts, now: Monotonic) -> Self {
        let lines = alerts.iter().map(|(robot, alert)| {
            let is_shown = alerts.shows(robot);
            let since = age(now.since(alert.since));
            let lasts = match (alert.is_active, is_shown) {
                (true, true) => "still active",
                // Most robots that are not shown send no alert state.
                (true, false) => "still active at last contact",
                (false, _) => "over",
            };
            let times = match alert.times {
                1 => String::new(),
                times => format!(", {times} times"),
            };
            AlertLine {
                robot: robot.clone(),
                alarm: alert.alarm.clone(),
                text: if is_shown {
                    alert.text.clone()
                } else {
                    format!("{robot}: {}", alert.text)
                },
                detail: format!("{since} ago{times}, {lasts}"),
                is_active: alert.is_active,
                is_acknowledged: alert.is_acknowledged,
            }
        });
        Self {
            lines: lines.collect(),
            unacknowledged: alerts.unacknowledged(),
        }
    }
}

pub fn alerts_ui(ui: &mut Ui, data: &AlertsData) -> Option<Command> {
    let mut command = None;
    if data.lines.is_empty() {
        ui.label("No alerts.");
        return None;
    }
    ui.horizontal(|ui| {
        let is_any = data.unacknowledged > 0;
        let button = ui.add_enabled(is_any, Button::new("Acknowledge all"));
        let keys = Action::AcknowledgeAll.keys();
        if button
            .on_hover_text(format!("You have seen them ({keys})"))
            .clicked()
        {
            command = Some(Command::AcknowledgeAll);
        }
    });
    for line in &data.lines {
        ui.separator();
        if ui.available_width() < NARROW {
            alert_text_ui(ui, line);
            command = command.take().or(acknowledge_ui(ui, line));
        } else {
            // The button is laid out first, so that the text wraps.
            ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
                command = command.take().or(acknowledge_ui(ui, line));
                ui.with_layout(Layout::top_down(Align::Min), |ui| alert_text_ui(ui, line));
            });
        }
    }
    command
}

fn alert_text_ui(ui: &mut Ui, line: &AlertLine) {
    let tone = match (line.is_active, line.is_acknowledged) {
        (_, false) => Tone::Warning,
        (true, true) => Tone::Waiting,
        (false, true) => Tone::Good,
    };
    long_state_ui(ui, tone, &line.text, 15.0);
    ui.label(RichText::new(&line.detail).small().weak());
}

fn acknowledge_ui(ui: &mut Ui, line: &AlertLine) -> Option<Command> {
    if line.is_acknowledged {
        ui.weak("Acknowledged");
        return None;
    }
    let button = ui.button("Acknowledge");
    let is_seen = button.on_hover_text("You have seen this alert").clicked();
    is_seen.then(|| Command::Acknowledge(line.robot.clone(), line.alarm.clone()))
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use protocol::keys::Topic;
    use protocol::message::Status;

    use super::*;
    use crate::alerts::AlertSource;
    use crate::test_support::{at, console, inject};

    #[test]
    fn alerts_of_other_robots_have_their_name() {
        let mut model = console("boat", &[]);
        inject(&mut model, Topic::Status, &Status::default(), at(0));
        let [boat, scout] = ["boat", "scout"].map(|name| name.parse().unwrap());
        let mut alerts = FleetAlerts::default();
        alerts.change_to(&boat, at(0));
        let shown = alerts.shown_mut().unwrap();
        assert_eq!(
            shown
                .update(&model, AlertSource::Robot, &[], at(4_000))
                .len(),
            1
        );
        let listed = |alerts: &FleetAlerts| {
            let data = AlertsData::new(alerts, at(9_000));
            let lines = data.lines.into_iter();
            let texts = lines
                .map(|line| [line.text, line.detail])
                .collect::<Vec<_>>();
            (data.unacknowledged, texts)
        };
        let silent = "No data from the robot";
        let line = [silent, "5.0 s ago, still active"].map(str::to_owned);
        assert_eq!(listed(&alerts), (1, vec![line]));
        alerts.change_to(&scout, at(5_000));
        let [text, detail] = [
            "boat: No data from the robot",
            "5.0 s ago, still active at last contact",
        ];
        let line = [text, detail].map(str::to_owned);
        assert_eq!(listed(&alerts), (1, vec![line]));

        let data = AlertsData::new(&alerts, at(9_000));
        let mut window = Harness::builder()
            .with_size(vec2(340.0, 300.0))
            .build_ui_state(
                move |ui, command: &mut Option<Command>| {
                    *command = command.take().or(alerts_ui(ui, &data));
                },
                None,
            );
        window.get_by_label("Acknowledge").click();
        window.run_steps(2);
        let command = window.state_mut().take();
        assert_eq!(command, Some(Command::Acknowledge(boat, Alarm::LinkLost)));
    }
}
