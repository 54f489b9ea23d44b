//! Which program this is.

use eframe::egui::{Align2, Context, Window};

/// Draws it; `is_open` becomes false where it is closed.
pub(super) fn about_ui(ctx: &Context, is_open: &mut bool) {
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
