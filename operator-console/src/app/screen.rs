//! What is on the screen: panels on the left, the map, and below it what the map says under the pointer.

use std::time::Duration;

use eframe::egui::{
    CentralPanel, CollapsingHeader, Frame, Label, Margin, Panel, RichText, ScrollArea, Ui,
};
use robot_edge::clock::Monotonic;

use crate::command::Command;
use crate::helm::HelmSight;
use crate::map_view::MapView;
use crate::model::ConsoleModel;
use crate::panels::connection::{ConnectionData, LinkSight, connection_ui};
use crate::panels::driving::{DrivingData, DrivingEntry, driving_ui};
use crate::panels::events::{EventsData, events_ui};
use crate::panels::layers::{LayersData, layers_ui};
use crate::panels::legend::{LegendData, legend_ui};
use crate::panels::losses::{LossesData, losses_ui};
use crate::panels::robot::{RobotData, robot_ui};
use crate::panels::robots::{AddressEntry, RobotsData, robots_ui};
use crate::panels::shores::{ShoresData, shores_ui};
use crate::panels::stale::{StaleData, stale_ui};
use crate::theme;

const SIDE_WIDTH: f32 = 290.0;
const DRIVING_WIDTH: f32 = 300.0;
/// Narrower windows have no room for two panels and a map.
const NARROW: f32 = 1000.0;
/// Ages of commands are looked at while somebody drives.
const DRIVING_PERIOD: Duration = Duration::from_millis(100);
/// Ages on the screen are at most this much behind.
const AGES_PERIOD: Duration = Duration::from_secs(1);

/// What the screen remembers between frames.
#[derive(Default)]
pub struct Screen {
    map_view: MapView,
    address: AddressEntry,
    driving: DrivingEntry,
}

/// What is shown of one robot.
pub struct RobotSight<'a> {
    /// The robot.
    pub model: &'a mut ConsoleModel,
    /// Its link.
    pub link: &'a LinkSight,
    /// Its helm, where there is one.
    pub helm: Option<&'a HelmSight>,
}

impl Screen {
    /// The map view.
    pub const fn map_view(&self) -> &MapView {
        &self.map_view
    }

    /// The map view, to move it.
    pub const fn map_view_mut(&mut self) -> &mut MapView {
        &mut self.map_view
    }

    /// Draws everything; what the operator asks for.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        robots: &RobotsData,
        mut robot: Option<RobotSight<'_>>,
        now: Monotonic,
    ) -> Vec<Command> {
        let mut commands = Vec::new();
        if let Some(RobotSight { model, .. }) = &mut robot {
            self.map_view.update(model);
            ui.ctx().request_repaint_after(AGES_PERIOD);
        }
        let helm = robot.as_ref().and_then(|robot| robot.helm);
        let robot = robot.map(|RobotSight { model, link, .. }| (&*model, link));
        // Who drives in a small window looks at the map.
        let is_driving = helm.is_some_and(|helm| helm.lease.held().is_some());
        if !(is_driving && ui.available_width() < NARROW) {
            Panel::left("side")
                .resizable(true)
                .default_size(SIDE_WIDTH)
                .size_range(240.0..=480.0)
                .show(ui, |ui| {
                    ScrollArea::vertical()
                        .auto_shrink([false, false])
                        .show(ui, |ui| commands = self.side_ui(ui, robots, robot, now));
                });
        }
        if let (Some((model, _)), Some(helm)) = (robot, helm)
            && let Some(data) = DrivingData::new(model, helm, now)
        {
            if !data.is_at_rest() {
                ui.ctx().request_repaint_after(DRIVING_PERIOD);
            }
            Panel::right("driving")
                .resizable(true)
                .default_size(DRIVING_WIDTH)
                .size_range(270.0..=420.0)
                .show(ui, |ui| {
                    ui.add_space(4.0);
                    commands.extend(driving_ui(ui, &data, &mut self.driving));
                });
        }
        if let Some((model, _)) = robot {
            self.probe_ui(ui, model, now);
        }
        match robot {
            Some((model, _)) => {
                if let Some(stale) = StaleData::new(model, now) {
                    let frame = Frame::new().fill(theme::BANNER[0]).inner_margin(8.0);
                    Panel::top("stale")
                        .frame(frame)
                        .resizable(false)
                        .show(ui, |ui| stale_ui(ui, &stale));
                }
                let map = CentralPanel::no_frame();
                let look = map.show(ui, |ui| self.map_view.show(ui, model, now));
                commands.extend(look.inner.map(Command::Look));
            }
            None => {
                CentralPanel::default().show(ui, |ui| nothing_ui(ui, robots));
            }
        }
        commands
    }

    fn side_ui(
        &mut self,
        ui: &mut Ui,
        robots: &RobotsData,
        robot: Option<(&ConsoleModel, &LinkSight)>,
        now: Monotonic,
    ) -> Vec<Command> {
        let mut commands = Vec::new();
        ui.add_space(4.0);
        if let Some((model, link)) = robot {
            ui.label(RichText::new(model.robot().to_string()).heading().strong());
            connection_ui(ui, &ConnectionData::new(model, link, now));
            section(ui, "Layer");
            let layers = LayersData::new(model, self.map_view.palette());
            commands.extend(layers_ui(ui, &layers));
            legend_ui(ui, &LegendData::new(self.map_view.palette()));
            if let Some(shores) = ShoresData::new(model) {
                section(ui, "Shores");
                commands.extend(shores_ui(ui, &shores).map(Command::Look));
            }
            section(ui, "Robot");
            robot_ui(ui, &RobotData::new(model, now));
        }
        if robot.is_some() {
            section(ui, "Robots on the network");
        } else {
            ui.strong("Robots on the network");
        }
        commands.extend(robots_ui(ui, robots, &mut self.address));
        if let Some((model, _)) = robot {
            ui.add_space(6.0);
            ui.separator();
            let events = EventsData::new(model, now);
            let title = format!("Events ({})", events.events.len());
            CollapsingHeader::new(title)
                .id_salt("events header")
                .show(ui, |ui| events_ui(ui, &events));
            CollapsingHeader::new("Losses").show(ui, |ui| losses_ui(ui, &LossesData::new(model)));
        }
        commands
    }

    fn probe_ui(&self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) {
        let line = match self.map_view.probe(ui.ctx(), model, now) {
            Some(probe) => RichText::new(probe.line()),
            None => RichText::new("Point at the map to read it").weak(),
        };
        let frame = Frame::side_top_panel(ui.style()).inner_margin(Margin::symmetric(12, 5));
        Panel::bottom("probe")
            .frame(frame)
            .resizable(false)
            .show(ui, |ui| ui.add(Label::new(line).truncate()));
    }
}

fn section(ui: &mut Ui, title: &str) {
    ui.add_space(4.0);
    ui.separator();
    ui.label(RichText::new(title).strong());
}

/// The middle of the screen while no robot is shown.
fn nothing_ui(ui: &mut Ui, robots: &RobotsData) {
    ui.add_space(0.4 * ui.available_height());
    ui.vertical_centered(|ui| {
        let heading = if robots.found.is_empty() {
            "Looking for robots"
        } else {
            "Robots were found"
        };
        ui.label(RichText::new(heading).size(24.0));
        ui.add_space(6.0);
        ui.label(robots.advice.as_deref().unwrap_or_default());
    });
}

#[cfg(test)]
mod tests;
