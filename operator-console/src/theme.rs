//! Colours, sizes and state marks, legible in light and dark themes and for colour-blind operators. A state always
//! has a shape and a text besides its colour.

use eframe::egui::{
    Color32, Context, CornerRadius, FontFamily, FontId, Label, Painter, Pos2, Response, RichText,
    Sense, Shape, Stroke, TextStyle, Theme, Ui, Visuals, pos2, vec2,
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Good,
    /// Ring: not yet.
    Waiting,
    /// Triangle.
    Warning,
}

/// Sets sizes and colours of both themes. The system selects the theme.
pub fn set(ctx: &Context) {
    for theme in [Theme::Dark, Theme::Light] {
        ctx.style_mut_of(theme, |style| {
            let size = |style: &TextStyle| match style {
                TextStyle::Small => 13.0,
                TextStyle::Heading => 20.0,
                TextStyle::Body | TextStyle::Monospace | TextStyle::Button | TextStyle::Name(_) => {
                    15.0
                }
            };
            for (name, font) in &mut style.text_styles {
                *font = FontId::new(size(name), font.family.clone());
            }
            style.spacing.item_spacing = vec2(8.0, 6.0);
            style.spacing.button_padding = vec2(8.0, 4.0);
            style.spacing.interact_size.y = 24.0;
            style.interaction.selectable_labels = false;
            style.visuals = visuals(theme);
        });
    }
}

fn visuals(theme: Theme) -> Visuals {
    let mut visuals = theme.default_visuals();
    let (panel, ink, well) = match theme {
        Theme::Dark => (0x1b_1e_23, 0xe4_e7_eb, 0x12_14_18),
        Theme::Light => (0xf6_f7_f9, 0x1a_1d_22, 0xff_ff_ff),
    };
    visuals.panel_fill = rgb(panel);
    visuals.window_fill = rgb(panel);
    visuals.extreme_bg_color = rgb(well);
    visuals.override_text_color = Some(rgb(ink));
    visuals.selection.bg_fill = match theme {
        Theme::Dark => rgb(0x0b_5c_8f),
        Theme::Light => rgb(0xa9_d5_f0),
    };
    visuals.selection.stroke = Stroke::new(1.0, rgb(ink));
    let rounded = CornerRadius::same(4);
    for widget in [
        &mut visuals.widgets.inactive,
        &mut visuals.widgets.hovered,
        &mut visuals.widgets.active,
        &mut visuals.widgets.open,
    ] {
        widget.corner_radius = rounded;
        widget.expansion = 0.0;
    }
    visuals
}

pub(crate) const fn rgb(hex: u32) -> Color32 {
    let [_, red, green, blue] = hex.to_be_bytes();
    Color32::from_rgb(red, green, blue)
}

/// Bluish, so that it differs from the greys of the occupancy map, and light enough for black walls.
pub const fn ground(visuals: &Visuals) -> Color32 {
    if visuals.dark_mode {
        rgb(0x74_84_98)
    } else {
        rgb(0xb4_c0_ce)
    }
}

pub fn card(visuals: &Visuals) -> Color32 {
    visuals.panel_fill.gamma_multiply(0.93)
}

// Marks on the map. Red is for danger only: no mark is red.
pub const VEHICLE: Color32 = rgb(0x00_72_b2);
/// Vehicle and path of an old position.
pub const VEHICLE_STALE: Color32 = rgb(0x5a_5f_66);
pub const PATH: Color32 = rgb(0xa0_40_c0);
/// Closures of loops.
pub const CLOSURE: Color32 = rgb(0x00_74_55);
pub const SCAN: Color32 = rgb(0x00_e5_ff);
pub const FIELD_OF_VIEW: Color32 = rgb(0x10_14_18);
/// The collision monitor: stopping distance, and the obstacle that limits the vehicle.
pub const MONITOR: Color32 = rgb(0xf0_a8_20);
pub const SELECTION: Color32 = rgb(0xff_ff_ff);
/// Rims of dark and of light marks, for contrast on every layer.
pub const RIMS: [Color32; 2] = [rgb(0xff_ff_ff), rgb(0x10_14_18)];
/// Drawn over an outdated map: halves its colours.
pub const STALE_OVERLAY: Color32 = Color32::from_rgba_premultiplied(0x38, 0x38, 0x38, 0x80);
pub const BANNER: [Color32; 2] = [rgb(0xf0_a8_20), rgb(0x1a_12_00)];

pub const DANGER: [Color32; 2] = [rgb(0xb3_1b_1b), rgb(0xff_ff_ff)];

impl Tone {
    /// Colour of marks and texts (Okabe and Ito; lighter in the dark theme).
    pub const fn color(self, visuals: &Visuals) -> Color32 {
        match (self, visuals.dark_mode) {
            (Self::Good, true) => rgb(0x2f_c4_97),
            (Self::Good, false) => rgb(0x00_74_55),
            (Self::Waiting, true) => rgb(0x8c_c8_f0),
            (Self::Waiting, false) => rgb(0x00_5d_92),
            (Self::Warning, true) => rgb(0xff_b0_3a),
            (Self::Warning, false) => rgb(0xa8_48_00),
        }
    }

    fn paint(self, painter: &Painter, at: Pos2, radius: f32, color: Color32) {
        match self {
            Self::Good => {
                painter.circle_filled(at, radius, color);
            }
            Self::Waiting => {
                painter.circle_stroke(at, radius - 1.0, Stroke::new(2.0, color));
            }
            Self::Warning => {
                let corners = [(0.0, -1.1), (1.1, 0.9), (-1.1, 0.9)]
                    .map(|(x, y)| at + vec2(x, y) * radius)
                    .to_vec();
                painter.add(Shape::convex_polygon(corners, color, Stroke::NONE));
            }
        }
    }
}

pub fn state_ui(ui: &mut Ui, tone: Tone, word: &str, size: f32) {
    marked_ui(ui, tone, word, size, Label::new);
}

pub fn long_state_ui(ui: &mut Ui, tone: Tone, words: &str, size: f32) {
    marked_ui(ui, tone, words, size, |words| Label::new(words).wrap());
}

pub fn short_state_ui(ui: &mut Ui, tone: Tone, words: &str, size: f32) -> Response {
    marked_ui(ui, tone, words, size, |words| Label::new(words).truncate())
}

fn marked_ui(
    ui: &mut Ui,
    tone: Tone,
    words: &str,
    size: f32,
    label: impl FnOnce(RichText) -> Label,
) -> Response {
    let shown = ui.horizontal(|ui| {
        let color = tone.color(ui.visuals());
        let (mark, beside) = ui.allocate_exact_size(vec2(0.8 * size, size), Sense::hover());
        let font = FontId::new(size, FontFamily::Proportional);
        let text = ui.add(label(RichText::new(words).font(font).color(color)));
        let middle = pos2(mark.center().x, text.rect.center().y);
        tone.paint(ui.painter(), middle, 0.36 * size, color);
        // The mark has the hover text, too.
        text.union(beside)
    });
    shown.inner
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color_vision::ColorVision;

    fn contrast(a: Color32, b: Color32) -> f64 {
        ColorVision::Normal.contrast(a, b)
    }

    #[test]
    fn texts_are_legible_in_both_themes() {
        for theme in [Theme::Dark, Theme::Light] {
            let visuals = visuals(theme);
            let paper = visuals.panel_fill;
            assert!(contrast(visuals.text_color(), paper) > 10.0);
            for tone in [Tone::Good, Tone::Waiting, Tone::Warning] {
                let ratio = contrast(tone.color(&visuals), paper);
                assert!(ratio > 4.5, "{tone:?} in {theme:?}: {ratio}");
            }
            let wall = contrast(Color32::BLACK, ground(&visuals));
            let free = contrast(Color32::WHITE, ground(&visuals));
            assert!(wall > 4.5 && free > 1.6, "{theme:?}: {wall} {free}");
        }
        assert!(contrast(BANNER[0], BANNER[1]) > 7.0);
        assert!(contrast(DANGER[0], DANGER[1]) > 6.0);
    }
}
