//! What menus and keys ask of the screen.

use eframe::egui::Context;
use measurement::time::RobotDuration;
use protocol::message::LeaseRequest;

use crate::command::{Command, Look};
use crate::map_view::{CameraMode, LayerCommand, Overlay};
use crate::panels::driving::LeaseButtons;
use crate::playback::PlaybackCommand;
use crate::settings::{Appearance, ThemeChoice};
use crate::shortcuts::{Action, Edge};
use crate::teleop_client::Intent;
use crate::workspace::PanelId;

use super::{Scene, Screen};

/// An arrow moves the map by this share of its width or height.
const PAN_SHARE: f32 = 0.1;

impl Screen {
    /// Does what concerns the screen alone; what is left for others to do.
    pub(super) fn act(
        &mut self,
        ctx: &Context,
        action: Action,
        scene: Scene<'_>,
    ) -> Option<Command> {
        match action {
            Action::Layer(layer) => {
                let info = scene.robot.and_then(|(model, _)| model.info());
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
                let robots = scene.context.robots;
                let found = robots.numbered(number)?;
                let is_shown = robots.current.as_ref() == Some(&found.robot);
                return (!is_shown).then(|| Command::Connect(found.clone()));
            }
            Action::Lease => {
                let request = match scene.driving?.lease {
                    LeaseButtons::Quiet => return None,
                    // The helm says why it asks the robot for nothing.
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
                if let Some((model, link)) = scene.robot {
                    let last = scene.context.export;
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
            Action::ShortcutSheet => self.dialogs.sheet.toggle(),
            Action::About => self.dialogs.show_about(),
            Action::CloseDialog => {
                if !self.dialogs.close_one() {
                    self.map_view.escape();
                }
            }
        }
        ctx.request_repaint();
        None
    }

    /// An overlay where it is not drawn, none where it is.
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
