//! RGB pixels; whatever falls outside is clipped.

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
    pub(super) fn right(self) -> u32 {
        self.x + self.width
    }

    pub(super) fn bottom(self) -> u32 {
        self.y + self.height
    }

    /// What is within a frame of one pixel.
    pub(super) fn inside(self) -> Self {
        Self {
            x: self.x + 1,
            y: self.y + 1,
            width: self.width.saturating_sub(2),
            height: self.height.saturating_sub(2),
        }
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

    /// Rows from the top, three bytes a pixel.
    pub(super) fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    pub(super) fn fill(&mut self, rect: Rect, color: [u8; 3]) {
        self.fill_with(rect, |_, _| color);
    }

    /// Gives each pixel of `rect` its colour, by where it is on the canvas.
    pub(super) fn fill_with(&mut self, rect: Rect, color: impl Fn(u32, u32) -> [u8; 3]) {
        let right = rect.right().min(self.width);
        for y in rect.y..rect.bottom().min(self.height) {
            for x in rect.x..right {
                self.put(x, y, color(x, y));
            }
        }
    }

    /// Fills `rect` and draws a one-pixel line around its inside.
    pub(super) fn fill_framed(&mut self, rect: Rect, color: [u8; 3], frame: [u8; 3]) {
        self.fill(rect, frame);
        self.fill(rect.inside(), color);
    }

    /// Lays `color` over a pixel with the given coverage, 0 … 1.
    pub(super) fn blend(&mut self, x: u32, y: u32, color: [u8; 3], coverage: f32) {
        let Some(pixel) = self.pixel(x, y) else {
            return;
        };
        for (channel, over) in pixel.iter_mut().zip(color) {
            let under = f32::from(*channel);
            *channel = (under + (f32::from(over) - under) * coverage.clamp(0.0, 1.0)).round() as u8;
        }
    }

    fn put(&mut self, x: u32, y: u32, color: [u8; 3]) {
        if let Some(pixel) = self.pixel(x, y) {
            pixel.copy_from_slice(&color);
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
