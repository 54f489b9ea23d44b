//! Addresses to search for robots, with the result of each, and the text field for a new one.

use std::collections::BTreeMap;
use std::net::Ipv6Addr;

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::text_edit::TextEditState;
use eframe::egui::{
    Align, Button, CollapsingHeader, Id, Key, Label, Layout, RichText, TextEdit, TextStyle, Ui,
};
use network::endpoints::{DEFAULT_PORT, check_console, place};

use super::formatting::with_monospace_options;
use crate::command::Command;
use crate::link::{AddressState, FoundRobot};
use crate::shortcuts::Action;
use crate::theme::Tone;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedAddress {
    pub address: String,
    pub state: Option<AddressState>,
    /// Whether it is stored in the settings and searched at every start without `--connect`.
    pub is_remembered: bool,
}

/// Newest first. Where a robot is known, the address counts as answered even if the last search failed.
pub fn listed<'a>(
    named: &'a [String],
    remembered: impl DoubleEndedIterator<Item = &'a String>,
    asked: &BTreeMap<String, AddressState>,
    found: &[FoundRobot],
) -> Vec<ListedAddress> {
    let state = |address: &String| {
        let answers = found.iter().any(|found| found.endpoint == *address);
        match asked.get(address) {
            Some(_) if answers => Some(AddressState::Found),
            state => state.cloned(),
        }
    };
    let mut all: Vec<_> = remembered
        .rev()
        .map(|address| ListedAddress {
            address: address.clone(),
            state: state(address),
            is_remembered: true,
        })
        .collect();
    for address in named {
        if all.iter().all(|listed| listed.address != *address) {
            all.push(ListedAddress {
                address: address.clone(),
                state: state(address),
                is_remembered: false,
            });
        }
    }
    all
}

impl ListedAddress {
    fn is_unanswered(&self) -> bool {
        self.state
            .as_ref()
            .is_some_and(|state| *state != AddressState::Found)
    }

    /// State, and what it means or what to do. `has_keys`: this console connects with keys.
    fn text(&self, has_keys: bool) -> (Tone, &'static str, String) {
        let (host, port) = place(&self.address).unwrap_or((&self.address, 0));
        let is_started = format!("Is the robot started, and is {port} the right port?");
        let (state, hint) = match &self.state {
            None => return (Tone::Waiting, "not asked", String::new()),
            Some(AddressState::Asking) => return (Tone::Waiting, "asking…", String::new()),
            Some(AddressState::Found) => return (Tone::Good, "answers", String::new()),
            Some(AddressState::NoRobot) if has_keys => (
                "no robot there",
                "A router answers, but no robot behind it, or none that lists you as an operator."
                    .to_owned(),
            ),
            Some(AddressState::NoRobot) => ("no robot there", no_robot(host, port)),
            Some(AddressState::AccessDenied { robot, by_quic }) => {
                let tiles = port_before(host, port).filter(|_| !by_quic);
                let tiles =
                    tiles.map(|asked| format!(" Or this is its port for tiles: try {asked}"));
                let hint = format!(
                    "{robot} answers, but you are not on its list of operators. Access is granted \
                     within two seconds of being added.{}",
                    tiles.unwrap_or_default()
                );
                ("denies access", hint)
            }
            Some(AddressState::UnknownName) => (
                "unknown host",
                format!("No computer is called {host}. Type its IP address instead."),
            ),
            Some(AddressState::Refused) => ("connection refused", is_started),
            Some(AddressState::Silent) => (
                "no answer",
                format!("{is_started} Is its network reached from here?"),
            ),
            Some(AddressState::WrongProtocol) if has_keys => (
                "answers without TLS of this fleet",
                "Was the robot started with --keys, and is its certificate of this fleet?"
                    .to_owned(),
            ),
            Some(AddressState::WrongProtocol) => (
                "does not answer as a robot",
                format!(
                    "A robot with keys is asked at quic/{host}:{port}, by a console that was started with --keys."
                ),
            ),
            Some(AddressState::WrongCertificate(why)) => ("wrong certificate", why.clone()),
            Some(AddressState::Problem(why)) => ("cannot be asked", why.clone()),
        };
        (Tone::Warning, state, hint)
    }
}

fn no_robot(host: &str, port: u16) -> String {
    let who = "This is a router, or a robot that is still starting";
    match port_before(host, port) {
        Some(asked) => format!("{who}. Or this is a robot's port for tiles: try {asked}"),
        None => who.to_owned(),
    }
}

/// Hint for a port that is the bulk port of a robot: the control port is the one before it.
fn port_before(host: &str, port: u16) -> Option<String> {
    let asked = port.checked_sub(1).filter(|asked| *asked > 0)?;
    Some(if host.contains(':') {
        format!("[{host}]:{asked}")
    } else {
        format!("{host}:{asked}")
    })
}

pub(super) fn unanswered_ui(
    ui: &mut Ui,
    addresses: &[ListedAddress],
    has_keys: bool,
) -> Option<Command> {
    let mut command = None;
    for listed in addresses.iter().filter(|listed| listed.is_unanswered()) {
        let (tone, state, hint) = listed.text(has_keys);
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new(&listed.address).small());
            let color = tone.color(ui.visuals());
            ui.label(RichText::new(state).small().color(color));
            command = command.take().or(buttons_ui(ui, listed));
        });
        if !hint.is_empty() {
            let weak = ui.visuals().weak_text_color();
            ui.add(Label::new(with_monospace_options(ui, &hint, &TextStyle::Small, weak)).wrap());
        }
    }
    command
}

pub(super) fn remembered_ui(ui: &mut Ui, addresses: &[ListedAddress]) -> Option<Command> {
    let mut command = None;
    let remembered = addresses.iter().filter(|listed| listed.is_remembered);
    let quiet: Vec<_> = remembered
        .filter(|listed| !listed.is_unanswered())
        .collect();
    if quiet.is_empty() {
        return None;
    }
    let others = addresses
        .iter()
        .any(|one| one.is_remembered && one.is_unanswered());
    let words = if others {
        "Other remembered addresses"
    } else {
        "Remembered addresses"
    };
    let heading = RichText::new(format!("{words} ({})", quiet.len())).small();
    let heading = CollapsingHeader::new(heading);
    let shown = heading.id_salt("remembered addresses").show(ui, |ui| {
        for listed in quiet {
            ui.horizontal(|ui| {
                ui.label(RichText::new(&listed.address).small());
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    command = command.take().or(buttons_ui(ui, listed));
                });
            });
        }
    });
    shown
        .header_response
        .on_hover_text("Addresses that are searched at every start");
    command
}

fn buttons_ui(ui: &mut Ui, listed: &ListedAddress) -> Option<Command> {
    let mut command = None;
    let address = &listed.address;
    if listed.is_remembered {
        let forget = Button::new(RichText::new("Forget").small());
        let hint = format!("Ask {address} no longer, now and from the next start on");
        if ui.add(forget).on_hover_text(hint).clicked() {
            command = Some(Command::ForgetAddress(address.clone()));
        }
    }
    if listed.state.is_none() {
        let ask = Button::new(RichText::new("Ask").small());
        let hint =
            format!("Search {address}, too: with --connect it is not searched automatically");
        let ink = ui.visuals().text_color();
        let hint = with_monospace_options(ui, &hint, &TextStyle::Body, ink);
        if ui.add(ask).on_hover_text(hint).clicked() {
            command = Some(Command::AddAddress(address.clone()));
        }
    }
    command
}

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
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    fn listed_as(address: &str, state: Option<AddressState>) -> ListedAddress {
        ListedAddress {
            address: address.to_owned(),
            state,
            is_remembered: true,
        }
    }

    #[test]
    fn each_address_has_its_own_state() {
        let owned = |all: &[&str]| all.iter().map(|one| (*one).to_owned()).collect::<Vec<_>>();
        let named = owned(&["tcp/named:7447", "tcp/both:7447"]);
        let remembered = owned(&["tcp/both:7447", "tcp/other:7447", "tcp/missed:7447"]);
        let asked = [
            ("tcp/named:7447", AddressState::Silent),
            ("tcp/both:7447", AddressState::Refused),
            ("tcp/missed:7447", AddressState::Silent),
        ];
        let asked = asked.map(|(address, state)| (address.to_owned(), state));
        let found = FoundRobot {
            robot: "boat".parse().unwrap(),
            endpoint: "tcp/missed:7447".to_owned(),
        };
        let all = listed(&named, remembered.iter(), &asked.into(), &[found]);
        let expected = [
            listed_as("tcp/missed:7447", Some(AddressState::Found)),
            listed_as("tcp/other:7447", None),
            listed_as("tcp/both:7447", Some(AddressState::Refused)),
            ListedAddress {
                is_remembered: false,
                ..listed_as("tcp/named:7447", Some(AddressState::Silent))
            },
        ];
        assert_eq!(all, expected);
    }

    #[test]
    fn address_states_have_advice() {
        let access_denied = |by_quic| AddressState::AccessDenied {
            robot: "scout".parse().unwrap(),
            by_quic,
        };
        for (state, has_keys, tone, label, hint) in [
            (AddressState::Asking, false, Tone::Waiting, "asking…", ""),
            (AddressState::Found, false, Tone::Good, "answers", ""),
            (
                AddressState::Refused,
                false,
                Tone::Warning,
                "connection refused",
                "Is the robot started, and is 7450 the right port?",
            ),
            (
                AddressState::Silent,
                false,
                Tone::Warning,
                "no answer",
                "Is the robot started, and is 7450 the right port? Is its network reached from here?",
            ),
            (
                AddressState::UnknownName,
                false,
                Tone::Warning,
                "unknown host",
                "No computer is called boat. Type its IP address instead.",
            ),
            (
                AddressState::NoRobot,
                false,
                Tone::Warning,
                "no robot there",
                "This is a router, or a robot that is still starting. \
                 Or this is a robot's port for tiles: try boat:7449",
            ),
            (
                AddressState::NoRobot,
                true,
                Tone::Warning,
                "no robot there",
                "A router answers, but no robot behind it, or none that lists you as an operator.",
            ),
            (
                access_denied(true),
                true,
                Tone::Warning,
                "denies access",
                "scout answers, but you are not on its list of operators. \
                 Access is granted within two seconds of being added.",
            ),
            (
                access_denied(false),
                true,
                Tone::Warning,
                "denies access",
                "scout answers, but you are not on its list of operators. \
                 Access is granted within two seconds of being added. \
                 Or this is its port for tiles: try boat:7449",
            ),
            (
                AddressState::WrongProtocol,
                false,
                Tone::Warning,
                "does not answer as a robot",
                "A robot with keys is asked at quic/boat:7450, by a console that was started with --keys.",
            ),
            (
                AddressState::WrongProtocol,
                true,
                Tone::Warning,
                "answers without TLS of this fleet",
                "Was the robot started with --keys, and is its certificate of this fleet?",
            ),
            (
                AddressState::Problem("eve is there".to_owned()),
                true,
                Tone::Warning,
                "cannot be asked",
                "eve is there",
            ),
        ] {
            let text = listed_as("tcp/boat:7450", Some(state)).text(has_keys);
            assert_eq!(text, (tone, label, hint.to_owned()));
        }
    }

    #[test]
    fn ipv6_addresses_need_brackets() {
        let hint = no_robot("::1", 7448);
        assert!(hint.ends_with(" try [::1]:7447"), "{hint}");
        assert!(!no_robot("boat", 1).contains("try"), "there is no port 0");
    }

    #[test]
    fn silent_addresses_can_be_forgotten() {
        let addresses = [
            listed_as("tcp/nosuch:7447", Some(AddressState::UnknownName)),
            listed_as("tcp/10.0.0.5:7447", Some(AddressState::Silent)),
            listed_as("tcp/here:7447", Some(AddressState::Found)),
        ];
        let mut window = Harness::builder()
            .with_size(vec2(300.0, 600.0))
            .build_ui_state(
                move |ui, asked: &mut Option<Command>| {
                    let command = unanswered_ui(ui, &addresses, false);
                    let other = remembered_ui(ui, &addresses);
                    *asked = asked.take().or(command).or(other);
                },
                None,
            );
        window.run_steps(2);
        for text in [
            "unknown host",
            "no answer",
            "Other remembered addresses (1)",
        ] {
            let place = window.get_by_label(text).rect();
            assert!(place.right() <= 300.0, "{text}: {place}");
        }
        assert!(window.query_by_label("tcp/here:7447").is_none());
        let second = window.get_all_by_label("Forget").nth(1).unwrap();
        second.click();
        window.run_steps(2);
        let expected = Command::ForgetAddress("tcp/10.0.0.5:7447".to_owned());
        assert_eq!(window.state().clone(), Some(expected));
    }

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
