//! Output files that a run writes all along: what an earlier run left is never written over.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use crate::free_space::{DiskSpace, DiskSpaceFn};

/// A file that this run writes.
#[derive(Debug)]
pub struct NewFile {
    /// Open for writing.
    pub file: File,
    /// Its name, which may be numbered.
    pub path: PathBuf,
    /// Else a device or a pipe: it can be written, and neither synced nor continued in another file.
    pub is_regular: bool,
}

/// Creates `path`, or, where there is such a file, the first of `drive-2.csv`, `drive-3.csv` … that does not exist: of two
/// processes that ask for one name, each gets a file of its own. A device or a pipe is opened as it is.
///
/// # Errors
/// Where the system refuses.
pub fn create(path: &Path) -> io::Result<NewFile> {
    let mut name = path.to_owned();
    let mut number: u32 = 1;
    loop {
        match File::create_new(&name) {
            Ok(file) => {
                sync_folder_of(&name);
                return Ok(NewFile {
                    file,
                    path: name,
                    is_regular: true,
                });
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
        if fs::metadata(&name).is_ok_and(|existing| !existing.is_file()) {
            return Ok(NewFile {
                file: File::options().write(true).open(&name)?,
                path: name,
                is_regular: false,
            });
        }
        number = number.checked_add(1).ok_or(io::ErrorKind::AlreadyExists)?;
        name = numbered(path, number);
    }
}

fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = OsString::from(path.file_stem().unwrap_or_default());
    name.push(format!("-{number}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// Or a power cut leaves a file that no folder knows.
pub fn sync_folder_of(path: &Path) {
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        Some(_) | None => Path::new("."),
    };
    if let Err(error) = File::open(folder).and_then(|folder| folder.sync_all()) {
        tracing::warn!(folder = %folder.display(), %error, "the folder cannot be synced");
    }
}

impl NewFile {
    /// Waits until all that was written is on the disk.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn sync(&self) -> io::Result<()> {
        if self.is_regular {
            self.file.sync_data()
        } else {
            Ok(())
        }
    }

    /// The room on its disk, where that is too little to go on; `None` also where the system does not say.
    pub fn low_space(&self, disk_space: DiskSpaceFn) -> Option<DiskSpace> {
        if !self.is_regular {
            return None;
        }
        disk_space(&self.path).ok().filter(DiskSpace::is_low)
    }
}

/// Says that a file is not called as `option` asks for, and why; `None` where it is.
pub fn note(option: &str, asked: &Path, path: &Path) -> Option<String> {
    (path != asked).then(|| {
        format!(
            "{option}: {} exists and is not written over: this run writes {}",
            asked.display(),
            path.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn what_exists_is_left_alone_and_the_next_number_that_is_free_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        for (name, names) in [
            ("drive.mcap", ["drive.mcap", "drive-2.mcap", "drive-4.mcap"]),
            ("drive", ["drive", "drive-2", "drive-4"]),
        ] {
            let path = folder.path().join(name);
            fs::write(folder.path().join(name.replace("drive", "drive-3")), "kept").unwrap();
            for expected in names {
                let mut made = create(&path).unwrap();
                assert_eq!(made.path, folder.path().join(expected));
                assert!(made.is_regular);
                made.file.write_all(expected.as_bytes()).unwrap();
                made.sync().unwrap();
                let note = note("--record", &path, &made.path);
                assert_eq!(note.is_some(), expected != name);
            }
            for expected in names {
                let found = fs::read_to_string(folder.path().join(expected)).unwrap();
                assert_eq!(found, expected, "written over");
            }
        }
        let missing = folder.path().join("none/drive.csv");
        assert_eq!(
            create(&missing).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
        assert!(create(folder.path()).is_err(), "a folder is no file");
    }

    /// Of as many as ask at one time.
    #[test]
    fn nobody_is_given_the_file_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("drive.csv");
        let mut given = std::thread::scope(|scope| {
            let asking: Vec<_> = (0..8)
                .map(|_| scope.spawn(|| create(&path).unwrap().path))
                .collect();
            let given = asking.into_iter().map(|asking| asking.join().unwrap());
            given.collect::<Vec<_>>()
        });
        given.sort();
        given.dedup();
        assert_eq!(given.len(), 8);
    }

    #[test]
    #[cfg(unix)]
    fn a_device_is_written_to_as_it_is_and_a_link_to_nothing_is_not_followed() {
        let mut null = create(Path::new("/dev/null")).unwrap();
        assert_eq!(
            (null.path.as_path(), null.is_regular),
            (Path::new("/dev/null"), false)
        );
        null.file.write_all(b"x").unwrap();
        null.sync().unwrap();
        let scarce = |_: &Path| {
            Ok(DiskSpace {
                free_bytes: 0,
                total_bytes: 1,
            })
        };
        assert_eq!(null.low_space(scarce), None);
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("drive.csv");
        std::os::unix::fs::symlink(folder.path().join("nothing"), &link).unwrap();
        let made = create(&link).unwrap();
        assert_eq!(made.path, folder.path().join("drive-2.csv"));
        assert!(made.low_space(scarce).is_some());
    }
}
