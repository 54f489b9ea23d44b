//! Keyboard shortcuts: one table for menus, hover texts, the sheet and the handler.
//!
//! Driving keys (W A S D, arrows, 1 to 5, space) are not in it. They depend on the physical position, and
//! `input_loop` handles them before the window.

mod handler;
mod sheet;
mod table;

use eframe::egui::{Key, KeyboardShortcut, Modifiers};

pub use handler::{KeyContext, Pressed, TypeAhead, has_space_after_text, pressed};
pub use sheet::{Sheet, sheet_ui};
pub use table::{Action, Binding, Edge, Group, bindings};

/// Whether a pressed key matches `keys`. Some signs need Shift on some keyboards, so Shift is ignored for signs.
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
