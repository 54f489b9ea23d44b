//! Says on the disk that an operator records, so that the next run goes on after a crash.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use recording::new_file::sync_folder_of;

/// The file, which is there while an operator records.
#[derive(Debug)]
pub(super) struct Marker(PathBuf);

impl Marker {
    /// Of a robot, in its folder of recordings.
    pub(super) fn of(folder: &Path, robot: &str) -> Self {
        Self(folder.join(format!("{robot}.recording")))
    }

    /// Whether the run before was recording when it ended.
    pub(super) fn is_set(&self) -> bool {
        self.0.exists()
    }

    /// Recording has started, or is over. Where the disk refuses, it goes on as it is: that is worth a warning only.
    pub(super) fn set(&self, is_recording: bool) {
        let written = if is_recording {
            self.write()
        } else {
            match fs::remove_file(&self.0) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return,
                removed => removed,
            }
        };
        if let Err(error) = written {
            let path = self.0.display();
            tracing::warn!(%path, %error, "whether recording goes on after a crash cannot be noted");
        }
        sync_folder_of(&self.0);
    }

    fn write(&self) -> io::Result<()> {
        let mut file = File::create(&self.0)?;
        file.write_all(
            b"robot-edge records here, and starts again by itself if it finds this file.\n",
        )?;
        file.sync_data()
    }
}
