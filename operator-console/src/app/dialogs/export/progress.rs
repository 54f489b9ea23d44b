//! How far an export is, and how it ended.

use eframe::egui::{ProgressBar, RichText, Ui};

use super::part_words;
use crate::app::export_job::ExportProgress;
use crate::command::Command;
use crate::theme::{Tone, long_state_ui, state_ui};

const GOES_ON: &str =
    "It goes on when this is closed. Ctrl+E shows it again, and Events tells its end.";

/// Draws the bar, or how it ended.
pub(super) fn ui(ui: &mut Ui, progress: &ExportProgress) -> Option<Command> {
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

/// What is done just now.
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
    use crate::export::{ExportPart, Fetching};

    #[test]
    fn the_bar_says_what_is_written_and_how_much_is_fetched() {
        let progress = ExportProgress {
            parts: [2, 5],
            current: Some(ExportPart::Layer(LayerId::Cost)),
            ..ExportProgress::default()
        };
        assert_eq!(doing(&progress), "2 of 5: Slope cost");
        let progress = ExportProgress {
            current: Some(ExportPart::Voxels),
            fetching: Some(Fetching::Voxels(VoxelFile::Points, [1_300_000, 40_000_000])),
            ..progress
        };
        let words = "2 of 5: Voxels: points.ply, 1.3 of 40.0 MB fetched";
        assert_eq!(doing(&progress), words);
    }

    #[test]
    fn a_folder_that_could_not_be_opened_says_so_below_its_button() {
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
            .build_ui(move |ui| _ = super::ui(ui, &progress));
        window.run_steps(2);
        let place = window.get_by_label(why).rect();
        assert!(place.right() <= 300.0, "{place}");
        assert!(place.top() >= window.get_by_label("Open folder").rect().bottom());
    }
}
