//! Dialogs over the window.

use std::collections::BTreeSet;

use eframe::egui::{
    Align2, Button, Context, Key, ProgressBar, RichText, ScrollArea, TextEdit, Ui, Window, vec2,
};
use network::clock::wall_clock_label;

use super::desktop;
use super::export_job::ExportProgress;
use crate::command::{Command, ExportRequest};
use crate::export::ExportPart;
use crate::model::ConsoleModel;
use crate::panels::layers::layer_name;
use crate::playback::{absolute, typed_path};
use crate::settings::Settings;
use crate::shortcuts::{Sheet, sheet_ui};
use crate::theme::{Tone, long_state_ui, state_ui};

pub(super) struct Dialogs {
    sheet: Sheet,
    is_about_open: bool,
    export: Option<ExportDialog>,
    opens_exports: bool,
}

impl Default for Dialogs {
    fn default() -> Self {
        Self::of(&Settings::default())
    }
}

impl Dialogs {
    pub(super) fn of(settings: &Settings) -> Self {
        Self {
            sheet: Sheet::default(),
            is_about_open: false,
            export: None,
            opens_exports: settings.opens_exports,
        }
    }

    pub(super) const fn keep(&self, settings: &mut Settings) {
        settings.opens_exports = self.opens_exports;
    }

    pub(super) const fn show_about(&mut self) {
        self.is_about_open = true;
    }

    pub(super) const fn toggle_shortcuts(&mut self) {
        self.sheet = Sheet {
            is_open: !self.sheet.is_open,
            is_moved: false,
        };
    }

    pub(super) fn show_export(
        &mut self,
        model: &ConsoleModel,
        recording: Option<&str>,
        last: Option<&ExportProgress>,
    ) {
        self.export
            .get_or_insert_with(|| ExportDialog::new(model, recording, last));
    }

    pub(super) fn close_export(&mut self) {
        self.export = None;
    }

    pub(super) fn close_one(&mut self) -> bool {
        if self.export.take().is_some() {
            return true;
        }
        std::mem::take(&mut self.is_about_open) || std::mem::take(&mut self.sheet).is_open
    }

    pub(super) fn show(
        &mut self,
        ctx: &Context,
        model: Option<&ConsoleModel>,
        progress: Option<&ExportProgress>,
    ) -> Option<Command> {
        if self.sheet.is_open {
            sheet_ui(ctx, &mut self.sheet);
        }
        if self.is_about_open {
            about_ui(ctx, &mut self.is_about_open);
        }
        let mut command = None;
        if let Some(dialog) = &mut self.export {
            let mut is_open = true;
            command = dialog.show(ctx, model, progress, &mut self.opens_exports, &mut is_open);
            if !is_open {
                self.export = None;
            }
        }
        command
    }
}

fn about_ui(ctx: &Context, is_open: &mut bool) {
    Window::new("About Foreshore")
        .open(is_open)
        .collapsible(false)
        .resizable(false)
        .pivot(Align2::CENTER_CENTER)
        .default_pos(ctx.content_rect().center())
        .show(ctx, |ui| {
            ui.strong(concat!("Foreshore ", env!("CARGO_PKG_VERSION")));
            ui.label("Shows what a robot or a boat maps, and drives it, over a bad link.");
            ui.label(concat!("Licence: ", "MIT OR Apache-2.0"));
        });
}

const WIDTH: f32 = 460.0;
const MARGIN: f32 = 40.0;
const TITLE: f32 = 80.0;

struct ExportDialog {
    folder: String,
    parts: BTreeSet<ExportPart>,
    has_keyboard: bool,
    previous: Option<ExportProgress>,
}

impl ExportDialog {
    /// Selects all parts that exist, and a folder named after the robot or the recording.
    fn new(model: &ConsoleModel, recording: Option<&str>, last: Option<&ExportProgress>) -> Self {
        let shown = desktop::name_for_files(model.robot(), recording);
        let name = desktop::stamped_name(Some(&shown), &wall_clock_label());
        let folder = desktop::documents().map_or_else(|| name.clone().into(), |at| at.join(&name));
        Self {
            folder: folder.display().to_string(),
            parts: ExportPart::all().filter(|part| part.is_in(model)).collect(),
            has_keyboard: false,
            previous: last.filter(|last| last.ended.is_some()).cloned(),
        }
    }

    /// `opens_folder`: whether to open the folder of a finished export. `is_open` is cleared when the dialog is closed.
    fn show(
        &mut self,
        ctx: &Context,
        model: Option<&ConsoleModel>,
        progress: Option<&ExportProgress>,
        opens_folder: &mut bool,
        is_open: &mut bool,
    ) -> Option<Command> {
        let mut command = None;
        let progress = progress.filter(|progress| self.previous.as_ref() != Some(*progress));
        Window::new("Export maps")
            .open(is_open)
            .collapsible(false)
            .resizable(false)
            .pivot(Align2::CENTER_CENTER)
            .default_pos(ctx.content_rect().center())
            .show(ctx, |ui| {
                let room = ctx.content_rect().size() - vec2(MARGIN, TITLE);
                ui.set_width(WIDTH.min(room.x));
                // The dialog grows with its content up to the window's size.
                let scrolled = ScrollArea::vertical()
                    .max_height(room.y)
                    .min_scrolled_height(room.y);
                let shown =
                    scrolled.show(ui, |ui| self.choice_ui(ui, model, progress, opens_folder));
                command = shown.inner;
            });
        command
    }

    fn choice_ui(
        &mut self,
        ui: &mut Ui,
        model: Option<&ConsoleModel>,
        progress: Option<&ExportProgress>,
        opens_folder: &mut bool,
    ) -> Option<Command> {
        let mut command = None;
        let is_running = progress.is_some_and(|progress| progress.ended.is_none());
        let mut is_entered = false;
        ui.add_enabled_ui(!is_running, |ui| {
            let label = ui.label("Folder");
            let field = TextEdit::singleline(&mut self.folder)
                .char_limit(4096)
                .desired_width(f32::INFINITY);
            let field = ui.add(field).labelled_by(label.id);
            let field = field.on_hover_text("Folder of the files; it is made if it is missing");
            if !self.has_keyboard {
                field.request_focus();
                self.has_keyboard = true;
            }
            is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            for part in ExportPart::all() {
                self.part_ui(ui, part, model);
            }
            ui.separator();
            ui.checkbox(opens_folder, "Open the folder when all is in it")
                .on_hover_text("Where there is a desktop to show it");
        });
        ui.horizontal(|ui| {
            let lacking = self.lacking(model);
            let can_begin = !is_running && lacking.is_none();
            let button = ui.add_enabled(can_begin, Button::new("Export"));
            let button = button.on_hover_text("Files of the same name are replaced (Enter)");
            if can_begin && (button.clicked() || is_entered) {
                command = Some(Command::Export(ExportRequest {
                    folder: absolute(typed_path(self.folder.trim())),
                    parts: self.parts.clone(),
                    opens_folder: *opens_folder,
                }));
            }
            let hint = "Files that are complete stay";
            if is_running && ui.button("Cancel export").on_hover_text(hint).clicked() {
                command = Some(Command::CancelExport);
            }
            if let Some(lacking) = lacking.filter(|_| !is_running) {
                ui.label(lacking);
            }
        });
        if let Some(progress) = progress {
            command = command.take().or(progress_ui(ui, progress));
        }
        command
    }

    fn lacking(&self, model: Option<&ConsoleModel>) -> Option<&'static str> {
        if model.is_none() {
            Some("There is no robot to export from")
        } else if self.parts.is_empty() {
            Some("Choose what to export")
        } else if self.folder.trim().is_empty() {
            Some("Name a folder, which is made where it is missing")
        } else {
            None
        }
    }

    fn part_ui(&mut self, ui: &mut Ui, part: ExportPart, model: Option<&ConsoleModel>) {
        let is_there = model.is_some_and(|model| part.is_in(model));
        let mut is_chosen = is_there && self.parts.contains(&part);
        let words = part_words(part);
        ui.add_enabled_ui(is_there, |ui| {
            ui.horizontal_wrapped(|ui| {
                let check = ui.checkbox(&mut is_chosen, words);
                let check = check.on_hover_text(format!("Write {}", part.files()));
                if check.clicked() {
                    if is_chosen {
                        self.parts.insert(part);
                    } else {
                        self.parts.remove(&part);
                    }
                }
                ui.label(RichText::new(part.files()).small().weak());
                let is_hidden = |layer| model.is_some_and(|model| !model.map().is_wanted(layer));
                if is_there && matches!(part, ExportPart::Layer(layer) if is_hidden(layer)) {
                    ui.label(RichText::new("hidden: fetched first").small());
                }
            });
        });
    }
}

fn part_words(part: ExportPart) -> &'static str {
    match part {
        ExportPart::Layer(layer) => layer_name(layer),
        ExportPart::Trajectory => "Trajectory",
        ExportPart::Shores => "Shores as outlines",
        ExportPart::Voxels => "Voxels",
    }
}

const GOES_ON: &str =
    "The export continues when this is closed. Ctrl+E shows it again, and Events reports its end.";

fn progress_ui(ui: &mut Ui, progress: &ExportProgress) -> Option<Command> {
    match &progress.ended {
        None => {
            ui.add(ProgressBar::new(progress.share()).text(doing(progress)));
            ui.label(RichText::new(GOES_ON).small().weak());
            None
        }
        Some(Ok(words)) => {
            // A folder may be longer than the dialog is wide.
            long_state_ui(ui, Tone::Good, words, 15.0);
            open_folder_ui(ui, progress)
        }
        Some(Err(why)) => {
            let title = if progress.files == 0 {
                "Nothing was exported"
            } else {
                "Not all was exported"
            };
            state_ui(ui, Tone::Warning, title, 15.0);
            ui.label(why);
            (progress.files > 0)
                .then(|| open_folder_ui(ui, progress))
                .flatten()
        }
    }
}

fn doing(progress: &ExportProgress) -> String {
    let [done, all] = progress.parts;
    let what = progress.current.map(part_words).unwrap_or_default();
    match progress.fetching {
        None => format!("{done} of {all}: {what}"),
        Some(fetching) => format!("{done} of {all}: {what}: {fetching}"),
    }
}

fn open_folder_ui(ui: &mut Ui, progress: &ExportProgress) -> Option<Command> {
    let button = ui.button("Open folder");
    let button = button.on_hover_text(progress.folder.display().to_string());
    if let Some(why) = &progress.unopened {
        let color = Tone::Warning.color(ui.visuals());
        ui.label(RichText::new(why).color(color));
    }
    button
        .clicked()
        .then(|| Command::OpenFolder(progress.folder.clone()))
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use protocol::layer::LayerId;
    use protocol::message::VoxelFile;

    use super::*;
    use crate::export::{ExportPart, FetchProgress};

    #[test]
    fn progress_bar_names_part_and_fetched_share() {
        let progress = ExportProgress {
            parts: [2, 5],
            current: Some(ExportPart::Layer(LayerId::Cost)),
            ..ExportProgress::default()
        };
        assert_eq!(doing(&progress), "2 of 5: Slope cost");
        let progress = ExportProgress {
            current: Some(ExportPart::Voxels),
            fetching: Some(FetchProgress::Voxels(
                VoxelFile::Points,
                [1_300_000, 40_000_000],
            )),
            ..progress
        };
        let words = "2 of 5: Voxels: points.ply, 1.3 of 40.0 MB fetched";
        assert_eq!(doing(&progress), words);
    }

    #[test]
    fn open_failure_is_shown_below_its_button() {
        let why = "No file manager on this computer. This one is /home/anna/maps/scout-2026-01-01";
        let progress = ExportProgress {
            folder: "/home/anna/maps/scout-2026-01-01".into(),
            files: 1,
            ended: Some(Ok("1 file".to_owned())),
            unopened: Some(why.to_owned()),
            ..ExportProgress::default()
        };
        let mut window = Harness::builder()
            .with_size(vec2(300.0, 200.0))
            .build_ui(move |ui| _ = super::progress_ui(ui, &progress));
        window.run_steps(2);
        let place = window.get_by_label(why).rect();
        assert!(place.right() <= 300.0, "{place}");
        assert!(place.top() >= window.get_by_label("Open folder").rect().bottom());
    }
}
