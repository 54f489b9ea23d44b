//! The bar below a recording.

use std::time::Duration;

use eframe::egui::{Frame, Margin, Panel, Ui};
use robot_edge::replay_control::ReplayState;

use crate::panels::timeline::{TimelineData, timeline_ui};
use crate::playback::{Playback, PlaybackCommand};

/// The position of a recording is at most this much behind.
const PLAYBACK_PERIOD: Duration = Duration::from_millis(50);

/// The time line, and what its controls ask for.
pub(super) fn playback_ui(ui: &mut Ui, playback: &mut Playback) -> Option<PlaybackCommand> {
    let name = playback.file_name();
    let status = playback.status();
    playback.update_damage(&status);
    let data = TimelineData::new(&name, &status, playback.failure());
    if !matches!(status.state, ReplayState::Paused | ReplayState::Ended) || !status.is_settled {
        ui.ctx().request_repaint_after(PLAYBACK_PERIOD);
    }
    let frame = Frame::new().inner_margin(Margin::symmetric(12, 6));
    let panel = Panel::bottom("timeline").frame(frame).resizable(false);
    panel.show(ui, |ui| timeline_ui(ui, &data)).inner
}
