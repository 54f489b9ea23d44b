//! What is on the screen: a bar above, and below it the panels, each drawn where the workspace has it.

mod actions;
mod contents;

use std::time::Duration;

use eframe::egui::{CentralPanel, Color32, Context, Frame, Margin, MenuBar, Panel, Ui};
use measurement::time::Monotonic;

use super::dialogs::Dialogs;
use super::export_job::ExportProgress;
use super::menus::{Choice, MenuState, menus_ui};
use super::robot_overlay::robot_overlay_data;
use crate::alerts::FleetAlerts;
use crate::command::{Command, Look};
use crate::event_log::EventLog;
use crate::map_view::{MapView, Overlay};
use crate::model::ConsoleModel;
use crate::panels::addresses::AddressEntry;
use crate::panels::connection::LinkStatus;
use crate::panels::driving::{DrivingData, DrivingEntry};
use crate::panels::events::EventFilter;
use crate::panels::notice::{NoticeData, NoticeRoom, notice_ui};
use crate::panels::robots::RobotsData;
use crate::panels::top_bar::{TopBarData, right_bar_ui, robot_bar_ui};
use crate::settings::{Appearance, Settings};
use crate::shortcuts::{Action, KeyContext, Pressed, TypeAhead, pressed};
use crate::teleop_client::TeleopClientState;
use crate::workspace::{PanelId, Workspace, is_tight};

use contents::Panels;

/// Ages of commands are looked at while somebody drives.
const DRIVING_PERIOD: Duration = Duration::from_millis(100);
/// Ages on the screen are at most this much behind. What comes once a second anyway comes before.
const AGES_PERIOD: Duration = Duration::from_millis(1200);

/// What the screen remembers between frames.
#[derive(Default)]
pub struct Screen {
    map_view: MapView,
    workspace: Workspace,
    appearance: Appearance,
    address: AddressEntry,
    driving: DrivingEntry,
    filter: EventFilter,
    dialogs: Dialogs,
    /// Whether text was typed when the last frame ended.
    was_typing: bool,
    /// While somebody drove when the last frame was drawn, whether the window was too narrow, and too low, for all panels.
    is_tight: Option<[bool; 2]>,
    type_ahead: TypeAhead,
}

/// What is shown of one robot.
pub struct ShownRobot<'a> {
    /// The robot.
    pub model: &'a mut ConsoleModel,
    /// Its link.
    pub link: &'a LinkStatus,
    /// Its helm, where there is one.
    pub teleop_client: Option<&'a TeleopClientState>,
    /// Its own colour.
    pub color: Color32,
}

/// What is shown whether there is a robot or not.
#[derive(Clone, Copy)]
pub struct ScreenContext<'a> {
    /// Who is on the network.
    pub robots: &'a RobotsData,
    /// What happened.
    pub log: &'a EventLog,
    /// What wants attention.
    pub alerts: &'a FleetAlerts,
    /// The export that is under way, or the last one.
    pub export: Option<&'a ExportProgress>,
}

/// What panels draw from.
#[derive(Clone, Copy)]
struct Scene<'a> {
    context: ScreenContext<'a>,
    robot: Option<(&'a ConsoleModel, &'a LinkStatus)>,
    driving: Option<&'a DrivingData>,
    teleop_client: Option<&'a TeleopClientState>,
    now: Monotonic,
}

impl Screen {
    /// A screen as it was left.
    pub fn of(settings: &Settings) -> Self {
        let mut map_view = MapView::default();
        if let Some(look) = settings.map.clone() {
            map_view.restore(look);
        }
        Self {
            map_view,
            workspace: settings
                .layout
                .as_ref()
                .map_or_else(Workspace::default, Workspace::of),
            appearance: settings.appearance,
            dialogs: Dialogs::of(settings),
            ..Self::default()
        }
    }

    /// Writes what is to be kept into `settings`.
    pub fn keep(&self, settings: &mut Settings) {
        settings.layout = Some(self.workspace.layout());
        settings.appearance = self.appearance;
        settings.map = Some(self.map_view.settings().clone());
        self.dialogs.keep(settings);
    }

    /// Another robot is shown, or none: what was typed and chosen for the one before is not meant for it.
    pub fn forget_robot(&mut self) {
        self.map_view.forget();
        self.driving = DrivingEntry::default();
        self.dialogs.close_export();
    }

    /// How everything looks.
    pub const fn appearance(&self) -> Appearance {
        self.appearance
    }

    /// The map view.
    pub const fn map_view(&self) -> &MapView {
        &self.map_view
    }

    /// The map view, to move it.
    pub const fn map_view_mut(&mut self) -> &mut MapView {
        &mut self.map_view
    }

    /// The panels and where they are.
    pub const fn workspace_mut(&mut self) -> &mut Workspace {
        &mut self.workspace
    }

    /// Begins a frame, before anything of it is drawn.
    pub fn begin_frame(&mut self, ctx: &Context) {
        self.type_ahead.begin_frame(ctx);
    }

    /// Whether text is typed, or is about to be.
    pub fn is_typing(&self, ctx: &Context) -> bool {
        self.type_ahead.is_waiting() || ctx.text_edit_focused()
    }

    /// Draws everything; what the operator asks for.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        context: ScreenContext<'_>,
        mut robot: Option<ShownRobot<'_>>,
        now: Monotonic,
    ) -> Vec<Command> {
        // A recording is none of those on the network, and a robot alone need not be told from others.
        let found = context.robots.found.len();
        let color = robot.as_ref().and_then(|robot| {
            let is_alone = found < 2 || robot.link.recording.is_some();
            (!is_alone).then_some(robot.color)
        });
        if let Some(ShownRobot {
            model, color: own, ..
        }) = &mut robot
        {
            model.want_scan(self.map_view.settings().has(Overlay::Sensors));
            self.map_view
                .set_robot_overlay(robot_overlay_data(model, *own, now));
            self.map_view.update(model);
            ui.ctx().request_repaint_after(AGES_PERIOD);
        }
        let teleop_client = robot.as_ref().and_then(|robot| robot.teleop_client);
        let is_driving =
            teleop_client.is_some_and(|teleop_client| teleop_client.lease.held().is_some());
        let bar = robot
            .as_ref()
            .map(|robot| TopBarData::new(robot.model, robot.link, robot.teleop_client, color, now));
        let robot = robot.map(|ShownRobot { model, link, .. }| (&*model, link));
        let driving = robot
            .zip(teleop_client)
            .and_then(|((model, _), teleop_client)| DrivingData::new(model, teleop_client, now));
        if driving
            .as_ref()
            .is_some_and(|driving| !driving.is_at_rest())
        {
            ui.ctx().request_repaint_after(DRIVING_PERIOD);
        }
        let scene = Scene {
            context,
            robot,
            driving: driving.as_ref(),
            teleop_client,
            now,
        };
        let keys = KeyContext {
            is_driving,
            has_recording: robot.is_some_and(|(_, link)| link.recording.is_some()),
            was_typing: self.was_typing,
        };
        let Pressed {
            mut actions,
            typed_ahead,
        } = pressed(ui.ctx(), keys);
        if let Some(typed) = typed_ahead {
            self.type_ahead.wait(ui.ctx(), typed);
        }
        let mut commands = Vec::new();
        self.bar_ui(ui, scene, bar.as_ref(), &mut actions, &mut commands);
        let shown = CentralPanel::no_frame().show(ui, |ui| {
            let is_tight = is_driving.then(|| is_tight(ui.available_size()));
            self.is_tight = is_tight;
            let panels = &mut Panels {
                map_view: &mut self.map_view,
                address: &mut self.address,
                driving: &mut self.driving,
                filter: &mut self.filter,
                notice_room: None,
                draws_shores: false,
            };
            let (actions, commands) = (&mut actions, &mut commands);
            self.workspace.show(
                ui,
                |panel| scene.unavailable_reason(panel, is_tight).is_none(),
                &mut |ui, panel| panels.draw(ui, panel, scene, actions, commands),
            );
            (panels.notice_room.take(), panels.draws_shores)
        });
        let (on_map, draws_shores) = shown.inner;
        if !draws_shores && self.map_view.hovered().is_some() {
            // The list went away from under the hand.
            commands.push(Command::Look(Look::Hover(None)));
        }
        if let Some(news) = NoticeData::new(context.log, now) {
            let room = on_map.unwrap_or_else(|| NoticeRoom::of_window(ui));
            notice_ui(ui, &news, &room);
        }
        let model = robot.map(|(model, _)| model);
        let asked = self.dialogs.show(ui.ctx(), model, context.export);
        commands.extend(asked);
        for action in actions {
            commands.extend(self.act(ui.ctx(), action, scene));
        }
        let chooses_robot = |command: &Command| matches!(command, Command::Connect(_));
        if commands.iter().any(chooses_robot) {
            self.address.clear_error();
        }
        self.was_typing = ui.ctx().text_edit_focused();
        commands
    }

    fn bar_ui(
        &mut self,
        ui: &mut Ui,
        scene: Scene<'_>,
        bar: Option<&TopBarData>,
        actions: &mut Vec<Action>,
        commands: &mut Vec<Command>,
    ) {
        let frame = Frame::new().inner_margin(Margin::symmetric(8, 4));
        Panel::top("bar")
            .frame(frame)
            .resizable(false)
            .show(ui, |ui| {
                MenuBar::new().ui(ui, |ui| {
                    ui.set_min_height(30.0);
                    let sight = MenuState {
                        workspace: &self.workspace,
                        appearance: self.appearance,
                        has_robot: scene.robot.is_some(),
                        unavailable_reason: &|panel| scene.unavailable_reason(panel, self.is_tight),
                    };
                    match menus_ui(ui, &sight) {
                        Some(Choice::Act(action)) => actions.push(action),
                        Some(Choice::Panel(panel, is_wanted)) => {
                            self.workspace.set_wanted(panel, is_wanted);
                        }
                        Some(Choice::Theme(theme)) => {
                            self.appearance.theme = theme;
                            self.appearance.apply(ui.ctx());
                        }
                        None => {}
                    }
                    ui.separator();
                    // From the right first: what is in the middle gives way.
                    let asked =
                        right_bar_ui(ui, bar, scene.context.alerts.unacknowledged(), |ui| {
                            if let Some(bar) = bar {
                                robot_bar_ui(ui, bar);
                            }
                        });
                    commands.extend(asked.command);
                    if asked.shows_alerts {
                        self.workspace.set_wanted(PanelId::Alerts, true);
                    }
                });
            });
    }
}

#[cfg(test)]
mod tests;
