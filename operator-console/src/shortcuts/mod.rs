//! What can be done by keys: one table that menus, tooltips, the sheet and the handler read.
//!
//! Keys that drive are not in it. Where they are on the keyboard counts, whatever is printed on them, and they go to the
//! helm before the window sees them (`input_loop`): W A S D, arrows, 1 to 5 and the space bar.

mod action;
mod handler;
mod sheet;
mod space_after_text;
mod table;
mod type_ahead;

use eframe::egui::{Key, KeyboardShortcut, Modifiers};

pub use action::{Action, Edge};
pub use handler::{KeyContext, Pressed, pressed};
pub use sheet::Sheet;
pub use space_after_text::has_space_after_text;
pub use table::{Binding, Group, bindings};
pub use type_ahead::TypeAhead;

/// A combination of keys as the operator reads it.
pub fn words(keys: KeyboardShortcut) -> String {
    let KeyboardShortcut {
        modifiers,
        logical_key,
    } = keys;
    let mut words = String::new();
    for (is_down, name) in [
        (modifiers.command || modifiers.ctrl, "Ctrl+"),
        (modifiers.alt, "Alt+"),
        (modifiers.shift, "Shift+"),
    ] {
        if is_down {
            words.push_str(name);
        }
    }
    let named = [
        (Key::ArrowUp, "Up"),
        (Key::ArrowDown, "Down"),
        (Key::ArrowLeft, "Left"),
        (Key::ArrowRight, "Right"),
        (Key::Plus, "+"),
        (Key::Equals, "="),
        (Key::Minus, "−"),
        (Key::Escape, "Esc"),
        (Key::Questionmark, "?"),
        (Key::OpenBracket, "["),
        (Key::CloseBracket, "]"),
    ];
    let named = named.into_iter().find(|(key, _)| *key == logical_key);
    words.push_str(named.map_or(logical_key.name(), |(_, name)| name));
    words
}

/// Whether these modifiers are those of `keys`. Where a sign is printed on a key differs between keyboards: for some
/// signs Shift has to be held, and says nothing.
fn fits(keys: KeyboardShortcut, key: Key, held: Modifiers) -> bool {
    let is_sign = matches!(
        key,
        Key::Plus | Key::Equals | Key::Minus | Key::Questionmark
    );
    let wanted = keys.modifiers;
    keys.logical_key == key
        && wanted.alt == held.alt
        && (wanted.command || wanted.ctrl) == (held.command || held.ctrl)
        && (is_sign || wanted.shift == held.shift)
}

#[cfg(test)]
mod tests;
