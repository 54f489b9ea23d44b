//! A file appears complete or not at all.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use super::ExportError;

/// Writes `path` by way of a temporary file beside it, which is gone in every case when this returns.
pub(super) fn write_atomically(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    let written = write_part(path, &part, content);
    if written.is_err() {
        // The first error is the one to report; there may be no temporary file to remove.
        drop(fs::remove_file(&part));
    }
    written
}

fn write_part(
    path: &Path,
    part: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let io_error = |source| ExportError::Io {
        path: path.to_owned(),
        source,
    };
    let mut writer = BufWriter::new(File::create(part).map_err(io_error)?);
    content(&mut writer)?;
    writer.flush().map_err(io_error)?;
    writer.get_ref().sync_all().map_err(io_error)?;
    fs::rename(part, path).map_err(io_error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_previous_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map.pgm");
        fs::write(&path, "before").unwrap();
        let failed = write_atomically(&path, |writer| {
            writer.write_all(b"half").unwrap();
            Err(ExportError::Io {
                path: path.clone(),
                source: std::io::Error::other("disk full"),
            })
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"before");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_error_names_the_file_asked_for() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing").join("map.pgm");
        let error = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(error.starts_with(path.to_str().unwrap()), "{error}");
    }
}
