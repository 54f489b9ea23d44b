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
    /// Whether a failure was logged.
    has_failed: bool,
}

impl ControlsFile {
    /// The file is replaced atomically.
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
        // Writing to a `String` does not fail.
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

#[cfg(test)]
mod tests {
    use eframe::egui::{RawInput, Rect, Vec2, pos2};
    use tempfile::tempdir;

    use super::*;

    #[test]
    fn controls_have_the_positions_of_the_window() {
        let folder = tempdir().unwrap();
        let path = folder.path().join("controls");
        let ctx = Context::default();
        ctx.add_plugin(ControlsFile::new(path.clone()));
        let mut drawn = Rect::NOTHING;
        for _frame in 0..3 {
            let input = RawInput {
                screen_rect: Some(Rect::from_min_size(pos2(0.0, 0.0), Vec2::splat(300.0))),
                ..RawInput::default()
            };
            let mut output = ctx.run_ui(input, |ui| {
                ui.label("Depth\tof water");
                drawn = ui.button("Drive").rect;
            });
            output.textures_delta.clear();
        }
        let text = fs::read_to_string(path).unwrap();
        let find = |name: &str| {
            let mut rows = text
                .lines()
                .map(|line| line.split('\t').collect::<Vec<_>>());
            rows.find(|row| row[0] != "TextRun" && row[5..].contains(&name))
                .unwrap()
        };
        let button = find("Drive");
        assert_eq!(button[0], "Button");
        let edges = [drawn.left(), drawn.top(), drawn.right(), drawn.bottom()];
        assert_eq!(button[1..5], edges.map(|edge| edge.round().to_string()));
        assert_eq!(find("Depth of water")[0], "Label");
    }
}
