//! Keys that were pressed, as actions.

use eframe::egui::{Context, Event, Key, KeyboardShortcut, Modifiers};

use super::type_ahead::is_typed;
use super::{Action, Binding, Group, bindings, fits};

/// What decides which keys count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeyContext {
    /// This operator drives, and arrows do.
    pub is_driving: bool,
    /// A recording is open, which can be wound and paced.
    pub has_recording: bool,
    /// Text was typed when the last frame ended. What ends typing may come in one frame with letters before it.
    pub was_typing: bool,
}

/// What was pressed since the last frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pressed {
    /// The actions whose keys were pressed.
    pub actions: Vec<Action>,
    /// What was typed behind a key that opens a text field, where one was pressed.
    pub typed_ahead: Option<Vec<Event>>,
}

/// The actions whose keys were pressed since the last frame. Nobody behind sees those keys any more, nor what is typed for
/// a text field that they open.
///
/// While text is typed, plain keys are text. While this operator drives, arrows drive, and a widget that has the
/// keyboard may need them itself.
pub fn pressed(ctx: &Context, scene: KeyContext) -> Pressed {
    let is_typing = scene.was_typing || ctx.text_edit_focused();
    let is_on_widget = ctx.memory(|memory| memory.focused().is_some());
    let mut actions = Vec::new();
    let mut typed_ahead: Option<Vec<Event>> = None;
    ctx.input_mut(|input| {
        input.events.retain(|event| {
            if let Some(typed) = &mut typed_ahead
                && is_typed(event)
            {
                typed.push(event.clone());
                return false;
            }
            let Event::Key {
                key,
                physical_key,
                pressed: true,
                repeat,
                modifiers,
            } = event
            else {
                return true;
            };
            let Some(binding) = find_binding(*key, *physical_key, *modifiers) else {
                return true;
            };
            let action = binding.action;
            let is_free = match (action, binding.group) {
                (Action::Pan(_), _) => !scene.is_driving && !is_on_widget,
                // A dialog that is open takes it; else it leaves a text field.
                (Action::CloseDialog, _) => true,
                (_, Group::Recording) if !scene.has_recording => false,
                (
                    _,
                    Group::Map | Group::Robots | Group::Recording | Group::Files | Group::Window,
                ) => !is_typing || !is_text(*key, *modifiers),
            };
            if is_free && (!repeat || action.repeats()) {
                actions.push(action);
                if action.opens_text() {
                    typed_ahead = Some(Vec::new());
                }
            }
            !is_free || action == Action::CloseDialog
        });
    });
    Pressed {
        actions,
        typed_ahead,
    }
}

/// What is printed on a key counts; where that means nothing, its place may.
fn find_binding(key: Key, place: Option<Key>, held: Modifiers) -> Option<&'static Binding> {
    let find = |is_it: &dyn Fn(KeyboardShortcut) -> bool| {
        let mut bindings = bindings().iter();
        bindings.find(|binding| binding.keys.iter().any(|keys| is_it(*keys)))
    };
    let printed = find(&|keys| fits(keys, key, held));
    printed.or_else(|| {
        let place = place?;
        find(&|keys| matches_physical_key(keys) && fits(keys, place, held))
    })
}

/// Comma and period are side by side, and it is for that that they step. What Shift makes of them differs between
/// keyboards.
const fn matches_physical_key(keys: KeyboardShortcut) -> bool {
    matches!(keys.logical_key, Key::Comma | Key::Period)
}

/// Whether the key writes something.
fn is_text(key: Key, held: Modifiers) -> bool {
    let is_function = matches!(key, Key::F1 | Key::F6 | Key::Escape);
    !is_function && !held.command && !held.ctrl && !held.alt
}
