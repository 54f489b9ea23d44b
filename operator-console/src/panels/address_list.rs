//! Addresses to search for robots, with the result of each.

use std::collections::BTreeMap;

use eframe::egui::{Align, Button, CollapsingHeader, Label, Layout, RichText, TextStyle, Ui};

use super::formatting::with_monospace_options;
use crate::command::Command;
use crate::link::{AddressState, FoundRobot, place};
use crate::theme::Tone;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedAddress {
    pub address: String,
    /// Result of the last search; `None` if the address is not searched in this run.
    pub state: Option<AddressState>,
    /// Whether it is stored in the settings and searched at every start without `--connect`.
    pub is_remembered: bool,
}

/// Addresses of the command line and `remembered` ones, newest first. An address at which a robot is known counts as
/// answered, even if the last search failed.
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

/// Lists the other remembered addresses, which can be forgotten.
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
    heading.id_salt("remembered addresses").show(ui, |ui| {
        for listed in quiet {
            ui.horizontal(|ui| {
                ui.label(RichText::new(&listed.address).small());
                ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                    command = command.take().or(buttons_ui(ui, listed));
                });
            });
        }
    });
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

#[cfg(test)]
mod tests;
