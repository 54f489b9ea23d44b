//! Keyboard shortcuts: one table for menus, hover texts, the sheet and the handler.
//!
//! Driving keys (W A S D, arrows, 1 to 5, space) are not in it. They depend on the physical position, and
//! `input_loop` handles them before the window.

mod handler;
mod sheet;

use std::sync::LazyLock;

use eframe::egui::{Key, KeyboardShortcut, Modifiers};
use protocol::layer::LayerId;

use crate::panels::layers::layer_name;

pub use handler::{KeyContext, Pressed, TypeAhead, has_space_after_text, pressed};
pub use sheet::{Sheet, sheet_ui};

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

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    Layer(LayerId),
    WholeMap,
    Follow,
    Turn,
    Grid,
    Legend,
    Measure,
    /// Measure or read the middle of the map.
    Point,
    UndoPoint,
    ZoomIn,
    ZoomOut,
    Pan(Edge),
    Robot(u8),
    TypeAddress,
    Lease,
    AcknowledgeAll,
    Screenshot,
    Export,
    OpenRecording,
    PlayOrPause,
    StepBack,
    StepForward,
    JumpBack,
    JumpForward,
    Slower,
    Faster,
    Loop,
    Quit,
    NextPanel,
    PreviousPanel,
    ResetLayout,
    ToggleTheme,
    ScaleUp,
    ScaleDown,
    ScaleReset,
    ShortcutSheet,
    About,
    CloseDialog,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Edge {
    Top,
    Left,
    Bottom,
    Right,
}

impl Action {
    pub fn words(self) -> &'static str {
        binding_of(self).map_or("", |binding| binding.words)
    }

    pub fn keys(self) -> &'static str {
        let binding = binding_of(self).and_then(|binding| binding.keys.first());
        binding.map_or("", |(text, _)| text)
    }

    pub(super) const fn opens_text(self) -> bool {
        matches!(self, Self::TypeAddress | Self::OpenRecording)
    }

    pub(super) const fn repeats(self) -> bool {
        matches!(
            self,
            Self::Pan(_)
                | Self::ZoomIn
                | Self::ZoomOut
                | Self::StepBack
                | Self::StepForward
                | Self::JumpBack
                | Self::JumpForward
                | Self::NextPanel
                | Self::PreviousPanel
                | Self::ScaleUp
                | Self::ScaleDown
        )
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    Map,
    Robots,
    Recording,
    Files,
    Window,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    pub action: Action,
    pub keys: Vec<(&'static str, KeyboardShortcut)>,
    pub words: &'static str,
    pub group: Group,
}

impl Group {
    pub const ALL: [Self; 5] = [
        Self::Map,
        Self::Robots,
        Self::Recording,
        Self::Files,
        Self::Window,
    ];

    pub const fn title(self) -> &'static str {
        match self {
            Self::Map => "Map",
            Self::Robots => "Robots",
            Self::Recording => "Recording, while one is open",
            Self::Files => "Files",
            Self::Window => "Window",
        }
    }
}

pub fn bindings() -> &'static [Binding] {
    static TABLE: LazyLock<Vec<Binding>> = LazyLock::new(|| {
        // Digits alone select the speed step.
        const LAYER_KEYS: [&str; LayerId::ALL.len()] = [
            "Alt+1", "Alt+2", "Alt+3", "Alt+4", "Alt+5", "Alt+6", "Alt+7", "Alt+8", "Alt+9",
        ];
        let layers = LayerId::ALL.into_iter().zip(LAYER_KEYS);
        let layers = layers.map(|(layer, keys)| (Action::Layer(layer), keys, layer_name(layer)));
        let mut bindings = of_group(Group::Map, layers);
        for (group, rows) in [
            (Group::Map, MAP),
            (Group::Robots, ROBOTS),
            (Group::Recording, RECORDING),
            (Group::Files, FILES),
            (Group::Window, WINDOW),
        ] {
            bindings.extend(of_group(group, rows.iter().copied()));
        }
        bindings
    });
    &TABLE
}

fn binding_of(action: Action) -> Option<&'static Binding> {
    bindings().iter().find(|binding| binding.action == action)
}

/// Action, keys (several are separated by a space), and text.
type Row = (Action, &'static str, &'static str);

fn of_group(group: Group, rows: impl Iterator<Item = Row>) -> Vec<Binding> {
    let binding = |(action, keys, words): Row| Binding {
        action,
        keys: keys
            .split_whitespace()
            .filter_map(|text| Some((text, shortcut(text)?)))
            .collect(),
        words,
        group,
    };
    rows.map(binding).collect()
}

/// The key combination of a text such as `Ctrl+Shift+K`.
fn shortcut(text: &str) -> Option<KeyboardShortcut> {
    let (mut modifiers, mut key) = (Modifiers::NONE, text);
    for (name, modifier) in [
        ("Ctrl+", Modifiers::COMMAND),
        ("Alt+", Modifiers::ALT),
        ("Shift+", Modifiers::SHIFT),
    ] {
        if let Some(rest) = key.strip_prefix(name) {
            (modifiers, key) = (modifiers | modifier, rest);
        }
    }
    Some(KeyboardShortcut::new(modifiers, Key::from_name(key)?))
}

const MAP: &[Row] = &[
    (Action::WholeMap, "F", "Whole map"),
    (Action::Follow, "V", "Follow the vehicle"),
    (Action::Turn, "N", "North up or robot up"),
    (Action::Grid, "G", "Grid"),
    (Action::Legend, "L", "Legends on the map"),
    (Action::Measure, "M", "Measure"),
    (Action::Point, "C", "Read or measure the center"),
    (Action::UndoPoint, "Backspace", "Undo the last point"),
    (Action::ZoomIn, "+ =", "Zoom in"),
    (Action::ZoomOut, "−", "Zoom out"),
    (Action::Pan(Edge::Top), "Up", "Pan up, unless you drive"),
    (
        Action::Pan(Edge::Left),
        "Left",
        "Pan left, unless you drive",
    ),
    (
        Action::Pan(Edge::Bottom),
        "Down",
        "Pan down, unless you drive",
    ),
    (
        Action::Pan(Edge::Right),
        "Right",
        "Pan right, unless you drive",
    ),
];
const ROBOTS: &[Row] = &[
    (Action::Robot(1), "Ctrl+1", "Robot 1"),
    (Action::Robot(2), "Ctrl+2", "Robot 2"),
    (Action::Robot(3), "Ctrl+3", "Robot 3"),
    (Action::Robot(4), "Ctrl+4", "Robot 4"),
    (Action::Robot(5), "Ctrl+5", "Robot 5"),
    (Action::Robot(6), "Ctrl+6", "Robot 6"),
    (Action::Robot(7), "Ctrl+7", "Robot 7"),
    (Action::Robot(8), "Ctrl+8", "Robot 8"),
    (Action::Robot(9), "Ctrl+9", "Robot 9"),
    (Action::TypeAddress, "Ctrl+L", "Type an address"),
    (Action::Lease, "Ctrl+G", "Request or release control"),
    (
        Action::AcknowledgeAll,
        "Ctrl+Shift+K",
        "Acknowledge all alerts",
    ),
];
const RECORDING: &[Row] = &[
    (Action::PlayOrPause, "P", "Play or pause"),
    (Action::StepBack, "Comma", "1 second back"),
    (Action::StepForward, "Period", "1 second forward"),
    (Action::JumpBack, "Shift+Comma", "10 seconds back"),
    (Action::JumpForward, "Shift+Period", "10 seconds forward"),
    (Action::Slower, "[", "Slower"),
    (Action::Faster, "]", "Faster"),
    (Action::Loop, "R", "Toggle looping"),
];
const FILES: &[Row] = &[
    (Action::OpenRecording, "Ctrl+O", "Open recording…"),
    (Action::Export, "Ctrl+E", "Export maps…"),
    (Action::Screenshot, "Ctrl+S", "Save a screenshot"),
    (Action::Quit, "Ctrl+Q", "Quit"),
];
const WINDOW: &[Row] = &[
    (Action::NextPanel, "F6", "Next panel"),
    (Action::PreviousPanel, "Shift+F6", "Previous panel"),
    (Action::ResetLayout, "", "Reset layout"),
    (Action::ToggleTheme, "Ctrl+Shift+D", "Switch dark and light"),
    (Action::ScaleUp, "Ctrl++ Ctrl+=", "Larger"),
    (Action::ScaleDown, "Ctrl+−", "Smaller"),
    (Action::ScaleReset, "Ctrl+0", "Reset zoom"),
    (Action::ShortcutSheet, "F1 ?", "Keyboard shortcuts"),
    (Action::About, "", "About Foreshore"),
    (Action::CloseDialog, "Esc", "Close, unpin a reading"),
];

#[cfg(test)]
mod tests;
