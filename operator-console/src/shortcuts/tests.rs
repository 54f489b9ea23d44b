use std::collections::BTreeMap;

use eframe::egui::{Event, vec2};
use egui_kittest::Harness;

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

#[test]
fn no_two_actions_have_the_same_keys() {
    let mut taken: BTreeMap<String, Action> = BTreeMap::new();
    for binding in bindings() {
        for keys in &binding.keys {
            let other = taken.insert(words(*keys), binding.action);
            assert_eq!(other, None, "{} is also {:?}", words(*keys), binding.action);
        }
    }
    assert!(taken.len() > 30);
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
    assert_eq!(Action::NextTheme.keys(), "Ctrl+Shift+D");
    assert_eq!(Action::Pan(Edge::Left).keys(), "Left");
    assert_eq!(Action::ResetLayout.keys(), "");
    assert_eq!(Action::Layer(LayerId::Elevation).keys(), "Alt+2");
    assert_eq!(Action::Export.words(), "Export maps…");
}

/// What `key` means with `modifiers` held, where `text` says whether a text field has the keyboard.
fn meaning(key: Key, modifiers: Modifiers, is_driving: bool, text: bool) -> Vec<Action> {
    let mut harness = Harness::builder()
        .with_size(vec2(300.0, 100.0))
        .build_ui_state(
            |ui, (actions, typed): &mut (Vec<Action>, String)| {
                actions.extend(pressed(ui.ctx(), is_driving));
                let label = ui.label("Field");
                let field = ui.text_edit_singleline(typed).labelled_by(label.id);
                if text {
                    field.request_focus();
                }
            },
            (Vec::new(), String::new()),
        );
    harness.run_steps(2);
    harness.event(Event::Key {
        key,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers,
    });
    harness.run_steps(1);
    harness.state().0.clone()
}

#[test]
fn keys_mean_what_the_table_says_and_text_is_text() {
    let none = Modifiers::NONE;
    assert_eq!(meaning(Key::F, none, false, false), [Action::WholeMap]);
    assert_eq!(meaning(Key::F, none, false, true), []);
    assert_eq!(meaning(Key::F, Modifiers::ALT, false, false), []);
    assert_eq!(meaning(Key::F1, none, false, true), [Action::ShortcutSheet]);
    let ctrl = Modifiers::COMMAND;
    assert_eq!(meaning(Key::S, ctrl, false, true), [Action::Screenshot]);
    assert_eq!(meaning(Key::S, none, false, false), []);
    // On this keyboard the plus is beside the digits, with Shift.
    let plus = meaning(Key::Plus, Modifiers::SHIFT, false, false);
    assert_eq!(plus, [Action::ZoomIn]);
    assert_eq!(
        meaning(Key::F6, Modifiers::SHIFT, false, false),
        [Action::PreviousPanel]
    );
}

#[test]
fn arrows_look_around_only_where_nobody_drives() {
    let none = Modifiers::NONE;
    let left = [Action::Pan(Edge::Left)];
    assert_eq!(meaning(Key::ArrowLeft, none, false, false), left);
    assert_eq!(meaning(Key::ArrowLeft, none, true, false), []);
    assert_eq!(meaning(Key::ArrowLeft, none, false, true), []);
}
