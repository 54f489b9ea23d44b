//! Short notice over the map about what this console has just done.

use std::time::Duration;

use eframe::egui::{
    Align2, Area, Frame, Id, Order, Rect, RichText, TextStyle, TextWrapMode, Ui, Vec2, WidgetText,
    vec2,
};
use measurement::time::Monotonic;

use crate::event_log::{EventLog, Severity, Source};
use crate::theme::Tone;

/// Long enough to read a path.
const SHOWN_FOR: Duration = Duration::from_secs(5);
/// Kinds of events that no panel shows.
const KINDS: [&str; 4] = ["screenshot", "folder", "settings", "driving"];
/// Distance from the lower edge and, as a share of the width, from both sides of a window without a map.
const ABOVE: f32 = 24.0;
const BESIDE_SHARE: f32 = 0.1;
const GAP: f32 = 6.0;
const NARROWEST: f32 = 60.0;

#[derive(Clone, Debug, PartialEq)]
pub struct NoticeData {
    pub text: String,
    pub tone: Tone,
    pub rest: Duration,
}

impl NoticeData {
    pub fn new(log: &EventLog, now: Monotonic) -> Option<Self> {
        let entries = log.entries().iter().rev();
        let mut fresh = entries.take_while(|entry| now.since(entry.at) < SHOWN_FOR);
        let entry = fresh.find(|entry| {
            entry.source == Source::Console && KINDS.contains(&entry.kind.as_str())
        })?;
        Some(Self {
            text: entry.text.clone(),
            tone: match entry.severity {
                Severity::Info => Tone::Good,
                Severity::Warning | Severity::Alarm => Tone::Warning,
            },
            rest: SHOWN_FOR.saturating_sub(now.since(entry.at)),
        })
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct NoticeRoom {
    pub place: Rect,
    pub taken: Vec<Rect>,
}

impl NoticeRoom {
    pub fn of_window(ui: &Ui) -> Self {
        let window = ui.ctx().content_rect();
        Self {
            place: window.shrink2(vec2(BESIDE_SHARE * window.width(), ABOVE)),
            taken: Vec::new(),
        }
    }

    /// Lowest free place; the lower edge if there is none.
    fn rect(&self, size: Vec2) -> Rect {
        let lowest = Align2::CENTER_BOTTOM.anchor_size(self.place.center_bottom(), size);
        let mut rect = lowest;
        while let Some(below) = self.taken.iter().find(|taken| taken.intersects(rect)) {
            rect = rect.translate(vec2(0.0, below.top() - GAP - rect.bottom()));
            if rect.top() < self.place.top() {
                return lowest;
            }
        }
        rect
    }
}

/// Draws the notice. It does not block clicks.
pub fn notice_ui(ui: &Ui, data: &NoticeData, room: &NoticeRoom) {
    let frame = Frame::popup(ui.style());
    let margin = frame.total_margin().sum();
    let text = WidgetText::from(RichText::new(&data.text).color(data.tone.color(ui.visuals())));
    let width = (room.place.width() - margin.x).max(NARROWEST);
    // The position depends on the size of the text.
    let text = text.into_galley(ui, Some(TextWrapMode::Wrap), width, TextStyle::Body);
    let rect = room.rect(text.size() + margin);
    Area::new(Id::unique("notice"))
        .fixed_pos(rect.min)
        // Above the map, below dialogs.
        .order(Order::Background)
        .interactable(false)
        .show(ui.ctx(), |ui| frame.show(ui, |ui| ui.label(text)));
    ui.ctx().request_repaint_after(data.rest);
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;
    use crate::test_support::at;

    #[test]
    fn a_notice_is_at_the_lowest_free_place() {
        let place = Rect::from_min_max(pos2(300.0, 100.0), pos2(900.0, 600.0));
        let mut room = NoticeRoom {
            place,
            taken: vec![Rect::from_min_max(pos2(300.0, 540.0), pos2(490.0, 600.0))],
        };
        let beside = room.rect(vec2(200.0, 30.0));
        assert_eq!(beside.center_bottom(), place.center_bottom());
        let over = room.rect(vec2(400.0, 30.0));
        assert_eq!(over.center_bottom(), pos2(600.0, 540.0 - GAP));
        let card = Rect::from_min_max(pos2(300.0, 400.0), pos2(500.0, 535.0));
        room.taken.push(card);
        let over = room.rect(vec2(400.0, 30.0));
        assert_eq!(over.center_bottom(), pos2(600.0, 400.0 - GAP));
        room.taken.push(place);
        let nowhere = room.rect(vec2(400.0, 30.0));
        assert_eq!(nowhere.center_bottom(), place.center_bottom());
    }

    #[test]
    fn notices_are_short_and_of_this_console() {
        let mut log = EventLog::default();
        assert_eq!(NoticeData::new(&log, at(0)), None);
        log.note(Severity::Info, "link", "scout is connected", at(0), 0);
        assert_eq!(NoticeData::new(&log, at(0)), None);
        log.note(Severity::Info, "screenshot", "Saved as a.png", at(1_000), 1);
        log.note(Severity::Info, "link", "Connected by QUIC", at(2_000), 2);
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
