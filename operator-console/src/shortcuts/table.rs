//! The table.

use std::sync::LazyLock;

use eframe::egui::{Key, KeyboardShortcut, Modifiers};
use protocol::layer::LayerId;

use super::{Action, Edge};
use crate::panels::layers::layer_name;

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

/// What belongs together on the sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// How to look at the map.
    Map,
    /// Robots and what happens to them.
    Robots,
    /// The recording that is open, if one is.
    Recording,
    /// In and out.
    Files,
    /// The window itself.
    Window,
}

/// An action, its keys and its words.
#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    /// What it does.
    pub action: Action,
    /// Any of these does it.
    pub keys: Vec<KeyboardShortcut>,
    /// The same in words.
    pub words: &'static str,
    /// Where it stands on the sheet.
    pub group: Group,
}

impl Group {
    /// All of them, in the order of the sheet.
    pub const ALL: [Self; 5] = [
        Self::Map,
        Self::Robots,
        Self::Recording,
        Self::Files,
        Self::Window,
    ];

    /// Its heading.
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

/// Every action that has a name.
pub fn bindings() -> &'static [Binding] {
    static TABLE: LazyLock<Vec<Binding>> =
        LazyLock::new(|| [layers(), map(), robots(), recording(), files(), window()].concat());
    &TABLE
}

pub(super) fn binding_of(action: Action) -> Option<&'static Binding> {
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

/// Digits alone are steps of speed.
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
