//! The menus of the top bar. Every entry says its keys.

use eframe::egui::{Button, Checkbox, Ui};

use crate::settings::{Appearance, ThemeChoice};
use crate::shortcuts::Action;
use crate::workspace::{PanelId, Workspace};

/// What the menus need to know.
pub(super) struct MenuState<'a> {
    pub(super) workspace: &'a Workspace,
    pub(super) appearance: Appearance,
    /// Whether a robot is shown, whose map could be exported.
    pub(super) has_robot: bool,
    /// Why a panel is not there although it is wanted.
    pub(super) unavailable_reason: &'a dyn Fn(PanelId) -> Option<&'static str>,
}

/// What was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    /// Something that has a name.
    Act(Action),
    /// Show a panel, or hide it.
    Panel(PanelId, bool),
    /// Look like this.
    Theme(ThemeChoice),
}

/// Draws the menus.
pub(super) fn menus_ui(ui: &mut Ui, state: &MenuState<'_>) -> Option<Choice> {
    let mut choice = None;
    ui.menu_button("File", |ui| {
        for action in [Action::OpenRecording, Action::Export, Action::Screenshot] {
            let is_possible = action != Action::Export || state.has_robot;
            entry_ui(ui, action, is_possible, &mut choice);
        }
        ui.separator();
        entry_ui(ui, Action::Quit, true, &mut choice);
    });
    ui.menu_button("View", |ui| {
        for panel in PanelId::ALL {
            if panel.can_be_closed() {
                choice = choice.or(panel_ui(ui, panel, state));
            }
        }
        entry_ui(ui, Action::ResetLayout, true, &mut choice);
        ui.separator();
        for theme in ThemeChoice::ALL {
            let is_chosen = state.appearance.theme == theme;
            let words = format!("Theme: {}", theme.label().to_lowercase());
            if ui.radio(is_chosen, words).clicked() {
                choice = Some(Choice::Theme(theme));
                ui.close();
            }
        }
        ui.separator();
        ui.weak(format!("Scale: {} %", state.appearance.scale_percent));
        for action in [Action::ScaleUp, Action::ScaleDown, Action::ScaleReset] {
            entry_ui(ui, action, true, &mut choice);
        }
    });
    ui.menu_button("Help", |ui| {
        for action in [Action::ShortcutSheet, Action::About] {
            entry_ui(ui, action, true, &mut choice);
        }
    });
    choice
}

/// A panel that is there is ticked. What nobody could see now can be neither shown nor hidden, and says why.
fn panel_ui(ui: &mut Ui, panel: PanelId, state: &MenuState<'_>) -> Option<Choice> {
    let unavailable_reason = (state.unavailable_reason)(panel);
    let mut is_wanted = state.workspace.is_wanted(panel) && unavailable_reason.is_none();
    let tick = Checkbox::new(&mut is_wanted, panel.title());
    let mut tick = ui.add_enabled(unavailable_reason.is_none(), tick);
    if let Some(unavailable_reason) = unavailable_reason {
        tick = tick.on_disabled_hover_text(unavailable_reason);
    }
    tick.clicked().then(|| {
        ui.close();
        Choice::Panel(panel, is_wanted)
    })
}

fn entry_ui(ui: &mut Ui, action: Action, is_possible: bool, choice: &mut Option<Choice>) {
    let button = Button::new(action.words()).shortcut_text(action.keys());
    if ui.add_enabled(is_possible, button).clicked() {
        *choice = Some(Choice::Act(action));
        ui.close();
    }
}
