//! The emergency stop in force, on disk: it outlives the process.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use teleop::EStopId;
use teleop::emergency_stop::StoredEStop;

const NAME: &str = "estop";
const BYTES: usize = 38;

/// A file that says which emergency stop is active, if one is.
///
/// It always has the same length and is written in place: on a full disk an emergency stop is still stored (on file
/// systems that write in place). What is half written or damaged reads as an emergency stop.
#[derive(Debug)]
pub struct EStopFile {
    file: File,
    path: PathBuf,
}

impl EStopFile {
    /// Opens the file of a directory; where there is none it is made, and says that no emergency stop is active.
    ///
    /// # Errors
    /// Where the directory or the file cannot be made or written.
    pub fn open(dir: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(dir)?;
        let path = dir.join(NAME);
        let is_new = !path.try_exists()?;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)?;
        let mut estop = Self { file, path };
        if is_new {
            estop.write(None)?;
            File::open(dir)?.sync_all()?;
        }
        Ok(estop)
    }

    /// What was in force when it was last written.
    pub fn read(&mut self) -> StoredEStop {
        let mut bytes = Vec::with_capacity(BYTES + 1);
        let read = self
            .file
            .rewind()
            .and_then(|()| (&self.file).take(BYTES as u64 + 1).read_to_end(&mut bytes));
        match read {
            Ok(_) => parse(&bytes),
            Err(error) => {
                tracing::error!(path = %self.path.display(), %error, "cannot be read");
                StoredEStop::Unreadable
            }
        }
    }

    /// Says which emergency stop is active, and returns when it is on the disk.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn write(&mut self, estop: Option<EStopId>) -> io::Result<()> {
        self.file.rewind()?;
        self.file.write_all(content(estop).as_bytes())?;
        self.file.sync_data()
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn content(estop: Option<EStopId>) -> String {
    let record = match estop {
        None => format!("{:<8}{:020}", "none", 0),
        Some(EStopId(id)) => format!("{:<8}{id:020}", "latched"),
    };
    let check = crc32fast::hash(record.as_bytes());
    format!("{record} {check:08x}\n")
}

fn parse(bytes: &[u8]) -> StoredEStop {
    let id = std::str::from_utf8(bytes).ok().and_then(|text| {
        let id = text.get(8..28)?.parse().ok()?;
        (text == content(None) || text == content(Some(EStopId(id)))).then_some((text, id))
    });
    match id {
        Some((text, _)) if text.starts_with("none") => StoredEStop::None,
        Some((_, id)) => StoredEStop::Latched(EStopId(id)),
        None => StoredEStop::Unreadable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_found_again_and_what_is_damaged_counts_as_stopped() {
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path().join("state/scout");
        let read = || EStopFile::open(&dir).unwrap().read();
        assert_eq!(read(), StoredEStop::None);
        let mut file = EStopFile::open(&dir).unwrap();
        for id in [7, u64::MAX, 0] {
            file.write(Some(EStopId(id))).unwrap();
            assert_eq!(read(), StoredEStop::Latched(EStopId(id)));
        }
        let path = file.path().to_owned();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole.len(), BYTES);
        for at in 0..BYTES {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            std::fs::write(&path, &damaged).unwrap();
            assert_eq!(read(), StoredEStop::Unreadable, "{at}");
            std::fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(read(), StoredEStop::Unreadable, "cut at {at}");
        }
        std::fs::write(&path, [&whole[..], b"x"].concat()).unwrap();
        assert_eq!(read(), StoredEStop::Unreadable, "longer");
        std::fs::write(&path, &whole).unwrap();
        file.write(None).unwrap();
        assert_eq!(read(), StoredEStop::None);
    }

    #[test]
    fn a_directory_that_cannot_be_made_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(EStopFile::open(&file.join("state")).is_err());
    }
}
