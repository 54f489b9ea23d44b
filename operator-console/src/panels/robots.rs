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

use super::address_list::{ListedAddress, remembered_ui, unanswered_ui};
use super::addresses::{AddressEntry, address_ui};
use super::formatting::{age, with_monospace_options};
use crate::command::Command;
use crate::link::{DiscoveredRobot, FleetState, FoundRobot, SEEN_RECENTLY};
use crate::model::{LinkState, UncommandedMotion};
use crate::shortcuts::Action;
use crate::theme::Tone;

const SWATCH: Vec2 = vec2(12.0, 16.0);

#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotsData {
    /// Robots that have answered, in the order of their first answer.
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

    /// Robots that answered but denied access, if none is shown.
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

    /// Robot by its number in the list, from 1.
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
mod tests;
