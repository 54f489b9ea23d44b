//! The buttons on the map.

use eframe::egui::{Button, Frame, Ui};

use crate::command::Look;
use crate::theme;

/// Height of the bar, points.
pub(super) const HEIGHT: f32 = 36.0;

/// What the camera keeps in sight by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// The whole map, as it grows.
    Whole,
    /// The vehicle, in the middle.
    Vehicle,
    /// Nothing: the operator looks where he wants.
    Free,
}

/// What the buttons show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToolbarData {
    /// Which of the buttons is down.
    pub sight: Sight,
}

/// Draws the bar.
pub(super) fn toolbar_ui(ui: &mut Ui, data: ToolbarData) -> Option<Look> {
    let mut look = None;
    Frame::new()
        .fill(theme::card(ui.visuals()))
        .corner_radius(4.0)
        .inner_margin(4.0)
        .show(ui, |ui| {
            ui.horizontal(|ui| {
                ui.spacing_mut().item_spacing.x = 4.0;
                // Laid out from the right in a right-aligned corner, so the last comes first.
                let is_following = data.sight == Sight::Vehicle;
                for (label, hint, is_on, asks) in [
                    (
                        "Whole map",
                        "Keep the whole map in sight (F)",
                        data.sight == Sight::Whole,
                        Look::Whole,
                    ),
                    (
                        "Follow",
                        "Keep the vehicle in the middle (V)",
                        is_following,
                        Look::Follow(!is_following),
                    ),
                    ("−", "Farther (−)", false, Look::Out),
                    ("+", "Closer (+)", false, Look::In),
                ] {
                    let button = Button::selectable(is_on, label).min_size([26.0, 26.0].into());
                    if ui.add(button).on_hover_text(hint).clicked() {
                        look = Some(asks);
                    }
                }
            });
        });
    look
}
