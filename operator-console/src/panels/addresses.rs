//! Text field for the address of a robot or router.

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::text_edit::TextEditState;
use eframe::egui::{Id, Key, Label, TextEdit, TextStyle, Ui};
use network::endpoints::{DEFAULT_PORT, check_console};

use super::formatting::with_monospace_options;
use crate::command::Command;
use crate::shortcuts::Action;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AddressEntry {
    text: String,
    error: Option<String>,
    wants_keyboard: bool,
}

impl AddressEntry {
    pub const fn focus(&mut self) {
        self.wants_keyboard = true;
    }

    /// Clears a rejected address and its error.
    pub fn clear_error(&mut self) {
        if self.error.is_some() {
            *self = Self::default();
        }
    }

    pub fn submit(&mut self, has_keys: bool) -> Option<Command> {
        let address = self.text.trim().to_owned();
        if address.is_empty() {
            self.error = None;
            return None;
        }
        // The default protocol depends on the keys.
        let address = if address.contains('/') {
            address
        } else {
            format!("{}/{address}", protocol(has_keys))
        };
        if check_console(&address, has_keys).is_ok() {
            *self = Self::default();
            return Some(Command::AddAddress(address));
        }
        self.error = Some(expected_address(has_keys));
        None
    }
}

const fn protocol(has_keys: bool) -> &'static str {
    if has_keys { "quic" } else { "tcp" }
}

fn expected_address(has_keys: bool) -> String {
    if has_keys {
        format!(
            "With --keys, type a host name or an IPv4 address and a port, without tcp/, for example \
             192.168.1.20:{DEFAULT_PORT}."
        )
    } else {
        format!(
            "Without --keys, type host:port, without quic/ or tls/, for example 192.168.1.20:{DEFAULT_PORT}, or \
             [::1]:{DEFAULT_PORT} for IPv6."
        )
    }
}

pub(super) fn address_ui(ui: &mut Ui, entry: &mut AddressEntry, has_keys: bool) -> Option<Command> {
    let mut command = None;
    ui.horizontal(|ui| {
        let label = ui.label("Address");
        let width = (ui.available_width() - 56.0).max(60.0);
        let text = TextEdit::singleline(&mut entry.text)
            .hint_text(format!("host:{DEFAULT_PORT}"))
            .char_limit(200)
            .desired_width(width);
        let text = ui.add(text).labelled_by(label.id);
        if entry.wants_keyboard {
            text.request_focus();
            // Typing replaces the rejected address.
            select_all(ui, text.id, &entry.text);
            entry.wants_keyboard = false;
        }
        let keys = Action::TypeAddress.keys();
        let text = text.on_hover_text(format!("Address of a robot or router ({keys})"));
        if text.changed() {
            entry.error = None;
        }
        if text.lost_focus() && ui.input(|input| input.key_pressed(Key::Escape)) {
            *entry = AddressEntry::default();
        }
        let is_entered = text.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let button = ui
            .button("Add")
            .on_hover_text("Ask this address for robots");
        if is_entered || button.clicked() {
            command = entry.submit(has_keys);
            if entry.error.is_some() {
                text.request_focus();
            }
        }
    });
    if let Some(error) = &entry.error {
        let color = ui.visuals().warn_fg_color;
        ui.add(Label::new(with_monospace_options(ui, error, &TextStyle::Small, color)).wrap());
    }
    command
}

fn select_all(ui: &Ui, field: Id, text: &str) {
    let mut state = TextEditState::load(ui.ctx(), field).unwrap_or_default();
    let all = CCursorRange::two(CCursor::default(), CCursor::new(text.chars().count()));
    state.cursor.set_char_range(Some(all));
    state.store(ui.ctx(), field);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn submit(text: &str, has_keys: bool) -> (Option<Command>, AddressEntry) {
        let mut entry = AddressEntry {
            text: text.to_owned(),
            ..AddressEntry::default()
        };
        (entry.submit(has_keys), entry)
    }

    #[test]
    fn an_address_is_accepted_or_explained() {
        for (typed, has_keys, address) in [
            ("tcp/10.0.0.5:7447", false, "tcp/10.0.0.5:7447"),
            ("  tcp/boat:9 ", false, "tcp/boat:9"),
            ("boat:7447", false, "tcp/boat:7447"),
            ("[::1]:7447", false, "tcp/[::1]:7447"),
            ("boat:7447", true, "quic/boat:7447"),
            ("tls/boat:7447", true, "tls/boat:7447"),
        ] {
            let (command, entry) = submit(typed, has_keys);
            assert_eq!(command, Some(Command::AddAddress(address.to_owned())));
            assert_eq!(entry, AddressEntry::default());
        }
        for (has_keys, refused) in [
            (
                false,
                &[
                    "nosuchhost",
                    "10.0.0.5",
                    "tcp/boat",
                    "[::1]",
                    "my boat",
                    "boat:",
                    ":7447",
                    "udp/boat",
                    "tcp/boat:0",
                    "tcp/boat:65535",
                    "http://boat:80",
                    "fe80::1:7447",
                    "udp/boat:7447",
                    "quic/boat:7447",
                ][..],
            ),
            (true, &["boat", "tcp/boat:7447", "[::1]:7447"]),
        ] {
            for typed in refused {
                let (command, entry) = submit(typed, has_keys);
                assert_eq!(command, None, "{typed}");
                assert_eq!(entry.text, *typed, "it can be corrected");
                assert_eq!(entry.error, Some(expected_address(has_keys)));
            }
        }
        assert_eq!(submit("  ", false).1.error, None);
    }
}
