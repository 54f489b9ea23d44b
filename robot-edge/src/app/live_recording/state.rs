//! How a recording is going, for people.

use std::path::{Path, PathBuf};
use std::time::Duration;

use protocol::message::{self, RecordingStatus};

/// How recording is going.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::app) struct RecordingState {
    /// Measurements are being written.
    pub(in crate::app) is_running: bool,
    /// The file that is being written, or was last.
    pub(in crate::app) file: Option<PathBuf>,
    /// Why it has ended by itself; until it is started anew.
    pub(in crate::app) problem: Option<Problem>,
    /// Measurements that found no room on their way to the disk, since it was started.
    pub(in crate::app) lost: u64,
    /// Files since it was started, their bytes, and for how long they were written.
    pub(super) files: u32,
    pub(super) bytes: u64,
    pub(super) duration: Duration,
    /// What is free where they are written.
    pub(super) free_bytes: Option<u64>,
}

/// Why a recording ended by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::app) struct Problem {
    /// In words.
    pub(in crate::app) what: String,
    pub(super) is_disk_low: bool,
}

impl RecordingState {
    /// The same, for people.
    pub(in crate::app) fn status(&self) -> RecordingStatus {
        let state = match &self.problem {
            Some(problem) if problem.is_disk_low => message::RecordingState::StoppedDiskLow,
            Some(_) => message::RecordingState::Failed,
            None if self.is_running => message::RecordingState::Recording,
            None => message::RecordingState::Stopped,
        };
        let name = self.file.as_deref().and_then(Path::file_name);
        RecordingStatus {
            state,
            file: name.map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            files: self.files,
            duration_s: u32::try_from(self.duration.as_secs()).unwrap_or(u32::MAX),
            bytes: self.bytes,
            free_bytes: self.free_bytes,
            lost: self.lost,
        }
    }
}
