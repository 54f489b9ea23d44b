//! Driving: who drives, how the vehicle obeys, what holds it back, and the emergency stop.

mod data;
mod figures;
mod gauge;
mod guard;
mod headline;
mod input_hints;
mod keys;
pub mod labels;
mod last_stop;
mod limit_reason;
mod notice;
mod read_only;
mod strictest_limit;
mod unexpected_motion;

use eframe::egui::{
    Align, Button, CollapsingHeader, Color32, DragValue, Label, Layout, RectAlign, Response,
    RichText, ScrollArea, Stroke, TextStyle, Tooltip, Ui, vec2,
};
use protocol::keys::OperatorId;
use protocol::message::{LeaseRequest, Setting, Settings};

pub use data::{DrivingData, EStopButton, LeaseButtons};
pub use gauge::Gauge;
pub(crate) use guard::is_stopped_by_monitor;
pub(crate) use read_only::disabled_ui;

use super::rows::{rows_ui, toned_rows_ui};
use crate::command::Command;
use crate::role::OBSERVER_HINT;
use crate::shortcuts::Action;
use crate::teleop_client::Intent;
use crate::teleop_input::SpeedStep;
use crate::theme::{self, state_ui};

const ESTOP_HEIGHT: f32 = 56.0;
/// Its words stand in one line, or two, however narrow the panel is: their size is this share of its width.
const ESTOP_TEXT_SHARE: f32 = 0.08;
/// The same of the headline.
const HEADLINE_SHARE: f32 = 0.09;
/// Narrower panels have names above what they name, points.
const NARROW: f32 = 250.0;
/// What the robot takes for a budget, kbit/s.
const BUDGET_KBPS: std::ops::RangeInclusive<u32> = 1..=1_000_000;

/// What the panel remembers between frames: numbers that are being typed.
#[derive(Clone, Debug, Default)]
pub struct DrivingEntry {
    budget_kbps: Option<u32>,
    /// The robot's budget when the number was typed.
    budget_was: u32,
}

/// Draws the panel. The emergency stop stays where it is, whatever is scrolled or changes.
pub fn driving_ui(ui: &mut Ui, data: &DrivingData, entry: &mut DrivingEntry) -> Option<Command> {
    let stop = estop_ui(ui, &data.estop, data.is_observer);
    let rest = ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            // The bar lies over what it scrolls. It has its room before it comes as well: what is narrower may be lower,
            // and then the bar would come and go.
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
    intent = intent.or(lease_ui(ui, data.lease, data.cannot_take_over));
    if let Some(notice) = &data.notice {
        let warning = theme::Tone::Warning.color(ui.visuals());
        ui.add(Label::new(RichText::new(notice).small().color(warning)).wrap());
    }
    if let Some(who) = &data.handover_request {
        intent = intent.or(handover_request_ui(ui, who));
    }
    ui.separator();
    intent = intent.or(step_ui(ui, data.step, data.top_speed_mps));
    for gauge in data.gauges.iter().flatten() {
        gauge::gauge_ui(ui, gauge);
    }
    let clamp = data.clamp.as_deref().unwrap_or(" ");
    let warning = theme::Tone::Warning.color(ui.visuals());
    let color = if limit_reason::is_free(clamp) {
        ui.visuals().weak_text_color()
    } else {
        warning
    };
    ui.label(RichText::new(clamp).small().color(color));
    ui.separator();
    toned_rows_ui(ui, "driving", &data.rows, &figures::hint);
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

/// Always there, in as many lines as the longest that a key brings: the buttons below stay under the pointer.
fn advice_ui(ui: &mut Ui, advice: Option<&str>) {
    let font = TextStyle::Small.resolve(ui.style());
    let width = ui.available_width();
    let height = |words: &str| {
        let galley = ui
            .painter()
            .layout(words.to_owned(), font.clone(), Color32::BLACK, width);
        galley.size().y
    };
    let reserved = headline::KEY_ADVICE.into_iter().map(height);
    let reserved = reserved.fold(0.0, f32::max);
    let words = RichText::new(advice.unwrap_or(" ")).small();
    let shown = ui.add(Label::new(words).wrap()).rect.height();
    ui.add_space((reserved - shown).max(0.0));
}

fn estop_ui(ui: &mut Ui, face: &EStopButton, is_observer: bool) -> Option<Intent> {
    let [fill, ink] = theme::DANGER;
    let text_size = (ESTOP_TEXT_SHARE * ui.available_width()).clamp(11.0, 18.0);
    let big = |words: &str, fill: Color32, ink: Color32| {
        let text = RichText::new(words).size(text_size).strong().color(ink);
        Button::new(text)
            .fill(fill)
            .stroke(Stroke::new(2.0, ink))
            .corner_radius(6.0)
    };
    let size = vec2(ui.available_width(), ESTOP_HEIGHT);
    match face {
        EStopButton::Ready => {
            let button = ui.add_sized(size, big("EMERGENCY STOP", fill, ink));
            button
                .on_hover_text("Stops at once, and stays stopped until it is reset (space bar)")
                .clicked()
                .then_some(Intent::EStop)
        }
        EStopButton::Sending(words) => {
            let [fill, ink] = theme::BANNER;
            let words = format!("SENDING STOP\n{words}");
            // It is sent ten times a second: pressing again is what one does, and does no harm.
            let button = ui.add_sized(size, big(&words, fill, ink));
            button.clicked().then_some(Intent::EStop)
        }
        EStopButton::InForce { number, is_stored } => {
            ui.add_sized(
                size,
                big(&format!("EMERGENCY STOP {number} ACTIVE"), ink, fill)
                    .sense(eframe::egui::Sense::hover()),
            );
            let reset = Button::new("Reset e-stop");
            let reset = ui.add_enabled(*is_stored && !is_observer, reset);
            let why_not = if is_observer {
                OBSERVER_HINT
            } else {
                "It is not stored yet"
            };
            reset
                .on_disabled_hover_text(why_not)
                .clicked()
                .then_some(Intent::Reset(*number))
        }
        EStopButton::ReadOnly => {
            read_only::estop_ui(ui, size);
            None
        }
        EStopButton::Refused(why) => {
            let warning = theme::Tone::Warning.color(ui.visuals());
            let words = format!("The robot does not stop for you: {why}");
            ui.label(RichText::new(words).strong().color(warning));
            let button = ui.add_sized(size, big("EMERGENCY STOP", fill, ink));
            button.clicked().then_some(Intent::EStop)
        }
    }
}

fn lease_ui(ui: &mut Ui, face: LeaseButtons, cannot_take_over: bool) -> Option<Intent> {
    let buttons: &[(&str, Option<&str>, LeaseRequest)] = match face {
        LeaseButtons::Quiet => &[],
        LeaseButtons::Free => &[(
            "Request control",
            Some("Request the control lease"),
            LeaseRequest::Request,
        )],
        LeaseButtons::HeldByOther => &[
            (
                "Request handover",
                Some("The operator in control is asked to agree"),
                LeaseRequest::Request,
            ),
            (
                "Take over",
                Some("For supervisors: the vehicle stops, then you have control. It is logged"),
                LeaseRequest::TakeOver,
            ),
        ],
        LeaseButtons::Waiting => &[(
            "Cancel request",
            Some("The operator in control has not agreed yet, or the vehicle still moves"),
            LeaseRequest::Release,
        )],
        // It is where "Request control" was, under a pointer that rests there for the whole drive, and so would be its hint.
        LeaseButtons::Held => &[("Release control", None, LeaseRequest::Release)],
        LeaseButtons::ReadOnly => {
            read_only::lease_ui(ui);
            return None;
        }
    };
    let mut asked = None;
    ui.horizontal(|ui| {
        // As high with buttons as without, so that nothing below moves.
        ui.set_min_height(28.0);
        for (label, hint, request) in buttons {
            if cannot_take_over && *request == LeaseRequest::TakeOver {
                read_only::take_over_ui(ui, label);
                continue;
            }
            let keys = Action::Lease.keys();
            let mut button = ui.button(*label);
            match hint {
                Some(hint) if *request == LeaseRequest::TakeOver => {
                    button = button.on_hover_text(*hint);
                }
                Some(hint) => button = button.on_hover_text(format!("{hint} ({keys})")),
                None => {
                    ui.weak(keys);
                }
            }
            if button.clicked() {
                asked = Some(Intent::Lease(request.clone()));
            }
        }
    });
    asked
}

fn handover_request_ui(ui: &mut Ui, who: &OperatorId) -> Option<Intent> {
    let [fill, ink] = theme::BANNER;
    let mut answer = None;
    eframe::egui::Frame::new()
        .fill(fill)
        .corner_radius(4.0)
        .inner_margin(8.0)
        .show(ui, |ui| {
            ui.set_width(ui.available_width());
            ui.label(
                RichText::new(format!("{who} requests control"))
                    .strong()
                    .color(ink),
            );
            ui.horizontal(|ui| {
                for (label, request) in [
                    ("Hand over", LeaseRequest::HandOver(who.clone())),
                    ("Keep control", LeaseRequest::Refuse(who.clone())),
                ] {
                    if ui.button(label).clicked() {
                        answer = Some(Intent::Lease(request));
                    }
                }
            });
        });
    answer
}

fn step_ui(ui: &mut Ui, step: SpeedStep, top_speed_mps: f32) -> Option<Intent> {
    let weak = ui.visuals().weak_text_color();
    if ui.available_width() < NARROW {
        ui.colored_label(weak, "Keys drive at");
        let row = ui.horizontal(|ui| steps_ui(ui, step, top_speed_mps));
        return row.inner;
    }
    let row = ui.horizontal(|ui| {
        ui.colored_label(weak, "Keys drive at");
        steps_ui(ui, step, top_speed_mps)
    });
    row.inner
}

fn steps_ui(ui: &mut Ui, step: SpeedStep, top_speed_mps: f32) -> Option<Intent> {
    let mut chosen = None;
    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        // As wide as there is room for.
        let count = f32::from(SpeedStep::COUNT);
        let width = ((ui.available_width() + 3.0) / count - 3.0).clamp(16.0, 26.0);
        ui.spacing_mut().button_padding.x = 4.0;
        let steps: Vec<_> = SpeedStep::all().collect();
        for of in steps.into_iter().rev() {
            let text = RichText::new(of.number().to_string());
            let button = Button::selectable(of == step, text).min_size(vec2(width, 24.0));
            let button = ui.add(button);
            step_hint_ui(&button, of, top_speed_mps);
            if button.clicked() {
                chosen = Some(Intent::Step(of));
            }
        }
    });
    chosen
}

/// Above the step: below it are the speeds that it is chosen for.
fn step_hint_ui(button: &Response, step: SpeedStep, top_speed_mps: f32) {
    let mut words = format!(
        "{}: {:.0} % of its top speed",
        step.number(),
        100.0 * step.share()
    );
    if top_speed_mps > 0.0 {
        words = format!("{words}, {:.2} m/s", step.share() * top_speed_mps);
    }
    let mut tooltip = Tooltip::for_enabled(button);
    tooltip.popup = tooltip
        .popup
        .align(RectAlign::TOP_END)
        .align_alternatives(&[RectAlign::TOP, RectAlign::TOP_START]);
    tooltip.show(|ui| ui.label(words));
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
        // What is shown is what the robot says; a click only asks.
        if ui.checkbox(&mut shown, name).clicked() {
            set = Some(to);
        }
    }
    set.map(Intent::Set)
}

#[cfg(test)]
mod tests;
