//! An export on its way, on a thread of its own: the window goes on, and drives.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use robot_edge::clock::Monotonic;

use super::watch::Note;
use crate::command::ExportWish;
use crate::event_log::Severity;
use crate::export::{ExportPart, Snapshot};
use crate::link::ModelHandle;
use crate::locks::lock;
use crate::model::VoxelsProgress;

/// How far an export is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportProgress {
    /// Where it goes.
    pub folder: PathBuf,
    /// Parts that are written, of how many.
    pub parts: [usize; 2],
    /// The part that is being written.
    pub current: Option<ExportPart>,
    /// Files that are written.
    pub files: usize,
    /// How it ended: with what, in words.
    pub ended: Option<Result<String, String>>,
}

/// Between two looks at what is being fetched.
const LOOK: Duration = Duration::from_millis(50);
/// A robot that is gone, or another that was chosen meanwhile, is not waited for any longer.
const PATIENCE: Duration = Duration::from_mins(1);

/// An export. Dropping it leaves it.
pub(super) struct ExportJob {
    progress: Arc<Mutex<ExportProgress>>,
    is_cancelled: Arc<AtomicBool>,
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
            is_told: false,
        }
    }

    /// How far it is.
    pub(super) fn progress(&self) -> ExportProgress {
        lock(&self.progress).clone()
    }

    /// How it ended, once.
    pub(super) fn take_end(&mut self) -> Option<Note> {
        if self.is_told {
            return None;
        }
        let ended = lock(&self.progress).ended.clone()?;
        self.is_told = true;
        Some(match ended {
            Ok(words) => (Severity::Note, "export", words),
            Err(why) => (Severity::Warning, "export", why),
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
    let parts: &BTreeSet<ExportPart> = &wish.parts;
    for part in parts {
        if is_cancelled.load(Ordering::Relaxed) {
            let files = lock(progress).files;
            return Err(format!(
                "Left after {files} files; they are whole, and in {}",
                wish.folder.display()
            ));
        }
        lock(progress).current = Some(*part);
        wake();
        if *part == ExportPart::Voxels {
            fetch_voxels(model, is_cancelled)?;
        }
        // Its own statement: the model is free as soon as the snapshot is taken.
        let snapshot = Snapshot::of(&model.lock(), *part);
        let files = snapshot
            .and_then(|snapshot| snapshot.write(&wish.folder))
            .map_err(|why| format!("{why:#}"))?
            .len();
        if *part == ExportPart::Voxels {
            model.lock().drop_voxels();
        }
        let mut progress = lock(progress);
        progress.parts[0] += 1;
        progress.files += files;
    }
    let files = lock(progress).files;
    let word = if files == 1 { "file is" } else { "files are" };
    Ok(format!("{files} {word} in {}", wish.folder.display()))
}

/// Waits until the octree's files are here, or the robot has none.
fn fetch_voxels(model: &ModelHandle, is_cancelled: &AtomicBool) -> Result<(), String> {
    model.lock().want_voxels();
    let (mut before, mut since) = (VoxelsProgress::Waiting, Monotonic::now());
    loop {
        // Its own statement: the model is free while this waits.
        let progress = model.lock().voxels();
        match progress {
            VoxelsProgress::Ready(_) | VoxelsProgress::None | VoxelsProgress::Unwanted => {
                return Ok(());
            }
            VoxelsProgress::TooLong => {
                return Err("The octree is longer than a console takes".to_owned());
            }
            VoxelsProgress::Waiting | VoxelsProgress::Fetching { .. } => {}
        }
        let why = if is_cancelled.load(Ordering::Relaxed) {
            Some("Left before the octree was here")
        } else if since.elapsed() > PATIENCE {
            Some("The robot does not send its octree; all before it was written")
        } else {
            None
        };
        if let Some(why) = why {
            model.lock().drop_voxels();
            return Err(why.to_owned());
        }
        if progress != before {
            (before, since) = (progress, Monotonic::now());
        }
        thread::sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_an_export_is_told_once() {
        let progress = Arc::new(Mutex::new(ExportProgress::default()));
        let mut job = ExportJob {
            progress: Arc::clone(&progress),
            is_cancelled: Arc::default(),
            is_told: false,
        };
        assert_eq!(job.take_end(), None);
        lock(&progress).ended = Some(Ok("3 files are in maps".to_owned()));
        let note = (Severity::Note, "export", "3 files are in maps".to_owned());
        assert_eq!(job.take_end(), Some(note));
        assert_eq!(job.take_end(), None);
    }
}
