//! What cannot be written should be known before an hour of mapping, and nothing is written over its source.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use anyhow::Context as _;

use crate::cli::MappingOptions;
use crate::exit::UsageError;

/// Refuses outputs that are the recording itself.
///
/// # Errors
/// Where one is.
pub(super) fn check_not_source(
    recording: &Path,
    options: &MappingOptions,
) -> Result<(), UsageError> {
    for (option, output) in [
        ("--record", &options.record),
        ("--summary", &options.summary),
    ] {
        if let Some(output) = output
            && is_same_file(recording, output)
        {
            return Err(UsageError(format!(
                "{}: {option} names the recording that is replayed: name another file",
                output.display()
            )));
        }
    }
    Ok(())
}

/// Makes the folder for the maps, and tries whether it and the summary can be written.
///
/// # Errors
/// Where one cannot.
pub(super) fn prepare(export: Option<&Path>, summary: Option<&Path>) -> anyhow::Result<()> {
    if let Some(dir) = export {
        fs::create_dir_all(dir)
            .with_context(|| format!("{}: cannot make the folder to export to", dir.display()))?;
        try_folder(dir).with_context(|| format!("{}: cannot write the maps", dir.display()))?;
    }
    if let Some(path) = summary {
        try_file(path).with_context(|| format!("{}: cannot write the summary", path.display()))?;
    }
    Ok(())
}

/// Tries what will be written under a temporary name beside `path` first.
fn try_file(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(existing) if existing.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
        // A pipe or a terminal is written to directly; trying it would already be output.
        Ok(existing) if !existing.is_file() => Ok(()),
        Ok(_) | Err(_) => match path.parent() {
            Some(folder) if folder != Path::new("") => try_folder(folder),
            Some(_) | None => try_folder(Path::new(".")),
        },
    }
}

fn try_folder(folder: &Path) -> io::Result<()> {
    let trial = folder.join(format!(".robot-edge.{}.tmp", std::process::id()));
    File::create_new(&trial)?;
    fs::remove_file(&trial)
}

/// Whether both names lead to one file, by whatever links.
#[cfg(unix)]
fn is_same_file(one: &Path, other: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |path: &Path| fs::metadata(path).map(|data| (data.dev(), data.ino())).ok();
    identity(one).is_some_and(|one| identity(other) == Some(one))
}

/// Whether both names lead to one file; hard links are not seen.
#[cfg(not(unix))]
fn is_same_file(one: &Path, other: &Path) -> bool {
    let identity = |path: &Path| fs::canonicalize(path).ok();
    identity(one).is_some_and(|one| identity(other) == Some(one))
}
