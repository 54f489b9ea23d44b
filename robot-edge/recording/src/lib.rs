//! Reads recordings as measurements and writes measurements as MCAP.
//!
//! A [`RecordingReader`] yields the measurements of one file in *file* order, streamed, in bounded memory,
//! and survives any damage: what cannot be read is skipped and counted. [`open`] picks the reader by the
//! file's first bytes.

#![warn(missing_docs)]

use std::io;
use std::path::{Path, PathBuf};

use measurement::drops::DropCounts;
use measurement::time::RobotTime;
use measurement::{Measurement, Stream};

mod capture;
pub mod carmen;
#[cfg(test)]
mod corruption_tests;
mod format;
#[cfg(test)]
mod lidar_tests;
pub mod mcap;
pub mod messages;
pub mod new_file;
pub mod poses;
pub mod ros;
pub mod rosbag;
mod rosbag2;
#[cfg(test)]
pub(crate) mod shared_data;
#[cfg(test)]
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
pub mod time_sequencer;
pub mod writer;

pub use capture::LIDAR_PACKETS;
pub use format::{Format, open, open_surveyed};

/// Why a recording cannot be read at all. Damage inside a readable file is counted, not an error.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be opened, or reading stopped.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Neither name nor content is that of a known format.
    #[error("{path}: not a recording this program reads: it begins with {begins_with}. \
             It reads MCAP, ROS 2 bags (.db3), ROS 1 bags (version 2.0), CARMEN logs and network captures (.pcap)", path = path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its first bytes, printable.
        begins_with: String,
    },
    /// The file is a Git LFS pointer.
    #[error("{path}: this is not the recording but a pointer to it that Git LFS left. \
             Fetch the file with `git lfs pull`", path = path.display())]
    GitLfsPointer {
        /// The file.
        path: PathBuf,
    },
    /// A known format in a version that is not read.
    #[error("{path}: {format} version {version} is not supported: {remedy}", path = path.display())]
    UnsupportedVersion {
        /// The file.
        path: PathBuf,
        /// Name of the format.
        format: &'static str,
        /// The file's version.
        version: String,
        /// Advice to the user.
        remedy: &'static str,
    },
    /// The beginning is damaged such that nothing in the file can be trusted.
    #[error("{path}: damaged at byte {offset}: {what}. {remedy}", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What is wrong.
        what: String,
        /// Advice to the user.
        remedy: &'static str,
    },
}

impl RecordingError {
    /// Adds `path` to an error of the system.
    pub(crate) fn io(path: &Path) -> impl Fn(io::Error) -> Self + Copy {
        move |source| Self::Io {
            path: path.to_owned(),
            source: name_missing(path, source),
        }
    }
}

/// The error of the system at `path`; where something is missing it names the folder or says that it is the file.
pub fn name_missing(path: &Path, error: io::Error) -> io::Error {
    if error.kind() != io::ErrorKind::NotFound {
        return error;
    }
    let folders = path.ancestors().skip(1);
    let missing = folders.filter(|folder| *folder != Path::new("") && !folder.exists());
    let what = match missing.last() {
        Some(folder) => format!("there is no folder {}", folder.display()),
        None => "there is no such file".to_owned(),
    };
    io::Error::new(io::ErrorKind::NotFound, what)
}

/// Summary of one stream so far, including streams of unsupported types.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamSummary {
    /// Name and type.
    pub stream: Stream,
    /// Whether its messages become measurements.
    pub understood: bool,
    /// Messages so far.
    pub messages: u64,
    /// Time the first message was logged.
    pub first: Option<RobotTime>,
    /// Time the last message was logged.
    pub last: Option<RobotTime>,
}

/// Progress of reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Bytes read.
    pub bytes_read: u64,
    /// Bytes in the file.
    pub bytes_total: u64,
}

/// Streams to decode.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum Selection {
    /// All that are understood.
    #[default]
    All,
    /// Those with one of these names; others are counted in [`StreamSummary`] only.
    Named(Vec<String>),
}

impl Selection {
    /// Whether the stream called `name` is to be decoded.
    pub fn contains(&self, name: &str) -> bool {
        match self {
            Self::All => true,
            Self::Named(names) => names.iter().any(|wanted| wanted == name),
        }
    }
}

/// Reads one file from its beginning to its end.
pub trait RecordingReader: Send {
    /// The next measurement in file order; `None` at the end.
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError>;

    /// The streams met so far; a [`measurement::StreamId`] is an index into it. It only grows.
    fn streams(&self) -> &[StreamSummary];

    /// Losses so far, by reason.
    fn losses(&self) -> &DropCounts;

    /// The first few losses in words: where (byte or line) and what.
    fn loss_notes(&self) -> &[String];

    /// Progress of reading.
    fn position(&self) -> Position;

    /// Stamps so far that contradicted the order of their stream and were changed to fit it.
    fn stamp_repairs(&self) -> u64 {
        0
    }

    /// The vehicle that the recording's metadata names.
    fn vehicle(&self) -> Option<&str> {
        None
    }
}
