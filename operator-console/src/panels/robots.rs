//! The robots on the network, and a box for an address where none is found.

use eframe::egui::{Key, RichText, TextEdit, Ui};
use protocol::keys::RobotId;
use robot_edge::link::endpoints::bulk_endpoint;

use crate::command::Command;
use crate::link::FoundRobot;

/// What the panel shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RobotsData {
    /// The robots that answered, each once, by name.
    pub found: Vec<FoundRobot>,
    /// The robot that is shown.
    pub current: Option<RobotId>,
    /// What to do where nothing is shown: it stands where the map would be.
    pub advice: Option<String>,
    /// Why none can be found.
    pub problem: Option<String>,
}

impl RobotsData {
    /// `named`: the robot that the command line asks for.
    pub fn new(
        found: &[FoundRobot],
        current: Option<&RobotId>,
        named: Option<&RobotId>,
        problem: Option<String>,
    ) -> Self {
        let mut found = found.to_vec();
        found.sort_by(|a, b| (&a.robot, &a.endpoint).cmp(&(&b.robot, &b.endpoint)));
        found.dedup();
        let advice = match (current, named) {
            (Some(_), _) => None,
            (None, Some(named)) => Some(format!(
                "Looking for {named}. Start it, or type its address."
            )),
            (None, None) if found.is_empty() => Some(
                "No robot found. Start one with `robot-edge simulate rooms`, or type an address."
                    .to_owned(),
            ),
            (None, None) => Some("Choose one on the left.".to_owned()),
        };
        Self {
            found,
            current: current.cloned(),
            advice,
            problem,
        }
    }
}

/// The address as it is being typed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AddressEntry {
    text: String,
    error: Option<String>,
}

impl AddressEntry {
    /// Takes the address if it is one; else says what it should be.
    pub fn submit(&mut self) -> Option<Command> {
        let address = self.text.trim().to_owned();
        if address.is_empty() {
            self.error = None;
            return None;
        }
        // Who types a host and a port means TCP.
        let address = if address.contains('/') {
            address
        } else {
            format!("tcp/{address}")
        };
        match bulk_endpoint(&address) {
            Ok(_bulk) => {
                *self = Self::default();
                Some(Command::AddAddress(address))
            }
            Err(why) => {
                self.error = Some(why.to_string());
                None
            }
        }
    }
}

/// Draws the panel.
pub fn robots_ui(ui: &mut Ui, data: &RobotsData, entry: &mut AddressEntry) -> Option<Command> {
    let mut command = None;
    for found in &data.found {
        let is_current = data.current.as_ref() == Some(&found.robot);
        let name = found.robot.to_string();
        let row = ui.selectable_label(is_current, name);
        if row.on_hover_text(&found.endpoint).clicked() && !is_current {
            command = Some(Command::Connect(found.clone()));
        }
    }
    if let Some(current) = &data.current
        && !data.found.iter().any(|found| found.robot == *current)
    {
        ui.add_enabled_ui(false, |ui| {
            ui.selectable_label(true, format!("{current} (not found now)"))
        });
    }
    if let Some(problem) = &data.problem {
        ui.label(
            RichText::new(problem)
                .small()
                .color(ui.visuals().warn_fg_color),
        );
    }
    command.or(address_ui(ui, entry))
}

fn address_ui(ui: &mut Ui, entry: &mut AddressEntry) -> Option<Command> {
    let mut command = None;
    ui.horizontal(|ui| {
        let width = ui.available_width() - 56.0;
        let text = TextEdit::singleline(&mut entry.text)
            .hint_text("tcp/192.168.1.20:7447")
            .char_limit(200)
            .desired_width(width);
        let text = ui.add(text);
        if text.changed() {
            entry.error = None;
        }
        let is_entered = text.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        let button = ui
            .button("Add")
            .on_hover_text("Ask this address for robots");
        if is_entered || button.clicked() {
            command = entry.submit();
        }
    });
    if let Some(error) = &entry.error {
        ui.label(
            RichText::new(error)
                .small()
                .color(ui.visuals().warn_fg_color),
        );
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    fn submit(text: &str) -> (Option<Command>, AddressEntry) {
        let mut entry = AddressEntry {
            text: text.to_owned(),
            error: None,
        };
        (entry.submit(), entry)
    }

    #[test]
    fn an_address_is_taken_or_explained() {
        for (typed, address) in [
            ("tcp/10.0.0.5:7447", "tcp/10.0.0.5:7447"),
            ("  tcp/boat:9 ", "tcp/boat:9"),
            ("boat:7447", "tcp/boat:7447"),
        ] {
            let (command, entry) = submit(typed);
            assert_eq!(command, Some(Command::AddAddress(address.to_owned())));
            assert_eq!(entry, AddressEntry::default());
        }
        for typed in ["boat", "tcp/boat", "tcp/boat:0", "tcp/boat:65535"] {
            let (command, entry) = submit(typed);
            assert_eq!(command, None);
            assert_eq!(entry.text, typed, "what was typed can be mended");
            assert!(entry.error.unwrap().contains("for example tcp/"));
        }
        assert_eq!(submit("  ").1.error, None);
    }

    #[test]
    fn the_advice_says_what_to_do() {
        let found = |robot: &str| FoundRobot {
            robot: robot.parse().unwrap(),
            endpoint: format!("tcp/{robot}:7447"),
        };
        let named = "boat".parse().unwrap();
        let advice = |found: &[FoundRobot], named| {
            RobotsData::new(found, None, named, None)
                .advice
                .unwrap_or_default()
        };
        assert!(advice(&[], None).contains("robot-edge simulate rooms"));
        assert_eq!(
            advice(&[found("a"), found("b")], None),
            "Choose one on the left."
        );
        assert!(advice(&[found("a")], Some(&named)).contains("Looking for boat"));
        let data = RobotsData::new(&[found("b"), found("a"), found("b")], None, None, None);
        let names: Vec<_> = data
            .found
            .iter()
            .map(|robot| robot.robot.to_string())
            .collect();
        assert_eq!(names, ["a", "b"]);
    }
}
