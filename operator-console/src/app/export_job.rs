//! An export in a thread of its own, so that window and driving continue.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use super::session_monitor::LogNote;
use crate::command::ExportRequest;
use crate::event_log::Severity;
use crate::export::{ExportPart, FetchProgress, Fetcher, export_parts};
use crate::link::ModelHandle;
use crate::lock;
use crate::playback::in_words;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExportProgress {
    pub folder: PathBuf,
    pub parts: [usize; 2],
    pub current: Option<ExportPart>,
    pub fetching: Option<FetchProgress>,
    pub files: usize,
    pub ended: Option<Result<String, String>>,
    pub unopened: Option<String>,
}

impl ExportProgress {
    pub fn share(&self) -> f32 {
        let [done, all] = self.parts;
        let of_part = self.fetching.map_or(0.0, FetchProgress::share);
        (done as f32 + of_part) / all.max(1) as f32
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ExportEnd {
    pub(super) note: LogNote,
    /// The folder to open, if everything was written and the operator wants it.
    pub(super) folder: Option<PathBuf>,
}

/// Time without data after which fetching fails.
const PATIENCE: Duration = Duration::from_mins(1);

/// Dropping an export cancels it.
pub(super) struct ExportJob {
    progress: Arc<Mutex<ExportProgress>>,
    is_cancelled: Arc<AtomicBool>,
    opens_folder: bool,
    is_end_reported: bool,
}

impl ExportJob {
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

    pub(super) fn progress(&self) -> ExportProgress {
        lock(&self.progress).clone()
    }

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

    pub(super) fn not_opened(&self, folder: &Path, why: &str) {
        let mut progress = lock(&self.progress);
        if progress.folder == folder {
            progress.unopened = Some(why.to_owned());
        }
    }

    /// Begins no further part.
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
mod tests {
    use std::fs;

    use super::*;

    fn ended(ended: Result<&str, &str>, opens_folder: bool) -> ExportJob {
        ExportJob {
            progress: Arc::new(Mutex::new(ExportProgress {
                folder: PathBuf::from("maps"),
                ended: Some(ended.map(str::to_owned).map_err(str::to_owned)),
                ..ExportProgress::default()
            })),
            is_cancelled: Arc::default(),
            opens_folder,
            is_end_reported: false,
        }
    }

    #[test]
    fn export_end_is_reported_once() {
        let mut job = ended(Ok("3 files are in maps"), true);
        let words = lock(&job.progress).ended.take();
        assert_eq!(job.take_end(), None);
        lock(&job.progress).ended = words;
        let end = ExportEnd {
            note: (Severity::Info, "export", "3 files are in maps".to_owned()),
            folder: Some(PathBuf::from("maps")),
        };
        assert_eq!(job.take_end(), Some(end));
        assert_eq!(job.take_end(), None);
    }

    #[test]
    fn folder_opens_only_if_wanted_and_complete() {
        let end = ended(Ok("all"), false).take_end().unwrap();
        assert_eq!(end.folder, None);
        let end = ended(Err("2 files\ncost is missing"), true)
            .take_end()
            .unwrap();
        assert_eq!(end.folder, None);
        let words = "2 files; cost is missing".to_owned();
        assert_eq!(end.note, (Severity::Warning, "export", words));
    }

    #[test]
    fn open_failure_concerns_its_own_folder_only() {
        let job = ended(Ok("all"), true);
        job.not_opened(Path::new("recordings"), "no");
        assert_eq!(job.progress().unopened, None);
        job.not_opened(Path::new("maps"), "no");
        assert_eq!(job.progress().unopened.as_deref(), Some("no"));
    }

    #[test]
    fn fetching_moves_the_progress_bar() {
        let progress = ExportProgress {
            parts: [3, 4],
            fetching: Some(FetchProgress::Poses([1, 2])),
            ..ExportProgress::default()
        };
        assert_eq!(progress.share().to_bits(), 0.875_f32.to_bits());
        assert_eq!(
            ExportProgress::default().share().to_bits(),
            0.0_f32.to_bits()
        );
    }

    fn exported(
        folder: &std::path::Path,
        last: ExportPart,
        is_cancelled: bool,
    ) -> (Result<String, String>, usize) {
        let request = ExportRequest {
            folder: folder.to_owned(),
            parts: [ExportPart::Trajectory, last].into(),
            opens_folder: false,
        };
        let model = ModelHandle::of(crate::test_support::scout());
        let progress = Mutex::default();
        let ended = write(
            &request,
            &model,
            &progress,
            &AtomicBool::new(is_cancelled),
            &|| {},
        );
        (ended, progress.into_inner().unwrap().files)
    }

    #[test]
    fn failed_part_is_reported_and_others_are_written() {
        let dir = tempfile::tempdir().unwrap();
        let (ended, files) = exported(dir.path(), ExportPart::Shores, false);
        let folder = dir.path().display();
        let expected = format!(
            "2 files are in {folder}\n\
             trajectory is incomplete: only what was received here: no data from the robot"
        );
        assert_eq!(ended, Err(expected));
        assert_eq!(files, 2);

        fs::remove_file(dir.path().join("trajectory.tum")).unwrap();
        fs::create_dir(dir.path().join("trajectory.tum")).unwrap();
        let (ended, files) = exported(dir.path(), ExportPart::Shores, false);
        let why = ended.unwrap_err();
        assert!(
            why.starts_with(&format!("0 files are in {folder}\ntrajectory is missing")),
            "{why}"
        );
        assert_eq!(files, 0);

        let (ended, _) = exported(dir.path(), ExportPart::Shores, true);
        assert!(ended.unwrap_err().starts_with("Cancelled after 0 files"));
    }

    #[test]
    fn an_octree_that_does_not_come_is_missing() {
        let dir = tempfile::tempdir().unwrap();
        let (ended, files) = exported(dir.path(), ExportPart::Voxels, false);
        let why = ended.unwrap_err();
        let missing = "\nvoxels is missing: no data from the robot. Export it again later";
        assert!(why.contains(missing), "{why}");
        assert_eq!(files, 2, "the way");
    }
}
