//! Where to export to, and what.

mod progress;

use eframe::egui::{
    Align2, Button, Context, Key, RichText, ScrollArea, TextEdit, Ui, Window, vec2,
};
use robot_edge::clock::wall_clock_label;
use std::collections::BTreeSet;

use crate::app::export_job::ExportProgress;
use crate::app::pictures;
use crate::command::{Command, ExportRequest};
use crate::export::ExportPart;
use crate::model::ConsoleModel;
use crate::panels::layers::layer_name;
use crate::typed_path::{absolute, typed_path};

/// Of the dialog, where the window is not narrower, points.
const WIDTH: f32 = 460.0;
/// What its frame takes of that.
const MARGIN: f32 = 40.0;
/// What its title and frame take of its height.
const TITLE: f32 = 80.0;

/// What is chosen.
pub(super) struct ExportDialog {
    folder: String,
    parts: BTreeSet<ExportPart>,
    has_keyboard: bool,
    /// How the export before ended: that was told.
    previous: Option<ExportProgress>,
}

impl ExportDialog {
    /// All that there is of the robot, to a folder named after it, or after the recording that it is.
    pub(super) fn new(
        model: &ConsoleModel,
        recording: Option<&str>,
        last: Option<&ExportProgress>,
    ) -> Self {
        let shown = pictures::name_for_files(model.robot(), recording);
        let name = pictures::stamped_name(Some(&shown), &wall_clock_label());
        let folder = pictures::documents().map_or_else(|| name.clone().into(), |at| at.join(&name));
        Self {
            folder: folder.display().to_string(),
            parts: ExportPart::all().filter(|part| part.is_in(model)).collect(),
            has_keyboard: false,
            previous: last.filter(|last| last.ended.is_some()).cloned(),
        }
    }

    /// Draws it; `opens_folder` is whether a finished export is shown, and `is_open` becomes false where it is closed.
    pub(super) fn show(
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
                // It grows with what it says, as far as the window goes.
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
            if is_running && ui.button("Cancel export").clicked() {
                command = Some(Command::CancelExport);
            }
            if let Some(lacking) = lacking.filter(|_| !is_running) {
                ui.label(lacking);
            }
        });
        if let Some(progress) = progress {
            command = command.take().or(progress::ui(ui, progress));
        }
        command
    }

    /// What has to be done before anything can be exported.
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
                if ui.checkbox(&mut is_chosen, words).clicked() {
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

pub(super) fn part_words(part: ExportPart) -> &'static str {
    match part {
        ExportPart::Layer(layer) => layer_name(layer),
        ExportPart::Trajectory => "Trajectory",
        ExportPart::Shores => "Shores as outlines",
        ExportPart::Voxels => "Voxels",
    }
}
