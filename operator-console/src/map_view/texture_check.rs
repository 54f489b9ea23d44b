//! Compares textures on the graphics card with the map, to find uploads that were lost.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use eframe::egui::{Color32, ColorImage, PaintCallback, Rect, Shape, TextureId};
use eframe::egui_glow::{CallbackFn, Painter};
use eframe::glow::{self, HasContext as _};
use measurement::time::Monotonic;
use network::clock;
use protocol::layer::LayerId;

use super::chunks::ChunkKey;
use crate::lock;

/// From one check to the next. A check reads one tile of one chunk.
const PERIOD: Duration = Duration::from_millis(250);
/// From one report of repairs to the next.
const REPORT_PERIOD: Duration = Duration::from_mins(1);

/// After so many textures in a row that cannot be read, the graphics driver can read none.
const UNREADABLE_LIMIT: u32 = 16;

/// What a tile of a chunk must look like.
pub(super) struct Sample {
    pub(super) layer: LayerId,
    pub(super) key: ChunkKey,
    pub(super) texture: TextureId,
    /// Of the tile in the texture.
    pub(super) texel: [usize; 2],
    pub(super) expected: ColorImage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reading {
    Equal,
    /// The texture is missing or has other texels.
    Different,
    /// The texture never got its size, as its first upload was lost, or the graphics driver cannot read textures.
    Unreadable,
}

#[derive(Default)]
pub(super) struct TextureCheck {
    due: Monotonic,
    /// For a picture that waits for its checks: a check in each frame.
    pub(super) is_hurried: bool,
    /// Checks so far.
    number: u64,
    /// Checks since the last one that found a difference.
    equal: u64,
    /// The checks after which each visible chunk was compared.
    pub(super) round: u64,
    asked: Option<(LayerId, ChunkKey, TextureId)>,
    reading: Arc<Mutex<Option<Reading>>>,
    /// In a row.
    unreadable: u32,
    /// Chunks that were drawn again, as their textures were not what was uploaded.
    pub(super) repairs: u64,
    reported: u64,
    report_due: Monotonic,
}

impl TextureCheck {
    /// The number of the check that is due.
    pub(super) fn next(&mut self, now: Monotonic) -> Option<u64> {
        if self.is_unreadable() || now < self.due && !self.is_hurried {
            return None;
        }
        self.due = now + PERIOD;
        self.number += 1;
        Some(self.number)
    }

    /// Reads and compares the sample when the shape is painted, after the uploads of this frame.
    pub(super) fn request(&mut self, sample: Sample, place: Rect) -> Shape {
        self.asked = Some((sample.layer, sample.key, sample.texture));
        let reading = Arc::clone(&self.reading);
        let compare = move |painter: &Painter| {
            let is_equal = |texels: Vec<u8>| {
                let expected = sample.expected.pixels.iter();
                texels.chunks_exact(4).eq(expected.map(Color32::to_array))
            };
            let Some(texture) = painter.texture(sample.texture) else {
                return Reading::Different;
            };
            let texels = read_texels(painter, texture, sample.texel, sample.expected.size);
            match texels.map(is_equal) {
                None => Reading::Unreadable,
                Some(true) => Reading::Equal,
                Some(false) => Reading::Different,
            }
        };
        let callback = CallbackFn::new(move |_, painter| {
            let began = clock::now();
            *lock(&reading) = Some(compare(painter));
            let took_us = clock::elapsed(began).as_micros();
            tracing::trace!(took_us, "a tile was read back");
        });
        let callback = Arc::new(callback);
        PaintCallback {
            rect: place,
            callback,
        }
        .into()
    }

    /// Must be called if there is nothing to compare in the check that is due.
    pub(super) const fn pass(&mut self) {
        self.equal += 1;
    }

    /// Whether each visible chunk was compared since the last difference.
    pub(super) const fn is_round_equal(&self) -> bool {
        self.is_unreadable() || self.equal >= self.round
    }

    /// All repairs so far, if there are new ones to report.
    pub(super) fn take_report(&mut self, now: Monotonic) -> Option<u64> {
        if self.repairs == self.reported || now < self.report_due {
            return None;
        }
        self.reported = self.repairs;
        self.report_due = now + REPORT_PERIOD;
        Some(self.repairs)
    }

    /// The chunk whose texture turned out to differ.
    pub(super) fn take_different(&mut self) -> Option<(LayerId, ChunkKey, TextureId)> {
        let reading = lock(&self.reading).take()?;
        let asked = self.asked.take();
        self.unreadable = match reading {
            Reading::Unreadable => self.unreadable + 1,
            Reading::Equal | Reading::Different => 0,
        };
        if self.is_unreadable() {
            tracing::warn!(
                "The graphics driver cannot read textures: the picture of the map is not checked"
            );
        }
        let is_equal = reading == Reading::Equal;
        self.equal = if is_equal { self.equal + 1 } else { 0 };
        asked.filter(|_| !is_equal)
    }

    const fn is_unreadable(&self) -> bool {
        self.unreadable >= UNREADABLE_LIMIT
    }
}

/// RGBA of a rectangle of a texture, row by row.
#[expect(unsafe_code, reason = "OpenGL has no safe interface")]
fn read_texels(
    painter: &Painter,
    texture: glow::Texture,
    [x, y]: [usize; 2],
    [width, height]: [usize; 2],
) -> Option<Vec<u8>> {
    let gl = painter.gl();
    let mut texels = vec![0; 4 * width * height];
    // SAFETY: a paint callback runs with the context of this painter, which made the texture. The slice has the size of
    // the rectangle. The binding that egui expects is restored.
    unsafe {
        let framebuffer = gl.create_framebuffer().ok()?;
        gl.bind_framebuffer(glow::READ_FRAMEBUFFER, Some(framebuffer));
        gl.framebuffer_texture_2d(
            glow::READ_FRAMEBUFFER,
            glow::COLOR_ATTACHMENT0,
            glow::TEXTURE_2D,
            Some(texture),
            0,
        );
        let is_readable =
            gl.check_framebuffer_status(glow::READ_FRAMEBUFFER) == glow::FRAMEBUFFER_COMPLETE;
        if is_readable {
            let to = glow::PixelPackData::Slice(Some(&mut texels));
            let [x, y, width, height] =
                [x, y, width, height].map(|side| i32::try_from(side).unwrap_or_default());
            gl.read_pixels(x, y, width, height, glow::RGBA, glow::UNSIGNED_BYTE, to);
        }
        gl.bind_framebuffer(glow::READ_FRAMEBUFFER, painter.intermediate_fbo());
        gl.delete_framebuffer(framebuffer);
        is_readable.then_some(texels)
    }
}
