//! The program behind the window: finds robots, shows one, does what the operator asks.

mod choice;
mod screen;
mod screenshot;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use eframe::egui::{Context, Ui};
use protocol::keys::RobotId;
use protocol::tile::BootId;
use robot_edge::clock::Monotonic;
use robot_edge::credentials::Credentials;
use robot_edge::link::sessions::Endpoints;

use crate::cockpit::Cockpit;
use crate::command::Command;
use crate::hands::Hands;
use crate::identity::Identity;
use crate::link::{Discovery, FoundRobot, RobotSession};
use crate::model::ModelSettings;
use crate::panels::connection::LinkSight;
use crate::panels::robots::RobotsData;
use crate::teleop_input::InputEvent;

use choice::RobotChoice;

pub use screen::{RobotSight, Screen};
pub use screenshot::{Outcome, Screenshot, result_of};

/// Memory for tiles, megabytes: 30,000 tiles, 30 km² at 0.5 m.
const STORE_MB: u32 = 256;

/// What the app is started with.
pub struct AppSettings {
    /// Addresses that are asked for robots besides scouting.
    pub connect: Vec<String>,
    /// The robot to show.
    pub robot: Option<RobotId>,
    /// A Zenoh configuration to lay ours over.
    pub zenoh_config: Option<PathBuf>,
    /// Who the operator is, where the link is secured.
    pub credentials: Option<Credentials>,
    /// This run of the console: random.
    pub session: BootId,
    /// A picture to take.
    pub screenshot: Option<Screenshot>,
    /// Who drives.
    pub identity: Identity,
    /// What drives.
    pub hands: Rc<Hands>,
}

/// The app.
pub struct ConsoleApp {
    ctx: Context,
    zenoh_config: Option<PathBuf>,
    credentials: Option<Credentials>,
    session_id: BootId,
    discovery: Discovery,
    choice: RobotChoice,
    found: Vec<FoundRobot>,
    shown: Option<(FoundRobot, RobotSession)>,
    /// Why a robot cannot be shown.
    problem: Option<String>,
    screen: Screen,
    screenshot: Option<Screenshot>,
    identity: Identity,
    hands: Rc<Hands>,
}

impl ConsoleApp {
    /// Begins to look for robots.
    pub fn new(ctx: &Context, settings: AppSettings) -> Self {
        let waking = ctx.clone();
        // Whoever names an address wants what is there.
        let scouts = settings.connect.is_empty();
        let discovery = Discovery::start(
            settings.connect,
            scouts,
            settings.zenoh_config.clone(),
            settings.credentials.clone(),
            move || {
                waking.request_repaint();
            },
        );
        Self {
            ctx: ctx.clone(),
            zenoh_config: settings.zenoh_config,
            credentials: settings.credentials,
            session_id: settings.session,
            discovery,
            choice: RobotChoice::new(settings.robot),
            found: Vec::new(),
            shown: None,
            problem: None,
            screen: Screen::default(),
            screenshot: settings.screenshot,
            identity: settings.identity,
            hands: settings.hands,
        }
    }

    fn connect(&mut self, found: FoundRobot) {
        let settings = ModelSettings {
            robot: found.robot.clone(),
            session: self.session_id,
            store_mb: STORE_MB,
            layers: BTreeSet::from([self.screen.map_view().layer()]),
        };
        let endpoints = Endpoints {
            listen: Vec::new(),
            connect: vec![found.endpoint.clone()],
            zenoh_config: self.zenoh_config.clone(),
            credentials: self.credentials.clone(),
            audit: None,
        };
        self.screen.map_view_mut().forget();
        let ctx = self.ctx.clone();
        // Any delay but none: a request for now would be two frames.
        let wake = move || ctx.request_repaint_after(Duration::from_millis(1));
        // What was driven is left before anything else is.
        self.hands.take(None);
        let opened = RobotSession::open(settings, &endpoints, wake).map_err(anyhow::Error::from);
        let opened = opened.and_then(|mut session| {
            let cockpit = session
                .take_driving()
                .map(|driving| Cockpit::new(found.robot.clone(), self.identity.clone(), driving));
            Ok((session, cockpit.transpose()?))
        });
        match opened {
            Ok((session, cockpit)) => {
                self.problem = None;
                self.shown = Some((found, session));
                self.hands.take(cockpit);
            }
            Err(why) => {
                tracing::error!(%why, "the robot cannot be shown");
                self.problem = Some(format!("{} cannot be shown: {why}", found.robot));
                self.shown = None;
            }
        }
    }

    fn obey(&mut self, command: Command) {
        let map_view = self.screen.map_view_mut();
        match command {
            Command::Connect(found) => self.connect(found),
            Command::AddAddress(address) => self.discovery.add_address(address),
            Command::ShowScheme(scheme) => map_view.show_scheme(scheme),
            Command::Look(look) => map_view.look(look),
            Command::Drive(intent) => self.hands.want(intent, Monotonic::now()),
            Command::ShowLayer(layer) => {
                if let Some((_, session)) = &self.shown {
                    map_view.show_layer(layer, &session.model());
                }
            }
            Command::FitColors => {
                if let Some((_, session)) = &self.shown {
                    map_view.fit_colors(&session.model());
                }
            }
        }
        self.ctx.request_repaint();
    }
}

impl eframe::App for ConsoleApp {
    fn logic(&mut self, ctx: &Context, _frame: &mut eframe::Frame) {
        let now = Monotonic::now();
        self.found = self.discovery.found();
        if self.shown.is_none() {
            if let Some(found) = self.choice.choose(&self.found, now).cloned() {
                self.connect(found);
            } else if let Some(rest) = self.choice.look_again_after(now) {
                ctx.request_repaint_after(rest);
            }
        }
        if let Some(screenshot) = &mut self.screenshot {
            screenshot.step(ctx, now);
        }
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let now = Monotonic::now();
        let current = self.shown.as_ref().map(|(found, _)| &found.robot);
        let problem = self.problem.clone().or_else(|| self.discovery.problem());
        let robots = RobotsData::new(&self.found, current, self.choice.named(), problem);
        let commands = match &self.shown {
            Some((_, session)) => {
                let link = LinkSight {
                    is_connected: session.is_connected(),
                    problem: session.problem(),
                };
                let mut model = session.model();
                if let Some(info) = model.info() {
                    self.hands.hear_of(info);
                }
                let helm = self.hands.sight(now);
                let robot = Some(RobotSight {
                    model: &mut model,
                    link: &link,
                    helm: helm.as_ref(),
                });
                let commands = self.screen.show(ui, &robots, robot, now);
                let map_view = self.screen.map_view();
                let rectangle_m = map_view.visible_m().map(|edge_m| edge_m as f32);
                let layers = BTreeSet::from([map_view.layer()]);
                model.look_at(rectangle_m, layers);
                commands
            }
            None => self.screen.show(ui, &robots, None, now),
        };
        let is_typing = ui.ctx().text_edit_focused();
        self.hands.apply(InputEvent::Typing(is_typing));
        for command in commands {
            self.obey(command);
        }
    }
}
