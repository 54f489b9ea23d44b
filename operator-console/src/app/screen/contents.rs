//! What is in each panel, and which of them there is room for.

use eframe::egui::Ui;
use measurement::time::Monotonic;

use crate::app::first_run::first_run_ui;
use crate::command::Command;
use crate::map_view::MapView;
use crate::model::ConsoleModel;
use crate::panels::addresses::AddressEntry;
use crate::panels::alerts::{AlertsData, alerts_ui};
use crate::panels::driving::{DrivingEntry, driving_ui};
use crate::panels::events::{EventFilter, EventsData, events_ui};
use crate::panels::layers::{LayersData, layers_ui};
use crate::panels::link::{LinkData, link_ui};
use crate::panels::losses::{LossesData, losses_ui};
use crate::panels::notice::NoticeRoom;
use crate::panels::recording::{RecordingData, recording_ui};
use crate::panels::robot::{RobotData, robot_ui};
use crate::panels::robots::robots_ui;
use crate::panels::sensors::{SensorsData, sensors_ui};
use crate::panels::shores::{ShoresData, shores_ui};
use crate::shortcuts::Action;
use crate::workspace::PanelId;

use super::Scene;

/// Whether there is room for a panel while somebody drives in a window that is narrow, or low.
const fn fits(panel: PanelId, [is_narrow, is_low]: [bool; 2]) -> bool {
    match panel {
        PanelId::Map | PanelId::Driving => true,
        PanelId::Robots | PanelId::Robot | PanelId::Layers | PanelId::Shores => !is_narrow,
        PanelId::Link
        | PanelId::Sensors
        | PanelId::Recording
        | PanelId::Events
        | PanelId::Alerts
        | PanelId::Losses => !is_narrow && !is_low,
    }
}

/// What there is to say of a panel that does not fit.
const NO_ROOM: &str = "Hidden in a small window while you drive";

impl Scene<'_> {
    /// Why a panel is not there although it is wanted; `None` where it is. `is_tight`: while somebody drives, whether the window
    /// is narrow, and whether it is low.
    pub(super) fn unavailable_reason(
        &self,
        panel: PanelId,
        is_tight: Option<[bool; 2]>,
    ) -> Option<&'static str> {
        let has_room = is_tight.is_none_or(|is_tight| fits(panel, is_tight));
        self.lacks(panel).or((!has_room).then_some(NO_ROOM))
    }

    /// Why there is nothing to show in a panel; `None` where there is something.
    fn lacks(&self, panel: PanelId) -> Option<&'static str> {
        const NO_DATA: &str = "No data about it yet";
        let Some((model, link)) = self.robot else {
            return panel.needs_a_robot().then_some("No robot is shown");
        };
        match panel {
            PanelId::Map
            | PanelId::Robots
            | PanelId::Robot
            | PanelId::Layers
            | PanelId::Link
            | PanelId::Events
            | PanelId::Alerts
            | PanelId::Losses => None,
            PanelId::Shores if model.has_shores() => None,
            PanelId::Shores if model.info().is_none() => Some(NO_DATA),
            PanelId::Shores if link.recording.is_some() => {
                Some("This recording is mapped without shores")
            }
            PanelId::Shores => Some("This robot maps no shores"),
            PanelId::Driving if self.driving.is_some() => None,
            PanelId::Driving if link.recording.is_some() => Some("A recording cannot be driven"),
            PanelId::Driving if model.status().is_none() => Some(NO_DATA),
            PanelId::Driving => Some("This robot cannot be driven from here"),
            PanelId::Sensors | PanelId::Recording => model.status().is_none().then_some(NO_DATA),
        }
    }
}

/// What panels remember.
pub(super) struct Panels<'a> {
    pub(super) map_view: &'a mut MapView,
    pub(super) address: &'a mut AddressEntry,
    pub(super) driving: &'a mut DrivingEntry,
    pub(super) filter: &'a mut EventFilter,
    /// Where notices lie on the map, as soon as that is drawn.
    pub(super) notice_room: Option<NoticeRoom>,
    /// Whether the lists of shores are there.
    pub(super) draws_shores: bool,
}

impl Panels<'_> {
    pub(super) fn draw(
        &mut self,
        ui: &mut Ui,
        panel: PanelId,
        scene: Scene<'_>,
        actions: &mut Vec<Action>,
        commands: &mut Vec<Command>,
    ) {
        let Scene {
            context,
            robot,
            driving,
            teleop_client,
            now,
        } = scene;
        match panel {
            PanelId::Robots => {
                commands.extend(robots_ui(ui, context.robots, self.address));
                return;
            }
            PanelId::Events => {
                events_ui(ui, &EventsData::new(context.log, self.filter), self.filter);
                return;
            }
            PanelId::Alerts => {
                commands.extend(alerts_ui(ui, &AlertsData::new(context.alerts, now)));
                return;
            }
            PanelId::Map
            | PanelId::Robot
            | PanelId::Layers
            | PanelId::Shores
            | PanelId::Driving
            | PanelId::Link
            | PanelId::Sensors
            | PanelId::Recording
            | PanelId::Losses => {}
        }
        let Some((model, link)) = robot else {
            if panel == PanelId::Map {
                actions.extend(first_run_ui(ui, context.robots));
            }
            return;
        };
        match panel {
            PanelId::Map => commands.extend(self.map_ui(ui, model, now)),
            PanelId::Robot => robot_ui(ui, &RobotData::new(model, now)),
            PanelId::Layers => {
                let layers = LayersData::new(model, link, self.map_view, now);
                commands.extend(layers_ui(ui, &layers).map(Command::Layer));
            }
            PanelId::Shores => {
                self.draws_shores = true;
                if let Some(shores) = ShoresData::new(model, self.map_view) {
                    commands.extend(shores_ui(ui, &shores).map(Command::Look));
                }
            }
            PanelId::Driving => {
                if let Some(data) = driving {
                    commands.extend(driving_ui(ui, data, self.driving));
                }
            }
            PanelId::Link => link_ui(ui, &LinkData::new(model, link, now)),
            PanelId::Sensors => sensors_ui(ui, &SensorsData::new(model, now)),
            PanelId::Recording => {
                let data =
                    RecordingData::new(model, teleop_client, link.recordings.as_deref(), now);
                commands.extend(recording_ui(ui, &data));
            }
            PanelId::Losses => losses_ui(ui, &LossesData::new(model)),
            PanelId::Robots | PanelId::Events | PanelId::Alerts => {}
        }
    }

    fn map_ui(&mut self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) -> Option<Command> {
        let look = self.map_view.show(ui, model, now);
        self.notice_room = self.map_view.notice_room();
        look.map(Command::Look)
    }
}
