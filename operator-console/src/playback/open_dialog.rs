//! Dialog to open a recording: a path with completion.

use std::path::{MAIN_SEPARATOR, Path, PathBuf};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::text_edit::TextEditState;
use eframe::egui::{
    Align2, Button, Context, EventFilter, InputState, Key, Modifiers, RichText, ScrollArea,
    TextEdit, Ui, Window,
};

use super::path_completion::{Completions, completions};
use crate::playback::{home, typed_path};

/// Height of the dialog without the list of paths, points.
const OTHERS: f32 = 224.0;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenDialog {
    is_open: bool,
    path: String,
    completions: Completions,
    problem: Option<String>,
    wants_focus: Option<Focus>,
}

/// Effect of the next typed character: it is appended, or replaces the text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Focus {
    AtEnd,
    OnAll,
}

impl OpenDialog {
    /// Opens the dialog with the recordings of `folder`, or with the last typed path if there are none.
    pub fn open(&mut self, folder: Option<PathBuf>) {
        if self.is_open {
            // The operator types there already.
            self.wants_focus = Some(Focus::AtEnd);
            return;
        }
        let begin = folder.and_then(|folder| as_typed(&folder, home().as_deref()));
        if let Some(begin) = begin
            && !completions(&begin).offered.is_empty()
        {
            self.path = begin;
        }
        self.ask(Focus::OnAll);
    }

    fn ask(&mut self, focus: Focus) {
        self.is_open = true;
        self.wants_focus = Some(focus);
        self.problem = None;
        self.completions = completions(&self.path);
    }

    pub fn refuse(&mut self, path: String, why: String) {
        self.path = path;
        self.ask(Focus::AtEnd);
        self.problem = Some(why);
    }

    pub fn close(&mut self) {
        self.is_open = false;
        self.problem = None;
    }

    /// Draws the dialog and takes dropped files; returns the recording to open.
    pub fn show(&mut self, ctx: &Context) -> Option<PathBuf> {
        let dropped = ctx.input(|input| {
            let file = input.raw.dropped_files.first();
            file.map(|file| file.path().to_owned())
        });
        if dropped.is_some() || !self.is_open {
            return dropped;
        }
        if ctx.input_mut(|input| input.consume_key(Modifiers::NONE, Key::Escape)) {
            self.close();
            return None;
        }
        let mut is_open = true;
        let shown = Window::new("Open a recording")
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
            .show(ctx, |ui| {
                ui.set_width(520.0_f32.min(ctx.content_rect().width() - 40.0));
                self.dialog_ui(ui)
            });
        if !is_open {
            self.close();
        }
        shown.and_then(|shown| shown.inner.flatten())
    }

    fn dialog_ui(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        let label =
            ui.label("MCAP, ROS 1 bag or CARMEN log. It can be dropped on the window, too.");
        let field = TextEdit::singleline(&mut self.path)
            .hint_text("Path of the recording")
            .desired_width(f32::INFINITY)
            // Tab completes.
            .event_filter(EventFilter {
                tab: true,
                ..EventFilter::default()
            });
        let field = ui.add(field).labelled_by(label.id);
        let field = field.on_hover_text("Tab completes the path");
        let is_tab = |input: &mut InputState| input.consume_key(Modifiers::NONE, Key::Tab);
        if field.has_focus() && ui.input_mut(is_tab) {
            self.complete();
        }
        if let Some(focus) = self.wants_focus.take() {
            field.request_focus();
            let end = CCursor::new(self.path.chars().count());
            let range = match focus {
                Focus::AtEnd => CCursorRange::one(end),
                Focus::OnAll => CCursorRange::two(CCursor::new(0), end),
            };
            let mut state = TextEditState::load(ui.ctx(), field.id).unwrap_or_default();
            state.cursor.set_char_range(Some(range));
            state.store(ui.ctx(), field.id);
        }
        if field.changed() {
            self.problem = None;
            self.completions = completions(&self.path);
        }
        let is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
        if let Some(problem) = &self.problem {
            ui.label(RichText::new(problem).color(ui.visuals().warn_fg_color));
        }
        let chosen = self.offered_ui(ui);
        let mut is_wanted = is_entered;
        ui.horizontal(|ui| {
            let path = self.path.trim();
            let open = Button::new("Open");
            let open = ui.add_enabled(!path.is_empty() && !is_folder(path), open);
            is_wanted |= open.on_hover_text("Open this recording (Enter)").clicked();
            if ui
                .button("Cancel")
                .on_hover_text("Close this window (Esc)")
                .clicked()
            {
                self.close();
            }
        });
        if let Some(chosen) = chosen {
            self.path.clone_from(&chosen);
            self.ask(Focus::AtEnd);
            return (!is_folder(&chosen)).then(|| typed_path(&chosen));
        }
        let path = self.path.trim();
        if is_wanted
            && let Some(only) = self.only_offered()
            && !typed_path(path).is_file()
        {
            return Some(typed_path(only));
        }
        if is_wanted && is_folder(path) {
            // Offer its content.
            self.wants_focus = Some(Focus::AtEnd);
            return None;
        }
        (is_wanted && !path.is_empty()).then(|| typed_path(path))
    }

    fn only_offered(&self) -> Option<&str> {
        match (&self.completions.offered[..], &self.completions.more) {
            ([only], None) if !is_folder(only) => Some(only),
            _ => None,
        }
    }

    fn complete(&mut self) {
        if let Some(common) = &self.completions.common
            && common.len() > self.path.len()
        {
            self.path.clone_from(common);
        }
        self.completions = completions(&self.path);
        self.wants_focus = Some(Focus::AtEnd);
    }

    fn offered_ui(&self, ui: &mut Ui) -> Option<String> {
        let mut chosen = None;
        let height = (ui.ctx().content_rect().height() - OTHERS).clamp(60.0, 220.0);
        ScrollArea::vertical().max_height(height).show(ui, |ui| {
            for path in &self.completions.offered {
                let offered = ui.selectable_label(false, path);
                let hint = "Open this recording, or list this folder";
                if offered.on_hover_text(hint).clicked() {
                    chosen = Some(path.clone());
                }
            }
        });
        if let Some(more) = &self.completions.more {
            ui.weak(more);
        }
        chosen
    }
}

fn is_folder(path: &str) -> bool {
    path.ends_with(MAIN_SEPARATOR)
}

/// `folder` as a typed path with a trailing separator, if it is valid UTF-8.
fn as_typed(folder: &Path, home: Option<&Path>) -> Option<String> {
    let below_home = home.and_then(|home| folder.strip_prefix(home).ok());
    let typed = below_home.map_or_else(
        || folder.to_owned(),
        |below_home| Path::new("~").join(below_home),
    );
    // Joining an empty path appends the separator.
    typed.join("").into_os_string().into_string().ok()
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::Arc;
    use std::time::Duration;

    use eframe::egui::{DroppedFile, vec2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    struct State {
        dialog: OpenDialog,
        opened: Vec<PathBuf>,
    }

    fn harness(dialog: OpenDialog) -> Harness<'static, State> {
        let state = State {
            dialog,
            opened: Vec::new(),
        };
        Harness::builder()
            .with_size(vec2(700.0, 500.0))
            .build_ui_state(
                |ui, state: &mut State| {
                    let ctx = ui.ctx().clone();
                    state.opened.extend(state.dialog.show(&ctx));
                },
                state,
            )
    }

    fn enter(harness: &mut Harness<'_, State>, text: &str) {
        harness.event(eframe::egui::Event::Text(text.to_owned()));
        harness.run_steps(3);
    }

    fn press(harness: &mut Harness<'_, State>, key: Key) {
        harness.key_press(key);
        harness.run_steps(3);
    }

    #[test]
    fn a_recording_is_found_by_its_beginning() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["rooms.mcap", "roof.mcap"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let mut harness = harness(OpenDialog::default());
        harness.run();
        assert!(harness.query_by_label("Open a recording").is_none());
        harness.state_mut().dialog.open(None);
        harness.run_steps(3);
        let typed = format!("{}/roo", folder.path().display());
        enter(&mut harness, &typed);
        let names = ["f", "ms"].map(|end| format!("{typed}{end}.mcap"));
        assert_eq!(harness.state().dialog.completions.offered, names);
        enter(&mut harness, "m");
        press(&mut harness, Key::Tab);
        assert_eq!(harness.state().dialog.path, format!("{typed}ms.mcap"));
        enter(&mut harness, "x");
        assert_eq!(harness.state().dialog.path, format!("{typed}ms.mcapx"));
        harness.key_press(Key::Backspace);
        press(&mut harness, Key::Enter);
        let opened = PathBuf::from(format!("{typed}ms.mcap"));
        assert_eq!(harness.state().opened, [opened]);
    }

    #[test]
    fn newest_recordings_are_offered_and_rest_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..12_u64 {
            let path = folder.path().join(format!("lake-{number:02}.mcap"));
            fs::write(&path, "").unwrap();
            let file = fs::File::options().append(true).open(&path).unwrap();
            let now = file.metadata().unwrap().modified().unwrap();
            let age = Duration::from_secs(100 - number);
            file.set_modified(now - age).unwrap();
        }
        let mut harness = harness(OpenDialog::default());
        let open = &mut harness.state_mut().dialog;
        open.open(Some(folder.path().to_owned()));
        harness.run_steps(3);
        harness.get_by_label_contains("lake-11.mcap");
        assert!(harness.query_by_label_contains("lake-00.mcap").is_none());
        harness.get_by_label("2 more recordings: type how a name begins");
    }

    #[test]
    fn typing_replaces_the_offered_folder() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("rooms.mcap");
        fs::write(&recording, "").unwrap();
        fs::write(folder.path().join("sea.mcap"), "").unwrap();
        let typed = as_typed(folder.path(), home().as_deref()).unwrap();
        let mut harness = harness(OpenDialog::default());
        let open = |harness: &mut Harness<'static, State>, folder: PathBuf| {
            harness.state_mut().dialog.close();
            harness.run_steps(2);
            harness.state_mut().dialog.open(Some(folder));
            harness.run_steps(3);
        };
        open(&mut harness, folder.path().to_owned());
        assert_eq!(harness.state().dialog.path, typed);
        let mut offered = harness.state().dialog.completions.offered.clone();
        offered.sort();
        let names = ["rooms", "sea"].map(|name| format!("{typed}{name}.mcap"));
        assert_eq!(offered, names);
        // A folder is offered, but no recording yet.
        press(&mut harness, Key::Enter);
        assert!(harness.state().opened.is_empty());
        enter(&mut harness, "ro");
        assert_eq!(harness.state().dialog.path, format!("{typed}ro"));

        open(&mut harness, folder.path().to_owned());
        enter(&mut harness, "/x");
        assert_eq!(harness.state().dialog.path, "/x");
        open(&mut harness, folder.path().join("gone"));
        assert_eq!(harness.state().dialog.path, "/x");

        open(&mut harness, folder.path().to_owned());
        harness.get_by_label(&format!("{typed}rooms.mcap")).click();
        harness.run_steps(3);
        assert_eq!(harness.state().opened, [recording]);
    }

    #[test]
    fn return_opens_the_only_offered_recording() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("rooms.mcap");
        fs::write(&recording, "").unwrap();
        let mut harness = harness(OpenDialog::default());
        let dialog = &mut harness.state_mut().dialog;
        dialog.open(Some(folder.path().to_owned()));
        harness.run_steps(3);
        press(&mut harness, Key::Enter);
        assert_eq!(harness.state().opened, [recording]);
    }

    #[test]
    fn a_folder_is_shown_as_it_would_be_typed() {
        let check = |folder: &str, expected: &str| {
            let home = Some(Path::new("/home/anna"));
            let shown = as_typed(Path::new(folder), home).unwrap();
            assert_eq!(Path::new(&shown), Path::new(expected), "{folder}");
            assert!(is_folder(&shown), "{shown}");
        };
        check("/home/anna/maps", "~/maps/");
        check("/home/anna/maps/", "~/maps/");
        check("/home/anna", "~/");
        check("/home/annabel/maps", "/home/annabel/maps/");
        check("/", "/");
    }

    #[test]
    fn recording_in_home_folder_is_opened() {
        let mut dialog = OpenDialog::default();
        dialog.refuse("~/no such day.mcap".to_owned(), "gone".to_owned());
        let mut harness = harness(dialog);
        harness.run_steps(3);
        press(&mut harness, Key::Enter);
        let home = crate::playback::home().unwrap();
        assert_eq!(harness.state().opened, [home.join("no such day.mcap")]);
    }

    #[derive(Debug)]
    struct Dropped(PathBuf);

    impl DroppedFile for Dropped {
        fn path(&self) -> &Path {
            &self.0
        }

        fn bytes(&self) -> Result<Vec<u8>, String> {
            Err("nobody reads it here".to_owned())
        }
    }

    #[test]
    fn dropped_recording_is_opened() {
        for is_open in [false, true] {
            let mut dialog = OpenDialog::default();
            if is_open {
                dialog.open(None);
            }
            let mut harness = harness(dialog);
            harness.run_steps(2);
            let file = Dropped(PathBuf::from("rooms.mcap"));
            harness.input_mut().dropped_files.push(Arc::new(file));
            harness.run_steps(2);
            assert_eq!(harness.state().opened, [PathBuf::from("rooms.mcap")]);
        }
    }

    #[test]
    fn failed_path_is_shown_with_reason() {
        let mut dialog = OpenDialog::default();
        dialog.refuse(
            "notes.txt".to_owned(),
            "notes.txt: not a recording".to_owned(),
        );
        let mut harness = harness(dialog);
        harness.run_steps(3);
        harness.get_by_label("notes.txt: not a recording");
        harness.get_by_label("Cancel").click();
        harness.run_steps(3);
        assert!(harness.query_by_label("Open a recording").is_none());
        assert!(harness.state().opened.is_empty());
    }
}
