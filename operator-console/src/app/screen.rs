//! Layout of the window: top bar, map and panels.

use std::time::Duration;

use eframe::egui::{CentralPanel, Color32, Context, Frame, Margin, MenuBar, Panel, Ui};
use measurement::time::{Monotonic, RobotDuration};
use protocol::message::{LeaseRequest, Setting};

use super::dialogs::Dialogs;
use super::export_job::ExportProgress;
use super::menus::{Choice, MenuState, menus_ui};
use super::robot_overlay::robot_overlay_data;
use crate::alerts::FleetAlerts;
use crate::app::menus::first_run_ui;
use crate::command::{Command, Look};
use crate::event_log::EventLog;
use crate::map_view::{CameraMode, GoalOffer, LayerCommand, MapView, Overlay, PosePurpose};
use crate::model::ConsoleModel;
use crate::panels::addresses::AddressEntry;
use crate::panels::alerts::{AlertsData, alerts_ui};
use crate::panels::connection::{ConnectionData, LinkStatus};
use crate::panels::driving::{DrivingData, DrivingEntry, LeaseButtons, driving_ui};
use crate::panels::events::{EventFilter, EventsData, events_ui};
use crate::panels::layers::{LayersData, layers_ui};
use crate::panels::link::{LinkData, link_ui};
use crate::panels::losses::{LossesData, losses_ui};
use crate::panels::notice::{NoticeData, NoticeRoom, notice_ui};
use crate::panels::recording::{RecordingData, recording_ui};
use crate::panels::robot::{RobotData, robot_ui};
use crate::panels::robots::{RobotsData, robots_ui};
use crate::panels::sensors::{SensorsData, sensors_ui};
use crate::panels::shores::{DockingOffer, ShoresData, docking_ui, shores_ui};
use crate::panels::top_bar::{TopBarData, right_bar_ui, robot_bar_ui};
use crate::playback::PlaybackCommand;
use crate::settings::{Appearance, Settings, ThemeChoice};
use crate::shortcuts::{Action, Edge, KeyContext, Pressed, TypeAhead, pressed};
use crate::teleop_client::{Intent, TeleopClientState};
use crate::workspace::{PanelId, Workspace, is_tight};

const DRIVING_PERIOD: Duration = Duration::from_millis(100);
const AGES_PERIOD: Duration = Duration::from_millis(1200);

#[derive(Default)]
pub struct Screen {
    map_view: MapView,
    workspace: Workspace,
    appearance: Appearance,
    address: AddressEntry,
    driving: DrivingEntry,
    filter: EventFilter,
    dialogs: Dialogs,
    /// Whether a text field had the keyboard at the end of the last frame.
    was_typing: bool,
    /// While driving, whether the window was too narrow and too low for all panels in the last frame.
    is_tight: Option<[bool; 2]>,
    type_ahead: TypeAhead,
}

pub struct ShownRobot<'a> {
    pub model: &'a mut ConsoleModel,
    pub link: &'a LinkStatus,
    /// `None` if the robot is not driven from here.
    pub teleop_client: Option<&'a TeleopClientState>,
    pub color: Color32,
}

#[derive(Clone, Copy)]
pub struct ScreenContext<'a> {
    pub robots: &'a RobotsData,
    pub log: &'a EventLog,
    pub alerts: &'a FleetAlerts,
    pub export: Option<&'a ExportProgress>,
}

#[derive(Clone, Copy)]
struct FrameData<'a> {
    context: ScreenContext<'a>,
    robot: Option<(&'a ConsoleModel, &'a LinkStatus)>,
    driving: Option<&'a DrivingData>,
    teleop_client: Option<&'a TeleopClientState>,
    now: Monotonic,
}

impl Screen {
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

    pub fn keep(&self, settings: &mut Settings) {
        settings.layout = Some(self.workspace.layout());
        settings.appearance = self.appearance;
        settings.map = Some(self.map_view.settings().clone());
        self.dialogs.keep(settings);
    }

    pub fn forget_robot(&mut self) {
        self.map_view.forget();
        self.driving = DrivingEntry::default();
        self.dialogs.close_export();
    }

    pub const fn appearance(&self) -> Appearance {
        self.appearance
    }

    pub const fn map_view(&self) -> &MapView {
        &self.map_view
    }

    pub const fn map_view_mut(&mut self) -> &mut MapView {
        &mut self.map_view
    }

    /// Must be called before anything of the frame is drawn.
    pub fn begin_frame(&mut self, ctx: &Context) {
        self.type_ahead.begin_frame(ctx);
    }

    /// Whether a text field has the keyboard or is about to get it.
    pub fn is_typing(&self, ctx: &Context) -> bool {
        self.type_ahead.is_waiting() || ctx.text_edit_focused()
    }

    pub fn show(
        &mut self,
        ui: &mut Ui,
        context: ScreenContext<'_>,
        mut robot: Option<ShownRobot<'_>>,
        now: Monotonic,
    ) -> Vec<Command> {
        // A recording is not a robot of the network, and a single robot needs no colour.
        let found = context.robots.found.len();
        let color = robot.as_ref().and_then(|robot| {
            let is_alone = found < 2 || robot.link.recording.is_some();
            (!is_alone).then_some(robot.color)
        });
        if let Some(ShownRobot {
            model,
            color: own,
            teleop_client,
            ..
        }) = &mut robot
        {
            model.want_scan(self.map_view.settings().has(Overlay::Sensors));
            self.map_view
                .set_robot_overlay(robot_overlay_data(model, *own, now));
            let drives = teleop_client.is_some_and(|client| client.lease.held().is_some());
            let goal_offer = GoalOffer::new(model.goal().has_planner, drives);
            self.map_view.set_goal_offer(goal_offer);
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
        let frame = FrameData {
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
        self.bar_ui(ui, frame, bar.as_ref(), &mut actions, &mut commands);
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
                |panel| frame.unavailable_reason(panel, is_tight).is_none(),
                &mut |ui, panel| panels.draw(ui, panel, frame, actions, commands),
            );
            (panels.notice_room.take(), panels.draws_shores)
        });
        let (on_map, draws_shores) = shown.inner;
        if !draws_shores && self.map_view.hovered().is_some() {
            // The hovered list has disappeared.
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
            commands.extend(self.act(ui.ctx(), action, frame));
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
        frame: FrameData<'_>,
        bar: Option<&TopBarData>,
        actions: &mut Vec<Action>,
        commands: &mut Vec<Command>,
    ) {
        Panel::top("bar")
            .frame(Frame::new().inner_margin(Margin::symmetric(8, 4)))
            .resizable(false)
            .show(ui, |ui| {
                MenuBar::new().ui(ui, |ui| {
                    ui.set_min_height(30.0);
                    let sight = MenuState {
                        workspace: &self.workspace,
                        appearance: self.appearance,
                        has_robot: frame.robot.is_some(),
                        unavailable_reason: &|panel| frame.unavailable_reason(panel, self.is_tight),
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
                    // From the right: the middle gets the remaining space.
                    let asked =
                        right_bar_ui(ui, bar, frame.context.alerts.unacknowledged(), |ui| {
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

/// An arrow key moves the map by this share of the view.
const PAN_SHARE: f32 = 0.1;

impl Screen {
    /// Executes what concerns the screen alone and returns the remaining command.
    fn act(&mut self, ctx: &Context, action: Action, frame: FrameData<'_>) -> Option<Command> {
        match action {
            Action::Layer(layer) => {
                let info = frame.robot.and_then(|(model, _)| model.info());
                let is_offered =
                    info.is_some_and(|info| info.layers.iter().any(|one| one.layer == layer));
                let is_shown = self.map_view.stack().get(layer).is_shown;
                let command = LayerCommand::Show(layer, !is_shown);
                return is_offered.then_some(Command::Layer(command));
            }
            Action::WholeMap => return Some(Command::Look(Look::Whole)),
            Action::Follow => {
                let is_following = self.map_view.camera_mode() == CameraMode::FollowVehicle;
                return Some(Command::Look(Look::Follow(!is_following)));
            }
            Action::Turn => {
                let orientation = self.map_view.settings().orientation.other();
                return Some(Command::Look(Look::Up(orientation)));
            }
            Action::Grid => return Some(self.toggled(Overlay::Grid)),
            Action::Legend => return Some(self.toggled(Overlay::Legend)),
            Action::Measure => {
                let is_measuring = self.map_view.ruler().is_some();
                return Some(Command::Look(Look::Measure(!is_measuring)));
            }
            Action::Point => return Some(Command::Look(Look::Point)),
            Action::UndoPoint => return Some(Command::Look(Look::UndoPoint)),
            Action::ZoomIn => return Some(Command::Look(Look::In)),
            Action::ZoomOut => return Some(Command::Look(Look::Out)),
            Action::Pan(edge) => {
                return Some(Command::Look(Look::Beside(match edge {
                    Edge::Top => [0.0, -PAN_SHARE],
                    Edge::Left => [-PAN_SHARE, 0.0],
                    Edge::Bottom => [0.0, PAN_SHARE],
                    Edge::Right => [PAN_SHARE, 0.0],
                })));
            }
            Action::Robot(number) => {
                let robots = frame.context.robots;
                let found = robots.numbered(number)?;
                let is_shown = robots.current.as_ref() == Some(&found.robot);
                return (!is_shown).then(|| Command::Connect(found.clone()));
            }
            Action::Lease => {
                let request = match frame.driving?.lease {
                    LeaseButtons::Quiet => return None,
                    // The driving panel shows why nothing is requested.
                    LeaseButtons::Free | LeaseButtons::HeldByOther | LeaseButtons::ReadOnly => {
                        LeaseRequest::Request
                    }
                    LeaseButtons::Waiting | LeaseButtons::Held => LeaseRequest::Release,
                };
                return Some(Command::Drive(Intent::Lease(request)));
            }
            Action::AcknowledgeAll => return Some(Command::AcknowledgeAll),
            Action::Screenshot => return Some(Command::Screenshot),
            Action::Quit => return Some(Command::Quit),
            Action::PlayOrPause => return Some(Command::Playback(PlaybackCommand::PlayOrPause)),
            Action::StepBack => return Some(stepped(-1)),
            Action::StepForward => return Some(stepped(1)),
            Action::JumpBack => return Some(stepped(-10)),
            Action::JumpForward => return Some(stepped(10)),
            Action::Slower => return Some(Command::Playback(PlaybackCommand::Slower)),
            Action::Faster => return Some(Command::Playback(PlaybackCommand::Faster)),
            Action::Loop => return Some(Command::Playback(PlaybackCommand::ToggleLooping)),
            Action::TypeAddress => {
                self.workspace.set_wanted(PanelId::Robots, true);
                self.address.focus();
            }
            Action::Export => {
                if let Some((model, link)) = frame.robot {
                    let last = frame.context.export;
                    self.dialogs
                        .show_export(model, link.recording.as_deref(), last);
                }
            }
            Action::OpenRecording => return Some(Command::AskForRecording),
            Action::NextPanel => self.workspace.cycle_focus(true),
            Action::PreviousPanel => self.workspace.cycle_focus(false),
            Action::ResetLayout => self.workspace.reset(),
            Action::ToggleTheme => {
                self.appearance.theme = ThemeChoice::other_than(ctx.theme());
                self.appearance.apply(ctx);
            }
            Action::ScaleUp | Action::ScaleDown => {
                self.appearance = self.appearance.scaled(action == Action::ScaleUp);
                self.appearance.apply(ctx);
            }
            Action::ScaleReset => {
                self.appearance.scale_percent = Appearance::default().scale_percent;
                self.appearance.apply(ctx);
            }
            Action::ShortcutSheet => self.dialogs.toggle_shortcuts(),
            Action::About => self.dialogs.show_about(),
            Action::CloseDialog => {
                let goal = frame.teleop_client.and_then(|client| client.goal);
                if !self.dialogs.close_one() {
                    if goal.is_some() {
                        return Some(Command::Drive(Intent::Goal(None)));
                    }
                    self.map_view.escape();
                }
            }
        }
        ctx.request_repaint();
        None
    }

    fn toggled(&self, overlay: Overlay) -> Command {
        let is_drawn = self.map_view.settings().has(overlay);
        Command::Look(Look::Draw(overlay, !is_drawn))
    }
}

const fn stepped(by_s: i64) -> Command {
    Command::Playback(PlaybackCommand::Step(RobotDuration::from_millis(
        1000 * by_s,
    )))
}

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

const NO_ROOM: &str = "Hidden in a small window while you drive";

impl FrameData<'_> {
    fn unavailable_reason(
        &self,
        panel: PanelId,
        is_tight: Option<[bool; 2]>,
    ) -> Option<&'static str> {
        let has_room = is_tight.is_none_or(|is_tight| fits(panel, is_tight));
        self.why_empty(panel).or((!has_room).then_some(NO_ROOM))
    }

    fn why_empty(&self, panel: PanelId) -> Option<&'static str> {
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

struct Panels<'a> {
    map_view: &'a mut MapView,
    address: &'a mut AddressEntry,
    driving: &'a mut DrivingEntry,
    filter: &'a mut EventFilter,
    notice_room: Option<NoticeRoom>,
    draws_shores: bool,
}

impl Panels<'_> {
    fn draw(
        &mut self,
        ui: &mut Ui,
        panel: PanelId,
        frame: FrameData<'_>,
        actions: &mut Vec<Action>,
        commands: &mut Vec<Command>,
    ) {
        let FrameData {
            context,
            robot,
            driving,
            teleop_client,
            now,
        } = frame;
        match (panel, robot) {
            (PanelId::Robots, _) => {
                commands.extend(robots_ui(ui, context.robots, self.address));
            }
            (PanelId::Events, _) => {
                events_ui(ui, &EventsData::new(context.log, self.filter), self.filter);
            }
            (PanelId::Alerts, _) => {
                commands.extend(alerts_ui(ui, &AlertsData::new(context.alerts, now)));
            }
            (PanelId::Map, None) => actions.extend(first_run_ui(ui, context.robots)),
            (_, None) => {}
            (PanelId::Map, Some((model, _))) => commands.extend(self.map_ui(ui, model, now)),
            (PanelId::Robot, Some((model, link))) => {
                let connection = ConnectionData::new(model, link, now);
                let advice = connection.advice.as_deref();
                commands.extend(robot_ui(ui, &RobotData::new(model, now), advice));
            }
            (PanelId::Layers, Some((model, link))) => {
                let layers = LayersData::new(model, link, self.map_view, now);
                commands.extend(layers_ui(ui, &layers).map(Command::Layer));
            }
            (PanelId::Shores, Some((model, _))) => {
                self.draws_shores = true;
                let offer = DockingOffer::new(model, self.map_view, teleop_client);
                let intent = offer.and_then(|offer| docking_ui(ui, offer));
                commands.extend(intent.map(Command::Drive));
                if let Some(shores) = ShoresData::new(model, self.map_view) {
                    commands.extend(shores_ui(ui, &shores).map(Command::Look));
                }
            }
            (PanelId::Driving, Some(_)) => {
                if let Some(data) = driving {
                    commands.extend(driving_ui(ui, data, self.driving));
                }
            }
            (PanelId::Link, Some((model, link))) => link_ui(ui, &LinkData::new(model, link, now)),
            (PanelId::Sensors, Some((model, _))) => sensors_ui(ui, &SensorsData::new(model, now)),
            (PanelId::Recording, Some((model, link))) => {
                let folder = link.recordings.as_deref();
                let data = RecordingData::new(model, teleop_client, folder, now);
                commands.extend(recording_ui(ui, &data));
            }
            (PanelId::Losses, Some((model, _))) => losses_ui(ui, &LossesData::new(model)),
        }
    }

    fn map_ui(&mut self, ui: &mut Ui, model: &ConsoleModel, now: Monotonic) -> Option<Command> {
        let look = self.map_view.show(ui, model, now);
        self.notice_room = self.map_view.notice_room();
        let said = match self.map_view.take_said_pose() {
            Some((PosePurpose::Locate, pose)) => Some(Intent::Set(Setting::Locate(pose))),
            Some((PosePurpose::Goal, pose)) => {
                // A second click by mistake must not change the goal.
                self.map_view.look(Look::SetPose(None));
                Some(Intent::Goal(Some(pose)))
            }
            None => None,
        };
        said.map(Command::Drive).or(look.map(Command::Look))
    }
}

#[cfg(test)]
mod tests;
