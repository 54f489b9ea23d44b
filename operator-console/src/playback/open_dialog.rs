//! File > Open: a path, completed while it is typed.

use std::path::{MAIN_SEPARATOR, Path, PathBuf};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::text_edit::TextEditState;
use eframe::egui::{
    Align2, Button, Context, EventFilter, Id, InputState, Key, Modifiers, RichText, ScrollArea,
    TextEdit, Ui, Window,
};

use super::path_completion::{Completions, completions};
use crate::typed_path::{home, typed_path};

/// What the dialog has above and below the list of paths, points.
const OTHERS: f32 = 224.0;

/// The dialog, where it is open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenDialog {
    is_open: bool,
    path: String,
    completions: Completions,
    /// Why the path could not be opened.
    problem: Option<String>,
    wants_focus: Option<Focus>,
}

/// What the next letter that is typed does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Focus {
    /// It goes on behind the path.
    AtEnd,
    /// It replaces the path.
    OnAll,
}

impl OpenDialog {
    /// Asks for a recording, of those in `folder` first. Where there are none, it begins with what was typed last.
    pub fn open(&mut self, folder: Option<PathBuf>) {
        if self.is_open {
            // Somebody types there already.
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

    /// Says why a recording could not be opened, and asks for another.
    pub fn refuse(&mut self, path: String, why: String) {
        self.path = path;
        self.ask(Focus::AtEnd);
        self.problem = Some(why);
    }

    /// A recording was opened.
    pub fn close(&mut self) {
        self.is_open = false;
        self.problem = None;
    }

    /// Draws it where it is open, and takes files that are dropped on the window; the recording to open.
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
        if let Some(focus) = self.wants_focus.take() {
            field.request_focus();
            let end = CCursor::new(self.path.chars().count());
            select(
                ui,
                field.id,
                match focus {
                    Focus::AtEnd => CCursorRange::one(end),
                    Focus::OnAll => CCursorRange::two(CCursor::new(0), end),
                },
            );
        }
        let is_tab = |input: &mut InputState| input.consume_key(Modifiers::NONE, Key::Tab);
        if field.has_focus() && ui.input_mut(is_tab) {
            self.complete();
            let end = CCursor::new(self.path.chars().count());
            select(ui, field.id, CCursorRange::one(end));
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
            let names_one = !self.path.trim().is_empty() && !is_folder(self.path.trim());
            let open = ui.add_enabled(names_one, Button::new("Open"));
            is_wanted |= open.on_hover_text("Enter").clicked();
            if ui.button("Cancel").on_hover_text("Esc").clicked() {
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
            // What is in it is offered.
            self.wants_focus = Some(Focus::AtEnd);
            return None;
        }
        (is_wanted && !path.is_empty()).then(|| typed_path(path))
    }

    /// The recording that is meant where nothing else is offered.
    fn only_offered(&self) -> Option<&str> {
        match (&self.completions.offered[..], &self.completions.more) {
            ([only], None) if !is_folder(only) => Some(only),
            ([..], Some(_) | None) => None,
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
                if ui.selectable_label(false, path).clicked() {
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

/// What is typed next replaces what is in `range`.
fn select(ui: &Ui, field: Id, range: CCursorRange) {
    let mut state = TextEditState::load(ui.ctx(), field).unwrap_or_default();
    state.cursor.set_char_range(Some(range));
    state.store(ui.ctx(), field);
}

/// Whether a path that is typed or offered is one of a folder for sure.
fn is_folder(path: &str) -> bool {
    path.ends_with(MAIN_SEPARATOR)
}

/// `folder` as somebody would type it, who wants to see what is in it. `None` where nobody could.
fn as_typed(folder: &Path, home: Option<&Path>) -> Option<String> {
    let below_home = home.and_then(|home| folder.strip_prefix(home).ok());
    let typed = below_home.map_or_else(
        || folder.to_owned(),
        |below_home| Path::new("~").join(below_home),
    );
    // Nothing joined is the separator.
    typed.join("").into_os_string().into_string().ok()
}

#[cfg(test)]
mod tests;
