//! RGB canvas with clipping, and text in Ubuntu Light, the console's font.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

/// A picture in 8-bit sRGB.
pub(super) struct Canvas {
    width: u32,
    height: u32,
    rgb: Vec<u8>,
}

/// A rectangle of pixels.
#[derive(Clone, Copy)]
pub(super) struct Rect {
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) width: u32,
    pub(super) height: u32,
}

impl Rect {
    pub(super) const fn new(x: u32, y: u32, width: u32, height: u32) -> Self {
        Self {
            x,
            y,
            width,
            height,
        }
    }

    pub(super) fn right(self) -> u32 {
        self.x + self.width
    }

    pub(super) fn bottom(self) -> u32 {
        self.y + self.height
    }

    pub(super) fn contains(self, other: Self) -> bool {
        other.x >= self.x
            && other.y >= self.y
            && other.right() <= self.right()
            && other.bottom() <= self.bottom()
    }

    pub(super) fn intersects(self, other: Self) -> bool {
        self.x < other.right()
            && other.x < self.right()
            && self.y < other.bottom()
            && other.y < self.bottom()
    }

    /// The rectangle without a frame of one pixel.
    pub(super) fn inside(self) -> Self {
        let (width, height) = (self.width.saturating_sub(2), self.height.saturating_sub(2));
        Self::new(self.x + 1, self.y + 1, width, height)
    }
}

impl Canvas {
    pub(super) fn new(width: u32, height: u32, color: [u8; 3]) -> Self {
        let pixels = width as usize * height as usize;
        Self {
            width,
            height,
            rgb: color.repeat(pixels),
        }
    }

    pub(super) fn width(&self) -> u32 {
        self.width
    }

    pub(super) fn height(&self) -> u32 {
        self.height
    }

    /// Rows from the top, three bytes per pixel.
    pub(super) fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    pub(super) fn fill(&mut self, rect: Rect, color: [u8; 3]) {
        self.fill_with(rect, |_, _| color);
    }

    /// Sets each pixel of `rect` to `color` of its position.
    pub(super) fn fill_with(&mut self, rect: Rect, color: impl Fn(u32, u32) -> [u8; 3]) {
        let right = rect.right().min(self.width);
        for y in rect.y..rect.bottom().min(self.height) {
            for x in rect.x..right {
                if let Some(pixel) = self.pixel(x, y) {
                    pixel.copy_from_slice(&color(x, y));
                }
            }
        }
    }

    /// Draws a line of squares of `width` pixels.
    pub(super) fn line(&mut self, from: (u32, u32), to: (u32, u32), width: u32, color: [u8; 3]) {
        let steps = from.0.abs_diff(to.0).max(from.1.abs_diff(to.1)).max(1);
        for step in 0..=steps {
            let along = |from: u32, to: u32| {
                let (from, to) = (f64::from(from), f64::from(to));
                (from + (to - from) * f64::from(step) / f64::from(steps)).round() as u32
            };
            let [x, y] = [along(from.0, to.0), along(from.1, to.1)];
            let [x, y] = [x, y].map(|middle| middle.saturating_sub((width - 1) / 2));
            self.fill(Rect::new(x, y, width, width), color);
        }
    }

    /// Blends `color` over a pixel with the given coverage, 0 … 1.
    pub(super) fn blend(&mut self, x: u32, y: u32, color: [u8; 3], coverage: f32) {
        let Some(pixel) = self.pixel(x, y) else {
            return;
        };
        for (channel, over) in pixel.iter_mut().zip(color) {
            let under = f32::from(*channel);
            *channel = (under + (f32::from(over) - under) * coverage.clamp(0.0, 1.0)).round() as u8;
        }
    }

    fn pixel(&mut self, x: u32, y: u32) -> Option<&mut [u8]> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let start = 3 * (y as usize * self.width as usize + x as usize);
        self.rgb.get_mut(start..start + 3)
    }
}

/// Draws text, and scales it and all lengths of the page, so that large pictures stay legible.
pub(super) struct TextRenderer {
    /// Pixels of a length of 1.
    scale: u32,
    /// `None` only if the embedded font were damaged, which a test excludes; then no text is drawn.
    font: Option<FontRef<'static>>,
}

impl TextRenderer {
    pub(super) fn new(scale: u32) -> Self {
        Self {
            scale,
            font: FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).ok(),
        }
    }

    /// A length of the page, pixels.
    pub(super) const fn px(&self, length: u32) -> u32 {
        length * self.scale
    }

    /// Width of one line of text, pixels.
    pub(super) fn width(&self, text: &str, size_px: f32) -> u32 {
        let (_, end) = self.layout(text, size_px);
        end.ceil() as u32
    }

    /// Draws one line of text; `at` is its upper left corner.
    pub(super) fn draw(
        &self,
        canvas: &mut Canvas,
        at: (u32, u32),
        size_px: f32,
        color: [u8; 3],
        text: &str,
    ) {
        let Some(font) = &self.font else { return };
        let scaled_px = size_px * self.scale as f32;
        let ascent = font.as_scaled(PxScale::from(scaled_px)).ascent().round();
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
                    // Thickens the edges: a light face on a light page looks thinner than its
                    // outline.
                    canvas.blend(x as u32, y as u32, color, coverage.powf(0.75));
                }
            });
        }
    }

    /// Breaks `text` at spaces into lines of at most `width_px`.
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

    /// Glyphs along a baseline from the origin, and the width of the line.
    fn layout(&self, text: &str, size_px: f32) -> (Vec<Glyph>, f32) {
        let Some(font) = &self.font else {
            return (Vec::new(), 0.0);
        };
        let scaled = font.as_scaled(PxScale::from(size_px * self.scale as f32));
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
        let font = TextRenderer::new(1).font.unwrap();
        let mut text = "—×0123456789.,kmµ-:".to_owned();
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
        let text_renderer = TextRenderer::new(1);
        let lines = text_renderer.wrap("height above ground plane (m)", 19.0, 150);
        assert_eq!(lines, ["height above", "ground plane (m)"]);
        assert_eq!(
            text_renderer.wrap("immeasurable", 19.0, 10),
            ["immeasurable"]
        );
    }
}
