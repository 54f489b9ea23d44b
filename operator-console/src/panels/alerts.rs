//! What wants somebody's attention, and the buttons that say it was seen.

use eframe::egui::{Align, Button, Layout, RichText, Ui};
use robot_edge::clock::Monotonic;

use super::wording::age;
use crate::alerts::{Alarm, Alerts};
use crate::command::Command;
use crate::shortcuts::Action;
use crate::theme::{Tone, long_state_ui};

/// What the panel shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlertsData {
    /// The newest first.
    pub lines: Vec<AlertLine>,
    /// How many nobody has seen.
    pub unseen: usize,
}

/// One alert.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlertLine {
    /// Which.
    pub alarm: Alarm,
    /// What it is about.
    pub text: String,
    /// Since when, how often, whether it lasts.
    pub detail: String,
    /// Whether its reason lasts.
    pub is_active: bool,
    /// Whether somebody has said that they have seen it.
    pub is_acknowledged: bool,
}

impl AlertsData {
    /// The alerts at `now`.
    pub fn new(alerts: &Alerts, now: Monotonic) -> Self {
        let lines = alerts.iter().map(|alert| {
            let since = age(now.since(alert.since));
            let lasts = if alert.is_active { "still so" } else { "over" };
            let times = match alert.times {
                1 => String::new(),
                times => format!(", {times} times"),
            };
            AlertLine {
                alarm: alert.alarm.clone(),
                text: alert.text.clone(),
                detail: format!("{since} ago{times}, {lasts}"),
                is_active: alert.is_active,
                is_acknowledged: alert.is_acknowledged,
            }
        });
        Self {
            lines: lines.collect(),
            unseen: alerts.unseen(),
        }
    }
}

/// Draws the panel.
pub fn alerts_ui(ui: &mut Ui, data: &AlertsData) -> Option<Command> {
    let mut command = None;
    if data.lines.is_empty() {
        ui.label("No alerts.");
        return None;
    }
    ui.horizontal(|ui| {
        let is_any = data.unseen > 0;
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
        // The button first: words give way to it, not it to words.
        ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
            let tone = match (line.is_active, line.is_acknowledged) {
                (_, false) => Tone::Warning,
                (true, true) => Tone::Waiting,
                (false, true) => Tone::Good,
            };
            if line.is_acknowledged {
                ui.weak("Acknowledged");
            } else if ui.button("Acknowledge").clicked() {
                command = Some(Command::Acknowledge(line.alarm.clone()));
            }
            ui.with_layout(Layout::top_down(Align::Min), |ui| {
                long_state_ui(ui, tone, &line.text, 15.0);
                ui.label(RichText::new(&line.detail).small().weak());
            });
        });
    }
    command
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn in_a_narrow_panel_words_give_way_to_the_button() {
        const WIDTH: f32 = 240.0;
        let data = AlertsData {
            lines: vec![AlertLine {
                alarm: Alarm::EStop,
                text: "laser: Silent. Nothing comes from it. Look at its power and its cable."
                    .to_owned(),
                detail: "12 s ago, 2 times, still so".to_owned(),
                is_active: true,
                is_acknowledged: false,
            }],
            unseen: 1,
        };
        let words = data.lines[0].text.clone();
        let mut window = Harness::builder()
            .with_size(vec2(WIDTH, 300.0))
            .build_ui(move |ui| {
                alerts_ui(ui, &data);
            });
        window.run_steps(2);
        let button = window.get_by_label("Acknowledge").rect();
        let words = window.get_by_label(&words).rect();
        assert!(button.right() <= WIDTH, "{button}");
        assert!(words.right() <= button.left(), "{words} {button}");
        assert!(words.bottom() < 200.0, "{words}");
    }
}
