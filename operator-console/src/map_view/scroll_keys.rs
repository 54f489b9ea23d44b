//! What scrolls, by keys: Page Up and Page Down, for arrows drive.

use eframe::egui::accesskit::Role;
use eframe::egui::style::ScrollAnimation;
use eframe::egui::{Key, Modifiers, Rect, ScrollArea, Sense, StrokeKind, Ui, WidgetInfo, vec2};

/// Of what is in sight, a key goes on so far: a line or two are seen before and after.
const PAGE: f32 = 0.8;
/// From what scrolls to the frame that says that it has the keyboard, points.
const FRAME: f32 = 3.0;

/// Who has the keyboard, and whether there is anything to scroll.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ScrollKeys {
    /// What a screen reader says of it.
    pub(super) label: &'static str,
    /// Whether there is more than is in sight. Where there is not, the keyboard does not stop here.
    pub(super) is_needed: bool,
    /// Whether a button that belongs to it has the keyboard: keys scroll then as well.
    pub(super) is_on_button: bool,
}

impl ScrollKeys {
    /// Draws what scrolls, of which so many points are in sight.
    pub(super) fn show(
        self,
        ui: &mut Ui,
        (height, scroll): (f32, ScrollArea),
        add: impl FnOnce(&mut Ui),
    ) {
        if !self.is_needed {
            scroll.show(ui, add);
            return;
        }
        // Before what is in it, so that the keyboard comes here first; it is laid out after that.
        let size = vec2(ui.available_width(), height);
        let place = Rect::from_min_size(ui.next_widget_position(), size);
        let id = ui.scope_id().with("scrolled by keys");
        let response = ui.interact(place, id, Sense::focusable_noninteractive());
        response.widget_info(|| WidgetInfo::labeled(Role::ScrollView, true, self.label));
        let pages = if response.has_focus() || self.is_on_button {
            ui.input_mut(|input| {
                let mut pressed = |key| input.count_and_consume_key(Modifiers::NONE, key) as f32;
                pressed(Key::PageUp) - pressed(Key::PageDown)
            })
        } else {
            0.0
        };
        scroll.show(ui, |ui| {
            if pages.abs() > 0.5 {
                let by = vec2(0.0, pages * PAGE * height);
                ui.scroll_with_delta_animation(by, ScrollAnimation::none());
            }
            add(ui);
        });
        if response.has_focus() {
            let line = ui.visuals().selection.stroke;
            ui.painter()
                .rect_stroke(place.expand(FRAME), 2.0, line, StrokeKind::Inside);
        }
    }
}
