//! What can be done by keys: one table that menus, tooltips, the sheet and the handler read.
//!
//! Keys that drive are not in it. Where they are on the keyboard counts, whatever is printed on them, and they go to the
//! helm before the window sees them (`input_loop`): W A S D, arrows, 1 to 5 and the space bar.

mod handler;
mod sheet;
mod table;

use eframe::egui::{Key, KeyboardShortcut, Modifiers};
use protocol::layer::LayerId;

pub use handler::pressed;
pub use sheet::sheet_ui;
pub use table::{Binding, Group, bindings};

/// Something that can be asked for by a key, and mostly from a menu as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    /// Show or hide a layer.
    Layer(LayerId),
    /// Keep the whole map in sight.
    WholeMap,
    /// Keep the vehicle in the middle, or no longer.
    Follow,
    /// North up, or robot up.
    Turn,
    /// A grid over the map, or none.
    Grid,
    /// Legends on the map, or none.
    Legend,
    /// Let clicks measure, or end that.
    Measure,
    /// Closer.
    ZoomIn,
    /// Farther.
    ZoomOut,
    /// Look at what lies beyond an edge of the map view.
    Pan(Edge),
    /// Show the robot of this number in the list, from 1.
    Robot(u8),
    /// Type the address of a robot.
    TypeAddress,
    /// Ask for the lease, or give it back.
    Lease,
    /// Acknowledge every alert.
    AcknowledgeAll,
    /// Save a picture of the window.
    Screenshot,
    /// Write the maps to files.
    Export,
    /// Open a recording.
    OpenRecording,
    /// End the program.
    Quit,
    /// Go to the next panel.
    NextPanel,
    /// Go to the panel before.
    PreviousPanel,
    /// Put all panels back where they were at first.
    ResetLayout,
    /// Light, dark, as the system.
    NextTheme,
    /// Everything larger.
    ScaleUp,
    /// Everything smaller.
    ScaleDown,
    /// Everything as large as the system says.
    ScaleReset,
    /// The list of all keys.
    ShortcutSheet,
    /// Which program this is.
    About,
    /// Close what lies over the window.
    CloseDialog,
}

/// An edge of the map view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Edge {
    /// What is above comes into sight.
    Top,
    /// What is on the left.
    Left,
    /// What is below.
    Bottom,
    /// What is on the right.
    Right,
}

impl Action {
    /// What it does, as menus and the sheet say it.
    pub fn words(self) -> &'static str {
        table::of(self).map_or("", |binding| binding.words)
    }

    /// Its first key in words, for menus and tooltips; empty where it has none.
    pub fn keys(self) -> String {
        table::of(self)
            .and_then(|binding| binding.keys.first())
            .map(|keys| words(*keys))
            .unwrap_or_default()
    }
}

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
