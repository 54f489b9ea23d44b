//! What lies over the window when it is asked for.

mod about;
mod export;

use eframe::egui::Context;

use super::export_job::ExportProgress;
use crate::command::Command;
use crate::model::ConsoleModel;
use crate::settings::Settings;
use crate::shortcuts::Sheet;

use export::ExportDialog;

/// The dialogs, open or not.
pub(super) struct Dialogs {
    pub(super) sheet: Sheet,
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
    /// None is open.
    pub(super) const fn of(settings: &Settings) -> Self {
        Self {
            sheet: Sheet::CLOSED,
            is_about_open: false,
            export: None,
            opens_exports: settings.opens_exports,
        }
    }

    /// Writes what is to be kept into `settings`.
    pub(super) const fn keep(&self, settings: &mut Settings) {
        settings.opens_exports = self.opens_exports;
    }

    pub(super) const fn show_about(&mut self) {
        self.is_about_open = true;
    }

    /// `recording`: the name of the file, where that is what is shown.
    pub(super) fn show_export(
        &mut self,
        model: &ConsoleModel,
        recording: Option<&str>,
        last: Option<&ExportProgress>,
    ) {
        self.export
            .get_or_insert_with(|| ExportDialog::new(model, recording, last));
    }

    /// Something else is shown: what was chosen was not meant for that.
    pub(super) fn close_export(&mut self) {
        self.export = None;
    }

    /// Closes the one in front; whether there was one.
    pub(super) fn close_one(&mut self) -> bool {
        if self.export.take().is_some() {
            return true;
        }
        std::mem::take(&mut self.is_about_open) || self.sheet.close()
    }

    /// Draws those that are open.
    pub(super) fn show(
        &mut self,
        ctx: &Context,
        model: Option<&ConsoleModel>,
        progress: Option<&ExportProgress>,
    ) -> Option<Command> {
        self.sheet.show(ctx);
        if self.is_about_open {
            about::about_ui(ctx, &mut self.is_about_open);
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
