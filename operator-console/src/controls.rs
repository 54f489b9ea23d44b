//! Writes the accessibility tree of the window to a file, for tests that press real keys and buttons.

use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use eframe::egui::accesskit::TreeUpdate;
use eframe::egui::{Context, FullOutput, Plugin};

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
