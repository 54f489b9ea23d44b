//! Robots on the network, and a field for addresses.

use std::collections::BTreeSet;
use std::iter;
use std::sync::Arc;

use eframe::egui::{
    Align, Button, Color32, Galley, Layout, RichText, Sense, TextStyle, Ui, Vec2, WidgetInfo,
    accesskit::Role, vec2,
};
use measurement::time::Monotonic;
use protocol::keys::RobotId;

use super::addresses::{AddressEntry, ListedAddress, address_ui, remembered_ui, unanswered_ui};
use super::formatting::{age, with_monospace_options};
use crate::command::Command;
use crate::link::{DiscoveredRobot, FleetState, FoundRobot, SEEN_RECENTLY};
use crate::model::{LinkState, UncommandedMotion};
use crate::shortcuts::Action;
use crate::theme::Tone;

const SWATCH: Vec2 = vec2(12.0, 16.0);

#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotsData {
    pub found: Vec<RobotLine>,
    pub current: Option<RobotId>,
    /// Shown instead of the map if no robot is shown.
    pub advice: Option<String>,
    pub heading: &'static str,
    pub is_up_to_operator: bool,
    pub problem: Option<String>,
    pub addresses: Vec<ListedAddress>,
    pub has_keys: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SearchTarget<'a> {
    Any,
    Named(&'a RobotId),
    Demo { failure: Option<String> },
}

#[derive(Clone, Debug, PartialEq)]
pub struct RobotLine {
    pub found: FoundRobot,
    pub color: Color32,
    pub tone: Tone,
    pub state: String,
    /// Whether it is silent and not shown: it may be removed from the list.
    pub is_forgettable: bool,
}

impl RobotLine {
    fn state_text(&self, ui: &Ui) -> Arc<Galley> {
        let font = TextStyle::Small.resolve(ui.style());
        let color = self.tone.color(ui.visuals());
        ui.painter().layout_no_wrap(self.state.clone(), font, color)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct RobotEntry {
    pub discovered: DiscoveredRobot,
    pub color: Color32,
    pub alerts: usize,
    /// Cause of uncommanded motion; known of the shown robot only.
    pub uncommanded_motion: Option<UncommandedMotion>,
}

impl RobotsData {
    /// `current`: the shown robot with its link state, which is newer than its discovery.
    pub fn new(
        seen: &[RobotEntry],
        current: Option<(&RobotId, LinkState)>,
        search_target: SearchTarget<'_>,
        problem: Option<String>,
        now: Monotonic,
    ) -> Self {
        let mut known = BTreeSet::new();
        let found: Vec<_> = seen
            .iter()
            .filter(|seen| known.insert(&seen.discovered.found.robot))
            .map(|seen| {
                let discovered = &seen.discovered;
                let link = current
                    .filter(|(robot, _)| **robot == discovered.found.robot)
                    .map(|(_, link)| link);
                let (tone, state) =
                    robot_state_text(discovered, link, seen.uncommanded_motion, now);
                let (tone, state) = match seen.alerts {
                    0 => (tone, state),
                    n => (Tone::Warning, format!("{state}, {}", alerts(n))),
                };
                RobotLine {
                    found: discovered.found.clone(),
                    color: seen.color,
                    tone,
                    state,
                    is_forgettable: link.is_none() && is_overdue(discovered, now),
                }
            })
            .collect();
        let heading = match &search_target {
            SearchTarget::Demo { failure: None } => "Starting the demo…",
            SearchTarget::Demo { failure: Some(_) } => "The demo has ended",
            SearchTarget::Any | SearchTarget::Named(_) if found.is_empty() => "Looking for robots",
            SearchTarget::Any | SearchTarget::Named(_) => "Robots were found",
        };
        let is_up_to_operator = search_target != SearchTarget::Demo { failure: None };
        let advice = match (current, search_target) {
            (Some(_), _) => None,
            (None, SearchTarget::Demo { failure }) => failure,
            (None, SearchTarget::Named(named)) => Some(format!(
                "Looking for {named}. Start it, or type its address."
            )),
            (None, SearchTarget::Any) if found.is_empty() => Some("No robot found yet.".to_owned()),
            (None, SearchTarget::Any) => Some("Choose one on the left.".to_owned()),
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

    /// Discovery uses only these addresses.
    pub fn set_search_addresses(&mut self, addresses: &[String]) {
        if self.current.is_none() && self.found.is_empty() && self.is_up_to_operator {
            let are = if addresses.len() > 1 { "are" } else { "is" };
            let addresses = addresses.join(", ");
            let advice = self.advice.take().unwrap_or_default();
            self.advice = Some(format!(
                "{advice} Only {addresses} {are} asked, as --connect says."
            ));
        }
    }

    pub fn set_denied_by(&mut self, robots: &BTreeSet<RobotId>) {
        if self.current.is_some() || !self.found.is_empty() || !self.is_up_to_operator {
            return;
        }
        let names: Vec<_> = robots.iter().map(RobotId::as_str).collect();
        if !names.is_empty() {
            let names = names.join(", ");
            self.advice = Some(format!(
                "{names} answers, but denies access: you are not on its list of operators. Access is granted \
                 within two seconds of being added."
            ));
        }
    }

    pub fn numbered(&self, number: u8) -> Option<&FoundRobot> {
        let index = usize::from(number).checked_sub(1)?;
        self.found.get(index).map(|line| &line.found)
    }
}

pub fn alerts(count: usize) -> String {
    match count {
        1 => "1 alert".to_owned(),
        n => format!("{n} alerts"),
    }
}

fn is_overdue(discovered: &DiscoveredRobot, now: Monotonic) -> bool {
    now.since(discovered.seen) > SEEN_RECENTLY
}

fn robot_state_text(
    discovered: &DiscoveredRobot,
    link: Option<LinkState>,
    uncommanded_motion: Option<UncommandedMotion>,
    now: Monotonic,
) -> (Tone, String) {
    let seen = format!("last seen {} ago", age(now.since(discovered.seen)));
    let has_ended = discovered.has_ended();
    match link {
        // Silence after the end of the data is expected.
        Some(LinkState::Silent) if has_ended => return (Tone::Waiting, format!("ended, {seen}")),
        None if has_ended && is_overdue(discovered, now) => {
            return (Tone::Waiting, format!("ended, {seen}"));
        }
        Some(LinkState::Silent) => return (Tone::Warning, format!("silent, {seen}")),
        Some(LinkState::Waiting) => return (Tone::Waiting, seen),
        None if is_overdue(discovered, now) => return (Tone::Warning, format!("silent, {seen}")),
        Some(LinkState::Live) | None => {}
    }
    match &discovered.state {
        None => (Tone::Waiting, "there".to_owned()),
        Some(FleetState::NotDrivable) => (Tone::Waiting, "cannot be driven".to_owned()),
        Some(FleetState::Ended) => (Tone::Waiting, "ended".to_owned()),
        // Same text as in the driving panel.
        Some(FleetState::Free) => match uncommanded_motion {
            None => (Tone::Good, "free".to_owned()),
            Some(UncommandedMotion::Autonomous) => (Tone::Waiting, "moving by itself".to_owned()),
            Some(UncommandedMotion::MaybeDrifting) => {
                (Tone::Warning, "moving or adrift".to_owned())
            }
        },
        Some(FleetState::DrivenBy(operator)) => (Tone::Waiting, format!("{operator} drives")),
        Some(FleetState::EStop { .. }) => (Tone::Warning, "emergency stop".to_owned()),
        Some(FleetState::Fault { .. }) => (Tone::Warning, "fault".to_owned()),
    }
}

pub fn robots_ui(ui: &mut Ui, data: &RobotsData, entry: &mut AddressEntry) -> Option<Command> {
    let mut command = None;
    let numbers = (1..u8::MAX).chain(iter::repeat(u8::MAX));
    for (line, number) in data.found.iter().zip(numbers) {
        let is_current = data.current.as_ref() == Some(&line.found.robot);
        let mut state_fits = false;
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
                if line.is_forgettable && forget_ui(ui, &line.found.robot) {
                    command = Some(Command::ForgetRobot(line.found.robot.clone()));
                }
                let state = line.state_text(ui);
                state_fits = state.size().x <= ui.available_width();
                if state_fits {
                    ui.label(state);
                }
            });
        });
        if !state_fits {
            ui.horizontal(|ui| {
                ui.add_space(SWATCH.x + ui.spacing().item_spacing.x);
                let state = line.state_text(ui);
                ui.label(state);
            });
        }
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
        ui.label(with_monospace_options(
            ui,
            problem,
            &TextStyle::Small,
            color,
        ));
    }
    ui.add_space(4.0);
    let typed = address_ui(ui, entry, data.has_keys);
    command
        .or(typed)
        .or(unanswered_ui(ui, &data.addresses, data.has_keys))
        .or(remembered_ui(ui, &data.addresses))
}

fn forget_ui(ui: &mut Ui, robot: &RobotId) -> bool {
    let button = ui.add(Button::new(RichText::new("×").small()).small());
    button.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Forget {robot}")));
    let hint = format!("Forget {robot} and its alerts. It is listed again when it answers.");
    button.on_hover_text(hint).clicked()
}

pub fn swatch_ui(ui: &mut Ui, color: Color32) {
    let (place, _) = ui.allocate_exact_size(SWATCH, Sense::hover());
    ui.painter().rect_filled(place, 3.0, color);
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;

    const NOW: Monotonic = Monotonic::from_nanos(60_000_000_000);

    fn seen(robot: &str, ago_s: u64, state: Option<FleetState>) -> RobotEntry {
        let found = FoundRobot {
            robot: robot.parse().unwrap(),
            endpoint: format!("tcp/{robot}:7447"),
        };
        let seen = Monotonic::from_nanos((60 - ago_s) * 1_000_000_000);
        RobotEntry {
            discovered: DiscoveredRobot { found, seen, state },
            color: Color32::BLUE,
            alerts: 0,
            uncommanded_motion: None,
        }
    }

    #[test]
    fn advice_of_the_list() {
        let named = "boat".parse().unwrap();
        let advice = |seen: &[RobotEntry], search_target| {
            RobotsData::new(seen, None, search_target, None, NOW)
                .advice
                .unwrap_or_default()
        };
        assert_eq!(advice(&[], SearchTarget::Any), "No robot found yet.");
        let (a, b) = (seen("a", 0, None), seen("b", 0, None));
        assert_eq!(
            advice(&[a.clone(), b.clone()], SearchTarget::Any),
            "Choose one on the left."
        );
        let waiting = advice(std::slice::from_ref(&a), SearchTarget::Named(&named));
        assert!(waiting.contains("Looking for boat"));
        let data = RobotsData::new(&[b.clone(), a, b], None, SearchTarget::Any, None, NOW);
        let names: Vec<_> = data
            .found
            .iter()
            .map(|line| line.found.robot.to_string())
            .collect();
        assert_eq!(names, ["b", "a"], "as first found");
        let second = data.numbered(2).unwrap();
        assert_eq!(second.robot.as_str(), "a");
        assert_eq!((data.numbered(0), data.numbered(3)), (None, None));
    }

    #[test]
    fn search_addresses_are_shown_while_searching() {
        let addresses = ["tcp/a:7447".to_owned(), "tcp/b:7447".to_owned()];
        let texts = |seen: &[RobotEntry], current, search_target: SearchTarget<'_>| {
            let mut data = RobotsData::new(seen, current, search_target, None, NOW);
            let before = data.advice.clone();
            data.set_search_addresses(&addresses);
            (data.advice != before).then_some(data.advice).flatten()
        };
        let only = " Only tcp/a:7447, tcp/b:7447 are asked, as --connect says.";
        assert_eq!(
            texts(&[], None, SearchTarget::Any),
            Some(format!("No robot found yet.{only}"))
        );
        let boat = "boat".parse().unwrap();
        let named = texts(&[], None, SearchTarget::Named(&boat));
        let looking = "Looking for boat. Start it, or type its address.";
        assert_eq!(named, Some(format!("{looking}{only}")));
        let found = [seen("a", 0, None)];
        assert_eq!(texts(&found, None, SearchTarget::Any), None, "one is there");
        let shown = Some((&boat, LinkState::Live));
        assert_eq!(texts(&[], shown, SearchTarget::Any), None, "one is shown");
        let demo = SearchTarget::Demo { failure: None };
        assert_eq!(texts(&[], None, demo), None, "it comes by itself");
    }

    #[test]
    fn a_robot_that_denies_access_is_shown() {
        let boat: RobotId = "boat".parse().unwrap();
        let advice = |seen: &[RobotEntry], told_nothing_by: &[RobotId]| {
            let mut data = RobotsData::new(seen, None, SearchTarget::Any, None, NOW);
            data.set_denied_by(&told_nothing_by.iter().cloned().collect());
            data.advice.unwrap()
        };
        let reported = advice(&[], std::slice::from_ref(&boat));
        assert!(
            reported.starts_with("boat answers, but denies access"),
            "{reported}"
        );
        assert_eq!(advice(&[], &[]), "No robot found yet.");
        let other = [seen("a", 0, None)];
        assert_eq!(advice(&other, &[boat]), "Choose one on the left.");
    }

    #[test]
    fn robot_states() {
        let anna = FleetState::DrivenBy("anna".parse().unwrap());
        let mut fleet = [
            seen("a", 3, Some(FleetState::Free)),
            seen("b", 3, Some(anna)),
            seen("c", 3, Some(FleetState::EStop { has_ended: false })),
            seen("d", 25, Some(FleetState::Free)),
            seen("e", 3, Some(FleetState::Free)),
            seen("f", 3, None),
            seen("g", 3, Some(FleetState::Ended)),
            seen("h", 25, Some(FleetState::Ended)),
            seen("i", 3, Some(FleetState::EStop { has_ended: true })),
            seen("j", 25, Some(FleetState::EStop { has_ended: true })),
            seen("k", 3, Some(FleetState::NotDrivable)),
        ];
        fleet[1].alerts = 1;
        fleet[2].alerts = 2;
        let current = "e".parse().unwrap();
        let current = Some((&current, LinkState::Silent));
        let data = RobotsData::new(&fleet, current, SearchTarget::Any, None, NOW);
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
                ("silent, last seen 3.0 s ago", Tone::Warning),
                ("there", Tone::Waiting),
                ("ended", Tone::Waiting),
                ("ended, last seen 25 s ago", Tone::Waiting),
                ("emergency stop", Tone::Warning),
                ("ended, last seen 25 s ago", Tone::Waiting),
                ("cannot be driven", Tone::Waiting),
            ]
        );
    }

    #[test]
    fn a_robot_that_moves_by_itself_is_not_free() {
        let reported = |state, uncommanded_motion, link| {
            let mut seen = seen("a", 3, Some(state));
            seen.uncommanded_motion = uncommanded_motion;
            let current = "a".parse().unwrap();
            let data = RobotsData::new(
                &[seen],
                Some((&current, link)),
                SearchTarget::Any,
                None,
                NOW,
            );
            (data.found[0].state.clone(), data.found[0].tone)
        };
        let text = |words: &str, tone| (words.to_owned(), tone);
        let (live, free) = (LinkState::Live, || FleetState::Free);
        let [by_itself, or_adrift] = [
            UncommandedMotion::Autonomous,
            UncommandedMotion::MaybeDrifting,
        ]
        .map(Some);
        let moving = text("moving by itself", Tone::Waiting);
        assert_eq!(reported(free(), by_itself, live), moving);
        let adrift = text("moving or adrift", Tone::Warning);
        assert_eq!(reported(free(), or_adrift, live), adrift);
        assert_eq!(reported(free(), None, live), text("free", Tone::Good));
        let silent = text("silent, last seen 3.0 s ago", Tone::Warning);
        assert_eq!(reported(free(), by_itself, LinkState::Silent), silent);
        let stopped = text("emergency stop", Tone::Warning);
        assert_eq!(
            reported(FleetState::EStop { has_ended: false }, by_itself, live),
            stopped
        );
    }

    #[test]
    fn only_silent_robots_can_be_forgotten() {
        let fleet = [
            seen("a", 3, Some(FleetState::Free)),
            seen("b", 16, Some(FleetState::Free)),
            seen("c", 3, Some(FleetState::Free)),
        ];
        let reported = |link| {
            let current = "b".parse().unwrap();
            let data =
                RobotsData::new(&fleet, Some((&current, link)), SearchTarget::Any, None, NOW);
            let b = &data.found[1];
            (b.tone, b.state.clone(), b.is_forgettable)
        };
        for (link, tone, state) in [
            (LinkState::Waiting, Tone::Waiting, "last seen 16 s ago"),
            (
                LinkState::Silent,
                Tone::Warning,
                "silent, last seen 16 s ago",
            ),
        ] {
            assert_eq!(
                reported(link),
                (tone, state.to_owned(), false),
                "it is shown"
            );
        }
        let data = RobotsData::new(&fleet, None, SearchTarget::Any, None, NOW);
        let mut window = Harness::builder()
            .with_size(vec2(180.0, 400.0))
            .build_ui_state(
                move |ui, asked: &mut Option<Command>| {
                    let mut entry = AddressEntry::default();
                    let command = robots_ui(ui, &data, &mut entry);
                    *asked = asked.take().or(command);
                },
                None,
            );
        window.run_steps(2);
        for forget in ["Forget a", "Forget c"] {
            assert!(
                window.query_by_label(forget).is_none(),
                "{forget}: it answers"
            );
        }
        window.get_by_label("Forget b").click();
        window.run_steps(2);
        let expected = Command::ForgetRobot("b".parse().unwrap());
        assert_eq!(window.state().clone(), Some(expected));
    }
}
