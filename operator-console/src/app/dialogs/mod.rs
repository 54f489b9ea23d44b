//! Dialogs over the window.

use eframe::egui::{Align2, Context, Window};
use export::ExportDialog;

use super::export_job::ExportProgress;
use crate::command::Command;
use crate::model::ConsoleModel;
use crate::settings::Settings;
use crate::shortcuts::{Sheet, sheet_ui};

mod export;

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

    /// Another robot is shown: the choice was for the last one.
    pub(super) fn close_export(&mut self) {
        self.export = None;
    }

    /// Closes the topmost dialog; returns whether one was open.
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
