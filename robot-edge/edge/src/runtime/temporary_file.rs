//! What the octree has no memory for, in a file that goes with this value.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::sync::OnceLock;

use mapping::octree::BlockFile;

/// Made when it is needed, in `TMPDIR`.
#[derive(Debug, Default)]
pub(super) struct TemporaryFile {
    file: OnceLock<io::Result<File>>,
}

impl TemporaryFile {
    /// Whether `access` worked; if not, why is logged.
    fn with(&self, access: impl FnOnce(&File) -> io::Result<()>) -> bool {
        let done = match self.file.get_or_init(tempfile::tempfile) {
            Ok(file) => access(file).map_err(|why| why.to_string()),
            Err(why) => Err(why.to_string()),
        };
        if let Err(why) = &done {
            tracing::warn!(%why, "the file of the octree (TMPDIR, mapping.octree.disk_limit_mb) failed");
        }
        done.is_ok()
    }
}

impl BlockFile for TemporaryFile {
    fn write(&self, bytes: &[u8], offset: u64) -> bool {
        self.with(|file| file.write_all_at(bytes, offset))
    }

    fn read(&self, bytes: &mut [u8], offset: u64) -> bool {
        self.with(|file| file.read_exact_at(bytes, offset))
    }
}
