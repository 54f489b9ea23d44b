//! Opens the window.

use std::cell::Cell;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use eframe::egui::ViewportBuilder;
use protocol::keys::RobotId;
use protocol::tile::BootId;
use robot_edge::credentials::Credentials;
use robot_edge::link::random_id;
use winit::event_loop::EventLoop;

use crate::app::{AppSettings, ConsoleApp, Outcome, Screenshot, result_of};
use crate::hands::Hands;
use crate::identity::Identity;
use crate::input_loop::InputLoop;
use crate::theme;

/// What the window is opened with.
#[derive(Clone)]
pub struct WindowSettings {
    /// Addresses that are asked for robots besides scouting.
    pub connect: Vec<String>,
    /// The robot to show; without it, the only one that is found.
    pub robot: Option<RobotId>,
    /// Who drives.
    pub identity: Identity,
    /// A Zenoh configuration to lay ours over.
    pub zenoh_config: Option<PathBuf>,
    /// Who the operator is, where the link is secured.
    pub credentials: Option<Credentials>,
    /// Where to save a picture of the window, and after how long; then it closes.
    pub screenshot: Option<(PathBuf, Duration)>,
    /// On the window.
    pub title: String,
}

/// Shows the window until it is closed.
///
/// # Errors
/// Where no window can be opened, or the picture that was asked for cannot be taken.
pub fn run(settings: WindowSettings) -> anyhow::Result<()> {
    let session = BootId(random_id()?);
    let outcome = Outcome::default();
    let is_picture_wanted = settings.screenshot.is_some();
    let for_picture = Outcome::clone(&outcome);
    let options = eframe::NativeOptions {
        viewport: ViewportBuilder::default()
            .with_app_id("foreshore-operator-console")
            .with_inner_size([1280.0, 800.0])
            .with_min_inner_size([640.0, 480.0]),
        // The loop that drives must not wait for a display, which may be off.
        glow_options: eframe::egui_glow::GlowConfiguration {
            vsync: false,
            ..eframe::egui_glow::GlowConfiguration::default()
        },
        ..eframe::NativeOptions::default()
    };
    let hands = Rc::new(Hands::default());
    let is_open = Rc::new(Cell::new(false));
    let (hands_of_app, is_open_of_app) = (Rc::clone(&hands), Rc::clone(&is_open));
    let create = move |creation: &eframe::CreationContext<'_>| {
        is_open_of_app.set(true);
        theme::set(&creation.egui_ctx);
        let screenshot = settings
            .screenshot
            .map(|(path, after)| Screenshot::new(path, after, for_picture));
        let app = ConsoleApp::new(
            &creation.egui_ctx,
            AppSettings {
                connect: settings.connect,
                robot: settings.robot,
                zenoh_config: settings.zenoh_config,
                credentials: settings.credentials,
                session,
                screenshot,
                identity: settings.identity,
                hands: hands_of_app,
            },
        );
        Ok(Box::new(app) as Box<dyn eframe::App>)
    };
    let no_window = "no window can be opened; on a computer without a screen use --headless";
    let event_loop = EventLoop::with_user_event()
        .build()
        .map_err(|why| anyhow!("{why}"))
        .context(no_window)?;
    let window = eframe::create_native(&settings.title, options, Box::new(create), &event_loop);
    event_loop
        .run_app(&mut InputLoop::new(window, hands))
        .map_err(|why| anyhow!("{why}"))
        .context(no_window)?;
    // What eframe could not do, it has only logged.
    if !is_open.get() {
        return Err(anyhow!(no_window));
    }
    if is_picture_wanted {
        result_of(&outcome)?;
    }
    Ok(())
}
