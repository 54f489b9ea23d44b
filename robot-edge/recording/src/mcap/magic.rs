//! The first and last bytes of an MCAP file.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::RecordingError;

/// `\x89MCAP0\r\n`, at both ends of a file.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Opens a file and checks its first bytes.
pub(super) fn open_checked(path: &Path) -> Result<File, RecordingError> {
    let io_error = |source| RecordingError::Io {
        path: path.to_owned(),
        source,
    };
    let mut file = File::open(path).map_err(io_error)?;
    let mut magic = Vec::new();
    file.by_ref()
        .take(MAGIC.len() as u64)
        .read_to_end(&mut magic)
        .map_err(io_error)?;
    if magic == MAGIC {
        Ok(file)
    } else {
        Err(not_this_format(path, &magic))
    }
}

fn not_this_format(path: &Path, begins_with: &[u8]) -> RecordingError {
    let path = path.to_owned();
    match begins_with {
        [0x89, b'M', b'C', b'A', b'P', version, b'\r', b'\n'] => {
            RecordingError::UnsupportedVersion {
                path,
                format: "MCAP",
                version: char::from(*version).to_string(),
                remedy: "only version 0 exists at the time of writing: update this program",
            }
        }
        _ => RecordingError::UnknownFormat {
            path,
            begins_with: format!("{:?}", String::from_utf8_lossy(begins_with)),
        },
    }
}
