//! What is typed right behind keys that open a text field.
//!
//! The field is there, and has the keyboard, only some frames later. A frame may take as long as a hand needs for several
//! keys: they wait here for the field instead of meaning something else, or nothing.

use eframe::egui::{Context, Event, ImeEvent};

/// A field that does not have the keyboard so many frames later never will.
const PATIENCE_FRAMES: u32 = 10;

/// What waits for a text field that is about to open.
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
    /// A text field is about to open, and `typed` came behind the keys that open it.
    pub fn wait(&mut self, ctx: &Context, typed: Vec<Event>) {
        let waiting = self.waiting.get_or_insert_default();
        waiting.typed.extend(typed);
        // It is not for a field that had the keyboard until now.
        ctx.memory_mut(|memory| {
            if let Some(before) = memory.focused() {
                memory.surrender_focus(before);
            }
        });
        ctx.request_repaint();
    }

    /// Whether a text field is waited for: what is typed is text.
    pub const fn is_waiting(&self) -> bool {
        self.waiting.is_some()
    }

    /// To be called before anything of a frame is drawn: a text field that has the keyboard gets what waited for it. Where
    /// none comes, everybody sees it.
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

/// Whether a text field would want it.
pub(super) const fn is_typed(event: &Event) -> bool {
    matches!(
        event,
        Event::Key { pressed: true, .. }
            | Event::Text(_)
            | Event::Paste(_)
            | Event::Ime(ImeEvent::Commit(_) | ImeEvent::Preedit { .. })
    )
}

#[cfg(test)]
mod tests {
    use eframe::egui::{Key, Modifiers, RawInput, TextEdit};

    use super::super::{Action, KeyContext, Pressed, pressed};
    use super::*;

    /// A window with a text field that opens some frames after its keys.
    #[derive(Default)]
    struct Window {
        ctx: Context,
        type_ahead: TypeAhead,
        opens_in: Option<u32>,
        has_field: bool,
        text: String,
        /// A field that is always there, and at first has the keyboard where it is wanted to.
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

    /// As a window hears it.
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
    fn what_is_typed_before_the_field_is_there_goes_into_it() {
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
    fn nothing_goes_into_the_field_that_had_the_keyboard() {
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
    fn where_no_field_comes_keys_mean_what_they_meant() {
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
}
