//! What this console has just done for the operator, over the map for as long as it is news.

use std::time::Duration;

use eframe::egui::{
    Align2, Area, Frame, Id, Order, Rect, RichText, TextStyle, TextWrapMode, Ui, Vec2, WidgetText,
    vec2,
};
use measurement::time::Monotonic;

use crate::event_log::{EventLog, Severity, Source};
use crate::theme::Tone;

/// Long enough to read a path, and to look for it among the events afterwards.
const SHOWN_FOR: Duration = Duration::from_secs(5);
/// What is done without a panel in sight that would say how it went.
const KINDS: [&str; 4] = ["screenshot", "folder", "settings", "driving"];
/// Above the lower edge of a window that shows no map, and beside both its edges as a share of its width.
const ABOVE: f32 = 24.0;
const BESIDE_SHARE: f32 = 0.1;
/// Between a notice and what it lies above, points.
const GAP: f32 = 6.0;
/// Narrower text is not wrapped any more, points.
const NARROWEST: f32 = 60.0;

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
                Severity::Info => Tone::Good,
                Severity::Warning | Severity::Alarm => Tone::Warning,
            },
            rest: SHOWN_FOR.saturating_sub(now.since(entry.at)),
        })
    }
}

/// Where a notice may lie.
#[derive(Clone, Debug, PartialEq)]
pub struct NoticeRoom {
    /// Within this, at its lower edge.
    pub place: Rect,
    /// Over none of these, if it can be helped.
    pub taken: Vec<Rect>,
}

impl NoticeRoom {
    /// Where there is no map.
    pub fn of_window(ui: &Ui) -> Self {
        let window = ui.ctx().content_rect();
        Self {
            place: window.shrink2(vec2(BESIDE_SHARE * window.width(), ABOVE)),
            taken: Vec::new(),
        }
    }

    /// Where one of this size lies: as low as it can.
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

/// Draws it, in the way of nothing that is pressed.
pub fn notice_ui(ui: &Ui, data: &NoticeData, room: &NoticeRoom) {
    let frame = Frame::popup(ui.style());
    let margin = frame.total_margin().sum();
    let text = WidgetText::from(RichText::new(&data.text).color(data.tone.color(ui.visuals())));
    let width = (room.place.width() - margin.x).max(NARROWEST);
    // Laid out before, for where it lies depends on how large it is.
    let text = text.into_galley(ui, Some(TextWrapMode::Wrap), width, TextStyle::Body);
    let rect = room.rect(text.size() + margin);
    Area::new(Id::unique("notice"))
        .fixed_pos(rect.min)
        // Over the map, and below dialogs.
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
    fn a_notice_is_as_low_as_what_stands_there_allows() {
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
    fn what_was_saved_is_news_for_a_while_and_what_a_robot_says_is_not() {
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
