//! The robots on the network, and below them a box for an address where none is found.

use eframe::egui::{Align, Color32, Layout, RichText, Sense, TextStyle, Ui, vec2};
use protocol::keys::RobotId;
use robot_edge::clock::Monotonic;

use super::address_list::{ListedAddress, remembered_ui, unanswered_ui};
use super::addresses::{AddressEntry, address_ui};
use super::command_line::with_options;
use super::wording::age;
use crate::command::Command;
use crate::link::{FleetState, FoundRobot, SEEN_LATELY, Sighting};
use crate::model::LinkState;
use crate::shortcuts::Action;
use crate::theme::Tone;

/// What the panel shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotsData {
    /// The robots that answered, each once, by name.
    pub found: Vec<RobotLine>,
    /// The robot that is shown.
    pub current: Option<RobotId>,
    /// What to do where nothing is shown: it stands where the map would be.
    pub advice: Option<String>,
    /// What stands over the advice.
    pub heading: &'static str,
    /// Whether there is anything that the operator could do.
    pub is_up_to_operator: bool,
    /// Why none can be found.
    pub problem: Option<String>,
    /// Addresses that are remembered, or asked for robots in this run.
    pub addresses: Vec<ListedAddress>,
    /// Whether this console has keys: addresses are of another kind then.
    pub has_keys: bool,
}

/// Which robot is waited for while none is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Sought<'a> {
    /// Whichever there is.
    Any,
    /// The one that the command line asks for.
    Named(&'a RobotId),
    /// The one that this program simulates.
    Demo {
        /// Why it will not come, where its simulation has ended.
        failure: Option<String>,
    },
}

/// One robot.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotLine {
    /// Which.
    pub found: FoundRobot,
    /// Its own.
    pub color: Color32,
    /// How it is.
    pub tone: Tone,
    /// The same in words.
    pub state: String,
}

/// A robot that may be a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Where, when, and how it was.
    pub sighting: Sighting,
    /// Its own colour.
    pub color: Color32,
    /// Its alerts that nobody has seen.
    pub alerts: usize,
}

impl RobotsData {
    /// `current`: the robot that is shown, and how its link is, which is newer than what was seen of it before.
    pub fn new(
        seen: &[Seen],
        current: Option<(&RobotId, LinkState)>,
        sought: Sought<'_>,
        problem: Option<String>,
        now: Monotonic,
    ) -> Self {
        let mut found: Vec<_> = seen
            .iter()
            .map(|seen| {
                let sighting = &seen.sighting;
                let link = current
                    .filter(|(robot, _)| **robot == sighting.found.robot)
                    .map(|(_, link)| link);
                let (tone, state) = state_words(sighting, link, now);
                let (tone, state) = match seen.alerts {
                    0 => (tone, state),
                    n => (Tone::Warning, format!("{state}, {}", alerts(n))),
                };
                RobotLine {
                    found: sighting.found.clone(),
                    color: seen.color,
                    tone,
                    state,
                }
            })
            .collect();
        found.sort_by(|a, b| a.found.cmp(&b.found));
        found.dedup_by(|a, b| a.found == b.found);
        let heading = match &sought {
            Sought::Demo { failure: None } => "Starting the demo…",
            Sought::Demo { failure: Some(_) } => "The demo has ended",
            Sought::Any | Sought::Named(_) if found.is_empty() => "Looking for robots",
            Sought::Any | Sought::Named(_) => "Robots were found",
        };
        let is_up_to_operator = sought != Sought::Demo { failure: None };
        let advice = match (current, sought) {
            (Some(_), _) => None,
            (None, Sought::Demo { failure }) => failure,
            (None, Sought::Named(named)) => Some(format!(
                "Looking for {named}. Start it, or type its address."
            )),
            (None, Sought::Any) if found.is_empty() => Some("No robot found yet.".to_owned()),
            (None, Sought::Any) => Some("Choose one on the left.".to_owned()),
        };
        Self {
            found,
            current: current.map(|(robot, _)| robot.clone()),
            advice,
            heading,
            is_up_to_operator,
            problem,
            addresses: Vec::new(),
            has_keys: false,
        }
    }

    /// Says that nobody looks but at these addresses.
    pub fn looks_only_at(&mut self, addresses: &[String]) {
        if self.current.is_none() && self.found.is_empty() && self.is_up_to_operator {
            let are = if addresses.len() > 1 { "are" } else { "is" };
            let addresses = addresses.join(", ");
            let advice = self.advice.take().unwrap_or_default();
            self.advice = Some(format!(
                "{advice} Only {addresses} {are} asked, as --connect says."
            ));
        }
    }

    /// The robot of this number in the list, from 1.
    pub fn numbered(&self, number: u8) -> Option<&FoundRobot> {
        let index = usize::from(number).checked_sub(1)?;
        self.found.get(index).map(|line| &line.found)
    }
}

/// So many alerts, in words.
pub fn alerts(count: usize) -> String {
    match count {
        1 => "1 alert".to_owned(),
        n => format!("{n} alerts"),
    }
}

fn state_words(sighting: &Sighting, link: Option<LinkState>, now: Monotonic) -> (Tone, String) {
    let seen = now.since(sighting.seen);
    match link {
        Some(LinkState::Silent) => return (Tone::Warning, "silent".to_owned()),
        Some(LinkState::Waiting) => return (Tone::Waiting, "not heard yet".to_owned()),
        None if seen > SEEN_LATELY => {
            return (
                Tone::Warning,
                format!("silent, last seen {} ago", age(seen)),
            );
        }
        Some(LinkState::Live) | None => {}
    }
    match &sighting.state {
        None => (Tone::Waiting, "there".to_owned()),
        Some(FleetState::Undriven) => (Tone::Waiting, "not to be driven".to_owned()),
        Some(FleetState::Ended) => (Tone::Waiting, "ended".to_owned()),
        Some(FleetState::Free) => (Tone::Good, "free".to_owned()),
        Some(FleetState::DrivenBy(operator)) => (Tone::Waiting, format!("{operator} drives")),
        Some(FleetState::EStop) => (Tone::Warning, "emergency stop".to_owned()),
        Some(FleetState::Fault) => (Tone::Warning, "fault".to_owned()),
    }
}

/// Draws the panel.
pub fn robots_ui(ui: &mut Ui, data: &RobotsData, entry: &mut AddressEntry) -> Option<Command> {
    let mut command = None;
    for (line, number) in data.found.iter().zip(1_u8..) {
        let is_current = data.current.as_ref() == Some(&line.found.robot);
        ui.horizontal(|ui| {
            swatch_ui(ui, line.color);
            let name = line.found.robot.to_string();
            let keys = Action::Robot(number).keys();
            let hint = match number {
                1..=9 => format!("{} ({keys})", line.found.endpoint),
                _ => line.found.endpoint.clone(),
            };
            let row = ui.selectable_label(is_current, name);
            if row.on_hover_text(hint).clicked() && !is_current {
                command = Some(Command::Connect(line.found.clone()));
            }
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let color = line.tone.color(ui.visuals());
                ui.label(RichText::new(&line.state).small().color(color));
            });
        });
    }
    if let Some(current) = &data.current
        && !data.found.iter().any(|line| line.found.robot == *current)
    {
        ui.add_enabled_ui(false, |ui| {
            ui.selectable_label(true, format!("{current} (not found now)"))
        });
    }
    if let Some(problem) = &data.problem {
        let color = ui.visuals().warn_fg_color;
        ui.label(with_options(ui, problem, &TextStyle::Small, color));
    }
    ui.add_space(4.0);
    let typed = address_ui(ui, entry, data.has_keys);
    command
        .or(typed)
        .or(unanswered_ui(ui, &data.addresses, data.has_keys))
        .or(remembered_ui(ui, &data.addresses))
}

/// A robot's colour.
pub fn swatch_ui(ui: &mut Ui, color: Color32) {
    let (place, _) = ui.allocate_exact_size(vec2(12.0, 16.0), Sense::hover());
    ui.painter().rect_filled(place, 3.0, color);
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Monotonic = Monotonic::from_nanos(60_000_000_000);

    fn seen(robot: &str, ago_s: u64, state: Option<FleetState>) -> Seen {
        let found = FoundRobot {
            robot: robot.parse().unwrap(),
            endpoint: format!("tcp/{robot}:7447"),
        };
        let seen = Monotonic::from_nanos((60 - ago_s) * 1_000_000_000);
        Seen {
            sighting: Sighting { found, seen, state },
            color: Color32::BLUE,
            alerts: 0,
        }
    }

    #[test]
    fn the_advice_says_what_to_do() {
        let named = "boat".parse().unwrap();
        let advice = |seen: &[Seen], sought| {
            RobotsData::new(seen, None, sought, None, NOW)
                .advice
                .unwrap_or_default()
        };
        assert_eq!(advice(&[], Sought::Any), "No robot found yet.");
        let (a, b) = (seen("a", 0, None), seen("b", 0, None));
        assert_eq!(
            advice(&[a.clone(), b.clone()], Sought::Any),
            "Choose one on the left."
        );
        let waiting = advice(std::slice::from_ref(&a), Sought::Named(&named));
        assert!(waiting.contains("Looking for boat"));
        let data = RobotsData::new(&[b.clone(), a, b], None, Sought::Any, None, NOW);
        let names: Vec<_> = data
            .found
            .iter()
            .map(|line| line.found.robot.to_string())
            .collect();
        assert_eq!(names, ["a", "b"]);
        let second = data.numbered(2).unwrap();
        assert_eq!(second.robot.as_str(), "b");
        assert_eq!((data.numbered(0), data.numbered(3)), (None, None));
    }

    #[test]
    fn where_robots_are_looked_for_alone_is_said_while_that_matters() {
        let addresses = ["tcp/a:7447".to_owned(), "tcp/b:7447".to_owned()];
        let said = |seen: &[Seen], current, sought: Sought<'_>| {
            let mut data = RobotsData::new(seen, current, sought, None, NOW);
            let before = data.advice.clone();
            data.looks_only_at(&addresses);
            (data.advice != before).then_some(data.advice).flatten()
        };
        let only = " Only tcp/a:7447, tcp/b:7447 are asked, as --connect says.";
        assert_eq!(
            said(&[], None, Sought::Any),
            Some(format!("No robot found yet.{only}"))
        );
        let boat = "boat".parse().unwrap();
        let named = said(&[], None, Sought::Named(&boat));
        let looking = "Looking for boat. Start it, or type its address.";
        assert_eq!(named, Some(format!("{looking}{only}")));
        let found = [seen("a", 0, None)];
        assert_eq!(said(&found, None, Sought::Any), None, "one is there");
        let shown = Some((&boat, LinkState::Live));
        assert_eq!(said(&[], shown, Sought::Any), None, "one is shown");
        let demo = Sought::Demo { failure: None };
        assert_eq!(said(&[], None, demo), None, "it comes by itself");
    }

    #[test]
    fn every_robot_says_how_it_is() {
        let anna = FleetState::DrivenBy("anna".parse().unwrap());
        let mut fleet = [
            seen("a", 3, Some(FleetState::Free)),
            seen("b", 3, Some(anna)),
            seen("c", 3, Some(FleetState::EStop)),
            seen("d", 25, Some(FleetState::Free)),
            seen("e", 3, Some(FleetState::Free)),
            seen("f", 3, None),
            seen("g", 3, Some(FleetState::Ended)),
        ];
        fleet[1].alerts = 1;
        fleet[2].alerts = 2;
        let current = "e".parse().unwrap();
        let current = Some((&current, LinkState::Silent));
        let data = RobotsData::new(&fleet, current, Sought::Any, None, NOW);
        let states: Vec<_> = data
            .found
            .iter()
            .map(|line| (line.state.as_str(), line.tone))
            .collect();
        assert_eq!(
            states,
            [
                ("free", Tone::Good),
                ("anna drives, 1 alert", Tone::Warning),
                ("emergency stop, 2 alerts", Tone::Warning),
                ("silent, last seen 25 s ago", Tone::Warning),
                ("silent", Tone::Warning),
                ("there", Tone::Waiting),
                ("ended", Tone::Waiting),
            ]
        );
    }
}
