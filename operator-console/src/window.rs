//! The window, and the file of its controls for tests.

use std::cell::Cell;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;
use std::{fs, io};

use anyhow::{Context as _, anyhow};
use eframe::egui::accesskit::TreeUpdate;
use eframe::egui::{Context, FullOutput, Plugin, ViewportBuilder};
use network::credentials::Credentials;
use network::random_id;
use protocol::keys::RobotId;
use protocol::tile::BootId;
use winit::event_loop::EventLoop;

use crate::app::{ConsoleApp, Screenshot, ScreenshotOutcome, result_of};
use crate::demo::DemoFailure;
use crate::identity::Identity;
use crate::input_loop::InputLoop;
use crate::playback::ToOpen;
use crate::settings::{self, ConfigPath, Read, SettingsWriter, WindowPlace};
use crate::teleop_handle::TeleopHandle;
use crate::theme;

#[derive(Clone)]
pub struct WindowSettings {
    pub connect: Vec<String>,
    pub robot: Option<RobotId>,
    pub demo: Option<DemoFailure>,
    /// Folder of the simulated robot's recordings.
    pub recordings: Option<PathBuf>,
    pub identity: Identity,
    pub zenoh_config: Option<PathBuf>,
    pub credentials: Option<Credentials>,
    /// Path of a screenshot and the time until it is taken; then the window closes.
    pub screenshot: Option<(PathBuf, Duration)>,
    pub controls: Option<PathBuf>,
    pub open: Option<ToOpen>,
    pub config: ConfigPath,
    pub forgets_settings: bool,
}

pub fn run(mut settings: WindowSettings) -> anyhow::Result<()> {
    let session = BootId(random_id()?);
    let outcome = ScreenshotOutcome::default();
    let is_picture_wanted = settings.screenshot.is_some();
    let for_picture = ScreenshotOutcome::clone(&outcome);
    let kept = match &settings.config {
        ConfigPath::File(path) if !settings.forgets_settings => settings::read(path),
        ConfigPath::File(_) | ConfigPath::None => Read::default(),
    };
    let settings_writer = match &settings.config {
        ConfigPath::File(path) => Some(SettingsWriter::start(path.clone(), kept.settings.clone())),
        ConfigPath::None => None,
    };
    let options = eframe::NativeOptions {
        viewport: viewport(kept.settings.window),
        // The input loop must not wait for a display, which may be off.
        glow_options: eframe::egui_glow::GlowConfiguration {
            vsync: false,
            ..eframe::egui_glow::GlowConfiguration::default()
        },
        // No gradients need it, and without a GPU it is slow.
        dithering: false,
        ..eframe::NativeOptions::default()
    };
    let teleop_handle = Rc::new(TeleopHandle::default());
    let is_open = Rc::new(Cell::new(false));
    let (handle_of_app, is_open_of_app) = (Rc::clone(&teleop_handle), Rc::clone(&is_open));
    let create = move |creation: &eframe::CreationContext<'_>| {
        is_open_of_app.set(true);
        theme::set(&creation.egui_ctx);
        if let Some(path) = settings.controls.take() {
            creation.egui_ctx.add_plugin(ControlsFile::new(path));
        }
        // The zoom keys are shortcuts of this program.
        creation
            .egui_ctx
            .options_mut(|options| options.zoom_with_keyboard = false);
        kept.settings.appearance.apply(&creation.egui_ctx);
        let screenshot = settings.screenshot.take();
        let screenshot = screenshot.map(|(path, after)| Screenshot::new(path, after, for_picture));
        let app = ConsoleApp::new(
            &creation.egui_ctx,
            settings,
            session,
            screenshot,
            handle_of_app,
            kept,
            settings_writer,
        );
        Ok(Box::new(app) as Box<dyn eframe::App>)
    };
    let no_window = "no window can be opened; on a computer without a screen use --headless";
    let event_loop = EventLoop::with_user_event()
        .build()
        .map_err(|why| anyhow!("{why}"))
        .context(no_window)?;
    let window = eframe::create_native("Foreshore", options, Box::new(create), &event_loop);
    event_loop
        .run_app(&mut InputLoop::new(window, teleop_handle))
        .map_err(|why| anyhow!("{why}"))
        .context(no_window)?;
    // eframe only logs why the window was not opened.
    if !is_open.get() {
        return Err(anyhow!(no_window));
    }
    if is_picture_wanted {
        result_of(&outcome)?;
    }
    Ok(())
}

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

/// Writes the controls of each frame if they changed.
///
/// One a line, separated by tabs: role, left, top, right, bottom in pixels of the window, label, value. Controls
/// without label and value are omitted.
pub struct ControlsFile {
    path: PathBuf,
    written: String,
    has_failed: bool,
}

impl ControlsFile {
    pub const fn new(path: PathBuf) -> Self {
        Self {
            path,
            written: String::new(),
            has_failed: false,
        }
    }
}

impl Plugin for ControlsFile {
    fn debug_name(&self) -> &'static str {
        "controls file"
    }

    fn setup(&mut self, ctx: &Context) {
        ctx.enable_accesskit();
    }

    fn output_hook(&mut self, ctx: &Context, output: &mut FullOutput) {
        let Some(update) = &output.platform_output.accesskit_update else {
            return;
        };
        let text = lines(update, f64::from(ctx.pixels_per_point()));
        if text == self.written {
            return;
        }
        match replace(&self.path, &text) {
            Ok(()) => self.written = text,
            Err(why) if !self.has_failed => {
                self.has_failed = true;
                tracing::error!(%why, path = %self.path.display(), "the controls are not written");
            }
            Err(_) => {}
        }
    }
}

fn lines(update: &TreeUpdate, pixels_per_point: f64) -> String {
    let mut text = String::new();
    for (_, node) in &update.nodes {
        let (label, value) = (node.label(), node.value());
        let (Some(bounds), true) = (node.bounds(), label.is_some() || value.is_some()) else {
            continue;
        };
        let [left, top, right, bottom] = [bounds.x0, bounds.y0, bounds.x1, bounds.y1]
            .map(|edge| (edge * pixels_per_point).round());
        let [label, value] = [label, value].map(|text| one_line(text.unwrap_or_default()));
        let role = node.role();
        let _written = writeln!(
            text,
            "{role:?}\t{left}\t{top}\t{right}\t{bottom}\t{label}\t{value}"
        );
    }
    text
}

fn one_line(text: &str) -> String {
    text.split(['\t', '\n', '\r']).collect::<Vec<_>>().join(" ")
}

/// Replaces the file atomically.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    let new = path.with_extension("new");
    fs::write(&new, text)?;
    fs::rename(new, path)
}
