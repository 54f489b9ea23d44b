//! Text in Ubuntu Light, the console's font.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

use super::canvas::Canvas;

/// The font, ready to draw.
pub(super) struct TextRenderer {
    /// `None` only if the embedded font were damaged, which a test excludes: then there is no text.
    font: Option<FontRef<'static>>,
}

impl TextRenderer {
    pub(super) fn new() -> Self {
        Self {
            font: FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).ok(),
        }
    }

    /// The width of one line of text, pixels.
    pub(super) fn width(&self, text: &str, size_px: f32) -> u32 {
        let (_, end) = self.layout(text, size_px);
        end.ceil() as u32
    }

    /// Draws one line of text of which `at` is the upper left corner.
    pub(super) fn draw(
        &self,
        canvas: &mut Canvas,
        at: (u32, u32),
        size_px: f32,
        color: [u8; 3],
        text: &str,
    ) {
        let Some(font) = &self.font else { return };
        let ascent = font.as_scaled(PxScale::from(size_px)).ascent().round();
        for mut glyph in self.layout(text, size_px).0 {
            glyph.position.x += at.0 as f32;
            glyph.position.y += at.1 as f32 + ascent;
            let Some(outlined) = font.outline_glyph(glyph) else {
                continue;
            };
            let corner = outlined.px_bounds().min;
            outlined.draw(|x, y, coverage| {
                let (x, y) = (corner.x + x as f32, corner.y + y as f32);
                if x >= 0.0 && y >= 0.0 {
                    // A light face on a light page looks thinner than its outline: thicken its edges.
                    canvas.blend(x as u32, y as u32, color, coverage.powf(0.75));
                }
            });
        }
    }

    /// `text` broken into lines of at most `width_px` where its words allow.
    pub(super) fn wrap(&self, text: &str, size_px: f32, width_px: u32) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if self.width(&format!("{line} {word}"), size_px) <= width_px => {
                    line.push(' ');
                    line.push_str(word);
                }
                Some(_) | None => lines.push(word.to_owned()),
            }
        }
        lines
    }

    /// Glyphs along a baseline from the origin, and where the line ends.
    fn layout(&self, text: &str, size_px: f32) -> (Vec<Glyph>, f32) {
        let Some(font) = &self.font else {
            return (Vec::new(), 0.0);
        };
        let scaled = font.as_scaled(PxScale::from(size_px));
        let mut glyphs: Vec<Glyph> = Vec::new();
        let mut end = 0.0;
        for character in text.chars() {
            let id = scaled.glyph_id(character);
            if let Some(before) = glyphs.last() {
                end += scaled.kern(before.id, id);
            }
            glyphs.push(id.with_scale_and_position(scaled.scale(), point(end, 0.0)));
            end += scaled.h_advance(id);
        }
        (glyphs, end)
    }
}

#[cfg(test)]
mod tests {
    use crate::layer::LayerId;

    use super::*;

    #[test]
    fn the_font_has_every_character_that_legends_use() {
        let font = TextRenderer::new().font.unwrap();
        let mut text = "—×0123456789.,kmµ".to_owned();
        for palette in LayerId::ALL.into_iter().flat_map(LayerId::palettes) {
            let legend = palette.legend();
            text += &legend.title;
            text.extend(legend.swatches.into_iter().map(|swatch| swatch.label));
            let ticks = legend.ramp.into_iter().flat_map(|ramp| ramp.ticks);
            text.extend(ticks.map(|tick| tick.label));
        }
        for character in text.chars() {
            assert_ne!(font.glyph_id(character).0, 0, "no glyph for {character:?}");
        }
    }

    #[test]
    fn lines_break_between_words() {
        let text_renderer = TextRenderer::new();
        let lines = text_renderer.wrap("height above ground plane (m)", 19.0, 150);
        assert_eq!(lines, ["height above", "ground plane (m)"]);
        assert_eq!(
            text_renderer.wrap("immeasurable", 19.0, 10),
            ["immeasurable"]
        );
    }
}
