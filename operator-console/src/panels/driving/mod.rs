//! Driving: control lease, vehicle state, speed limits and the reset of an emergency stop.

mod data;
pub mod labels;
mod limits;

use eframe::egui::accesskit::{Node, Role};
use eframe::egui::{
    Align, Align2, Button, CollapsingHeader, Color32, DragValue, FontId, Frame, Label, Layout,
    Rect, RectAlign, Response, RichText, ScrollArea, Sense, Stroke, TextStyle, Tooltip, Ui,
    WidgetInfo, pos2, vec2,
};
use protocol::keys::OperatorId;
use protocol::message::{LeaseRequest, Setting, Settings};

use super::rows::{rows_ui, toned_rows_ui};
use crate::command::Command;
use crate::identity::{OBSERVER_HINT, OPERATOR_HINT};
use crate::shortcuts::Action;
use crate::teleop_client::Intent;
use crate::teleop_input::SpeedStep;
use crate::theme::{self, Tone, state_ui};

pub use data::{DrivingData, EStopButton, LeaseButtons};
pub(crate) use limits::is_stopped_by_monitor;

use limits::Gauge;

/// Font size of the headline as a share of the panel's width.
const HEADLINE_SHARE: f32 = 0.09;
const BUDGET_KBPS: std::ops::RangeInclusive<u32> = 1..=1_000_000;

#[derive(Clone, Debug, Default)]
pub struct DrivingEntry {
    budget_kbps: Option<u32>,
    /// The robot's budget when the number was typed.
    budget_was: u32,
}

/// Draws the panel. The reset of an emergency stop is outside the scroll area, so that it is always visible.
pub fn driving_ui(ui: &mut Ui, data: &DrivingData, entry: &mut DrivingEntry) -> Option<Command> {
    let reset = estop_state_ui(ui, &data.estop, data.is_observer);
    let rest = ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            // Always reserved: otherwise the content's height changes with the bar, and the bar flickers.
            let bar = ui.spacing().scroll;
            ui.set_max_width(ui.available_width() - bar.bar_inner_margin - bar.bar_width);
            rest_ui(ui, data, entry)
        });
    reset.or(rest.inner).map(Command::Drive)
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
    if data.driver != data.headline {
        ui.label(RichText::new(&data.driver).strong());
    }
    if let Some((tone, words)) = &data.ahead {
        let color = tone.color(ui.visuals());
        let hint = "The first obstacle on the map straight ahead of the vehicle (a red cross on the map), within 20 m";
        ui.label(RichText::new(words).strong().color(color))
            .on_hover_text(hint);
    }
    intent = intent.or(lease_ui(ui, data.lease, data.cannot_take_over));
    if let Some(notice) = &data.notice {
        let warning = Tone::Warning.color(ui.visuals());
        ui.add(Label::new(RichText::new(notice).small().color(warning)).wrap());
    }
    if let Some(who) = &data.handover_request {
        intent = intent.or(handover_request_ui(ui, who));
    }
    ui.separator();
    intent = intent.or(step_ui(ui, data.step, data.top_speed_mps));
    for gauge in data.gauges.iter().flatten() {
        gauge_ui(ui, gauge);
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
        let shown = CollapsingHeader::new("Settings of the robot").show(ui, |ui| {
            ui.add_enabled_ui(!data.is_observer, |ui| {
                intent = intent.take().or(settings_ui(ui, settings, entry));
            });
        });
        let hint = "Data rate, collision monitor and recording of the robot";
        shown.header_response.on_hover_text(hint);
    }
    let shown = CollapsingHeader::new("Refused commands").show(ui, |ui| {
        if data.refused.is_empty() {
            ui.label("None");
        }
        rows_ui(ui, "refused commands", &data.refused);
    });
    let hint = "Commands that the robot refused, by reason";
    shown.header_response.on_hover_text(hint);
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
        let hint = "Data rate of the map that the robot sends to its consoles";
        if ui.add(field).on_hover_text(hint).changed() {
            entry.budget_kbps = Some(budget_kbps);
        }
        let is_new = budget_kbps != settings.budget_kbps;
        let set_button = ui.add_enabled(is_new, Button::new("Set"));
        let hint = "Send this data rate to the robot";
        if set_button.on_hover_text(hint).clicked() {
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
        let check = ui.checkbox(&mut shown, name);
        if check.on_hover_text("Switch it on the robot").clicked() {
            set = Some(to);
        }
    }
    set.map(Intent::Set)
}

/// Below this panel width the label of the speed steps is above them, points.
const NARROW: f32 = 250.0;
const GAUGE_HEIGHT: f32 = 14.0;
const GAUGE_MARK: f32 = 3.0;
/// Below this panel width the gauge's text is below its name, points.
const GAUGE_NARROW: f32 = 200.0;

/// State and reset of an emergency stop. The button that stops is in the top bar.
fn estop_state_ui(ui: &mut Ui, button: &EStopButton, is_observer: bool) -> Option<Intent> {
    let words = match button {
        EStopButton::Ready | EStopButton::ReadOnly => return None,
        EStopButton::Sending(words) => format!("Sending the emergency stop. {words}"),
        EStopButton::InForce { number, .. } => format!("Emergency stop {number} is active"),
        EStopButton::Refused(why) => format!("The robot does not stop for you: {why}"),
    };
    let warning = Tone::Warning.color(ui.visuals());
    ui.add(Label::new(RichText::new(words).strong().color(warning)).wrap());
    let EStopButton::InForce { number, is_stored } = button else {
        return None;
    };
    let reset = Button::new("Reset e-stop");
    let reset = ui.add_enabled(*is_stored && !is_observer, reset);
    let why_not = if is_observer {
        OBSERVER_HINT
    } else {
        "The emergency stop is not stored yet"
    };
    reset
        .on_hover_text("The vehicle can be driven again, after control is requested")
        .on_disabled_hover_text(why_not)
        .clicked()
        .then_some(Intent::Reset(*number))
}

fn lease_ui(ui: &mut Ui, buttons: LeaseButtons, cannot_take_over: bool) -> Option<Intent> {
    let buttons: &[(&str, Option<&str>, LeaseRequest)] = match buttons {
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
        // No hint: the pointer rests here after "Request control" was pressed, and the hint would cover the panel.
        LeaseButtons::Held => &[("Release control", None, LeaseRequest::Release)],
        LeaseButtons::ReadOnly => {
            disabled_reason_ui(ui, "Request control", OBSERVER_HINT);
            ui.add(Label::new(OBSERVER_HINT).wrap());
            return None;
        }
    };
    let mut asked = None;
    ui.horizontal(|ui| {
        // The same height with and without buttons keeps everything below in place.
        ui.set_min_height(28.0);
        for (label, hint, request) in buttons {
            if cannot_take_over && *request == LeaseRequest::TakeOver {
                disabled_reason_ui(ui, label, OPERATOR_HINT);
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
    Frame::new()
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
                for (label, hint, request) in [
                    (
                        "Hand over",
                        "The vehicle stops, and the other operator has control",
                        LeaseRequest::HandOver(who.clone()),
                    ),
                    (
                        "Keep control",
                        "The other operator gets a refusal",
                        LeaseRequest::Refuse(who.clone()),
                    ),
                ] {
                    if ui.button(label).on_hover_text(hint).clicked() {
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
        let count = f32::from(SpeedStep::COUNT);
        let width = ((ui.available_width() + 3.0) / count - 3.0).clamp(16.0, 26.0);
        ui.spacing_mut().button_padding.x = 4.0;
        let steps: Vec<_> = SpeedStep::all().collect();
        for choice in steps.into_iter().rev() {
            let text = RichText::new(choice.number().to_string());
            let button = Button::selectable(choice == step, text).min_size(vec2(width, 24.0));
            let button = ui.add(button);
            step_hint_ui(&button, choice, top_speed_mps);
            if button.clicked() {
                chosen = Some(Intent::Step(choice));
            }
        }
    });
    chosen
}

/// The hint is above the button, so that it does not cover the speeds below.
fn step_hint_ui(button: &Response, step: SpeedStep, top_speed_mps: f32) {
    let mut words = format!(
        "{}: {:.0} % of its top speed",
        step.number(),
        100.0 * step.share()
    );
    if top_speed_mps > 0.0 {
        words = format!("{words}, {:.2} m/s", step.share() * top_speed_mps);
    }
    let describe = |node: &mut Node| node.set_description(&*words);
    button.ctx.accesskit_node_builder(button.id, describe);
    let mut tooltip = Tooltip::for_enabled(button);
    tooltip.popup = tooltip
        .popup
        .align(RectAlign::TOP_END)
        .align_alternatives(&[RectAlign::TOP, RectAlign::TOP_START]);
    tooltip.show(|ui| ui.label(words));
}

/// Draws a gauge: filled from its middle to the applied speed, with a mark at the requested speed.
fn gauge_ui(ui: &mut Ui, gauge: &Gauge) {
    let weak = ui.visuals().weak_text_color();
    if ui.available_width() < GAUGE_NARROW {
        ui.colored_label(weak, gauge.name);
        ui.label(&gauge.figures);
    } else {
        ui.horizontal(|ui| {
            ui.colored_label(weak, gauge.name);
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                ui.label(&gauge.figures)
            });
        });
    }
    let small = TextStyle::Small.resolve(ui.style());
    let height = GAUGE_HEIGHT + small.size + 4.0;
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), height), Sense::hover());
    let bar = Rect::from_min_size(rect.min, vec2(rect.width(), GAUGE_HEIGHT));
    paint_gauge(ui, bar, gauge);
    paint_gauge_ends(ui, rect, gauge, &small);
}

fn paint_gauge(ui: &Ui, bar: Rect, gauge: &Gauge) {
    let painter = ui.painter();
    painter.rect_filled(bar, 3.0, ui.visuals().extreme_bg_color);
    let middle = bar.center().x;
    let x_of = |speed: f32| {
        let share = if gauge.limit > 0.0 && speed.is_finite() {
            (speed / gauge.limit).clamp(-1.0, 1.0)
        } else {
            0.0
        };
        middle + 0.5 * share * (bar.width() - GAUGE_MARK)
    };
    let tone = if gauge.is_held_back() {
        Tone::Warning
    } else {
        Tone::Good
    };
    let color = tone.color(ui.visuals());
    let ink = ui.visuals().text_color();
    let applied = x_of(gauge.applied);
    let filled = Rect::from_x_y_ranges(middle.min(applied)..=middle.max(applied), bar.y_range());
    painter.rect_filled(filled.shrink2(vec2(0.0, 2.0)), 0.0, color);
    painter.vline(middle, bar.y_range(), Stroke::new(1.0, ink));
    let asked = x_of(gauge.requested);
    painter.vline(asked, bar.y_range(), Stroke::new(GAUGE_MARK, ink));
}

fn paint_gauge_ends(ui: &Ui, rect: Rect, gauge: &Gauge, font: &FontId) {
    let weak = ui.visuals().weak_text_color();
    let [low, high] = gauge.ends;
    for (x, align, text) in [
        (rect.left(), Align2::LEFT_BOTTOM, low),
        (rect.right(), Align2::RIGHT_BOTTOM, high),
    ] {
        ui.painter()
            .text(pos2(x, rect.bottom()), align, text, font.clone(), weak);
    }
}

/// A disabled button with the reason as hover text and in its accessible name.
fn disabled_reason_ui(ui: &mut Ui, label: &str, why: &str) -> Response {
    let shown = ui.add_enabled(false, Button::new(label));
    let name = format!("{label}. {why}");
    shown.widget_info(|| WidgetInfo::labeled(Role::Button, false, &name));
    shown.on_disabled_hover_text(why)
}

#[cfg(test)]
mod tests;
