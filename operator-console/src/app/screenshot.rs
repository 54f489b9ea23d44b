//! Screenshots of the window.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use eframe::egui::{ColorImage, Context, ScreenshotCallback, ViewportCommand};
use measurement::time::Monotonic;
use network::clock;

use crate::lock;

/// A window that has not delivered an image by then never will.
const PATIENCE: Duration = Duration::from_secs(10);

/// The thread that saves the image; `None` until the window has delivered one.
pub type ScreenshotOutcome = Arc<Mutex<Option<JoinHandle<anyhow::Result<()>>>>>;

pub struct Screenshot {
    path: PathBuf,
    due: Monotonic,
    asked: Option<Monotonic>,
    outcome: ScreenshotOutcome,
}

impl Screenshot {
    pub fn new(path: PathBuf, after: Duration, outcome: ScreenshotOutcome) -> Self {
        Self {
            path,
            due: clock::now() + after,
            asked: None,
            outcome,
        }
    }

    pub(super) fn is_due(&self, now: Monotonic) -> bool {
        now >= self.due
    }

    /// Must be called every frame, with the time of the last one that showed all of the map.
    pub(super) fn step(&mut self, ctx: &Context, drawn: Monotonic, now: Monotonic) {
        if let Some(asked) = self.asked {
            let is_over = lock(&self.outcome)
                .as_ref()
                .map_or(now.since(asked) > PATIENCE, JoinHandle::is_finished);
            if is_over {
                ctx.send_viewport_cmd(ViewportCommand::Close);
            }
            ctx.request_repaint_after(Duration::from_millis(20));
            return;
        }
        let rest = self.due.since(now);
        if !rest.is_zero() {
            ctx.request_repaint_after(rest);
            return;
        }
        // A covered window draws nothing, so what it would show first is old or incomplete.
        if drawn <= self.due && now.since(self.due) < PATIENCE {
            ctx.send_viewport_cmd(ViewportCommand::RequestPaintWhileHidden);
            ctx.request_repaint();
            return;
        }
        if drawn <= self.due {
            tracing::warn!(
                "The picture does not show all of the map: it was not drawn within 10 s"
            );
        }
        self.asked = Some(now);
        request(ctx, self.path.clone(), Arc::clone(&self.outcome), |path| {
            File::create(path)
        });
    }
}

/// The result after the window is closed. Waits until the file is written.
pub fn result_of(outcome: &ScreenshotOutcome) -> anyhow::Result<()> {
    let saving = lock(outcome).take();
    saving.map_or_else(
        || {
            Err(anyhow!(
                "no picture was taken: the window was closed before, or gave none"
            ))
        },
        join,
    )
}

/// The result if the file is written.
pub(super) fn take_result(outcome: &ScreenshotOutcome) -> Option<anyhow::Result<()>> {
    let saving = lock(outcome).take_if(|saving| saving.is_finished());
    saving.map(join)
}

fn join(saving: JoinHandle<anyhow::Result<()>>) -> anyhow::Result<()> {
    saving
        .join()
        .unwrap_or_else(|_panic| Err(anyhow!("the picture was not saved")))
}

/// Existing files are not replaced.
pub(super) fn take(ctx: &Context, path: PathBuf, outcome: ScreenshotOutcome) {
    request(ctx, path, outcome, |path| {
        std::fs::create_dir_all(path.parent().unwrap_or(Path::new("")))?;
        File::create_new(path)
    });
}

/// Saves the next frame in another thread: encoding would delay the teleop client.
fn request(
    ctx: &Context,
    path: PathBuf,
    outcome: ScreenshotOutcome,
    create: impl FnOnce(&Path) -> io::Result<File> + Send + Sync + 'static,
) {
    let callback = ScreenshotCallback::new(move |image| {
        let saving = thread::spawn(move || {
            create(&path)
                .map_err(anyhow::Error::from)
                .and_then(|file| save(file, &image))
                .with_context(|| format!("the picture was not saved to {}", path.display()))
        });
        *lock(&outcome) = Some(saving);
    });
    ctx.send_viewport_cmd(ViewportCommand::Screenshot(callback));
    ctx.request_repaint();
}

fn save(file: File, image: &ColorImage) -> anyhow::Result<()> {
    let file = BufWriter::new(file);
    let mut encoder = png::Encoder::new(file, image.width() as u32, image.height() as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    let rgb: Vec<u8> = image
        .pixels
        .iter()
        .flat_map(|pixel| [pixel.r(), pixel.g(), pixel.b()])
        .collect();
    writer.write_image_data(&rgb)?;
    writer.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use eframe::egui::Color32;

    use super::*;

    #[test]
    fn screenshot_is_saved_or_fails_with_reason() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("window.png");
        let mut image = ColorImage::filled([3, 2], Color32::BLUE);
        image.pixels[4] = Color32::RED;
        save(File::create(&path).unwrap(), &image).unwrap();
        let decoder = png::Decoder::new(std::io::BufReader::new(File::open(&path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgb).unwrap();
        assert_eq!((reader.info().width, reader.info().height), (3, 2));
        assert_eq!(rgb[9..18], [0, 0, 255, 255, 0, 0, 0, 0, 255]);

        // A read-only file.
        let file = File::open(&path).unwrap();
        assert!(save(file, &image).is_err());
        let outcome = ScreenshotOutcome::default();
        assert!(result_of(&outcome).is_err(), "the window was closed");

        // The window was closed while the file was written.
        let slow = thread::spawn(|| {
            thread::sleep(Duration::from_millis(50));
            Ok(())
        });
        *lock(&outcome) = Some(slow);
        assert!(take_result(&outcome).is_none());
        assert!(result_of(&outcome).is_ok());
    }
}
