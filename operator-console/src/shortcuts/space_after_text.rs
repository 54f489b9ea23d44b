//! The space bar right behind a text.
//!
//! While text is typed and nobody drives from here, a space is a space. The window knows that a text has ended only with its
//! next frame: what was pressed until then is looked at once more, so that no emergency stop is lost.

use eframe::egui::{Event, Key};

/// Whether the space bar was pressed behind what ends a text: for a stop, not for the text.
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
    use eframe::egui::{Modifiers, PointerButton, pos2};

    use super::*;

    fn key(key: Key, repeat: bool) -> Event {
        Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat,
            modifiers: Modifiers::NONE,
        }
    }

    #[test]
    fn a_space_in_a_text_is_none_and_one_behind_it_is() {
        let space = || key(Key::Space, false);
        let click = Event::PointerButton {
            pos: pos2(1.0, 2.0),
            button: PointerButton::Primary,
            pressed: true,
            modifiers: Modifiers::NONE,
        };
        assert!(!has_space_after_text(&[]));
        assert!(!has_space_after_text(&[space(), key(Key::A, false)]));
        assert!(!has_space_after_text(&[space(), key(Key::Enter, false)]));
        for end in [key(Key::Escape, false), key(Key::Enter, false), click] {
            assert!(has_space_after_text(&[space(), end.clone(), space()]));
            assert!(has_space_after_text(&[
                end.clone(),
                key(Key::M, false),
                space()
            ]));
            // It went down in the text.
            assert!(!has_space_after_text(&[end, key(Key::Space, true)]));
        }
    }
}
