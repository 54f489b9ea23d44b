//! The bar that is clicked and dragged.

use eframe::egui::{
    Align2, FontId, Pos2, Rect, Response, Sense, Shape, Stroke, TextStyle, Ui, WidgetInfo, pos2,
    vec2,
};
use measurement::time::RobotDuration;

use super::data::{DrawnMark, TimelineData, clock};
use crate::theme::Tone;

const HEIGHT: f32 = 42.0;
const TRACK: f32 = 8.0;
const HANDLE: f32 = 8.0;
/// A mark that is nearer to the pointer than this is explained.
const NEAR: f32 = 6.0;
/// Times are written at least so far from each other.
const TICKS_APART: f32 = 90.0;
/// Steps between the times that are written, seconds.
const TICKS_S: [f64; 13] = [
    0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0,
];
/// Marks that the tooltip explains at most.
const MAX_EXPLAINED: usize = 6;

/// Where the bar is, and how long it is in seconds.
struct Scale {
    track: Rect,
    length_s: f64,
}

impl Scale {
    fn x(&self, time_s: f64) -> f32 {
        let part = (time_s / self.length_s).clamp(0.0, 1.0);
        self.track.left() + part as f32 * self.track.width()
    }

    fn time_s(&self, x: f32) -> f64 {
        let part = (x - self.track.left()) / self.track.width();
        f64::from(part.clamp(0.0, 1.0)) * self.length_s
    }
}

/// Draws the bar; where to wind to.
pub(super) fn bar_ui(ui: &mut Ui, data: &TimelineData) -> Option<RobotDuration> {
    let width = ui.available_width();
    let (rect, response) = ui.allocate_exact_size(vec2(width, HEIGHT), Sense::click_and_drag());
    // The handle does not reach over the edge.
    let middle = pos2(rect.center().x, rect.top() + 11.0);
    let track = Rect::from_center_size(middle, vec2(width - 2.0 * HANDLE, TRACK));
    let scale = Scale {
        track,
        length_s: data.length_s.filter(|length| *length > 0.0).unwrap_or(1.0),
    };
    let is_enabled = ui.is_enabled();
    response.widget_info(|| {
        let words = match &data.length {
            Some(length) => format!("Position in the recording: {} of {length}", data.position),
            None => "Position in the recording".to_owned(),
        };
        WidgetInfo::slider(is_enabled, data.position_s, words)
    });
    if ui.is_rect_visible(rect) {
        paint(ui, data, &scale, &response);
    }
    let wanted = wanted_s(ui, &response, &scale);
    if is_enabled {
        explain(&response, data, &scale);
    }
    wanted.map(RobotDuration::from_secs_f64)
}

/// Only where the pointer moved: a hand that rests on the bar asks for nothing new.
fn wanted_s(ui: &Ui, response: &Response, scale: &Scale) -> Option<f64> {
    let is_moved = response.dragged() && ui.input(|input| input.pointer.delta() != vec2(0.0, 0.0));
    let is_asked = response.clicked() || response.drag_started() || is_moved;
    let pointer = response.interact_pointer_pos().filter(|_| is_asked)?;
    Some(scale.time_s(pointer.x))
}

fn paint(ui: &Ui, data: &TimelineData, scale: &Scale, response: &Response) {
    let visuals = ui.visuals();
    let painter = ui.painter();
    let track = scale.track;
    let done = visuals.selection.bg_fill;
    painter.rect_filled(track, TRACK / 2.0, visuals.widgets.inactive.bg_fill);
    let at = scale.x(data.position_s);
    let filled = Rect::from_min_max(track.min, pos2(at, track.max.y));
    painter.rect_filled(filled, TRACK / 2.0, done);
    if let Some(target_s) = data.target_s {
        let to = scale.x(target_s);
        let stroke = Stroke::new(2.0, Tone::Waiting.color(visuals));
        painter.line_segment(
            [pos2(at, track.center().y), pos2(to, track.center().y)],
            stroke,
        );
        painter.circle_stroke(pos2(to, track.center().y), HANDLE - 2.0, stroke);
    }
    for mark in &data.marks {
        paint_mark(ui, pos2(scale.x(mark.at_s), track.bottom() + 2.0), mark);
    }
    paint_times(ui, scale);
    let ink = visuals.text_color();
    let stroke = Stroke::new(2.0, visuals.panel_fill);
    painter.circle(pos2(at, track.center().y), HANDLE, ink, stroke);
    if response.has_focus() {
        let around = Stroke::new(2.0, visuals.selection.stroke.color);
        painter.circle_stroke(pos2(at, track.center().y), HANDLE + 2.0, around);
    }
    if let Some(pointer) = response.hover_pos() {
        let line = [track.top() - 4.0, track.bottom() + 4.0].map(|y| pos2(pointer.x, y));
        painter.line_segment(line, Stroke::new(1.0, ink));
    }
}

/// Faults are triangles, the rest are bars: not told by colour alone.
fn paint_mark(ui: &Ui, top: Pos2, mark: &DrawnMark) {
    let tone = if mark.is_fault {
        Tone::Warning
    } else {
        Tone::Waiting
    };
    let color = tone.color(ui.visuals());
    if mark.is_fault {
        let corners = [(0.0, 0.0), (4.5, 8.0), (-4.5, 8.0)].map(|(x, y)| top + vec2(x, y));
        let shape = Shape::convex_polygon(corners.to_vec(), color, Stroke::NONE);
        ui.painter().add(shape);
    } else {
        let bar = Rect::from_min_max(top + vec2(-1.5, 0.0), top + vec2(1.5, 8.0));
        ui.painter().rect_filled(bar, 0.0, color);
    }
}

fn paint_times(ui: &Ui, scale: &Scale) {
    let per_second = f64::from(scale.track.width()) / scale.length_s;
    let wide_enough = |step: &f64| *step * per_second >= f64::from(TICKS_APART);
    let step_s = TICKS_S.into_iter().find(wide_enough).unwrap_or_else(|| {
        let hours = f64::from(TICKS_APART) / per_second / 3600.0;
        3600.0 * libm::ceil(hours)
    });
    let font = FontId::new(
        TextStyle::Small.resolve(ui.style()).size,
        eframe::egui::FontFamily::Proportional,
    );
    let color = ui.visuals().weak_text_color();
    let count = (scale.length_s / step_s) as u32;
    for number in 0..=count {
        let time_s = f64::from(number) * step_s;
        let x = scale.x(time_s);
        let align = match number {
            0 => Align2::LEFT_BOTTOM,
            _ if x > scale.track.right() - 24.0 => Align2::RIGHT_BOTTOM,
            _ => Align2::CENTER_BOTTOM,
        };
        let words = clock(RobotDuration::from_secs_f64(time_s));
        let words = words.strip_suffix(".0").unwrap_or(&words);
        let below = pos2(x, scale.track.bottom() + HEIGHT - 15.0);
        ui.painter().text(below, align, words, font.clone(), color);
    }
}

fn explain(response: &Response, data: &TimelineData, scale: &Scale) {
    let Some(pointer) = response.hover_pos() else {
        return;
    };
    let time = RobotDuration::from_secs_f64(scale.time_s(pointer.x));
    let near = |mark: &&DrawnMark| (scale.x(mark.at_s) - pointer.x).abs() <= NEAR;
    response.clone().on_hover_ui_at_pointer(|ui| {
        ui.strong(clock(time));
        for mark in data.marks.iter().filter(near).take(MAX_EXPLAINED) {
            ui.label(&mark.words);
        }
    });
}
