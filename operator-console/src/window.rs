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

use crate::app::{AppSettings, ConsoleApp, Screenshot, ScreenshotOutcome, result_of};
use crate::controls::ControlsFile;
use crate::demo::DemoFailure;
use crate::identity::Identity;
use crate::input_loop::InputLoop;
use crate::playback::ToOpen;
use crate::settings::{self, ConfigPath, Read, SettingsWriter, WindowPlace};
use crate::teleop_handle::TeleopHandle;
use crate::theme;

/// What the window is opened with.
#[derive(Clone)]
pub struct WindowSettings {
    /// Addresses that are asked for robots besides scouting.
    pub connect: Vec<String>,
    /// The robot to show; without it, the only one that is found.
    pub robot: Option<RobotId>,
    /// Why that robot is gone, where this program simulates it.
    pub demo: Option<DemoFailure>,
    /// Where that robot's recordings are, where that is on this machine.
    pub recordings: Option<PathBuf>,
    /// Who drives.
    pub identity: Identity,
    /// A Zenoh configuration to lay ours over.
    pub zenoh_config: Option<PathBuf>,
    /// Who the operator is, where the link is secured.
    pub credentials: Option<Credentials>,
    /// Where to save a picture of the window, and after how long; then it closes.
    pub screenshot: Option<(PathBuf, Duration)>,
    /// Where to write what a screen reader is told.
    pub controls: Option<PathBuf>,
    /// On the window.
    pub title: String,
    /// A recording to show.
    pub open: Option<ToOpen>,
    /// Where settings are kept, and whether those of the last run are left aside.
    pub config: ConfigPath,
    /// Begin with defaults, whatever was kept.
    pub forgets_settings: bool,
}

/// Shows the window until it is closed.
///
/// # Errors
/// Where no window can be opened, or the picture that was asked for cannot be taken.
pub fn run(settings: WindowSettings) -> anyhow::Result<()> {
    let session = BootId(random_id()?);
    let outcome = ScreenshotOutcome::default();
    let is_picture_wanted = settings.screenshot.is_some();
    let for_picture = ScreenshotOutcome::clone(&outcome);
    let Read {
        settings: kept,
        complaint,
    } = match &settings.config {
        ConfigPath::File(path) if !settings.forgets_settings => settings::read(path),
        ConfigPath::File(_) | ConfigPath::None => Read::default(),
    };
    let settings_writer = match &settings.config {
        ConfigPath::File(path) => Some(SettingsWriter::start(path.clone(), kept.clone())),
        ConfigPath::None => None,
    };
    let options = eframe::NativeOptions {
        viewport: viewport(kept.window),
        // The loop that drives must not wait for a display, which may be off.
        glow_options: eframe::egui_glow::GlowConfiguration {
            vsync: false,
            ..eframe::egui_glow::GlowConfiguration::default()
        },
        // There is no gradient to smooth, and without a GPU every pixel would pay for it.
        dithering: false,
        ..eframe::NativeOptions::default()
    };
    let teleop_handle = Rc::new(TeleopHandle::default());
    let is_open = Rc::new(Cell::new(false));
    let (hands_of_app, is_open_of_app) = (Rc::clone(&teleop_handle), Rc::clone(&is_open));
    let create = move |creation: &eframe::CreationContext<'_>| {
        is_open_of_app.set(true);
        theme::set(&creation.egui_ctx);
        if let Some(path) = settings.controls {
            creation.egui_ctx.add_plugin(ControlsFile::new(path));
        }
        // Its keys are in the table of all others.
        creation
            .egui_ctx
            .options_mut(|options| options.zoom_with_keyboard = false);
        kept.appearance.apply(&creation.egui_ctx);
        let screenshot = settings
            .screenshot
            .map(|(path, after)| Screenshot::new(path, after, for_picture));
        let app = ConsoleApp::new(
            &creation.egui_ctx,
            AppSettings {
                connect: settings.connect,
                robot: settings.robot,
                demo: settings.demo,
                recordings: settings.recordings,
                zenoh_config: settings.zenoh_config,
                credentials: settings.credentials,
                session,
                screenshot,
                identity: settings.identity,
                teleop_handle: hands_of_app,
                open: settings.open,
                settings: kept,
                settings_writer,
                complaint,
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
        .run_app(&mut InputLoop::new(window, teleop_handle))
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

/// The window as it was left, or as it is at first.
fn viewport(place: Option<WindowPlace>) -> ViewportBuilder {
    let viewport = ViewportBuilder::default()
        .with_app_id("foreshore-operator-console")
        .with_min_inner_size([640.0, 480.0]);
    let Some(place) = place else {
        return viewport.with_inner_size([1280.0, 800.0]);
    };
    let viewport = viewport
        .with_inner_size(place.size)
        .with_clamp_size_to_monitor_size(true)
        .with_maximized(place.is_maximized);
    match place.corner {
        Some(corner) => viewport.with_position(corner),
        None => viewport,
    }
}
