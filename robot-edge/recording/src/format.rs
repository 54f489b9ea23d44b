//! Detects the format of a recording and opens it.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::{fmt, io};

use super::{RecordingError, RecordingReader, Selection, capture, carmen, rosbag, rosbag2};
use crate::capture::CaptureReader;
use crate::carmen::CarmenReader;
use crate::mcap::McapReader;
use crate::poses::{PoseFile, WithPoses};
use crate::rosbag::RosbagReader;
use crate::rosbag2::Rosbag2Reader;

/// Bytes looked at; enough for the first 100 lines of most CARMEN logs.
const DETECTION_BYTES: u64 = 64 << 10;

const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";

const GIT_LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// A file format that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// CARMEN log, text.
    Carmen,
    /// ROS 1 bag, version 2.0.
    Rosbag,
    /// MCAP with ROS 2 messages in CDR (or ROS 1 messages, which MCAP can hold too).
    Mcap,
    /// `SQLite` file of a ROS 2 bag.
    Rosbag2,
    /// Capture of a network.
    Capture,
}

impl Format {
    /// The format of the file at `path`.
    pub fn of(path: &Path) -> Result<Self, RecordingError> {
        let io_error = RecordingError::io(path);
        if path.is_dir() {
            return Err(io_error(io::Error::new(
                io::ErrorKind::IsADirectory,
                "this is a folder; name the recording in it (of a ROS 2 bag, the .mcap or .db3 file)",
            )));
        }
        let mut beginning = Vec::new();
        File::open(path)
            .and_then(|file| file.take(DETECTION_BYTES).read_to_end(&mut beginning))
            .map_err(io_error)?;
        if beginning.starts_with(GIT_LFS_POINTER) {
            return Err(RecordingError::GitLfsPointer {
                path: path.to_owned(),
            });
        }
        Self::from_prefix(&beginning).ok_or_else(|| RecordingError::UnknownFormat {
            path: path.to_owned(),
            begins_with: printable(&beginning),
        })
    }

    fn from_prefix(beginning: &[u8]) -> Option<Self> {
        if beginning.starts_with(MCAP_MAGIC) {
            Some(Self::Mcap)
        } else if beginning.starts_with(rosbag2::MAGIC) {
            Some(Self::Rosbag2)
        } else if capture::is_capture(beginning) {
            Some(Self::Capture)
        } else if rosbag::is_rosbag(beginning) {
            Some(Self::Rosbag)
        } else if carmen::is_carmen(beginning) {
            Some(Self::Carmen)
        } else {
            None
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Carmen => "CARMEN log",
            Self::Rosbag => "ROS 1 bag",
            Self::Mcap => "MCAP",
            Self::Rosbag2 => "ROS 2 bag (SQLite)",
            Self::Capture => "network capture",
        })
    }
}

/// Opens a recording, whatever its format.
pub fn open(path: &Path, selection: Selection) -> Result<Box<dyn RecordingReader>, RecordingError> {
    open_surveyed(path, selection, None, None)
}

/// Opens a recording whose survey found out from which range on its laser sees nothing although its messages
/// do not say so (`inferred_miss_range_m`): CARMEN's. `poses` come beside it.
pub fn open_surveyed(
    path: &Path,
    selection: Selection,
    inferred_miss_range_m: Option<f32>,
    poses: Option<PoseFile>,
) -> Result<Box<dyn RecordingReader>, RecordingError> {
    let reader: Box<dyn RecordingReader> = match Format::of(path)? {
        Format::Carmen => {
            let reader = CarmenReader::open(path, selection)?;
            Box::new(match inferred_miss_range_m {
                Some(range_m) => reader.with_laser_range_max_m(range_m),
                None => reader,
            })
        }
        Format::Rosbag => Box::new(RosbagReader::open(path, selection)?),
        Format::Mcap => Box::new(McapReader::open(path, selection)?),
        Format::Rosbag2 => Box::new(Rosbag2Reader::open(path, &selection)?),
        Format::Capture => Box::new(CaptureReader::open(path, selection)?),
    };
    Ok(match poses {
        Some(poses) => Box::new(WithPoses::new(reader, poses)),
        None => reader,
    })
}

/// The first few bytes such that a person sees what they are.
fn printable(beginning: &[u8]) -> String {
    if beginning.is_empty() {
        return "nothing: it is empty".to_owned();
    }
    let first = &beginning[..beginning.len().min(24)];
    format!("\"{}\"", first.escape_ascii())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn format_is_detected_by_first_bytes() {
        let check = |beginning: &[u8], expected| {
            assert_eq!(
                Format::from_prefix(beginning),
                expected,
                "{}",
                printable(beginning)
            );
        };
        check(b"\x89MCAP0\r\n\x01", Some(Format::Mcap));
        check(b"#ROSBAG V2.0\nE", Some(Format::Rosbag));
        check(b"#ROSRECORD V1.2\n", Some(Format::Rosbag));
        check(
            b"# comment\r\n\r\nODOM 0 0 0 0 0 0 1 h 1\r\n",
            Some(Format::Carmen),
        );
        check(
            b"# message_name [message contents] ipc_timestamp\n",
            Some(Format::Carmen),
        );
        check(b"PARAM robot_use_laser on nohost 0\n", Some(Format::Carmen));
        check(b"# a text\nthat is no log\n", None);
        check(b"FLASERS 1 2 3\n", None);
        check(&b"\n".repeat(101), None);
        check(b"", None);
    }

    #[test]
    fn unreadable_files_give_a_reason() {
        let folder = tempfile::tempdir().unwrap();
        let refusal = |content: &[u8]| {
            let path = folder.path().join("file");
            std::fs::write(&path, content).unwrap();
            let error = open(&path, Selection::All).err().unwrap();
            error.to_string().replace(&path.display().to_string(), "F")
        };
        assert_eq!(
            refusal(b"\x1f\x8b\x08packed"),
            "F: not a recording this program reads: it begins with \"\\x1f\\x8b\\x08packed\". \
         It reads MCAP, ROS 2 bags (.db3), ROS 1 bags (version 2.0), CARMEN logs and network captures (.pcap)"
        );
        assert!(refusal(b"").contains("it begins with nothing: it is empty"));
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n";
        assert!(refusal(pointer).ends_with("Fetch the file with `git lfs pull`"));
        let error = open(folder.path(), Selection::All)
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("this is a folder"), "{error}");
    }
}
