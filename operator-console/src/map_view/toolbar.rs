//! The buttons on the map.

use eframe::egui::{Button, Ui};

use super::view_settings::{CameraMode, Orientation, Overlay};
use super::{PosePurpose, card_frame};
use crate::command::Look;

pub(super) const HEIGHT: f32 = 36.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToolbarData {
    pub camera_mode: CameraMode,
    pub orientation: Orientation,
    pub has_grid: bool,
    pub is_measuring: bool,
    /// Where the pose can be set.
    pub is_setting_pose: Option<bool>,
    /// Whether its tool is on, or why it cannot be; `None` where there is no button.
    pub goal: Option<Result<bool, &'static str>>,
    /// A menu replaces most buttons.
    pub is_folded: bool,
}

/// On narrower maps they are always folded, points.
const NARROW: f32 = 460.0;

pub(super) fn toolbar_ui(ui: &mut Ui, data: ToolbarData) -> Option<Look> {
    let is_folded = data.is_folded || ui.available_width() < NARROW;
    let shown = card_frame(ui, 4.0).show(ui, |ui| {
        // Laid out from the right, so the last button comes first.
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            let look = if is_folded {
                let menu = ui.menu_button("Tools", |ui| entries_ui(ui, data));
                menu.response.on_hover_text("Camera, grid and ruler");
                menu.inner.flatten()
            } else {
                entries_ui(ui, data)
            };
            let farther = entry_ui(ui, &("−", "Zoom out (−)", false, Look::Out));
            let closer = entry_ui(ui, &("+", "Zoom in (+)", false, Look::In));
            look.or(farther).or(closer)
        })
        .inner
    });
    shown.inner
}

type Entry = (&'static str, &'static str, bool, Look);

fn entries_ui(ui: &mut Ui, data: ToolbarData) -> Option<Look> {
    let is_following = data.camera_mode == CameraMode::FollowVehicle;
    let is_robot_up = data.orientation == Orientation::RobotUp;
    let entries: [Entry; 5] = [
        (
            "Whole map",
            "Keep the whole map in sight (F)",
            data.camera_mode == CameraMode::FitMap,
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
    ];
    let set_pose = data.is_setting_pose.map(|is_on| {
        let hint = "Press where the vehicle is in the saved map and drag ahead; Esc ends";
        let purpose = (!is_on).then_some(PosePurpose::Locate);
        ("Set pose", hint, is_on, Look::SetPose(purpose))
    });
    let mut look = None;
    for entry in entries.iter().chain(&set_pose) {
        look = look.or(entry_ui(ui, entry));
    }
    look.or(goal_ui(ui, data))
}

/// Sends the planner to a goal; where it cannot, it says why.
fn goal_ui(ui: &mut Ui, data: ToolbarData) -> Option<Look> {
    let (is_on, why_not) = match data.goal? {
        Ok(is_on) => (is_on, None),
        Err(why) => (false, Some(why)),
    };
    let button = Button::selectable(is_on, "Goal").min_size([26.0, 26.0].into());
    let response = ui
        .add_enabled(why_not.is_none(), button)
        .on_hover_text(
            "Click where a planner on the vehicle is to drive; drag for the heading. Esc, any driving key, and losing the focus end it",
        )
        .on_disabled_hover_text(why_not.unwrap_or_default());
    let purpose = (!is_on).then_some(PosePurpose::Goal);
    response.clicked().then_some(Look::SetPose(purpose))
}

fn entry_ui(ui: &mut Ui, (label, hint, is_on, asks): &Entry) -> Option<Look> {
    let button = Button::selectable(*is_on, *label).min_size([26.0, 26.0].into());
    let button = ui.add(button).on_hover_text(*hint);
    button.clicked().then_some(*asks)
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn all_buttons_work_on_wide_and_narrow_maps() {
        for width in [700.0, 250.0] {
            let data = ToolbarData {
                camera_mode: CameraMode::FitMap,
                orientation: Orientation::NorthUp,
                has_grid: false,
                is_measuring: false,
                is_setting_pose: Some(false),
                goal: Some(Ok(false)),
                is_folded: false,
            };
            let mut window = Harness::builder()
                .with_size(vec2(width, 300.0))
                .build_ui_state(
                    move |ui, asked: &mut Vec<Look>| asked.extend(toolbar_ui(ui, data)),
                    Vec::new(),
                );
            window.run_steps(2);
            for (label, look) in [
                ("Measure", Look::Measure(true)),
                ("Set pose", Look::SetPose(Some(PosePurpose::Locate))),
                ("Goal", Look::SetPose(Some(PosePurpose::Goal))),
                ("Grid", Look::Draw(Overlay::Grid, true)),
                ("+", Look::In),
            ] {
                if width < NARROW && label != "+" {
                    window.get_by_label("Tools").click();
                    window.run_steps(2);
                }
                let button = window.get_by_label(label);
                assert!(button.rect().right() <= width, "{label} at {width}");
                button.click();
                window.run_steps(2);
                let asked = std::mem::take(window.state_mut());
                assert_eq!(asked, [look], "at {width}");
            }
        }
    }
}
