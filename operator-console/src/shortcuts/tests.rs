use eframe::egui::{Event, vec2};
use egui_kittest::Harness;
use protocol::layer::LayerId;

use super::*;

/// Keys that are the helm's as long as nothing but Shift is held with them (`input_loop/keys.rs`), and so never reach
/// the window while there is something to drive.
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

/// Every binding may be live together with every other: arrows with what a recording is paced by, and both with the
/// rest. What Shift adds to a sign, and where it is on other keyboards, is tried too.
#[test]
fn no_key_means_two_things_at_a_time() {
    let mut tried = 0;
    for binding in bindings() {
        for keys in &binding.keys {
            let key = keys.logical_key;
            let others = bindings().iter().filter(|other| *other != binding);
            for held in [keys.modifiers, keys.modifiers | Modifiers::SHIFT] {
                let other = others
                    .clone()
                    .find(|other| other.keys.iter().any(|other| fits(*other, key, held)));
                let is_it = fits(*keys, key, held);
                assert!(!is_it || other.is_none(), "{}: {other:?}", words(*keys));
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
fn no_action_has_a_key_that_drives() {
    for binding in bindings() {
        // Arrows look around where nobody drives: the handler, and the loop before it, see to that.
        if matches!(binding.action, Action::Pan(_)) {
            continue;
        }
        for keys in &binding.keys {
            let is_plain = !keys.modifiers.alt && !keys.modifiers.command && !keys.modifiers.ctrl;
            let is_the_helms = is_plain && OF_THE_HELM.contains(&keys.logical_key);
            assert!(!is_the_helms, "{} is the helm's", words(*keys));
        }
    }
}

#[test]
fn keys_are_told_in_words() {
    assert_eq!(Action::Screenshot.keys(), "Ctrl+S");
    assert_eq!(Action::ToggleTheme.keys(), "Ctrl+Shift+D");
    assert_eq!(Action::Pan(Edge::Left).keys(), "Left");
    assert_eq!(Action::ResetLayout.keys(), "");
    assert_eq!(Action::Layer(LayerId::Elevation).keys(), "Alt+2");
    assert_eq!(Action::Export.words(), "Export maps…");
    assert_eq!(Action::JumpBack.keys(), "Shift+Comma");
    assert_eq!(Action::Faster.keys(), "]");
}

/// What a frame makes of a key.
#[derive(Clone, Copy)]
struct Frame {
    scene: KeyContext,
    /// Whether a text field has the keyboard.
    has_field: bool,
    /// Where the key is, by what is printed there on an American keyboard.
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

    /// What `key` means with `modifiers` held, the first time and while it is kept down.
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
fn keys_mean_what_the_table_says_and_text_is_text() {
    let none = Modifiers::NONE;
    let typing = Frame::with_field();
    assert_eq!(QUIET.press(Key::F, none), Some(Action::WholeMap));
    assert_eq!(typing.press(Key::F, none), None);
    assert_eq!(QUIET.press(Key::F, Modifiers::ALT), None);
    assert_eq!(typing.press(Key::F1, none), Some(Action::ShortcutSheet));
    let ctrl = Modifiers::COMMAND;
    assert_eq!(typing.press(Key::S, ctrl), Some(Action::Screenshot));
    assert_eq!(QUIET.press(Key::S, none), None);
    // On this keyboard the plus is beside the digits, with Shift.
    let plus = QUIET.press(Key::Plus, Modifiers::SHIFT);
    assert_eq!(plus, Some(Action::ZoomIn));
    let back = QUIET.press(Key::F6, Modifiers::SHIFT);
    assert_eq!(back, Some(Action::PreviousPanel));
    let mut just_typed = QUIET;
    just_typed.scene.was_typing = true;
    assert_eq!(just_typed.press(Key::F, none), None);
}

#[test]
fn what_is_held_is_done_again_only_where_that_makes_sense() {
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
fn a_recording_has_keys_while_it_is_open() {
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
fn comma_and_period_are_found_where_shift_makes_something_else_of_them() {
    let german = |place| Frame {
        place: Some(place),
        ..Frame::with_recording()
    };
    let shift = Modifiers::SHIFT;
    let back = german(Key::Comma).press(Key::Semicolon, shift);
    assert_eq!(back, Some(Action::JumpBack));
    let on = german(Key::Period).press(Key::Colon, shift);
    assert_eq!(on, Some(Action::JumpForward));
    // Where Dvorak has its V there is a period in America: what is printed counts first.
    let dvorak = german(Key::Period).press(Key::V, Modifiers::NONE);
    assert_eq!(dvorak, Some(Action::Follow));
    let p = german(Key::R).press(Key::P, Modifiers::NONE);
    assert_eq!(p, Some(Action::PlayOrPause));
}

#[test]
fn arrows_look_around_only_where_nobody_drives() {
    let none = Modifiers::NONE;
    let left = Some(Action::Pan(Edge::Left));
    assert_eq!(QUIET.press(Key::ArrowLeft, none), left);
    let mut driving = QUIET;
    driving.scene.is_driving = true;
    assert_eq!(driving.press(Key::ArrowLeft, none), None);
    assert_eq!(Frame::with_field().press(Key::ArrowLeft, none), None);
}
