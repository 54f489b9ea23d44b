//! How much room a disk has, and from when on recordings and logs leave it alone.

use std::fmt;
use std::io;
use std::path::Path;

/// Recording leaves this much free …
const MIN_FREE_BYTES: u64 = 1_000_000_000;
/// … and one part in so many of the disk.
const MIN_FREE_DIVISOR: u64 = 20;

/// Room on a file system, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskSpace {
    /// What an ordinary user may still write.
    pub free_bytes: u64,
    /// All of it.
    pub total_bytes: u64,
}

impl DiskSpace {
    /// Less is free than 1 GB or 5 % ("Recording durability").
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
///
/// # Errors
/// Where the system does not say.
#[cfg(target_os = "linux")]
pub fn disk_space(path: &Path) -> io::Result<DiskSpace> {
    let found = rustix::fs::statvfs(path)?;
    Ok(DiskSpace {
        free_bytes: found.f_bavail.saturating_mul(found.f_frsize),
        total_bytes: found.f_blocks.saturating_mul(found.f_frsize),
    })
}

/// Not asked here: a disk that is full says so when it is written to.
///
/// # Errors
/// Always.
#[cfg(not(target_os = "linux"))]
pub fn disk_space(_path: &Path) -> io::Result<DiskSpace> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;

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
