//! Keys that were pressed, as actions.

use eframe::egui::{Context, Event, Key, Modifiers};

use super::{Action, bindings, fits};

/// The actions whose keys were pressed since the last frame. Nobody behind sees those keys any more.
///
/// While text is typed, plain keys are text. While this operator drives, arrows drive, and a widget that has the
/// keyboard may need them itself.
pub fn pressed(ctx: &Context, is_driving: bool) -> Vec<Action> {
    let is_typing = ctx.text_edit_focused();
    let is_on_widget = ctx.memory(|memory| memory.focused().is_some());
    let mut actions = Vec::new();
    ctx.input_mut(|input| {
        input.events.retain(|event| {
            let Event::Key {
                key,
                pressed: true,
                modifiers,
                ..
            } = event
            else {
                return true;
            };
            let Some(action) = action_of(*key, *modifiers) else {
                return true;
            };
            let is_free = match action {
                Action::Pan(_) => !is_driving && !is_on_widget,
                // A dialog that is open takes it; else it leaves a text field.
                Action::CloseDialog => true,
                Action::Layer(_)
                | Action::WholeMap
                | Action::Follow
                | Action::Turn
                | Action::Grid
                | Action::Legend
                | Action::Measure
                | Action::ZoomIn
                | Action::ZoomOut
                | Action::Robot(_)
                | Action::TypeAddress
                | Action::Lease
                | Action::AcknowledgeAll
                | Action::Screenshot
                | Action::Export
                | Action::OpenRecording
                | Action::Quit
                | Action::NextPanel
                | Action::PreviousPanel
                | Action::ResetLayout
                | Action::NextTheme
                | Action::ScaleUp
                | Action::ScaleDown
                | Action::ScaleReset
                | Action::ShortcutSheet
                | Action::About => !is_typing || !is_text(*key, *modifiers),
            };
            if is_free {
                actions.push(action);
            }
            !is_free || action == Action::CloseDialog
        });
    });
    actions
}

fn action_of(key: Key, held: Modifiers) -> Option<Action> {
    let mut bindings = bindings().iter();
    let is_it = |binding: &&super::Binding| binding.keys.iter().any(|keys| fits(*keys, key, held));
    bindings.find(is_it).map(|binding| binding.action)
}

/// Whether the key writes something.
fn is_text(key: Key, held: Modifiers) -> bool {
    let is_function = matches!(key, Key::F1 | Key::F6 | Key::Escape);
    !is_function && !held.command && !held.ctrl && !held.alt
}
