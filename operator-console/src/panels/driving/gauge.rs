//! A speed as a bar from its middle: filled as far as it is applied, marked where it is asked for.

use eframe::egui::{Align, Align2, FontId, Layout, Rect, Sense, Stroke, TextStyle, Ui, pos2, vec2};

use protocol::message::{TeleopStatus, Velocity};

use crate::panels::formatting::{signed, turn};
use crate::theme::Tone;

const BAR_HEIGHT: f32 = 14.0;
const MARK: f32 = 3.0;
/// Narrower panels have the figures below the name, points.
const LEAST: f32 = 200.0;

/// A speed that is asked for, and the one that is applied.
#[derive(Clone, Debug, PartialEq)]
pub struct Gauge {
    /// What it is.
    pub name: &'static str,
    /// Both speeds in words, with their unit; a dash where nothing is asked for.
    pub figures: String,
    /// What is asked for: m/s, or °/s to the right.
    pub requested: f32,
    /// What the motors are told, the same way.
    pub applied: f32,
    /// The greatest either way.
    pub limit: f32,
    /// Of its figures.
    pub decimals: usize,
    /// The names of its two ends.
    pub ends: [&'static str; 2],
}

impl Gauge {
    /// Whether less is applied than is asked for, or more, and its figures say so: nobody asks why 11 of 11 °/s are not more.
    pub fn is_held_back(&self) -> bool {
        let figure = |speed: f32| signed(f64::from(speed), self.decimals);
        let is_seen = figure(self.applied) != figure(self.requested);
        is_seen && (self.applied - self.requested).abs() > 0.02 * self.limit
    }
}

/// Forwards, and turning; `limits` are m/s and rad/s. Where the vehicle is not driven there are no figures.
pub(super) fn gauges(teleop: &TeleopStatus, limits: [f32; 2], is_driven: bool) -> [Gauge; 2] {
    let [requested, applied] = [teleop.requested, teleop.applied];
    let [speed_mps, turn_rate_radps] = limits;
    let figures = |words: String| if is_driven { words } else { "–".to_owned() };
    // To the left is on the left.
    let to_the_right = |velocity: Velocity| -velocity.angular_radps.to_degrees();
    [
        Gauge {
            name: "Linear speed",
            figures: figures(format!(
                "{} of {} m/s",
                signed(f64::from(applied.linear_mps), 2),
                signed(f64::from(requested.linear_mps), 2)
            )),
            requested: requested.linear_mps,
            applied: applied.linear_mps,
            limit: speed_mps,
            decimals: 2,
            ends: ["back", "forward"],
        },
        Gauge {
            name: "Angular speed",
            figures: figures(turn_of(applied.angular_radps, requested.angular_radps)),
            requested: to_the_right(requested),
            applied: to_the_right(applied),
            limit: turn_rate_radps.to_degrees(),
            decimals: 0,
            ends: ["left", "right"],
        },
    ]
}

/// How fast it turns, of how fast it is to, rad/s to the left. The way is said once where it is the same.
fn turn_of(applied_radps: f32, requested_radps: f32) -> String {
    let [applied, requested] = [applied_radps, requested_radps].map(|radps| turn(f64::from(radps)));
    let (speed, unit) = applied.split_once(' ').unwrap_or((&applied, ""));
    let (_, unit_requested) = requested.split_once(' ').unwrap_or((&requested, ""));
    if unit == unit_requested || speed == "0" {
        format!("{speed} of {requested}")
    } else {
        format!("{applied} of {requested}")
    }
}

/// Draws the gauge and, above it, its figures.
pub(super) fn gauge_ui(ui: &mut Ui, gauge: &Gauge) {
    let weak = ui.visuals().weak_text_color();
    if ui.available_width() < LEAST {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::idle_teleop_status;

    #[test]
    fn what_reads_as_it_was_asked_for_is_not_held_back() {
        // rad/s, of 0.5 at most.
        for (applied, requested, figures, is_held_back) in [
            (0.185, 0.199, "11 of 11 °/s left", false),
            (0.17, 0.199, "10 of 11 °/s left", true),
            (-0.185, 0.199, "11 °/s right of 11 °/s left", true),
        ] {
            let mut teleop = idle_teleop_status();
            teleop.applied.angular_radps = applied;
            teleop.requested.angular_radps = requested;
            let [_, turning] = gauges(&teleop, [1.0, 0.5], true);
            assert_eq!(turning.figures, figures);
            assert_eq!(turning.is_held_back(), is_held_back, "{figures}");
        }
    }

    #[test]
    fn turning_is_said_in_degrees_and_words() {
        for (applied_radps, requested_radps, says) in [
            (0.0, 0.0, "0 of 0 °/s"),
            (0.2, 0.4, "11 of 23 °/s left"),
            (-0.2, -0.4, "11 of 23 °/s right"),
            (0.0, -0.4, "0 of 23 °/s right"),
            (0.001, -0.4, "0 of 23 °/s right"),
            (0.2, 0.0, "11 °/s left of 0 °/s"),
            (-0.2, 0.4, "11 °/s right of 23 °/s left"),
        ] {
            assert_eq!(turn_of(applied_radps, requested_radps), says);
        }
    }
}
