//! What the window says while a file is held over it.

use std::path::Path;

use eframe::egui::{
    Align2, Area, Context, Frame, HoveredFile, Id, Label, Order, RichText, TextWrapMode,
};

/// Says what happens to files that are dropped now; nothing where none is held over the window.
pub fn drop_hint_ui(ctx: &Context) {
    let Some(words) = ctx.input(|input| words(&input.raw.hovered_files)) else {
        return;
    };
    let width = 520.0_f32.min(ctx.content_rect().width() - 40.0);
    Area::new(Id::unique("drop hint"))
        .order(Order::Tooltip)
        .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
        .interactable(false)
        .show(ctx, |ui| {
            Frame::popup(ui.style()).inner_margin(20).show(ui, |ui| {
                ui.set_max_width(width);
                let label = Label::new(RichText::new(words).heading());
                ui.add(label.wrap_mode(TextWrapMode::Wrap));
            });
        });
}

/// Of several files only the first is opened.
fn words(files: &[HoveredFile]) -> Option<String> {
    let path = files.first()?.path.as_deref();
    let name = path.and_then(Path::file_name);
    let name = name.map_or_else(|| "it".into(), |name| name.to_string_lossy());
    Some(match files.len() {
        1 => format!("Drop to open {name}"),
        count => format!("Drop to open {name}, the first of {count} files"),
    })
}

#[cfg(test)]
mod tests {
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    fn held(path: &str) -> HoveredFile {
        HoveredFile {
            path: Some(path.into()),
            ..HoveredFile::default()
        }
    }

    #[test]
    fn what_is_held_over_the_window_is_named_until_it_is_gone() {
        let mut harness = Harness::builder()
            .with_size(vec2(700.0, 500.0))
            .build_ui(|ui| drop_hint_ui(ui.ctx()));
        harness.run();
        assert!(harness.query_by_label_contains("Drop").is_none());
        harness.input_mut().hovered_files = vec![held("/home/anna/rooms.mcap")];
        harness.run_steps(2);
        harness.get_by_label("Drop to open rooms.mcap");
        let files = ["/a/yard.bag", "/a/rooms.mcap"].map(held);
        harness.input_mut().hovered_files = files.to_vec();
        harness.run_steps(2);
        harness.get_by_label("Drop to open yard.bag, the first of 2 files");
        harness.input_mut().hovered_files.clear();
        harness.run_steps(2);
        assert!(harness.query_by_label_contains("Drop").is_none());
    }

    #[test]
    fn a_file_without_a_name_can_be_dropped_too() {
        assert_eq!(words(&[]), None);
        let nameless = [HoveredFile::default()];
        assert_eq!(words(&nameless).as_deref(), Some("Drop to open it"));
    }
}
