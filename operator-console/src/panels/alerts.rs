//! What wants somebody's attention, and the buttons that say it was seen.

use eframe::egui::{Align, Button, Layout, RichText, Ui};
use robot_edge::clock::Monotonic;

use super::wording::age;
use crate::alerts::{Alarm, Alerts};
use crate::command::Command;
use crate::shortcuts::Action;
use crate::theme::{Tone, long_state_ui};

/// Narrower panels have the buttons below the words, points.
const NARROW: f32 = 300.0;

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
        if ui.available_width() < NARROW {
            words_ui(ui, line);
            command = command.take().or(seen_ui(ui, line));
        } else {
            // The button first: words give way to it, not it to words.
            ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
                command = command.take().or(seen_ui(ui, line));
                ui.with_layout(Layout::top_down(Align::Min), |ui| words_ui(ui, line));
            });
        }
    }
    command
}

fn words_ui(ui: &mut Ui, line: &AlertLine) {
    let tone = match (line.is_active, line.is_acknowledged) {
        (_, false) => Tone::Warning,
        (true, true) => Tone::Waiting,
        (false, true) => Tone::Good,
    };
    long_state_ui(ui, tone, &line.text, 15.0);
    ui.label(RichText::new(&line.detail).small().weak());
}

/// Says that somebody has seen it, or lets somebody say so.
fn seen_ui(ui: &mut Ui, line: &AlertLine) -> Option<Command> {
    if line.is_acknowledged {
        ui.weak("Acknowledged");
        return None;
    }
    let is_seen = ui.button("Acknowledge").clicked();
    is_seen.then(|| Command::Acknowledge(line.alarm.clone()))
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn words_give_way_to_the_button_and_it_to_them_in_a_narrow_panel() {
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
        for width in [180.0, 240.0, 340.0] {
            let data = data.clone();
            let mut window = Harness::builder()
                .with_size(vec2(width, 300.0))
                .build_ui(move |ui| {
                    alerts_ui(ui, &data);
                });
            window.run_steps(2);
            let button = window.get_by_label("Acknowledge").rect();
            let words = window.get_by_label(&words).rect();
            assert!(button.right() <= width && words.right() <= width);
            let is_beside = words.right() <= button.left();
            assert_eq!(is_beside, width > NARROW, "{width}: {words} {button}");
            assert!(is_beside || words.bottom() <= button.top(), "{width}");
            assert!(words.width() > 100.0, "{width}: {words}");
        }
    }
}
