//! Timeline of a recording: position, events, seeking and speed.

use edge::pacer::Rate;
use edge::replay_control::{ReplayState, ReplayStatus, TimelineMark};
use edge::runtime::choice::Choice;
use eframe::egui::{
    Align, Align2, Button, ComboBox, FontId, Layout, Pos2, Rect, Response, RichText, Sense, Shape,
    Stroke, TextStyle, Ui, WidgetInfo, pos2, vec2,
};
use measurement::time::RobotDuration;

use super::formatting::with_monospace_options;
use crate::event_log::kind_label;
use crate::playback::{Failure, PlaybackCommand, RATES, is_playing};
use crate::shortcuts::Action;
use crate::theme::{Tone, state_ui};

/// Fixed widths, so that nothing moves when a text changes.
const PLAY_WIDTH: f32 = 64.0;
const NARROW: f32 = 900.0;

pub fn timeline_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    if let Some(failure) = &data.failure {
        return failure_ui(ui, data, failure);
    }
    let is_narrow = ui.available_width() < NARROW;
    let mut command = None;
    ui.horizontal(|ui| {
        command = controls_ui(ui, data);
        if !is_narrow {
            command = command.or(state_and_close_ui(ui, data));
        }
    });
    if is_narrow {
        let asked = ui.horizontal(|ui| state_and_close_ui(ui, data)).inner;
        command = command.or(asked);
    }
    ui.add_enabled_ui(data.length_s.is_some(), |ui| {
        if let Some(to) = bar_ui(ui, data) {
            command = Some(PlaybackCommand::Seek(to));
        }
    });
    command
}

fn failure_ui(ui: &mut Ui, data: &TimelineData, failure: &Failure) -> Option<PlaybackCommand> {
    let (tone, headline) = if failure.choices.is_empty() {
        (Tone::Warning, "cannot be shown")
    } else {
        (Tone::Waiting, "needs a choice")
    };
    ui.horizontal(|ui| {
        state_ui(ui, tone, &format!("{} {headline}", data.name), 16.0);
        ui.with_layout(Layout::right_to_left(Align::Center), close_ui)
            .inner
    })
    .inner
    .or_else(|| {
        let ink = ui.visuals().text_color();
        let text = with_monospace_options(ui, &failure.text, &TextStyle::Body, ink);
        ui.label(text);
        let choices = failure.choices.iter().enumerate();
        ui.horizontal_wrapped(|ui| {
            let choose = |(n, choice): (usize, &Choice)| {
                let hint = "Opens the recording again with this choice";
                let button = ui.button(&choice.label).on_hover_text(hint);
                button.clicked().then_some(PlaybackCommand::Choose(n))
            };
            // `last`: every button is drawn.
            choices.filter_map(choose).last()
        })
        .inner
    })
}

fn controls_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    let command = transport_ui(ui, data);
    position_ui(ui, data);
    let command = command.or(rate_ui(ui, data));
    command.or(looping_ui(ui, data))
}

/// The state takes the rest of the row, so that nothing moves when it changes.
fn state_and_close_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    let right = Layout::right_to_left(Align::Center);
    ui.with_layout(right, |ui| {
        let closed = close_ui(ui);
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            state_ui(ui, data.tone, &data.state, 15.0);
        });
        closed
    })
    .inner
}

fn transport_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    let row = ui.add_enabled_ui(!data.is_opening, |ui| {
        let back = step_ui(ui, "−10 s", Action::JumpBack, -10);
        let back = back.or(step_ui(ui, "−1 s", Action::StepBack, -1));
        let played = back.or(play_ui(ui, data.is_playing));
        let on = played.or(step_ui(ui, "+1 s", Action::StepForward, 1));
        on.or(step_ui(ui, "+10 s", Action::JumpForward, 10))
    });
    row.inner
}

fn step_ui(ui: &mut Ui, label: &str, action: Action, by_s: i64) -> Option<PlaybackCommand> {
    let step = ui.button(label).on_hover_text(tip(action));
    let by = RobotDuration::from_millis(1000 * by_s);
    step.clicked().then_some(PlaybackCommand::Step(by))
}

fn play_ui(ui: &mut Ui, is_playing: bool) -> Option<PlaybackCommand> {
    let (words, request) = if is_playing {
        ("Pause", PlaybackCommand::Pause)
    } else {
        ("Play", PlaybackCommand::Play)
    };
    let size = vec2(PLAY_WIDTH, ui.spacing().interact_size.y);
    let play = Button::new(RichText::new(words).strong()).min_size(size);
    let hint = format!("{words} ({})", Action::PlayOrPause.keys());
    let play = ui.add(play).on_hover_text(hint);
    play.clicked().then_some(request)
}

fn tip(action: Action) -> String {
    format!("{} ({})", action.words(), action.keys())
}

fn position_ui(ui: &mut Ui, data: &TimelineData) {
    let words = match &data.length {
        Some(length) => format!("{} / {length}", data.position),
        None => data.position.clone(),
    };
    ui.label(RichText::new(words).monospace().strong())
        .on_hover_text("Time of the data since the first scan, and how long the recording is");
}

fn rate_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    let mut chosen = data.rate;
    let combo = ComboBox::from_id_salt("speed")
        .selected_text(format!("Speed {}", rate_text(data.rate)))
        .width(104.0)
        .show_ui(ui, |ui| {
            for rate in RATES {
                ui.selectable_value(&mut chosen, rate, rate_text(rate));
            }
        });
    combo.response.on_hover_text(format!(
        "{}, {}; max is as fast as it can be mapped",
        tip(Action::Slower),
        tip(Action::Faster)
    ));
    (chosen != data.rate).then_some(PlaybackCommand::SetRate(chosen))
}

fn looping_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    let mut is_looping = data.is_looping;
    let loops = ui.checkbox(&mut is_looping, "Loop");
    loops
        .on_hover_text(tip(Action::Loop))
        .changed()
        .then_some(PlaybackCommand::SetLooping(is_looping))
}

fn close_ui(ui: &mut Ui) -> Option<PlaybackCommand> {
    ui.button("Close recording")
        .on_hover_text("Close the recording and look for robots")
        .clicked()
        .then_some(PlaybackCommand::Close)
}

const HEIGHT: f32 = 42.0;
const TRACK: f32 = 8.0;
const HANDLE: f32 = 8.0;
/// Marks within this distance of the pointer are explained.
const NEAR: f32 = 6.0;
const TICKS_APART: f32 = 90.0;
const TICKS_S: [f64; 13] = [
    0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0,
];
const MAX_EXPLAINED: usize = 6;

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

fn bar_ui(ui: &mut Ui, data: &TimelineData) -> Option<RobotDuration> {
    let width = ui.available_width();
    let (rect, response) = ui.allocate_exact_size(vec2(width, HEIGHT), Sense::click_and_drag());
    // The handle stays within the edges.
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

/// A resting pointer requests no new seek.
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

/// Faults are triangles, other events are bars, so that they do not differ by colour alone.
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

/// A speed below this share of the requested one is shown.
const NEARLY_REACHED: f64 = 0.9;

#[derive(Clone, Debug, PartialEq)]
pub struct TimelineData {
    pub name: String,
    pub failure: Option<Failure>,
    pub tone: Tone,
    pub state: String,
    pub is_opening: bool,
    pub is_playing: bool,
    pub position_s: f64,
    pub position: String,
    pub target_s: Option<f64>,
    pub length_s: Option<f64>,
    pub length: Option<String>,
    pub rate: Rate,
    pub is_looping: bool,
    pub marks: Vec<DrawnMark>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct DrawnMark {
    pub at_s: f64,
    pub is_fault: bool,
    pub words: String,
}

impl TimelineData {
    pub fn new(name: &str, status: &ReplayStatus, failure: Option<&Failure>) -> Self {
        let (tone, state) = state(name, status);
        let known_length = status.length.filter(|_| !status.has_no_clock);
        let target = match status.state {
            ReplayState::Seeking { to } => Some(to),
            _ => None,
        };
        Self {
            name: name.to_owned(),
            failure: failure.cloned(),
            tone,
            state,
            is_opening: status.state == ReplayState::Opening,
            is_playing: is_playing(status),
            position_s: status.position.as_secs_f64(),
            position: clock(status.position),
            target_s: target.map(RobotDuration::as_secs_f64),
            // A position beyond an estimated end is exact.
            length_s: known_length.map(|length| length.duration.max(status.position).as_secs_f64()),
            length: known_length.map(|length| {
                let words = clock(length.duration.max(status.position));
                if length.is_estimate {
                    format!("about {words}")
                } else {
                    words
                }
            }),
            rate: status.rate,
            is_looping: status.is_looping,
            marks: status.marks.iter().map(mark).collect(),
        }
    }
}

fn state(name: &str, status: &ReplayStatus) -> (Tone, String) {
    match status.state {
        ReplayState::Playing | ReplayState::Paused | ReplayState::Ended if status.has_no_clock => {
            let words = "Its clock cannot be used: scans are mapped in the order of the file";
            (Tone::Warning, words.to_owned())
        }
        ReplayState::Opening => (Tone::Waiting, format!("Looking through {name}")),
        ReplayState::Paused => (Tone::Waiting, "Paused".to_owned()),
        ReplayState::Ended => (Tone::Waiting, "At the end".to_owned()),
        ReplayState::Seeking { to } => {
            let words = format!("Mapping up to {}", clock(to));
            (Tone::Waiting, with_speed(words, status.rate_reached))
        }
        ReplayState::Playing => match (status.rate, status.rate_reached) {
            (Rate::Max, reached) => (Tone::Good, with_speed("Playing".to_owned(), reached)),
            (Rate::Times(wanted), Some(reached)) if reached < NEARLY_REACHED * wanted => (
                Tone::Warning,
                format!("Only {} of {} reached", rounded(reached), times(wanted)),
            ),
            (Rate::Times(_), _) => (Tone::Good, "Playing".to_owned()),
        },
    }
}

fn with_speed(words: String, reached: Option<f64>) -> String {
    match reached {
        Some(reached) => format!("{words} at {}", rounded(reached)),
        None => words,
    }
}

fn mark(mark: &TimelineMark) -> DrawnMark {
    let kind = kind_label(mark.kind);
    DrawnMark {
        at_s: mark.at.as_secs_f64(),
        is_fault: matches!(mark.kind, "gap" | "clock" | "loss" | "pose_jump"),
        words: format!("{}  {kind}: {}", clock(mark.at), mark.message),
    }
}

fn rate_text(rate: Rate) -> String {
    match rate {
        Rate::Times(wanted) => times(wanted),
        Rate::Max => "max".to_owned(),
    }
}

fn rounded(rate: f64) -> String {
    let decimals = usize::from(rate < 9.95);
    format!("{rate:.decimals$}×")
}

fn times(rate: f64) -> String {
    if rate >= 9.95 {
        format!("{rate:.0}×")
    } else {
        let digits = format!("{rate:.2}");
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        format!("{digits}×")
    }
}

/// m:ss.t or h:mm:ss.t; tenths are truncated.
pub(crate) fn clock(time: RobotDuration) -> String {
    let tenths = time.as_nanos().max(0) / 100_000_000;
    let (seconds, tenth) = (tenths / 10, tenths % 10);
    let (minutes, second) = (seconds / 60, seconds % 60);
    let (hours, minute) = (minutes / 60, minutes % 60);
    if hours > 0 {
        format!("{hours}:{minute:02}:{second:02}.{tenth}")
    } else {
        format!("{minute}:{second:02}.{tenth}")
    }
}

#[cfg(test)]
mod tests;
