//! Driving: control lease, vehicle state, speed limits and the emergency stop.

mod data;
pub mod labels;
mod limits;
mod widgets;

use eframe::egui::{
    Button, CollapsingHeader, Color32, DragValue, Label, RichText, ScrollArea, TextStyle, Ui,
};
use protocol::message::{Setting, Settings};

pub use data::{DrivingData, EStopButton, LeaseButtons};
pub(crate) use limits::is_stopped_by_monitor;
pub(crate) use widgets::disabled_ui;

use super::rows::{rows_ui, toned_rows_ui};
use crate::command::Command;
use crate::teleop_client::Intent;
use crate::theme::{Tone, state_ui};

/// Font size of the headline as a share of the panel's width.
const HEADLINE_SHARE: f32 = 0.09;
const BUDGET_KBPS: std::ops::RangeInclusive<u32> = 1..=1_000_000;

#[derive(Clone, Debug, Default)]
pub struct DrivingEntry {
    budget_kbps: Option<u32>,
    /// The robot's budget when the number was typed.
    budget_was: u32,
}

/// Draws the panel. The emergency stop is outside the scroll area, so that it never moves.
pub fn driving_ui(ui: &mut Ui, data: &DrivingData, entry: &mut DrivingEntry) -> Option<Command> {
    let stop = widgets::estop_ui(ui, &data.estop, data.is_observer);
    let rest = ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            // The scroll bar's width is always reserved: otherwise the content's height could change with it, and the bar
            // could flicker.
            let bar = ui.spacing().scroll;
            ui.set_max_width(ui.available_width() - bar.bar_inner_margin - bar.bar_width);
            rest_ui(ui, data, entry)
        });
    stop.or(rest.inner).map(Command::Drive)
}

fn rest_ui(ui: &mut Ui, data: &DrivingData, entry: &mut DrivingEntry) -> Option<Intent> {
    let mut intent = None;
    ui.add_space(6.0);
    let headline = (HEADLINE_SHARE * ui.available_width()).clamp(14.0, 24.0);
    let shown = ui.scope(|ui| state_ui(ui, data.tone, &data.headline, headline));
    if let Some(hint) = data.hint {
        shown.response.on_hover_text(hint);
    }
    advice_ui(ui, data.advice.as_deref());
    ui.add_space(2.0);
    ui.label(RichText::new(&data.driver).strong());
    intent = intent.or(widgets::lease_ui(ui, data.lease, data.cannot_take_over));
    if let Some(notice) = &data.notice {
        let warning = Tone::Warning.color(ui.visuals());
        ui.add(Label::new(RichText::new(notice).small().color(warning)).wrap());
    }
    if let Some(who) = &data.handover_request {
        intent = intent.or(widgets::handover_request_ui(ui, who));
    }
    ui.separator();
    intent = intent.or(widgets::step_ui(ui, data.step, data.top_speed_mps));
    for gauge in data.gauges.iter().flatten() {
        widgets::gauge_ui(ui, gauge);
    }
    let clamp = data.clamp.as_deref().unwrap_or(" ");
    let warning = Tone::Warning.color(ui.visuals());
    let color = if limits::is_transient(clamp) {
        ui.visuals().weak_text_color()
    } else {
        warning
    };
    ui.label(RichText::new(clamp).small().color(color));
    ui.separator();
    toned_rows_ui(ui, "driving", &data.rows, &data::hint);
    ui.separator();
    rows_ui(ui, "driving link", &data.link);
    if let Some(settings) = data.settings {
        ui.separator();
        CollapsingHeader::new("Settings of the robot").show(ui, |ui| {
            ui.add_enabled_ui(!data.is_observer, |ui| {
                intent = intent.take().or(settings_ui(ui, settings, entry));
            });
        });
    }
    CollapsingHeader::new("Refused commands").show(ui, |ui| {
        if data.refused.is_empty() {
            ui.label("None");
        }
        rows_ui(ui, "refused commands", &data.refused);
    });
    intent
}

/// Reserves the lines of the longest advice that a key press can cause, so that the buttons below do not move.
fn advice_ui(ui: &mut Ui, advice: Option<&str>) {
    let font = TextStyle::Small.resolve(ui.style());
    let longest = labels::LONGEST_KEY_ADVICE.to_owned();
    let width = ui.available_width();
    let longest = ui.painter().layout(longest, font, Color32::BLACK, width);
    let words = RichText::new(advice.unwrap_or(" ")).small();
    let shown = ui.add(Label::new(words).wrap()).rect.height();
    ui.add_space((longest.size().y - shown).max(0.0));
}

fn settings_ui(ui: &mut Ui, settings: Settings, entry: &mut DrivingEntry) -> Option<Intent> {
    let mut set = None;
    if entry.budget_was != settings.budget_kbps {
        *entry = DrivingEntry {
            budget_kbps: None,
            budget_was: settings.budget_kbps,
        };
    }
    ui.horizontal(|ui| {
        let mut budget_kbps = entry.budget_kbps.unwrap_or(settings.budget_kbps);
        let field = DragValue::new(&mut budget_kbps)
            .range(BUDGET_KBPS)
            .suffix(" kbit/s");
        ui.label("Tiles");
        if ui.add(field).changed() {
            entry.budget_kbps = Some(budget_kbps);
        }
        let is_new = budget_kbps != settings.budget_kbps;
        if ui.add_enabled(is_new, Button::new("Set")).clicked() {
            set = Some(Setting::BudgetKbps(budget_kbps));
        }
    });
    for (name, is_on, to) in [
        (
            "Collision monitor",
            settings.collision_monitor,
            Setting::CollisionMonitor(!settings.collision_monitor),
        ),
        (
            "Recording",
            settings.recording,
            Setting::Recording(!settings.recording),
        ),
    ] {
        let mut shown = is_on;
        // Shows the robot's state. A click only sends a request.
        if ui.checkbox(&mut shown, name).clicked() {
            set = Some(to);
        }
    }
    set.map(Intent::Set)
}

#[cfg(test)]
mod tests;
