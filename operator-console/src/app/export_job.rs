//! An export on its way, on a thread of its own: the window goes on, and drives.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use super::session_monitor::LogNote;
use crate::command::ExportRequest;
use crate::event_log::Severity;
use crate::export::{ExportPart, Fetcher, Fetching, export_parts};
use crate::link::ModelHandle;
use crate::locks::lock;
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
    /// How far that is, where it is fetched from the robot.
    pub fetching: Option<Fetching>,
    /// Files that are written.
    pub files: usize,
    /// How it ended: with what, in words.
    pub ended: Option<Result<String, String>>,
    /// Why its folder could not be opened, in words.
    pub unopened: Option<String>,
}

impl ExportProgress {
    /// How much of all is done, 0 … 1. What is being fetched counts as far as it came.
    pub fn share(&self) -> f32 {
        let [done, all] = self.parts;
        let of_part = self.fetching.map_or(0.0, Fetching::share);
        (done as f32 + of_part) / all.max(1) as f32
    }
}

/// How an export ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ExportEnd {
    /// For the log.
    pub(super) note: LogNote,
    /// The folder, where all is in it and the operator wants to see that.
    pub(super) folder: Option<PathBuf>,
}

/// A robot that sends no more of what is fetched is not waited for any longer.
const PATIENCE: Duration = Duration::from_mins(1);

/// An export. Dropping it leaves it.
pub(super) struct ExportJob {
    progress: Arc<Mutex<ExportProgress>>,
    is_cancelled: Arc<AtomicBool>,
    opens_folder: bool,
    /// Whether its end was taken, whichever robot is shown by then.
    is_end_reported: bool,
}

impl ExportJob {
    /// Begins to write what `model` holds. `wake` is called when there is something new to tell.
    pub(super) fn start(
        request: ExportRequest,
        model: ModelHandle,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let progress = Arc::new(Mutex::new(ExportProgress {
            folder: request.folder.clone(),
            parts: [0, request.parts.len()],
            ..ExportProgress::default()
        }));
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let opens_folder = request.opens_folder;
        thread::spawn({
            let (progress, is_cancelled) = (Arc::clone(&progress), Arc::clone(&is_cancelled));
            move || {
                let ended = write(&request, &model, &progress, &is_cancelled, &wake);
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
            is_end_reported: false,
        }
    }

    /// How far it is.
    pub(super) fn progress(&self) -> ExportProgress {
        lock(&self.progress).clone()
    }

    /// How it ended, once.
    pub(super) fn take_end(&mut self) -> Option<ExportEnd> {
        if self.is_end_reported {
            return None;
        }
        let ExportProgress { folder, ended, .. } = self.progress();
        let ended = ended?;
        self.is_end_reported = true;
        Some(match ended {
            Ok(words) => ExportEnd {
                note: (Severity::Info, "export", words),
                folder: self.opens_folder.then_some(folder),
            },
            Err(why) => ExportEnd {
                // A row of the log is one line.
                note: (Severity::Warning, "export", why.replace('\n', "; ")),
                folder: None,
            },
        })
    }

    /// A folder could not be opened: that is told of its own.
    pub(super) fn not_opened(&self, folder: &Path, why: &str) {
        let mut progress = lock(&self.progress);
        if progress.folder == folder {
            progress.unopened = Some(why.to_owned());
        }
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
    request: &ExportRequest,
    model: &ModelHandle,
    progress: &Mutex<ExportProgress>,
    is_cancelled: &AtomicBool,
    wake: &dyn Fn(),
) -> Result<String, String> {
    let mut begun = 0;
    let fetcher = Fetcher::begin(model, request.parts.iter().copied(), PATIENCE);
    let exported = export_parts(
        &request.folder,
        request.parts.iter().copied(),
        |part, so_far| {
            if is_cancelled.load(Ordering::Relaxed) {
                return ControlFlow::Break(());
            }
            let mut now = lock(progress);
            now.parts[0] = begun;
            now.current = Some(part);
            now.files = so_far.files.len();
            now.fetching = None;
            drop(now);
            begun += 1;
            wake();
            fetcher.fetch(part, |fetching| {
                if is_cancelled.load(Ordering::Relaxed) {
                    return ControlFlow::Break(());
                }
                if lock(progress).fetching.replace(fetching) != Some(fetching) {
                    wake();
                }
                ControlFlow::Continue(())
            })
        },
    );
    let exported = exported.map_err(|why| in_words(&why))?;
    lock(progress).files = exported.files.len();
    exported.outcome(&request.folder)
}

#[cfg(test)]
mod tests;
