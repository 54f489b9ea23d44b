//! Menus of the top bar with their shortcuts, and the first-run page.

use eframe::egui::{Align, Button, Checkbox, Layout, RichText, TextStyle, Ui};

use crate::panels::formatting::with_monospace_options;
use crate::panels::robots::RobotsData;
use crate::settings::{Appearance, ThemeChoice};
use crate::shortcuts::Action;
use crate::workspace::{PanelId, Workspace};

pub(super) struct MenuState<'a> {
    pub(super) workspace: &'a Workspace,
    pub(super) appearance: Appearance,
    pub(super) has_robot: bool,
    pub(super) unavailable_reason: &'a dyn Fn(PanelId) -> Option<&'static str>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Choice {
    Act(Action),
    Panel(PanelId, bool),
    Theme(ThemeChoice),
}

pub(super) fn menus_ui(ui: &mut Ui, state: &MenuState<'_>) -> Option<Choice> {
    let mut choice = None;
    let file = ui.menu_button("File", |ui| {
        for action in [Action::OpenRecording, Action::Export, Action::Screenshot] {
            let is_possible = action != Action::Export || state.has_robot;
            entry_ui(ui, action, is_possible, &mut choice);
        }
        ui.separator();
        entry_ui(ui, Action::Quit, true, &mut choice);
    });
    file.response
        .on_hover_text("Recordings, exports and screenshots");
    let view = ui.menu_button("View", |ui| {
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
            let radio = ui.radio(is_chosen, words);
            if radio.on_hover_text("Colours of the window").clicked() {
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
    view.response
        .on_hover_text("Panels, colours and scale of the window");
    let help = ui.menu_button("Help", |ui| {
        for action in [Action::ShortcutSheet, Action::About] {
            entry_ui(ui, action, true, &mut choice);
        }
    });
    help.response.on_hover_text("Keys and version");
    choice
}

fn panel_ui(ui: &mut Ui, panel: PanelId, state: &MenuState<'_>) -> Option<Choice> {
    let unavailable_reason = (state.unavailable_reason)(panel);
    let mut is_wanted = state.workspace.is_wanted(panel) && unavailable_reason.is_none();
    let tick = Checkbox::new(&mut is_wanted, panel.title());
    let mut tick = ui
        .add_enabled(unavailable_reason.is_none(), tick)
        .on_hover_text(panel.hint());
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
    let button = ui.add_enabled(is_possible, button);
    if button.on_hover_text(hint(action)).clicked() {
        *choice = Some(Choice::Act(action));
        ui.close();
    }
}

const fn hint(action: Action) -> &'static str {
    match action {
        Action::OpenRecording => "Map a recording in this window",
        Action::Export => "Write maps, trajectory and voxels as files",
        Action::Screenshot => "Write this window as a PNG file",
        Action::Quit => "Close this window; the robot goes on",
        Action::ResetLayout => "Show all panels at their first places",
        Action::ScaleUp => "Larger texts and controls",
        Action::ScaleDown => "Smaller texts and controls",
        Action::ScaleReset => "Texts and controls at 100 %",
        Action::ShortcutSheet => "List all keys",
        Action::About => "Version and licence of this program",
        Action::TypeAddress => "Search an address for robots",
        _ => "",
    }
}

pub(super) fn first_run_ui(ui: &mut Ui, robots: &RobotsData) -> Option<Action> {
    let mut asked = None;
    let width = ui.available_width().min(520.0);
    ui.add_space((0.25 * ui.available_height()).min(180.0));
    ui.with_layout(Layout::top_down(Align::Center), |ui| {
        ui.label(RichText::new(robots.heading).size(24.0));
        let advice = robots.advice.as_deref().unwrap_or_default();
        let ink = ui.visuals().text_color();
        ui.label(with_monospace_options(ui, advice, &TextStyle::Body, ink));
        if !robots.is_up_to_operator || !robots.found.is_empty() {
            return;
        }
        ui.add_space(12.0);
        ui.allocate_ui_with_layout([width, 0.0].into(), Layout::top_down(Align::Min), |ui| {
            ui.strong("To begin");
            for (words, action) in [
                (
                    "A robot on another network, or behind a router:",
                    Action::TypeAddress,
                ),
                ("A recording:", Action::OpenRecording),
            ] {
                ui.horizontal_wrapped(|ui| {
                    ui.label(words);
                    let button = Button::new(action.words()).shortcut_text(action.keys());
                    if ui.add(button).on_hover_text(hint(action)).clicked() {
                        asked = Some(action);
                    }
                });
            }
            ui.horizontal_wrapped(|ui| {
                ui.label("No robot available: start this program as");
                ui.label(RichText::new("operator-console --demo lake").monospace());
            });
            ui.horizontal_wrapped(|ui| {
                ui.label("A simulated robot of its own:");
                ui.label(RichText::new("robot-edge simulate rooms").monospace());
            });
        });
    });
    asked
}
