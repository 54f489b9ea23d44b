use eframe::egui::{Event, vec2};
use egui_kittest::Harness;
use protocol::layer::LayerId;

use super::*;

/// Driving keys, which never reach the window while a vehicle can be driven, unless a modifier other than Shift is
/// held (`input_loop`).
const OF_THE_HELM: [Key; 14] = [
    Key::W,
    Key::A,
    Key::S,
    Key::D,
    Key::ArrowUp,
    Key::ArrowLeft,
    Key::ArrowDown,
    Key::ArrowRight,
    Key::Num1,
    Key::Num2,
    Key::Num3,
    Key::Num4,
    Key::Num5,
    Key::Space,
];

/// All bindings may be active at the same time. Signs are tested with Shift and on other keyboards, too.
#[test]
fn no_key_has_two_meanings() {
    let mut tried = 0;
    for binding in bindings() {
        for (text, keys) in &binding.keys {
            let key = keys.logical_key;
            let others = bindings().iter().filter(|other| *other != binding);
            for held in [keys.modifiers, keys.modifiers | Modifiers::SHIFT] {
                let other = others
                    .clone()
                    .find(|other| other.keys.iter().any(|(_, other)| fits(*other, key, held)));
                let is_it = fits(*keys, key, held);
                assert!(!is_it || other.is_none(), "{text}: {other:?}");
                tried += usize::from(is_it);
            }
        }
    }
    assert!(tried > 45, "{tried}");
    let actions: std::collections::BTreeSet<_> =
        bindings().iter().map(|binding| binding.action).collect();
    assert_eq!(actions.len(), bindings().len(), "each action has one row");
}

#[test]
fn no_shortcut_is_a_driving_key() {
    for binding in bindings() {
        // Arrows pan only while this console does not drive.
        if matches!(binding.action, Action::Pan(_)) {
            continue;
        }
        for (text, keys) in &binding.keys {
            let is_plain = !keys.modifiers.alt && !keys.modifiers.command && !keys.modifiers.ctrl;
            let is_the_helms = is_plain && OF_THE_HELM.contains(&keys.logical_key);
            assert!(!is_the_helms, "{text} is a driving key");
        }
    }
}

#[test]
fn key_texts() {
    assert_eq!(Action::Screenshot.keys(), "Ctrl+S");
    assert_eq!(Action::ToggleTheme.keys(), "Ctrl+Shift+D");
    assert_eq!(Action::Pan(Edge::Left).keys(), "Left");
    assert_eq!(Action::ResetLayout.keys(), "");
    assert_eq!(Action::Layer(LayerId::Elevation).keys(), "Alt+2");
    assert_eq!(Action::Export.words(), "Export maps…");
    assert_eq!(Action::JumpBack.keys(), "Shift+Comma");
    assert_eq!(Action::Faster.keys(), "]");
}

#[derive(Clone, Copy)]
struct Frame {
    scene: KeyContext,
    has_field: bool,
    /// Physical key, named by the US keyboard.
    place: Option<Key>,
}

const QUIET: Frame = Frame {
    scene: KeyContext {
        is_driving: false,
        has_recording: false,
        was_typing: false,
    },
    has_field: false,
    place: None,
};

impl Frame {
    const fn with_field() -> Self {
        Self {
            has_field: true,
            ..QUIET
        }
    }

    const fn with_recording() -> Self {
        Self {
            scene: KeyContext {
                has_recording: true,
                ..QUIET.scene
            },
            ..QUIET
        }
    }

    fn presses(self, key: Key, modifiers: Modifiers) -> Vec<Action> {
        let mut harness = Harness::builder()
            .with_size(vec2(300.0, 100.0))
            .build_ui_state(
                move |ui, (actions, typed): &mut (Vec<Action>, String)| {
                    actions.extend(pressed(ui.ctx(), self.scene).actions);
                    let label = ui.label("Field");
                    let field = ui.text_edit_singleline(typed).labelled_by(label.id);
                    if self.has_field {
                        field.request_focus();
                    }
                },
                (Vec::new(), String::new()),
            );
        harness.run_steps(2);
        for _frame in 0..2 {
            harness.event(Event::Key {
                key,
                physical_key: self.place,
                pressed: true,
                repeat: false,
                modifiers,
            });
            harness.run_steps(1);
        }
        harness.state().0.clone()
    }

    fn press(self, key: Key, modifiers: Modifiers) -> Option<Action> {
        self.presses(key, modifiers).first().copied()
    }
}

#[test]
fn keys_are_shortcuts_unless_typing() {
    let none = Modifiers::NONE;
    let typing = Frame::with_field();
    assert_eq!(QUIET.press(Key::F, none), Some(Action::WholeMap));
    assert_eq!(typing.press(Key::F, none), None);
    assert_eq!(QUIET.press(Key::F, Modifiers::ALT), None);
    assert_eq!(typing.press(Key::F1, none), Some(Action::ShortcutSheet));
    let ctrl = Modifiers::COMMAND;
    assert_eq!(typing.press(Key::S, ctrl), Some(Action::Screenshot));
    assert_eq!(QUIET.press(Key::S, none), None);
    // Plus is a shifted key on this keyboard.
    let plus = QUIET.press(Key::Plus, Modifiers::SHIFT);
    assert_eq!(plus, Some(Action::ZoomIn));
    let back = QUIET.press(Key::F6, Modifiers::SHIFT);
    assert_eq!(back, Some(Action::PreviousPanel));
    let mut just_typed = QUIET;
    just_typed.scene.was_typing = true;
    assert_eq!(just_typed.press(Key::F, none), None);
}

#[test]
fn only_some_actions_repeat() {
    let none = Modifiers::NONE;
    let recording = Frame::with_recording();
    for (key, times) in [
        (Key::G, 1),
        (Key::P, 1),
        (Key::CloseBracket, 1),
        (Key::Plus, 2),
        (Key::Comma, 2),
        (Key::ArrowUp, 2),
    ] {
        assert_eq!(recording.presses(key, none).len(), times, "{key:?}");
    }
}

#[test]
fn recording_shortcuts_need_an_open_recording() {
    let (none, shift) = (Modifiers::NONE, Modifiers::SHIFT);
    let recording = Frame::with_recording();
    for (key, modifiers, action) in [
        (Key::P, none, Some(Action::PlayOrPause)),
        (Key::P, shift, None),
        (Key::P, Modifiers::COMMAND, None),
        (Key::Comma, none, Some(Action::StepBack)),
        (Key::Period, none, Some(Action::StepForward)),
        (Key::Comma, shift, Some(Action::JumpBack)),
        (Key::Period, shift, Some(Action::JumpForward)),
        (Key::Period, Modifiers::COMMAND, None),
        (Key::OpenBracket, none, Some(Action::Slower)),
        (Key::CloseBracket, none, Some(Action::Faster)),
        (Key::R, none, Some(Action::Loop)),
        (Key::L, none, Some(Action::Legend)),
    ] {
        assert_eq!(recording.press(key, modifiers), action, "{key:?}");
        let is_of_recording = action.is_some_and(|action| action != Action::Legend);
        if is_of_recording {
            assert_eq!(QUIET.press(key, modifiers), None, "{key:?}: none is open");
        }
    }
    let typing = Frame {
        has_field: true,
        ..recording
    };
    assert_eq!(typing.press(Key::P, none), None);
}

#[test]
fn comma_and_period_by_position() {
    let german = |place| Frame {
        place: Some(place),
        ..Frame::with_recording()
    };
    let shift = Modifiers::SHIFT;
    let back = german(Key::Comma).press(Key::Semicolon, shift);
    assert_eq!(back, Some(Action::JumpBack));
    let on = german(Key::Period).press(Key::Colon, shift);
    assert_eq!(on, Some(Action::JumpForward));
    // The printed V has priority over the physical period.
    let dvorak = german(Key::Period).press(Key::V, Modifiers::NONE);
    assert_eq!(dvorak, Some(Action::Follow));
    let p = german(Key::R).press(Key::P, Modifiers::NONE);
    assert_eq!(p, Some(Action::PlayOrPause));
}

#[test]
fn arrows_pan_only_while_not_driving() {
    let none = Modifiers::NONE;
    let left = Some(Action::Pan(Edge::Left));
    assert_eq!(QUIET.press(Key::ArrowLeft, none), left);
    let mut driving = QUIET;
    driving.scene.is_driving = true;
    assert_eq!(driving.press(Key::ArrowLeft, none), None);
    assert_eq!(Frame::with_field().press(Key::ArrowLeft, none), None);
}
