//! How the recording is going that operators start and stop.

use serde::{Deserialize, Serialize};

/// The recording, in [`Status`](super::Status).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingStatus {
    /// Whether it runs, and if not, why.
    pub state: RecordingState,
    /// Name of the file that is being written, or was last, without its folder; empty before the first.
    pub file: String,
    /// How many files it has; a file ends after a minute.
    pub files: u32,
    /// How long it has run since it was started, or did, s.
    pub duration_s: u32,
    /// Bytes in all its files.
    pub bytes: u64,
    /// Bytes that are free where it is written; `None` where the system does not say.
    pub free_bytes: Option<u64>,
    /// Measurements that found no room on their way to the disk.
    pub lost: u64,
}

/// Whether a recording runs, and if not, why. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RecordingState {
    /// None runs: nobody started one, or somebody stopped it.
    Stopped,
    /// It runs.
    Recording,
    /// It was ended, or never begun, because the disk is nearly full.
    StoppedDiskLow,
    /// It ended because it could not be written.
    Failed,
}
