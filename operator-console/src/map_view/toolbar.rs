//! The buttons on the map.

use eframe::egui::{Button, Frame, Ui};

use super::look::{Orientation, Overlay, Sight};
use crate::command::Look;
use crate::theme;

/// Height of the bar, points.
pub(super) const HEIGHT: f32 = 36.0;

/// What the buttons show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToolbarData {
    /// What is kept in sight.
    pub sight: Sight,
    /// What is up.
    pub orientation: Orientation,
    /// Whether the grid is drawn.
    pub has_grid: bool,
    /// Whether clicks measure.
    pub is_measuring: bool,
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
                let is_following = data.sight == Sight::Vehicle;
                let is_robot_up = data.orientation == Orientation::RobotUp;
                // Laid out from the right in a right-aligned corner, so the last comes first.
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
                    (
                        "Robot up",
                        "Turn the map with the robot, or north up (N)",
                        is_robot_up,
                        Look::Up(data.orientation.other()),
                    ),
                    (
                        "Grid",
                        "A grid of round metres (G)",
                        data.has_grid,
                        Look::Draw(Overlay::Grid, !data.has_grid),
                    ),
                    (
                        "Measure",
                        "Measure by clicks; Esc ends (M)",
                        data.is_measuring,
                        Look::Measure(!data.is_measuring),
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
