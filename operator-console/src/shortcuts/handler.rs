//! Turns pressed keys into actions, and buffers text typed before its field is open.

use eframe::egui::{Context, Event, ImeEvent, Key, KeyboardShortcut, Modifiers};

use super::{Action, Binding, Group, bindings, fits};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeyContext {
    pub is_driving: bool,
    pub has_recording: bool,
    /// At the end of the last frame: one frame may contain letters and the key that ends typing.
    pub was_typing: bool,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pressed {
    pub actions: Vec<Action>,
    /// Text typed after a key that opens a text field.
    pub typed_ahead: Option<Vec<Event>>,
}

/// Consumes pressed shortcuts and returns their actions.
///
/// While a text field has the focus, plain keys are text. Arrow keys pan only if this console does not drive and no
/// widget has the focus.
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
                // Closes a dialog, or else leaves a text field.
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

/// The printed character has priority over the physical position.
fn find_binding(key: Key, place: Option<Key>, held: Modifiers) -> Option<&'static Binding> {
    let find = |is_it: &dyn Fn(KeyboardShortcut) -> bool| {
        let mut bindings = bindings().iter();
        bindings.find(|binding| binding.keys.iter().any(|(_, keys)| is_it(*keys)))
    };
    let printed = find(&|keys| fits(keys, key, held));
    printed.or_else(|| {
        let place = place?;
        find(&|keys| matches_physical_key(keys) && fits(keys, place, held))
    })
}

/// Comma and period are used for their position. Their Shift characters differ between keyboards.
const fn matches_physical_key(keys: KeyboardShortcut) -> bool {
    matches!(keys.logical_key, Key::Comma | Key::Period)
}

fn is_text(key: Key, held: Modifiers) -> bool {
    let is_function = matches!(key, Key::F1 | Key::F6 | Key::Escape);
    !is_function && !held.command && !held.ctrl && !held.alt
}

/// A text field gets the focus within this number of frames, or never.
const PATIENCE_FRAMES: u32 = 10;

/// Text for a field that is about to open: a slow frame may contain several keys.
#[derive(Clone, Debug, Default)]
pub struct TypeAhead {
    waiting: Option<Waiting>,
}

#[derive(Clone, Debug, Default)]
struct Waiting {
    typed: Vec<Event>,
    frames: u32,
}

impl TypeAhead {
    pub fn wait(&mut self, ctx: &Context, typed: Vec<Event>) {
        let waiting = self.waiting.get_or_insert_default();
        waiting.typed.extend(typed);
        // A field that had the focus before must not receive the text.
        ctx.memory_mut(|memory| {
            if let Some(before) = memory.focused() {
                memory.surrender_focus(before);
            }
        });
        ctx.request_repaint();
    }

    pub const fn is_waiting(&self) -> bool {
        self.waiting.is_some()
    }

    /// Must be called before a frame is drawn: passes the buffered text to the focused field.
    pub fn begin_frame(&mut self, ctx: &Context) {
        let Some(waiting) = &mut self.waiting else {
            return;
        };
        let is_over = ctx.text_edit_focused() || waiting.frames >= PATIENCE_FRAMES;
        ctx.input_mut(|input| {
            if is_over {
                let typed = std::mem::take(&mut waiting.typed);
                input.events.splice(..0, typed);
            } else {
                let typed = input.events.extract_if(.., |event| is_typed(event));
                waiting.typed.extend(typed);
            }
        });
        if is_over {
            self.waiting = None;
        } else {
            waiting.frames += 1;
            ctx.request_repaint();
        }
    }
}

const fn is_typed(event: &Event) -> bool {
    matches!(
        event,
        Event::Key { pressed: true, .. }
            | Event::Text(_)
            | Event::Paste(_)
            | Event::Ime(ImeEvent::Commit(_) | ImeEvent::Preedit { .. })
    )
}

/// Whether the space bar was pressed after a key or click that ends typing. Then it is an emergency stop, not text:
/// the window knows only in its next frame that typing has ended.
pub fn has_space_after_text(events: &[Event]) -> bool {
    let mut behind = events.iter().skip_while(|event| !ends_text(event));
    behind.any(|event| {
        matches!(
            event,
            Event::Key {
                key: Key::Space,
                pressed: true,
                repeat: false,
                ..
            }
        )
    })
}

const fn ends_text(event: &Event) -> bool {
    matches!(
        event,
        Event::Key {
            key: Key::Escape | Key::Enter | Key::Tab,
            pressed: true,
            ..
        } | Event::PointerButton { pressed: true, .. }
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Key, Modifiers, PointerButton, RawInput, TextEdit, pos2};

    use super::super::{Action, KeyContext, Pressed, pressed};

    /// A window with a text field that opens some frames after its shortcut.
    #[derive(Default)]
    struct Window {
        ctx: Context,
        type_ahead: TypeAhead,
        opens_in: Option<u32>,
        has_field: bool,
        text: String,
        /// A field that is always present, and may have the focus first.
        other: String,
        is_other_first: bool,
        actions: Vec<Action>,
    }

    impl Window {
        fn frame(&mut self, events: &[Event]) {
            let input = RawInput {
                events: events.to_vec(),
                ..RawInput::default()
            };
            let ctx = self.ctx.clone();
            let mut output = ctx.run_ui(input, |ui| {
                self.type_ahead.begin_frame(ui.ctx());
                let Pressed {
                    actions,
                    typed_ahead,
                } = pressed(ui.ctx(), KeyContext::default());
                if let Some(typed) = typed_ahead {
                    self.type_ahead.wait(ui.ctx(), typed);
                    self.has_field = self.opens_in.is_some();
                }
                self.actions.extend(actions);
                let other = ui.add(TextEdit::singleline(&mut self.other));
                if std::mem::take(&mut self.is_other_first) {
                    other.request_focus();
                }
                if self.has_field {
                    let field = ui.add(TextEdit::singleline(&mut self.text));
                    match self.opens_in {
                        Some(0) => field.request_focus(),
                        Some(frames) => self.opens_in = Some(frames - 1),
                        None => {}
                    }
                }
            });
            output.textures_delta.clear();
        }
    }

    fn key(key: Key, modifiers: Modifiers) -> Event {
        Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers,
        }
    }

    /// The events of typed letters.
    fn typed(letters: &str) -> Vec<Event> {
        letters
            .chars()
            .flat_map(|letter| {
                let name = letter.to_ascii_uppercase().to_string();
                let key = Key::from_name(&name).map(|it| key(it, Modifiers::NONE));
                key.into_iter().chain([Event::Text(letter.to_string())])
            })
            .collect()
    }

    #[test]
    fn text_typed_early_goes_into_the_field() {
        let open = key(Key::L, Modifiers::COMMAND);
        for opens_in in 0..4 {
            let mut window = Window {
                opens_in: Some(opens_in),
                ..Window::default()
            };
            window.frame(&[]);
            // L, F and G alone would change the map.
            window.frame(&[vec![open.clone()], typed("flag")].concat());
            window.frame(&typed("1"));
            window.frame(&typed("2"));
            for _later in 0..5 {
                window.frame(&[]);
            }
            window.frame(&typed("3"));
            assert_eq!(window.text, "flag123", "{opens_in}");
            assert_eq!(window.actions, [Action::TypeAddress]);
            assert!(!window.type_ahead.is_waiting());
        }
    }

    #[test]
    fn buffered_text_skips_the_previous_field() {
        let mut window = Window {
            opens_in: Some(2),
            is_other_first: true,
            ..Window::default()
        };
        window.frame(&[]);
        window.frame(&typed("a"));
        let open = key(Key::L, Modifiers::COMMAND);
        window.frame(&[vec![open], typed("b")].concat());
        for _later in 0..6 {
            window.frame(&[]);
        }
        assert_eq!((window.other.as_str(), window.text.as_str()), ("a", "b"));
    }

    #[test]
    fn buffered_keys_return_without_a_field() {
        let mut window = Window::default();
        window.frame(&[]);
        let open = key(Key::L, Modifiers::COMMAND);
        window.frame(&[vec![open], typed("f")].concat());
        for _frame in 0..=PATIENCE_FRAMES {
            assert_eq!(window.actions, [Action::TypeAddress]);
            window.frame(&[]);
        }
        assert_eq!(window.actions, [Action::TypeAddress, Action::WholeMap]);
    }

    fn press(key: Key, repeat: bool) -> Event {
        Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat,
            modifiers: Modifiers::NONE,
        }
    }

    #[test]
    fn a_space_after_typing_is_an_emergency_stop() {
        let space = || press(Key::Space, false);
        let click = Event::PointerButton {
            pos: pos2(1.0, 2.0),
            button: PointerButton::Primary,
            pressed: true,
            modifiers: Modifiers::NONE,
        };
        assert!(!has_space_after_text(&[]));
        assert!(!has_space_after_text(&[space(), press(Key::A, false)]));
        assert!(!has_space_after_text(&[space(), press(Key::Enter, false)]));
        for end in [press(Key::Escape, false), press(Key::Enter, false), click] {
            assert!(has_space_after_text(&[space(), end.clone(), space()]));
            assert!(has_space_after_text(&[
                end.clone(),
                press(Key::M, false),
                space()
            ]));
            assert!(!has_space_after_text(&[end, press(Key::Space, true)]));
        }
    }
}
