//! Output files of a run, which never overwrite existing files, and the free space of their disk.

use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::{fmt, fs, io};

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
    pub fn sync(&self) -> io::Result<()> {
        if self.is_regular {
            self.file.sync_data()
        } else {
            Ok(())
        }
    }

    /// Free space of its disk if that is too low to go on; `None` also if the system cannot report it.
    pub fn low_space(&self, disk_space: DiskSpaceFn) -> Option<DiskSpace> {
        if !self.is_regular {
            return None;
        }
        disk_space(&self.path).ok().filter(DiskSpace::is_low)
    }
}

/// Says that a file is not called as `option` asks for, and why; `None` if it is.
pub fn note(option: &str, asked: &Path, path: &Path) -> Option<String> {
    (path != asked).then(|| {
        format!(
            "{option}: {} exists and is not written over: this run writes {}",
            asked.display(),
            path.display()
        )
    })
}

const MIN_FREE_BYTES: u64 = 1_000_000_000;
/// … and one part in so many of the disk.
const MIN_FREE_DIVISOR: u64 = 20;

/// Room on a file system, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskSpace {
    /// Bytes available to an ordinary user.
    pub free_bytes: u64,
    /// All of it.
    pub total_bytes: u64,
}

impl DiskSpace {
    /// Less is free than 1 GB or 5 %.
    pub const fn is_low(&self) -> bool {
        self.free_bytes < MIN_FREE_BYTES || self.free_bytes < self.total_bytes / MIN_FREE_DIVISOR
    }
}

impl fmt::Display for DiskSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [free_gb, total_gb] =
            [self.free_bytes, self.total_bytes].map(|bytes| bytes as f64 / 1e9);
        write!(f, "{free_gb:.1} of {total_gb:.1} GB are free")
    }
}

/// Says how much room there is where a file or folder is.
pub type DiskSpaceFn = fn(&Path) -> io::Result<DiskSpace>;

/// The room where `path` is.
#[cfg(target_os = "linux")]
pub fn disk_space(path: &Path) -> io::Result<DiskSpace> {
    let found = rustix::fs::statvfs(path)?;
    Ok(DiskSpace {
        free_bytes: found.f_bavail.saturating_mul(found.f_frsize),
        total_bytes: found.f_blocks.saturating_mul(found.f_frsize),
    })
}

/// Not available on this system: a full disk is noticed by the failed write.
#[cfg(not(target_os = "linux"))]
pub fn disk_space(_path: &Path) -> io::Result<DiskSpace> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn existing_files_are_kept_and_the_next_free_number_is_used() {
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
    fn concurrent_creators_get_different_files() {
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
    fn devices_are_opened_and_dangling_links_are_not_followed() {
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

    const GB: u64 = 1_000_000_000;

    #[test]
    fn scarce_is_less_than_a_gigabyte_or_a_twentieth() {
        let space = |free_bytes, total_bytes| DiskSpace {
            free_bytes,
            total_bytes,
        };
        assert!(!space(GB, 10 * GB).is_low());
        assert!(space(GB - 1, 10 * GB).is_low());
        assert!(!space(50 * GB, 1000 * GB).is_low());
        assert!(space(50 * GB - 1, 1000 * GB).is_low());
    }
}
