//! Opens the window.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use eframe::egui::ViewportBuilder;
use protocol::keys::RobotId;
use protocol::tile::BootId;
use robot_edge::link::random_id;

use crate::app::{AppSettings, ConsoleApp, Outcome, Screenshot, result_of};
use crate::theme;

/// What the window is opened with.
#[derive(Clone, Debug)]
pub struct WindowSettings {
    /// Addresses that are asked for robots besides scouting.
    pub connect: Vec<String>,
    /// The robot to show; without it, the only one that is found.
    pub robot: Option<RobotId>,
    /// A Zenoh configuration to lay ours over.
    pub zenoh_config: Option<PathBuf>,
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
        ..eframe::NativeOptions::default()
    };
    let create = move |creation: &eframe::CreationContext<'_>| {
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
                session,
                screenshot,
            },
        );
        Ok(Box::new(app) as Box<dyn eframe::App>)
    };
    eframe::run_native(&settings.title, options, Box::new(create))
        .map_err(|why| anyhow!("{why}"))
        .context("no window can be opened; on a computer without a screen use --headless")?;
    if is_picture_wanted {
        result_of(&outcome)?;
    }
    Ok(())
}
