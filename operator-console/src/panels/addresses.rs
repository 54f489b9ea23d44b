//! Text field for the address of a robot or router.

use std::net::Ipv6Addr;

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::text_edit::TextEditState;
use eframe::egui::{Id, Key, Label, TextEdit, TextStyle, Ui};
use network::endpoints::{DEFAULT_PORT, check_console};

use super::formatting::with_monospace_options;
use crate::command::Command;
use crate::shortcuts::Action;

/// The last port is invalid, because tiles use the next port.
const LAST_PORT: u16 = u16::MAX - 1;

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
        self.error = Some(address_error(self.text.trim(), has_keys));
        None
    }
}

const fn protocol(has_keys: bool) -> &'static str {
    if has_keys { "quic" } else { "tcp" }
}

/// What is wrong with `typed`, which is not a valid address.
fn address_error(typed: &str, has_keys: bool) -> String {
    let (protocol, place) = typed.split_once('/').unwrap_or((protocol(has_keys), typed));
    let is_ipv6 = place.starts_with('[') || place.parse::<Ipv6Addr>().is_ok();
    let is_host = |letter: char| letter.is_alphanumeric() || "-_.".contains(letter);
    match (protocol, has_keys) {
        ("tcp", true) => {
            "TCP is for robots without keys, and this console was started with --keys. \
                          Type host:port without tcp/."
                .to_owned()
        }
        ("quic" | "tls", false) => format!(
            "{} needs keys, and this console was started without --keys. Type host:port without {protocol}/.",
            protocol.to_uppercase()
        ),
        ("quic" | "tls", true) if is_ipv6 => {
            "IPv6 addresses are not supported with keys. Type a name or an IPv4 address.".to_owned()
        }
        ("tcp" | "quic" | "tls", _) if !place.is_empty() && place.chars().all(is_host) => format!(
            "The port is missing: for example {typed}:{DEFAULT_PORT}, which is usual for robots."
        ),
        _ => format!(
            "This is not an address. Type host:port with a port from 1 to {LAST_PORT}, for example \
             192.168.1.20:{DEFAULT_PORT}, or [::1]:{DEFAULT_PORT} for IPv6."
        ),
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
        for (typed, has_keys, error) in [
            (
                "nosuchhost",
                false,
                "The port is missing: for example nosuchhost:7447",
            ),
            (
                "10.0.0.5",
                false,
                "The port is missing: for example 10.0.0.5:7447",
            ),
            (
                "tcp/boat",
                false,
                "The port is missing: for example tcp/boat:7447",
            ),
            ("boat", true, "The port is missing: for example boat:7447"),
            ("[::1]", false, "This is not an address. Type host:port"),
            ("my boat", false, "This is not an address."),
            ("boat:", false, "This is not an address."),
            (":7447", false, "This is not an address."),
            ("udp/boat", false, "This is not an address."),
            ("tcp/boat:0", false, "This is not an address."),
            ("tcp/boat:65535", false, "This is not an address."),
            ("http://boat:80", false, "This is not an address."),
            ("fe80::1:7447", false, "This is not an address."),
            ("udp/boat:7447", false, "This is not an address."),
            ("quic/boat:7447", false, "QUIC needs keys"),
            ("tcp/boat:7447", true, "TCP is for robots without keys"),
            (
                "[::1]:7447",
                true,
                "IPv6 addresses are not supported with keys.",
            ),
        ] {
            let (command, entry) = submit(typed, has_keys);
            assert_eq!(command, None, "{typed}");
            assert_eq!(entry.text, typed, "it can be corrected");
            let shown = entry.error.unwrap();
            assert!(shown.starts_with(error), "{typed}: {shown}");
        }
        assert_eq!(submit("  ", false).1.error, None);
    }
}
