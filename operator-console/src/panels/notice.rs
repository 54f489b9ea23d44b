//! What this console has just done for the operator, over the window for as long as it is news.

use std::time::Duration;

use eframe::egui::{Align2, Area, Context, Frame, Id, Order, RichText};
use robot_edge::clock::Monotonic;

use crate::event_log::{EventLog, Severity, Source};
use crate::theme::Tone;

/// Long enough to read a path, and to look for it among the events afterwards.
const SHOWN_FOR: Duration = Duration::from_secs(5);
/// What is done without a panel in sight that would say how it went.
const KINDS: [&str; 4] = ["screenshot", "folder", "settings", "driving"];
/// Above the lower edge of the window, points.
const ABOVE: f32 = 24.0;

/// The newest of it.
#[derive(Clone, Debug, PartialEq)]
pub struct NoticeData {
    /// In words, as the event log has it.
    pub text: String,
    /// Whether it went well.
    pub tone: Tone,
    /// For so much longer.
    pub rest: Duration,
}

impl NoticeData {
    /// What is news at `now`.
    pub fn new(log: &EventLog, now: Monotonic) -> Option<Self> {
        let entries = log.entries().iter().rev();
        let mut fresh = entries.take_while(|entry| now.since(entry.at) < SHOWN_FOR);
        let entry = fresh.find(|entry| {
            entry.source == Source::Console && KINDS.contains(&entry.kind.as_str())
        })?;
        Some(Self {
            text: entry.text.clone(),
            tone: match entry.severity {
                Severity::Note => Tone::Good,
                Severity::Warning | Severity::Alarm => Tone::Warning,
            },
            rest: SHOWN_FOR.saturating_sub(now.since(entry.at)),
        })
    }
}

/// Draws it, in the way of nothing that is pressed.
pub fn notice_ui(ctx: &Context, data: &NoticeData) {
    Area::new(Id::unique("notice"))
        .anchor(Align2::CENTER_BOTTOM, [0.0, -ABOVE])
        .order(Order::Foreground)
        .interactable(false)
        .show(ctx, |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.set_max_width(0.8 * ctx.content_rect().width());
                ui.label(RichText::new(&data.text).color(data.tone.color(ui.visuals())));
            });
        });
    ctx.request_repaint_after(data.rest);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretend::at;

    #[test]
    fn what_was_saved_is_news_for_a_while_and_what_a_robot_says_is_not() {
        let mut log = EventLog::default();
        assert_eq!(NoticeData::new(&log, at(0)), None);
        log.note(Severity::Note, "link", "scout is heard", at(0), 0);
        assert_eq!(NoticeData::new(&log, at(0)), None);
        log.note(Severity::Note, "screenshot", "Saved as a.png", at(1_000), 1);
        log.note(Severity::Note, "link", "Connected by QUIC", at(2_000), 2);
        let news = NoticeData::new(&log, at(2_000)).unwrap();
        assert_eq!(
            (news.text.as_str(), news.tone, news.rest),
            ("Saved as a.png", Tone::Good, Duration::from_secs(4))
        );
        let full = "the disk is full";
        log.note(Severity::Warning, "screenshot", full, at(3_000), 3);
        let news = NoticeData::new(&log, at(3_500)).unwrap();
        assert_eq!((news.text.as_str(), news.tone), (full, Tone::Warning));
        assert_eq!(NoticeData::new(&log, at(8_000)), None);
    }
}
