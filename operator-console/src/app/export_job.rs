//! An export on its way, on a thread of its own: the window goes on, and drives.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use anyhow::Error;
use protocol::message::VoxelFile;
use robot_edge::clock::Monotonic;

use super::watch::Note;
use crate::command::ExportWish;
use crate::event_log::Severity;
use crate::export::{ExportPart, Snapshot, export_parts};
use crate::link::ModelHandle;
use crate::locks::lock;
use crate::model::VoxelsProgress;
use crate::playback::in_words;

/// How far an export is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportProgress {
    /// Where it goes.
    pub folder: PathBuf,
    /// Parts that are done, of how many.
    pub parts: [usize; 2],
    /// The part that is being fetched or written.
    pub current: Option<ExportPart>,
    /// The file that is being fetched from the robot: bytes of it that came, of how many.
    pub fetched: Option<(VoxelFile, [u64; 2])>,
    /// Files that are written.
    pub files: usize,
    /// How it ended: with what, in words.
    pub ended: Option<Result<String, String>>,
}

impl ExportProgress {
    /// How much of all is done, 0 … 1. What is being fetched counts as far as it came.
    pub fn share(&self) -> f32 {
        let [done, all] = self.parts;
        let of_part = self.fetched.map_or(0.0, |(file, [fetched, of])| {
            let before = match file {
                VoxelFile::Tree => 0.0,
                VoxelFile::Points => 1.0,
            };
            (before + fetched as f32 / of.max(1) as f32) / VoxelFile::ALL.len() as f32
        });
        (done as f32 + of_part) / all.max(1) as f32
    }
}

/// How an export ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ExportEnd {
    /// For the log.
    pub(super) note: Note,
    /// The folder, where all is in it and the operator wants to see that.
    pub(super) folder: Option<PathBuf>,
}

/// Between two looks at what is being fetched.
const LOOK: Duration = Duration::from_millis(50);
/// A robot that is gone, or another that was chosen meanwhile, is not waited for any longer.
const PATIENCE: Duration = Duration::from_mins(1);

/// An export. Dropping it leaves it.
pub(super) struct ExportJob {
    progress: Arc<Mutex<ExportProgress>>,
    is_cancelled: Arc<AtomicBool>,
    opens_folder: bool,
    /// Whether its end was taken, whichever robot is shown by then.
    is_told: bool,
}

impl ExportJob {
    /// Begins to write what `model` holds. `wake` is called when there is something new to tell.
    pub(super) fn start(
        wish: ExportWish,
        model: ModelHandle,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let progress = Arc::new(Mutex::new(ExportProgress {
            folder: wish.folder.clone(),
            parts: [0, wish.parts.len()],
            ..ExportProgress::default()
        }));
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let opens_folder = wish.opens_folder;
        thread::spawn({
            let (progress, is_cancelled) = (Arc::clone(&progress), Arc::clone(&is_cancelled));
            move || {
                let ended = write(&wish, &model, &progress, &is_cancelled, &wake);
                let mut progress = lock(&progress);
                progress.current = None;
                progress.ended = Some(ended);
                drop(progress);
                wake();
            }
        });
        Self {
            progress,
            is_cancelled,
            opens_folder,
            is_told: false,
        }
    }

    /// How far it is.
    pub(super) fn progress(&self) -> ExportProgress {
        lock(&self.progress).clone()
    }

    /// How it ended, once.
    pub(super) fn take_end(&mut self) -> Option<ExportEnd> {
        if self.is_told {
            return None;
        }
        let ExportProgress { folder, ended, .. } = self.progress();
        let ended = ended?;
        self.is_told = true;
        Some(match ended {
            Ok(words) => ExportEnd {
                note: (Severity::Note, "export", words),
                folder: self.opens_folder.then_some(folder),
            },
            Err(why) => ExportEnd {
                // A row of the log is one line.
                note: (Severity::Warning, "export", why.replace('\n', "; ")),
                folder: None,
            },
        })
    }

    /// No part is begun any more.
    pub(super) fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }
}

impl Drop for ExportJob {
    fn drop(&mut self) {
        self.cancel();
    }
}

fn write(
    wish: &ExportWish,
    model: &ModelHandle,
    progress: &Mutex<ExportProgress>,
    is_cancelled: &AtomicBool,
    wake: &dyn Fn(),
) -> Result<String, String> {
    let mut begun = 0;
    let exported = export_parts(&wish.folder, wish.parts.iter().copied(), |part, so_far| {
        if is_cancelled.load(Ordering::Relaxed) {
            return ControlFlow::Break(());
        }
        let mut now = lock(progress);
        now.parts[0] = begun;
        now.current = Some(part);
        now.files = so_far.files.len();
        drop(now);
        begun += 1;
        wake();
        if part != ExportPart::Voxels {
            return ControlFlow::Continue(Ok(Snapshot::of(&model.lock(), part)));
        }
        let fetched = fetch_voxels(model, progress, is_cancelled, wake)?;
        let mut model = model.lock();
        let snapshot = Snapshot::of(&model, part);
        // The snapshot has them.
        model.drop_voxels();
        ControlFlow::Continue(fetched.map(|()| snapshot).map_err(Error::msg))
    });
    let exported = exported.map_err(|why| in_words(&why))?;
    lock(progress).files = exported.files.len();
    exported.outcome(&wish.folder)
}

/// Waits until the octree's files are here, or the robot has none; what keeps them away. Breaks off where the export is left.
fn fetch_voxels(
    model: &ModelHandle,
    progress: &Mutex<ExportProgress>,
    is_cancelled: &AtomicBool,
    wake: &dyn Fn(),
) -> ControlFlow<(), Result<(), &'static str>> {
    model.lock().want_voxels();
    let (mut before, mut since) = (VoxelsProgress::Waiting, Monotonic::now());
    loop {
        // Its own statement: the model is free while this waits.
        let now = model.lock().voxels();
        match &now {
            VoxelsProgress::Ready(_) | VoxelsProgress::None | VoxelsProgress::Unwanted => {
                return ControlFlow::Continue(Ok(()));
            }
            VoxelsProgress::TooLong => {
                return ControlFlow::Continue(Err(
                    "they are longer than a console takes. Export them where the robot is",
                ));
            }
            VoxelsProgress::Fetching { file, fetched, of } => {
                lock(progress).fetched = Some((*file, [*fetched, *of]));
            }
            VoxelsProgress::Waiting => {}
        }
        if is_cancelled.load(Ordering::Relaxed) {
            model.lock().drop_voxels();
            return ControlFlow::Break(());
        }
        if now != before {
            (before, since) = (now, Monotonic::now());
            wake();
        } else if since.elapsed() > PATIENCE {
            return ControlFlow::Continue(Err(
                "the robot sends no more of its octree. Export them again when the link is better",
            ));
        }
        thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests;
