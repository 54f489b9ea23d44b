//! The time line of a recording: where it is, what happened when, and everything that winds and paces it.

mod bar;
mod data;

use eframe::egui::{Align, Button, ComboBox, Layout, RichText, TextStyle, Ui, vec2};
use measurement::time::RobotDuration;

use super::command_line::with_monospace_options;
use crate::playback::{PlaybackCommand, RATES};
use crate::shortcuts::Action;
use crate::theme::{Tone, state_ui};

pub(crate) use data::clock;
pub use data::{DrawnMark, TimelineData};

use bar::bar_ui;
use data::rate_text;

/// So that nothing moves when a word changes.
const PLAY_WIDTH: f32 = 64.0;
/// Narrower windows have two rows.
const NARROW: f32 = 900.0;

/// Draws the time line over the full width; what the operator asks for.
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

fn failure_ui(ui: &mut Ui, data: &TimelineData, failure: &str) -> Option<PlaybackCommand> {
    ui.horizontal(|ui| {
        state_ui(
            ui,
            Tone::Warning,
            &format!("{} cannot be shown", data.name),
            16.0,
        );
        ui.with_layout(Layout::right_to_left(Align::Center), close_ui)
            .inner
    })
    .inner
    .or_else(|| {
        let ink = ui.visuals().text_color();
        ui.label(with_monospace_options(ui, failure, &TextStyle::Body, ink));
        None
    })
}

fn controls_ui(ui: &mut Ui, data: &TimelineData) -> Option<PlaybackCommand> {
    let command = transport_ui(ui, data);
    position_ui(ui, data);
    let command = command.or(rate_ui(ui, data));
    command.or(looping_ui(ui, data))
}

/// What is said of the state fills what is left of the row, so that nothing moves when it changes.
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

/// What it does, and its keys.
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

#[cfg(test)]
mod tests;
