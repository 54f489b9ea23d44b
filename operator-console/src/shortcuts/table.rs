//! Actions and their keys.

use std::sync::LazyLock;

use eframe::egui::{Key, KeyboardShortcut, Modifiers};
use protocol::layer::LayerId;

use super::words;
use crate::panels::layers::layer_name;

/// An action with a shortcut or menu entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Action {
    Layer(LayerId),
    WholeMap,
    Follow,
    Turn,
    Grid,
    Legend,
    /// Start or end measuring.
    Measure,
    /// Measure or read the middle of the map.
    Point,
    /// Remove the last point.
    UndoPoint,
    ZoomIn,
    ZoomOut,
    /// Pan towards an edge.
    Pan(Edge),
    /// Show the robot with this number, from 1.
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
    /// Close a dialog, end measuring, or unpin.
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
    /// Text for menus and the sheet.
    pub fn words(self) -> &'static str {
        binding_of(self).map_or("", |binding| binding.words)
    }

    /// Text of the first key; empty without one.
    pub fn keys(self) -> String {
        binding_of(self)
            .and_then(|binding| binding.keys.first())
            .map(|keys| words(*keys))
            .unwrap_or_default()
    }

    /// Whether it opens a text field.
    pub(super) const fn opens_text(self) -> bool {
        matches!(self, Self::TypeAddress | Self::OpenRecording)
    }

    /// Whether it repeats while the key is held.
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

const PLAIN: Modifiers = Modifiers::NONE;
const CTRL: Modifiers = Modifiers::COMMAND;
const ALT: Modifiers = Modifiers::ALT;
const SHIFT: Modifiers = Modifiers::SHIFT;
const CTRL_SHIFT: Modifiers = CTRL.plus(SHIFT);
const DIGITS: [Key; 9] = [
    Key::Num1,
    Key::Num2,
    Key::Num3,
    Key::Num4,
    Key::Num5,
    Key::Num6,
    Key::Num7,
    Key::Num8,
    Key::Num9,
];

/// Group on the sheet.
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
    pub keys: Vec<KeyboardShortcut>,
    /// Text for menus and the sheet.
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

/// All bindings.
pub fn bindings() -> &'static [Binding] {
    static TABLE: LazyLock<Vec<Binding>> =
        LazyLock::new(|| [layers(), map(), robots(), recording(), files(), window()].concat());
    &TABLE
}

fn binding_of(action: Action) -> Option<&'static Binding> {
    bindings().iter().find(|binding| binding.action == action)
}

type Row<'a> = (Action, &'static str, &'a [(Modifiers, Key)]);

fn rows(group: Group, rows: &[Row<'_>]) -> Vec<Binding> {
    let binding = |(action, words, keys): &Row<'_>| Binding {
        action: *action,
        keys: keys
            .iter()
            .map(|(modifiers, key)| KeyboardShortcut::new(*modifiers, *key))
            .collect(),
        words,
        group,
    };
    rows.iter().map(binding).collect()
}

/// Digits alone select the speed step.
fn layers() -> Vec<Binding> {
    let of = |(layer, key)| {
        let row = (Action::Layer(layer), layer_name(layer), &[(ALT, key)][..]);
        rows(Group::Map, &[row])
    };
    LayerId::ALL.into_iter().zip(DIGITS).flat_map(of).collect()
}

fn map() -> Vec<Binding> {
    let pan = |edge, words, key| (Action::Pan(edge), words, [(PLAIN, key)]);
    let pans = [
        pan(Edge::Top, "Pan up, unless you drive", Key::ArrowUp),
        pan(Edge::Left, "Pan left, unless you drive", Key::ArrowLeft),
        pan(Edge::Bottom, "Pan down, unless you drive", Key::ArrowDown),
        pan(Edge::Right, "Pan right, unless you drive", Key::ArrowRight),
    ];
    let mut bindings = rows(
        Group::Map,
        &[
            (Action::WholeMap, "Whole map", &[(PLAIN, Key::F)]),
            (Action::Follow, "Follow the vehicle", &[(PLAIN, Key::V)]),
            (Action::Turn, "North up or robot up", &[(PLAIN, Key::N)]),
            (Action::Grid, "Grid", &[(PLAIN, Key::G)]),
            (Action::Legend, "Legends on the map", &[(PLAIN, Key::L)]),
            (Action::Measure, "Measure", &[(PLAIN, Key::M)]),
            (
                Action::Point,
                "Read or measure the center",
                &[(PLAIN, Key::C)],
            ),
            (
                Action::UndoPoint,
                "Undo the last point",
                &[(PLAIN, Key::Backspace)],
            ),
            (
                Action::ZoomIn,
                "Zoom in",
                &[(PLAIN, Key::Plus), (PLAIN, Key::Equals)],
            ),
            (Action::ZoomOut, "Zoom out", &[(PLAIN, Key::Minus)]),
        ],
    );
    bindings.extend(rows(
        Group::Map,
        &pans
            .each_ref()
            .map(|(action, words, keys)| (*action, *words, &keys[..])),
    ));
    bindings
}

fn robots() -> Vec<Binding> {
    const NAMES: [&str; DIGITS.len()] = [
        "Robot 1", "Robot 2", "Robot 3", "Robot 4", "Robot 5", "Robot 6", "Robot 7", "Robot 8",
        "Robot 9",
    ];
    let numbered = NAMES.into_iter().zip(DIGITS).zip(1..);
    let mut bindings: Vec<_> = numbered
        .flat_map(|((name, key), number)| {
            let row = (Action::Robot(number), name, &[(CTRL, key)][..]);
            rows(Group::Robots, &[row])
        })
        .collect();
    bindings.extend(rows(
        Group::Robots,
        &[
            (Action::TypeAddress, "Type an address", &[(CTRL, Key::L)]),
            (
                Action::Lease,
                "Request or release control",
                &[(CTRL, Key::G)],
            ),
            (
                Action::AcknowledgeAll,
                "Acknowledge all alerts",
                &[(CTRL_SHIFT, Key::K)],
            ),
        ],
    ));
    bindings
}

fn recording() -> Vec<Binding> {
    rows(
        Group::Recording,
        &[
            (Action::PlayOrPause, "Play or pause", &[(PLAIN, Key::P)]),
            (Action::StepBack, "1 second back", &[(PLAIN, Key::Comma)]),
            (
                Action::StepForward,
                "1 second forward",
                &[(PLAIN, Key::Period)],
            ),
            (Action::JumpBack, "10 seconds back", &[(SHIFT, Key::Comma)]),
            (
                Action::JumpForward,
                "10 seconds forward",
                &[(SHIFT, Key::Period)],
            ),
            (Action::Slower, "Slower", &[(PLAIN, Key::OpenBracket)]),
            (Action::Faster, "Faster", &[(PLAIN, Key::CloseBracket)]),
            (Action::Loop, "Toggle looping", &[(PLAIN, Key::R)]),
        ],
    )
}

fn files() -> Vec<Binding> {
    rows(
        Group::Files,
        &[
            (Action::OpenRecording, "Open recording…", &[(CTRL, Key::O)]),
            (Action::Export, "Export maps…", &[(CTRL, Key::E)]),
            (Action::Screenshot, "Save a screenshot", &[(CTRL, Key::S)]),
            (Action::Quit, "Quit", &[(CTRL, Key::Q)]),
        ],
    )
}

fn window() -> Vec<Binding> {
    rows(
        Group::Window,
        &[
            (Action::NextPanel, "Next panel", &[(PLAIN, Key::F6)]),
            (Action::PreviousPanel, "Previous panel", &[(SHIFT, Key::F6)]),
            (Action::ResetLayout, "Reset layout", &[]),
            (
                Action::ToggleTheme,
                "Switch dark and light",
                &[(CTRL_SHIFT, Key::D)],
            ),
            (
                Action::ScaleUp,
                "Larger",
                &[(CTRL, Key::Plus), (CTRL, Key::Equals)],
            ),
            (Action::ScaleDown, "Smaller", &[(CTRL, Key::Minus)]),
            (Action::ScaleReset, "Reset zoom", &[(CTRL, Key::Num0)]),
            (
                Action::ShortcutSheet,
                "Keyboard shortcuts",
                &[(PLAIN, Key::F1), (PLAIN, Key::Questionmark)],
            ),
            (Action::About, "About Foreshore", &[]),
            (
                Action::CloseDialog,
                "Close, unpin a reading",
                &[(PLAIN, Key::Escape)],
            ),
        ],
    )
}
