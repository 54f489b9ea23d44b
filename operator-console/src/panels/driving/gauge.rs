//! A speed as a bar from its middle: filled as far as it is applied, marked where it is asked for.

use eframe::egui::{Align, Align2, FontId, Layout, Rect, Sense, Stroke, TextStyle, Ui, pos2, vec2};

use super::data::Gauge;
use crate::panels::wording::signed;
use crate::theme::Tone;

const BAR_HEIGHT: f32 = 14.0;
const MARK: f32 = 3.0;
/// Narrower panels have the figures below the name, points.
const LEAST: f32 = 200.0;

/// Draws the gauge and, above it, its figures.
pub(super) fn gauge_ui(ui: &mut Ui, gauge: &Gauge) {
    let weak = ui.visuals().weak_text_color();
    let figures = format!(
        "{} of {} {}",
        signed(f64::from(gauge.applied), 2),
        signed(f64::from(gauge.requested), 2),
        gauge.unit
    );
    if ui.available_width() < LEAST {
        ui.colored_label(weak, gauge.name);
        ui.label(figures);
    } else {
        ui.horizontal(|ui| {
            ui.colored_label(weak, gauge.name);
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| ui.label(figures));
        });
    }
    let small = TextStyle::Small.resolve(ui.style());
    let height = BAR_HEIGHT + small.size + 4.0;
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), height), Sense::hover());
    let bar = Rect::from_min_size(rect.min, vec2(rect.width(), BAR_HEIGHT));
    paint(ui, bar, gauge);
    ends(ui, rect, gauge, &small);
}

fn paint(ui: &Ui, bar: Rect, gauge: &Gauge) {
    let painter = ui.painter();
    painter.rect_filled(bar, 3.0, ui.visuals().extreme_bg_color);
    let middle = bar.center().x;
    let x_of = |speed: f32| {
        let share = if gauge.limit > 0.0 && speed.is_finite() {
            (speed / gauge.limit).clamp(-1.0, 1.0)
        } else {
            0.0
        };
        middle + 0.5 * share * (bar.width() - MARK)
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
    painter.vline(asked, bar.y_range(), Stroke::new(MARK, ink));
}

fn ends(ui: &Ui, rect: Rect, gauge: &Gauge, font: &FontId) {
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
